"""Servos: real ones as their makers publish them, with the document that each figure is from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from math import inf, pi
from typing import Any, Final

from foldback.planner.errors import InputError

KGF_CM_NM: Final = 0.0980665
"""Factor that converts a torque from kgf·cm, the unit of servo data sheets, to N·m, by the
definition of the kilogram-force."""
MIN_SERVO_RANGE_DEG: Final = 180.0
"""Minimum range of rotation, in degrees, of a servo that drives a hinge: hinges fold by 90° to
either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """Servo with the figures that its maker publishes.

    Attributes:
        name: Name of the product.
        maker: Name of the maker.
        stall_nm: Torque of a shaft that is held still, at ``volts``.
        no_load_rad_s: Speed of a shaft without load, at ``volts``.
        volts: Voltage of both measurements.
        mass_kg: Mass with housing, without horns and screws.
        size_m: Three sides, shortest first; mostly without mounting lugs.
        range_deg: Range of a shaft that holds an angle; None if not published.
        rated_nm: Torque that the maker allows permanently; None if not published.
        axes: Number of shafts of the housing that turn independently.
        title: Title of the document with the figures.
        url: Address of that document.
        checked: Comparison by which the figures were checked.
    """

    name: str
    maker: str
    stall_nm: float
    no_load_rad_s: float
    volts: float
    mass_kg: float
    size_m: tuple[float, float, float]
    range_deg: float | None
    rated_nm: float | None
    axes: int
    title: str
    url: str
    checked: str

    @property
    def turns_enough(self) -> bool | None:
        """True if its range lets a hinge fold to either side; None if no range is published."""
        return None if self.range_deg is None else self.range_deg >= MIN_SERVO_RANGE_DEG

    def speed_rad_s(self, load_nm: float) -> float:
        """Return its speed under a load, on the straight line from no load to stall."""
        return self.no_load_rad_s * max(1.0 - load_nm / self.stall_nm, 0.0)

    def shortest_time_s(self, turned_rad: float, load_nm: float) -> float:
        """Return the least time for an angle under a load, s; infinite if it stalls."""
        speed = self.speed_rad_s(load_nm)
        return turned_rad / speed if speed > 0.0 else inf


@cache
def servos() -> tuple[Servo, ...]:
    """Return all known servos, the lightest first."""
    text = files("foldback.planner.servos").joinpath("servos.toml").read_text(encoding="utf-8")
    entries = [_servo(entry) for entry in tomllib.loads(text)["servo"]]
    return tuple(sorted(entries, key=lambda servo: (servo.mass_kg, servo.name)))


def servo_named(name: str) -> Servo:
    """Return the servo of this name, regardless of case.

    Raises:
        InputError: ``unknown-servo``.
    """
    by_name = {servo.name.lower(): servo for servo in servos()}
    servo = by_name.get(name.strip().lower())
    if servo is None:
        near = get_close_matches(name.lower(), by_name, n=3, cutoff=0.4) or list(by_name)[:3]
        raise InputError(
            "unknown-servo",
            f"got the servo {name!r}, expected a servo from the list, such as "
            f"{', '.join(by_name[near_name].name for near_name in near)}.",
            where="servo",
        )
    return servo


def _servo(entry: Mapping[str, Any]) -> Servo:
    """Build a servo from its entry in the file, in SI units."""
    torque = _torque(entry, "stall")
    assert torque is not None, entry["name"]
    if "speed_rpm" in entry:
        speed = entry["speed_rpm"] * 2.0 * pi / 60.0
    else:
        speed = pi / 3.0 / entry["speed_s_per_60_deg"]
    a, b, c = sorted(1e-3 * side for side in entry["size_mm"])
    return Servo(
        name=entry["name"],
        maker=entry["maker"],
        stall_nm=torque,
        no_load_rad_s=speed,
        volts=float(entry["volts"]),
        mass_kg=1e-3 * entry["mass_g"],
        size_m=(a, b, c),
        range_deg=entry.get("range_deg"),
        rated_nm=_torque(entry, "rated"),
        axes=entry.get("axes", 1),
        title=entry["title"],
        url=entry["url"],
        checked=entry["checked"],
    )


def _torque(entry: Mapping[str, Any], kind: str) -> float | None:
    """Return a published torque, N·m, whichever its unit; None if there is none."""
    if f"{kind}_nm" in entry:
        return float(entry[f"{kind}_nm"])
    published = entry.get(f"{kind}_kgf_cm")
    return None if published is None else KGF_CM_NM * published
