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

from planner.errors import InputError

KGF_CM_NM: Final = 0.0980665
"""A kilogram-force at a centimetre, in N·m."""
FOLD_DEG: Final = 180.0
"""The range that a hinge needs which folds by 90° to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Servo:
    """A servo, by what its maker publishes of it.

    Attributes:
        name: As its maker calls it.
        maker: Who makes it.
        stall_nm: Torque of a shaft that is held still, at ``volts``.
        no_load_rad_s: Speed of a shaft that nothing holds, at ``volts``.
        volts: At which both were measured.
        mass_kg: With its housing, without horns and screws.
        size_m: Its three sides, shortest first; of most without mounting lugs.
        range_deg: How far a shaft turns while it holds an angle, or None where nobody says.
        rated_nm: What the maker allows for long, or None where nobody says.
        axes: Shafts of the one housing that turn independently.
        title: The document that the figures are from.
        url: Where that is.
        checked: What was compared with what.
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
        """Whether its range lets a hinge fold to either side; None where nobody says the range."""
        return None if self.range_deg is None else self.range_deg >= FOLD_DEG

    def speed_rad_s(self, load_nm: float) -> float:
        """Its speed under a load: along the straight line from no load to stall."""
        return self.no_load_rad_s * max(1.0 - load_nm / self.stall_nm, 0.0)

    def shortest_time_s(self, turned_rad: float, load_nm: float) -> float:
        """The least time in which it turns so far under that load; infinite when it stalls."""
        speed = self.speed_rad_s(load_nm)
        return turned_rad / speed if speed > 0.0 else inf


@cache
def servos() -> tuple[Servo, ...]:
    """All of them, by mass, the lightest first."""
    text = files("planner.robot").joinpath("servos.toml").read_text(encoding="utf-8")
    found = [_servo(entry) for entry in tomllib.loads(text)["servo"]]
    return tuple(sorted(found, key=lambda servo: (servo.mass_kg, servo.name)))


def servo_named(name: str) -> Servo:
    """The one of this name, in capitals or not.

    Raises:
        InputError: ``unknown-servo``.
    """
    by_name = {servo.name.lower(): servo for servo in servos()}
    found = by_name.get(name.strip().lower())
    if found is None:
        near = get_close_matches(name.lower(), by_name, n=3, cutoff=0.4) or list(by_name)[:3]
        raise InputError(
            "unknown-servo",
            f"got the servo {name!r}, expected one of the list, such as "
            f"{', '.join(by_name[each].name for each in near)}.",
            where="servo",
        )
    return found


def _servo(entry: Mapping[str, Any]) -> Servo:
    """A servo of its lines in the file, in SI units."""
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
    """A torque in N·m, in whichever unit it is published; None where it is not."""
    if f"{kind}_nm" in entry:
        return float(entry[f"{kind}_nm"])
    published = entry.get(f"{kind}_kgf_cm")
    return None if published is None else KGF_CM_NM * published
