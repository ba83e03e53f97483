"""Figures of a certificate: a comparison of those in a plan with those computed again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures import RobotFigures
from foldback.planner.certificate.motion_figures import MotionFigures
from foldback.planner.clearance.exempt_pairs import Place
from foldback.planner.clearance.sweep import clearance_at
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    FIGURES_ATOL,
    FIGURES_RTOL,
    Differences,
    figure_differences,
    value_differences,
)
from foldback.planner.playback.playback import Playback

BOUND_RTOL: Final = 1e-3
"""Maximum amount by which a certificate's clearance bound may exceed the one that verification
computes again, relative to the latter."""


@dataclass(frozen=True, slots=True)
class ReportedFigures:
    """Reported figures of a plan's certificate, and the motions that they belong to.

    Attributes:
        plan: The plan.
        certificate: Plain values of its certificate, as they were written.
        record, playback: Motions that were certified.
    """

    plan: Plan
    certificate: dict[str, Any]
    record: Record | None
    playback: Playback | None

    def differences(self, again: Certificate, notes: list[str]) -> Differences:
        """Yield the differences from a certificate computed again, except wall time."""
        mine, theirs = _reported(self.plan.certificate), _reported(again)
        aside = {"seconds", "margins", *_ROUNDING_DEPENDENT_FIGURES}  # margins are proved instead
        loose = [*_ROUNDING_DEPENDENT_FIGURES]
        if self.record is None and self.plan.explosion is not None:
            aside |= {"min_clearance_record", "max_angle_record_rad"}
            loose = [
                n
                for n in _ROUNDING_DEPENDENT_FIGURES
                if n not in ("in_betweens", "min_clearance_record_at")
            ]
            notes.append(
                "There is no record.npz, so the figures of the explosion were not compared."
            )
        if (mine.get("robots") or [])[1:] and self.playback and self.playback.others_rad is None:
            aside |= {"exempt_pairs", "max_angle_rad"}
            loose = [n for n in loose if n not in ("in_betweens", "robots")]
            notes.append(
                "Only the figures of the robot with the largest joint error were compared, because "
                "the playbacks of the other simulated robots are missing."
            )
        # Certificates of earlier versions lack the figures of the hinges' motion.
        aside |= {f.name for f in fields(MotionFigures)} - set(self.certificate)
        names = [f.name for f in fields(Certificate) if f.name not in aside]
        yield from figure_differences(
            {name: mine.get(name) for name in names},
            {name: theirs.get(name) for name in names},
            "plan.npz certificate",
        )
        for name in loose:
            if not self._passes(name, again):
                where = " and playback.npz others_rad" if name == "robots" else ""
                yield from value_differences(
                    mine.get(name), theirs.get(name), f"plan.npz certificate.{name}{where}"
                )
        yield from self._end(again)

    def _passes(self, name: str, again: Certificate) -> bool:
        """Return True if a figure that may depend on the processor is as good as the new one."""
        mine, theirs = getattr(self.plan.certificate, name), getattr(again, name)
        if mine is None or theirs is None:
            return mine is theirs
        if name == "in_betweens":
            # rounding may halve a few more intervals
            return abs(mine - theirs) <= 16 + 1e-2 * theirs
        if name == "clearance_bound":
            told = self.plan.certificate
            seen = [c for c in (told.min_clearance, told.min_clearance_playback) if c is not None]
            seen += [robot["min_clearance"] for robot in told.robots or ()]
            return mine <= min(seen, default=0.0) and mine <= theirs + BOUND_RTOL * abs(theirs)
        if name == "robots":
            return _same_robots(mine, theirs)
        return mine == theirs or self._as_near(name, mine)

    def _as_near(self, name: str, place: Place) -> bool:
        """Return True if the clearance at a place is the least one reported for its motion."""
        told = getattr(self.plan.certificate, name.removesuffix("_at"))
        motion = self._motion(name)
        if motion is None or place.modules is None or told is None:
            return False
        i, j = sorted(place.modules)
        chain = self.plan.chain
        if not (0.0 <= place.frame <= len(motion) - 1 and i >= 0 and j < len(chain)):
            return False
        if j - i < chain.module.apart:
            return False
        size = self.plan.certificate.module_size
        found = clearance_at(chain, motion, place.frame, (i, j), size=size)
        return abs(found - told) <= 1e-7  # rounding; another place may be equally close

    def _motion(self, name: str) -> Motion | None:
        if name == "min_clearance_at":
            return self.playback and self.playback.reference
        held = self.record if name == "min_clearance_record_at" else self.playback
        return held and held.frames

    def _end(self, again: Certificate) -> Differences:
        """Yield the differences of the end of a simulation from the playback's figures."""
        playback = self.playback
        if playback is None or not playback.simulated or again.rms_position_error is None:
            return
        if playback.status in ("folded", "missed"):  # else it broke off between two frames
            yield from figure_differences(
                playback.rms_position_error,
                again.rms_position_error,
                "plan.npz playback.rms_position_error",
            )


def _reported(certificate: Certificate) -> dict[str, Any]:
    """Return the certificate's values; those of a table without wall time and explanations.

    The explanations (``assumptions``) are texts, which later versions may word differently.
    """
    values: dict[str, Any] = {**certificate.as_dict()}
    if (table := values.get("table")) is not None:
        values["table"] = {
            name: value for name, value in table.items() if name not in ("seconds", "assumptions")
        }
    return values


def _same_robots(mine: tuple[RobotFigures, ...], theirs: tuple[RobotFigures, ...]) -> bool:
    """Return True if the figures of robots are equal, except for the halving of intervals."""
    names = ("max_angle_error_rad", "rms_position_error", "min_clearance")
    told, found = ([[one[name] for name in names] for one in all_] for all_ in (mine, theirs))
    return (
        np.shape(told) == np.shape(found)
        and np.allclose(told, found, rtol=FIGURES_RTOL, atol=FIGURES_ATOL)
        and all(
            one["clearance_bound"] <= min(one["min_clearance"], (1.0 + BOUND_RTOL) * other)
            for one, other in zip(mine, (one["clearance_bound"] for one in theirs), strict=True)
        )
    )


_ROUNDING_DEPENDENT_FIGURES: Final = (
    "robots",
    "in_betweens",
    "clearance_bound",
    "min_clearance_at",
    "min_clearance_playback_at",
    "min_clearance_record_at",
)
"""Keys of a certificate's figures that verification compares with tolerances, not exactly. Rounding
decides which of several equally close pairs is reported, and which time intervals the proof of
clearance halves, and so their number."""
