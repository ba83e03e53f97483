"""Sizing: servos that are suitable for a torque given in weights of a module times the pitch.

The torque is computed elsewhere, for cubes of pitch 1 and weight 1 (w·p). The size and the contents
of a module convert it to N·m. Assumptions on each module: it drives both hinges of one joint, by
two servos or one of two shafts; they lie side by side in its casing, at right angles to it; wires,
joints and electronics need neither room nor mass of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Final, cast

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.errors import InputError
from foldback.planner.servos.module_materials import Casing
from foldback.planner.servos.servos import Servo, servos

HINGES_PER_MODULE: Final = 2
"""Number of hinges of one cube, those of a universal joint; a module needs as many servo axes."""
PERMANENT_TORQUE_SHARE: Final = 1.0 / 3.0
"""Fraction of its stall torque that a servo is assumed to supply permanently. Feetech rates its
servos at 0.30 to 0.33; ROBOTIS states that robots with AX and XL-320 move stably up to 1/5."""
PITCH_RANGE_M: Final = (1e-4, 10.0)
"""Minimum and maximum pitch (distance between neighbouring modules) that is accepted to choose
servos, in m; others are refused as implausible."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Suitability of a servo for modules of one size.

    Attributes:
        servo: The servo.
        servos_kg: Mass of the servos in a module.
        module_kg: Mass of a module with them.
        need_nm: Torque that a hinge needs.
        gives_nm: Torque that the servo supplies permanently.
        has_room: True if a module has room for its servos.
    """

    servo: Servo
    servos_kg: float
    module_kg: float
    need_nm: float
    gives_nm: float
    has_room: bool

    @property
    def margin(self) -> float:
        """Ratio of supplied to needed torque; infinite if none is needed."""
        return self.gives_nm / self.need_nm if self.need_nm > 0.0 else inf

    @property
    def against(self) -> tuple[str, ...]:
        """Reasons why it is unsuitable, each in a few words; empty if it is suitable."""
        mismatches: list[str] = []
        if not self.has_room:
            mismatches.append("too large")
        if self.margin < 1.0:
            mismatches.append("too weak")
        if self.servo.turns_enough is False:
            mismatches.append(f"turns only {self.servo.range_deg:g}°")
        return tuple(mismatches)

    @property
    def would_do(self) -> bool:
        """True if there is no known reason against it."""
        return not self.against

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values; ``margin`` is None if no torque is needed."""
        margin = self.margin
        return {
            "servo": self.servo.name,
            "maker": self.servo.maker,
            "module_kg": self.module_kg,
            "need_nm": self.need_nm,
            "gives_nm": self.gives_nm,
            "margin": margin if isfinite(margin) else None,
            "would_do": self.would_do,
            "against": list(self.against),
            "turns_enough": self.servo.turns_enough,
            "url": self.servo.url,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class PitchRange:
    """Range of pitches at which a servo has room and is strong enough.

    Attributes:
        least_m: Smallest pitch at which it has room.
        most_m: Largest pitch at which it is strong enough; infinite if that exceeds ten metres.
    """

    least_m: float
    most_m: float

    @property
    def empty(self) -> bool:
        """True if it is too weak wherever it has room."""
        return self.most_m < self.least_m


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestShape:
    """Torque of a servo in modules of one size, and the shapes that need no more.

    Attributes:
        torque_wp: Largest torque that it supplies, in weights of a module times the pitch.
        within: Names of the shapes that need no more, those of least torque first.
    """

    torque_wp: float
    within: tuple[str, ...]

    @property
    def largest(self) -> str | None:
        """Shape of largest torque that it can fold, or None."""
        return self.within[-1] if self.within else None


def find_suitable_servos(
    torque_wp: float,
    *,
    pitch_m: float,
    casing: Casing,
    share: float = PERMANENT_TORQUE_SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
    among: Sequence[Servo] | None = None,
) -> tuple[Fit, ...]:
    """Return all servos, suitable ones first, then by mass.

    Args:
        torque_wp: Largest torque of a hinge, in weights of a module times the pitch.
        pitch_m: Distance of neighbouring modules.
        casing: Casing of the modules.
        share: Fraction of the stall torque that a servo may supply.
        gravity_m_s2: Gravity.
        among: Servos to choose from; None for all that are known.

    Raises:
        InputError: ``bad-sizing``.
    """
    _check(torque_wp, share, gravity_m_s2, pitch_m)
    fits = [
        Fit(
            servo=servo,
            servos_kg=_count(servo) * servo.mass_kg,
            module_kg=_module_kg(servo, casing, pitch_m),
            need_nm=torque_wp * _unit_nm(servo, casing, pitch_m, gravity_m_s2),
            gives_nm=share * servo.stall_nm,
            has_room=least_pitch_m(servo, casing) <= pitch_m,
        )
        for servo in (servos() if among is None else among)
    ]
    return tuple(sorted(fits, key=lambda fit: (not fit.would_do, fit.servos_kg)))


def suitable_pitches(
    servo: Servo,
    torque_wp: float,
    casing: Casing,
    *,
    share: float = PERMANENT_TORQUE_SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> PitchRange:
    """Return the pitches at which a servo is suitable.

    Its size bounds them from below. The torque that is needed grows with the pitch, with its
    fourth power where modules weigh as much as their cubes, and bounds them from above.

    Raises:
        InputError: ``bad-sizing``.
    """
    from scipy.optimize import brentq  # late: pages start without it

    _check(torque_wp, share, gravity_m_s2)
    gives = share * servo.stall_nm

    def lacks(pitch_m: float) -> float:
        return torque_wp * _unit_nm(servo, casing, pitch_m, gravity_m_s2) - gives

    longest = PITCH_RANGE_M[1]
    max_pitch_m = (
        inf if lacks(longest) <= 0.0 else cast(float, brentq(lacks, 0.0, longest, xtol=1e-12))
    )
    return PitchRange(least_m=least_pitch_m(servo, casing), most_m=max_pitch_m)


def largest_shape(
    servo: Servo,
    figures_wp: Mapping[str, float],
    *,
    pitch_m: float,
    casing: Casing,
    share: float = PERMANENT_TORQUE_SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> LargestShape:
    """Return the largest torque, w·p, that a servo supplies, and the shapes that need no more.

    Args:
        servo: The servo; its size is not checked.
        figures_wp: Torque that each shape needs, w·p, by name of the shape.
        pitch_m: Distance of neighbouring modules.
        casing: Casing of the modules.
        share: Fraction of the stall torque that the servo may supply.
        gravity_m_s2: Gravity; without any, every torque in w·p is possible.

    Raises:
        InputError: ``bad-sizing``.
    """
    for torque_wp in (0.0, *figures_wp.values()):
        _check(torque_wp, share, gravity_m_s2, pitch_m)
    unit = _unit_nm(servo, casing, pitch_m, gravity_m_s2)
    max_torque = share * servo.stall_nm / unit if unit > 0.0 else inf
    ordered = sorted(figures_wp, key=lambda name: (figures_wp[name], name))
    return LargestShape(
        torque_wp=max_torque,
        within=tuple(name for name in ordered if figures_wp[name] <= max_torque),
    )


def least_pitch_m(servo: Servo, casing: Casing) -> float:
    """Return the smallest pitch, m, at which a module's servos have room in its casing.

    Two equal boxes in a cube are always apart along one of its axes; they need the least room if
    that is the shortest side of both.
    """
    return max(_count(servo) * servo.size_m[0], servo.size_m[2]) + 2.0 * casing.wall_m


def total_turn_rad(angles_rad: Array) -> float:
    """Return the sum over all steps of the largest turn of a hinge, rad.

    Args:
        angles_rad: (F, J) angles of the frames, one after the other.

    Returns:
        The sum: at a bounded speed no motion along these frames takes less than it over the speed.
    """
    return float(np.abs(np.diff(angles_rad, axis=0)).max(axis=1, initial=0.0).sum())


def _count(servo: Servo) -> int:
    """Return the number of servos in a module."""
    return -(-HINGES_PER_MODULE // servo.axes)


def _module_kg(servo: Servo, casing: Casing, pitch_m: float) -> float:
    return casing.module_kg(pitch_m, _count(servo) * servo.mass_kg)


def _unit_nm(servo: Servo, casing: Casing, pitch_m: float, gravity_m_s2: float) -> float:
    """Return 1 w·p in N·m."""
    return _module_kg(servo, casing, pitch_m) * gravity_m_s2 * pitch_m


def _check(torque_wp: float, share: float, gravity: float, pitch_m: float = 1.0) -> None:
    """Check that all numbers are in their ranges."""
    for field, unit, value, min_value, max_value in (
        ("torque", "w·p (module weight × pitch)", torque_wp, 0.0, 1e9),
        ("share", "of the stall torque", share, 1e-6, 1.0),
        ("gravity", "m/s²", gravity, 0.0, 1e3),
        ("pitch", "m", pitch_m, *PITCH_RANGE_M),
    ):
        if not min_value <= value <= max_value:
            raise InputError(
                "bad-sizing",
                f"got a {field} of {value:g} {unit}, expected {min_value:g} to {max_value:g}.",
                where=field,
            )
