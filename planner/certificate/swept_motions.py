"""Sweeps of a fold's motions, and which motions have to be clear."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.exempt_pairs import Place
from foldback.planner.clearance.rounding_errors import clearance_rounding
from foldback.planner.clearance.sweep import ClosestMoment, Sweep, closest_at_frames, sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.playback.playback import Playback
from foldback.planner.progress import Cancelled, Progress, Report


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweeps:
    """Sweeps of a fold's motions; None of a motion that is not there, or not swept to its end.

    The order of ``other_robots`` is that of ``motions_of_other_robots``. Nothing is proved of the
    record.
    """

    record: ClosestMoment | None = None
    plan: Sweep | None = None
    playback: Sweep | None = None
    other_robots: tuple[Sweep, ...] = ()

    @property
    def of_robots(self) -> tuple[Sweep | None, ...]:
        """Sweeps of the simulated playbacks: the one that is shown, and those of other robots."""
        return (self.playback, *self.other_robots)

    def figures(self) -> dict[str, Any]:
        """Return the figures of a certificate that come from sweeps alone."""
        record, plan, playback = self.record, self.plan, self.playback
        sweeps = [swept for swept in (plan, *self.of_robots) if swept is not None]
        return {
            "min_clearance": plan and plan.clearance,
            "min_clearance_at": _place(plan),
            "clearance_bound": min((swept.bound for swept in sweeps), default=None),
            "min_clearance_playback": playback and playback.clearance,
            "min_clearance_playback_at": _place(playback),
            "min_clearance_record": record and record.clearance,
            "min_clearance_record_at": _place(record),
            "in_betweens": sum(swept.in_betweens for swept in sweeps),
        }


@dataclass(slots=True, kw_only=True)
class Sweeper:
    """Sweeps the motions of a fold, until it is cancelled."""

    chain: Chain
    size: float
    progress: Report
    cancelled: Cancelled
    is_cancelled: bool = False

    def sweep_all(self, record: Record | None, playback: Playback | None) -> Sweeps:
        """Return the sweeps of all motions; none at all if it was cancelled."""
        of_record: ClosestMoment | None = None
        of_plan = of_playback = None
        of_others: tuple[Sweep, ...] = ()
        if playback is not None:
            of_plan = self._sweep(playback.reference, "plan", 0.35)
            if playback.simulated:
                of_playback = self._sweep(playback.frames, "playback", 0.7)
                of_others = tuple(
                    self._sweep(angles, "playback of another simulated robot", 0.8)
                    for angles in motions_of_other_robots(playback)
                )
        if record is not None:
            frames = None if playback is None else playback.frames
            if frames is not None and frames.is_windowed and record.frames.passes_as(frames[::-1]):
                of_record = of_plan  # the same places, and the same ways between them
            else:
                self._report("recorded explosion", 0.0)
                of_record = closest_at_frames(
                    self.chain, record.frames, module_size=self.size, cancelled=self._stops
                )
        if self._stops():
            # What was not looked at to its end proves nothing; nobody knows what is least in it.
            return Sweeps()
        return Sweeps(record=of_record, plan=of_plan, playback=of_playback, other_robots=of_others)

    def _sweep(self, motion: Motion, name: str, fraction: float) -> Sweep:
        self._report(name, fraction)
        swept = sweep(self.chain, motion, module_size=self.size, cancelled=self._stops)
        if swept.bound <= 0.0:
            return swept
        rounding = clearance_rounding(self.chain, motion, self.size)
        return replace(swept, bound=swept.bound - rounding)

    def _report(self, name: str, fraction: float) -> None:
        message = f"checking the {name}"
        self.progress(Progress(stage="certify", fraction=fraction, message=message))

    def _stops(self) -> bool:
        self.is_cancelled = self.is_cancelled or self.cancelled()
        return self.is_cancelled


def followed(playback: Playback) -> tuple[Motion, ...]:
    """Return the motions that have to be clear: the plan, and the simulated playbacks."""
    plan = playback.reference
    if not playback.simulated:
        return (plan,)
    return (plan, playback.frames, *motions_of_other_robots(playback))


def motions_of_other_robots(playback: Playback) -> tuple[Motion, ...]:
    """Return the motion of each robot whose playback is not the one that is shown.

    That of a robot in MuJoCo is the last one.
    """
    other_angles = [] if playback.others_rad is None else list(playback.others_rad)
    if playback.mujoco_rad is not None:
        other_angles.append(playback.mujoco_rad)
    return tuple(playback.frames.with_angles(angles) for angles in other_angles)


def _place(swept: ClosestMoment | None) -> Place | None:
    return None if swept is None else Place(frame=swept.frame, modules=swept.modules)
