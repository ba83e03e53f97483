"""Sizing: which servos would do for a torque that is told in weights of a module times the pitch.

The torque comes from whoever worked it out, for cubes of pitch 1 and weight 1 (w·p). How large a
module is and what is in it says what that is in N·m. Assumed of each module: it drives both hinges
of one joint, by two servos or one of two shafts; they lie side by side in its casing, at right
angles to it; wires, joints and electronics have neither room nor mass of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from planner.chain.statics import GRAVITY_M_S2
from planner.errors import InputError
from planner.robot.casings import Casing
from planner.robot.servos import Servo, servos

HINGES: Final = 2
"""Hinges that a cube's servos drive: those of one universal joint."""
SHARE: Final = 1.0 / 3.0
"""Share of the stall torque that a servo gives for long. Feetech rates its servos at 0.30 to 0.33
of it; ROBOTIS says of its AX and XL-320 that robots move stably up to 1/5."""
PITCHES_M: Final = (1e-4, 10.0)
"""Range of pitches that may be asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """How a servo does in modules of one size.

    Attributes:
        servo: The servo.
        servos_kg: Mass of the servos in a module.
        module_kg: Mass of a module with them.
        need_nm: Torque that a hinge needs.
        gives_nm: What the servo gives for long.
        has_room: Whether a module has room for its servos.
    """

    servo: Servo
    servos_kg: float
    module_kg: float
    need_nm: float
    gives_nm: float
    has_room: bool

    @property
    def margin(self) -> float:
        """What it gives over what is needed; infinite where nothing is."""
        return self.gives_nm / self.need_nm if self.need_nm > 0.0 else inf

    @property
    def against(self) -> tuple[str, ...]:
        """Why it would not do, each in a few words; none when it would."""
        why: list[str] = []
        if not self.has_room:
            why.append("too large")
        if self.margin < 1.0:
            why.append("too weak")
        if self.servo.turns_enough is False:
            why.append(f"turns only {self.servo.range_deg:g}°")
        return tuple(why)

    @property
    def would_do(self) -> bool:
        """Whether nothing is against it that is known of it."""
        return not self.against

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values; ``margin`` is None where no torque is needed."""
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
    """The pitches at which a servo has room and is strong enough.

    Attributes:
        least_m: The least at which it has room.
        most_m: The largest at which it is strong enough; infinite where it is at ten metres.
    """

    least_m: float
    most_m: float

    @property
    def empty(self) -> bool:
        """Whether it is too weak wherever it has room."""
        return self.most_m < self.least_m


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestShape:
    """What a servo gives in modules of one size, and which shapes need no more.

    Attributes:
        torque_wp: The largest torque that it gives, in weights of a module times the pitch.
        within: Names of the shapes that need no more, those of least torque first.
        beyond: Names of the others, likewise.
    """

    torque_wp: float
    within: tuple[str, ...]
    beyond: tuple[str, ...]

    @property
    def largest(self) -> str | None:
        """The shape of most torque that it can fold, or None."""
        return self.within[-1] if self.within else None


def who_would_do(
    torque_wp: float,
    *,
    pitch_m: float,
    casing: Casing,
    share: float = SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
    among: Sequence[Servo] | None = None,
) -> tuple[Fit, ...]:
    """All servos: those that would do first, of each kind the lightest first.

    Args:
        torque_wp: Largest torque of a hinge, in weights of a module times the pitch.
        pitch_m: Distance of neighbouring modules.
        casing: What modules are made of.
        share: Share of the stall torque that may be asked of a servo.
        gravity_m_s2: Gravity.
        among: The servos to choose from; None for all that are known.

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


def at_which_pitch(
    servo: Servo,
    torque_wp: float,
    casing: Casing,
    *,
    share: float = SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> PitchRange:
    """The pitches at which a servo would do.

    Its room bounds them from below. The torque that is needed grows with the pitch, with its
    fourth power where modules weigh what their cubes weigh, and bounds them from above.

    Raises:
        InputError: ``bad-sizing``.
    """
    from scipy.optimize import brentq  # late: pages start without it

    _check(torque_wp, share, gravity_m_s2)
    gives = share * servo.stall_nm

    def lacks(pitch_m: float) -> float:
        return torque_wp * _unit_nm(servo, casing, pitch_m, gravity_m_s2) - gives

    longest = PITCHES_M[1]
    most = inf if lacks(longest) <= 0.0 else cast(float, brentq(lacks, 0.0, longest, xtol=1e-12))
    return PitchRange(least_m=least_pitch_m(servo, casing), most_m=most)


def largest_shape(
    servo: Servo,
    figures_wp: Mapping[str, float],
    *,
    pitch_m: float,
    casing: Casing,
    share: float = SHARE,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> LargestShape:
    """The largest torque in w·p that a servo gives, and which shapes need no more.

    Args:
        servo: The servo; whether it has room is not asked.
        figures_wp: The torque in w·p that each shape needs, by the shapes' names.
        pitch_m: Distance of neighbouring modules.
        casing: What modules are made of.
        share: Share of the stall torque that may be asked of the servo.
        gravity_m_s2: Gravity; without any it gives whatever is asked.

    Raises:
        InputError: ``bad-sizing``.
    """
    for torque_wp in (0.0, *figures_wp.values()):
        _check(torque_wp, share, gravity_m_s2, pitch_m)
    unit = _unit_nm(servo, casing, pitch_m, gravity_m_s2)
    most = share * servo.stall_nm / unit if unit > 0.0 else inf
    ordered = sorted(figures_wp, key=lambda name: (figures_wp[name], name))
    return LargestShape(
        torque_wp=most,
        within=tuple(name for name in ordered if figures_wp[name] <= most),
        beyond=tuple(name for name in ordered if figures_wp[name] > most),
    )


def least_pitch_m(servo: Servo, casing: Casing) -> float:
    """The least pitch at which a module's servos have room in its casing.

    Two equal boxes in a cube are always apart along one of its axes; they need the least when that
    is the shortest side of both.
    """
    return max(_count(servo) * servo.size_m[0], servo.size_m[2]) + 2.0 * casing.wall_m


def turned_rad(angles_rad: NDArray[np.float64]) -> float:
    """How far the hinges turn that turn most, step by step.

    Args:
        angles_rad: (F, J) angles of the frames, one after the other.

    Returns:
        The sum over the steps of the largest turn of any hinge: at a bounded speed no motion along
        these frames takes less than this over that speed.
    """
    return float(np.abs(np.diff(angles_rad, axis=0)).max(axis=1, initial=0.0).sum())


def _count(servo: Servo) -> int:
    """How many of them are in a module."""
    return -(-HINGES // servo.axes)


def _module_kg(servo: Servo, casing: Casing, pitch_m: float) -> float:
    return casing.module_kg(pitch_m, _count(servo) * servo.mass_kg)


def _unit_nm(servo: Servo, casing: Casing, pitch_m: float, gravity_m_s2: float) -> float:
    """1 w·p in N·m."""
    return _module_kg(servo, casing, pitch_m) * gravity_m_s2 * pitch_m


def _check(torque_wp: float, share: float, gravity: float, pitch_m: float = 1.0) -> None:
    """Refuses numbers that no motor can be chosen by."""
    for where, value, least, most in (
        ("torque", torque_wp, 0.0, 1e9),
        ("share", share, 1e-6, 1.0),
        ("gravity", gravity, 0.0, 1e3),
        ("pitch", pitch_m, *PITCHES_M),
    ):
        if not least <= value <= most:
            raise InputError(
                "bad-sizing",
                f"got a {where} of {value:g}, expected {least:g} to {most:g}.",
                where=where,
            )
