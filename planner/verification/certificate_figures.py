"""Figures of a certificate: a comparison of those in a plan with those computed again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures import RobotFigures
from foldback.planner.certificate.swept_motions import motions_of_other_robots
from foldback.planner.clearance.exempt_pairs import Place
from foldback.planner.clearance.sweep import clearance_at
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import (
    FIGURES_ATOL,
    FIGURES_RTOL,
    RECOMPUTED_RTOL,
    Differences,
    figure_differences,
    value_differences,
)
from foldback.planner.playback.playback import Playback


@dataclass(frozen=True, slots=True)
class ReportedFigures:
    """Reported figures of a plan's certificate, and the motions that they belong to.

    Attributes:
        plan: The plan.
        record, playback: Motions that were certified.
    """

    plan: Plan
    record: Record | None
    playback: Playback | None

    def differences(self, recomputed: Certificate, notes: list[str]) -> Differences:
        """Yield the differences from a certificate computed again, except wall time."""
        stated, expected = _reported(self.plan.certificate), _reported(recomputed)
        # Margins are proved instead.
        unchecked = {"seconds", "margins", *_ROUNDING_DEPENDENT_FIGURES}
        loose = [*_ROUNDING_DEPENDENT_FIGURES]
        if self.record is None and self.plan.explosion is not None:
            unchecked |= {"min_clearance_record", "max_angle_record_rad"}
            loose = [
                n
                for n in _ROUNDING_DEPENDENT_FIGURES
                if n not in ("in_betweens", "min_clearance_record_at")
            ]
            notes.append(
                "There is no record.npz, so the figures of the explosion were not compared."
            )
        robots = len(stated.get("robots") or [None]) + ("mujoco_robot" in stated)
        if self.playback and 1 + len(motions_of_other_robots(self.playback)) < robots:
            unchecked |= {"exempt_pairs", "max_angle_rad"}
            loose = [n for n in loose if n not in ("in_betweens", "robots", "mujoco_robot")]
            notes.append(
                "Only the figures of the robot with the largest joint error were compared, because "
                "the playbacks of the other simulated robots are missing."
            )
        names = [f.name for f in fields(Certificate) if f.name not in unchecked]
        yield from figure_differences(
            {name: stated.get(name) for name in names},
            {name: expected.get(name) for name in names},
            "plan.npz certificate",
        )
        for name in loose:
            if not self._passes(name, recomputed):
                arrays = {"robots": "others_rad", "mujoco_robot": "mujoco_rad"}
                addition = f" and playback.npz {arrays[name]}" if name in arrays else ""
                yield from value_differences(
                    stated.get(name), expected.get(name), f"plan.npz certificate.{name}{addition}"
                )
        yield from self._end(recomputed)

    def _passes(self, name: str, recomputed: Certificate) -> bool:
        """Return True if a figure that may depend on the processor is as good as the new one."""
        stated, expected = getattr(self.plan.certificate, name), getattr(recomputed, name)
        if stated is None or expected is None:
            return stated is expected
        if name == "in_betweens":
            # rounding may halve a few more intervals
            return abs(stated - expected) <= 16 + 1e-2 * expected
        if name == "clearance_bound":
            certificate = self.plan.certificate
            clearances = [
                c
                for c in (certificate.min_clearance, certificate.min_clearance_playback)
                if c is not None
            ]
            clearances += [robot["min_clearance"] for robot in certificate.robots or ()]
            allowed = expected + RECOMPUTED_RTOL * abs(expected)
            return stated <= min(clearances, default=0.0) and stated <= allowed
        if name == "robots":
            return _same_robots(stated, expected)
        if name == "mujoco_robot":
            exact = [(robot["robot"], robot["max_difference_rad"]) for robot in (stated, expected)]
            return _same_robots((stated,), (expected,)) and np.allclose(
                *exact, rtol=FIGURES_RTOL, atol=FIGURES_ATOL
            )
        return stated == expected or self._as_near(name, stated)

    def _as_near(self, name: str, place: Place) -> bool:
        """Return True if the clearance at a place is the least one reported for its motion."""
        stated = getattr(self.plan.certificate, name.removesuffix("_at"))
        motion = self._motion(name)
        if motion is None or place.modules is None or stated is None:
            return False
        i, j = sorted(place.modules)
        chain = self.plan.chain
        if not (0.0 <= place.frame <= len(motion) - 1 and i >= 0 and j < len(chain)):
            return False
        if j - i < chain.module.apart:
            return False
        size = self.plan.certificate.module_size
        clearance = clearance_at(chain, motion, place.frame, (i, j), module_size=size)
        return abs(clearance - stated) <= 1e-7  # rounding; another place may be equally close

    def _motion(self, name: str) -> Motion | None:
        if name == "min_clearance_at":
            return self.playback and self.playback.reference
        result = self.record if name == "min_clearance_record_at" else self.playback
        return result and result.frames

    def _end(self, recomputed: Certificate) -> Differences:
        """Yield the differences of the end of a simulation from the playback's figures."""
        playback = self.playback
        if playback is None or not playback.simulated or recomputed.rms_position_error is None:
            return
        if playback.status in ("folded", "missed"):  # else it broke off between two frames
            yield from figure_differences(
                playback.rms_position_error,
                recomputed.rms_position_error,
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


def _same_robots(stated: tuple[RobotFigures, ...], recomputed: tuple[RobotFigures, ...]) -> bool:
    """Return True if the figures of robots are equal, except for the halving of intervals."""
    names = ("max_angle_error_rad", "rms_position_error", "min_clearance")
    stated_values, expected_values = (
        [[robot[name] for name in names] for robot in all_] for all_ in (stated, recomputed)
    )
    return (
        np.shape(stated_values) == np.shape(expected_values)
        and np.allclose(stated_values, expected_values, rtol=FIGURES_RTOL, atol=FIGURES_ATOL)
        and all(
            robot["clearance_bound"] <= min(robot["min_clearance"], (1.0 + RECOMPUTED_RTOL) * bound)
            for robot, bound in zip(
                stated, (robot["clearance_bound"] for robot in recomputed), strict=True
            )
        )
    )


_ROUNDING_DEPENDENT_FIGURES: Final = (
    "robots",
    "mujoco_robot",
    "in_betweens",
    "clearance_bound",
    "min_clearance_at",
    "min_clearance_playback_at",
    "min_clearance_record_at",
)
"""Keys of a certificate's figures that verification compares with tolerances, not exactly. Rounding
decides which of several equally close pairs is reported, and which time intervals the proof of
clearance halves, and so their number."""
