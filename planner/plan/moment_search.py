"""Search for the moments of a fold, in its timeline and figures, when its plan is written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path as FilePath
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.certificate.figures_store import Curves, Figures
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.core import module_clearances
from foldback.planner.core.structures import Solid
from foldback.planner.errors import TimelineError
from foldback.planner.motion.inverse_dynamics import inverse_dynamics
from foldback.planner.motion.motion import PHASES
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.plan.moments import (
    CONTACT_LINKS,
    CONTACT_PITCH,
    HeldModule,
    Meeting,
    Moments,
    StepMoment,
)
from foldback.planner.plan.step_text import step_text
from foldback.planner.plan.steps import Steps

DIRECT_STEPS: Final = 100
"""Number of equal steps in which all hinges turn to their folded angles at once, without a plan, to
find the first collision of that motion. With 100 it is reported to whole per cent; larger values
are more exact and slower."""
OVERLAP_PITCH: Final = 1e-6
"""Overlap of two modules, in pitches, up to which they count as touching rather than as colliding
when the first collision of a motion without a plan is searched: rounding."""
SUM_WEIGHT: Final = 1000.0
"""Weight, in pitches, of the equation that makes the weights of the nearest point sum to 1, when
nonnegative least squares compute the distance of two modules. The weights are divided by their sum
afterwards, so that other values change the distance by rounding only."""
CHUNK_POSES: Final = 2**15
"""Number of modules' poses that are computed at once, over all frames."""


def moments_of(
    timeline: Timeline,
    *,
    module_size: float,
    figures: FilePath | None = None,
    forces: FilePath | None = None,
    direct: bool = True,
    steps: Steps | None = None,
) -> Moments | None:
    """Find the moments of a finished fold; None if it was not played back.

    Args:
        timeline: Its timeline.
        module_size: Module size as a fraction of the pitch.
        figures: Path of the timeline's figures; without them, the largest torque is unknown.
        forces: Path of the forces of a fold on a table, whose torques count in place of those.
        direct: True if the collision of direct servoing is searched.
        steps: Steps of its plan; None if it does not rest between steps.
    """
    _, phases = timeline.clock()
    played = np.flatnonzero(phases != PHASES.index("explosion"))
    folding = np.flatnonzero(phases == PHASES.index("playback"))
    if not len(folding):
        return None
    motion = _Folding(timeline, module_size, int(folding[0]), len(timeline))
    knot, determinant = motion.knot()
    collision, percent = motion.direct() if direct else (None, None)
    return Moments(
        plan=int(played[0]),
        straight=motion.first,
        frames=motion.end,
        contact=motion.contact(),
        torque=_torque(timeline, int(played[0]), figures, forces),
        knot=knot,
        determinant=determinant,
        direct=collision,
        direct_percent=percent,
        steps=() if steps is None else _steps(steps, int(played[0])),
    )


def _steps(steps: Steps, first: int) -> tuple[StepMoment, ...]:
    """Return the steps of a plan whose first frame is ``first`` in the timeline."""
    return tuple(
        StepMoment(
            start=first + start,
            end=first + end,
            text=step_text(steps.chain.module, step),
            joints=tuple(turn.module for turn in step.turns),
            moving=step.moving,
            held=_held(step.held[0], poses),
        )
        for step, (start, end), poses in zip(
            steps.steps, pairwise(steps.frames), steps.poses()[1:], strict=True
        )
    )


def _held(module: int, poses: Poses) -> HeldModule:
    x, y, z = np.round(poses.positions[module], 6).tolist()
    qw, qx, qy, qz = np.round(wxyz_from_matrix(poses.rotations[module]), 9).tolist()
    return HeldModule(module=module, position=(x, y, z), wxyz=(qw, qx, qy, qz))


@dataclass(frozen=True, slots=True)
class _Folding:
    """Frames ``first`` to ``end`` of a timeline, in which the straight chain folds."""

    timeline: Timeline
    size: float
    first: int
    end: int

    @property
    def chain(self) -> Chain:
        return self.timeline.chain

    def contact(self) -> Meeting | None:
        """Return the first contact of modules that are not near each other in the chain."""
        max_frames = 2_000_000 // len(self.chain)  # module poses
        for start, poses in self._poses(self.first, min(self.end, self.first + max_frames)):
            clearance, _ = self._clearances(poses, CONTACT_LINKS, CONTACT_PITCH)
            # The gap along a separating axis is at most the distance, so these may have met.
            for row in np.flatnonzero((clearance < CONTACT_PITCH).any(axis=1)):
                near = np.flatnonzero(clearance[row] < CONTACT_PITCH).tolist()
                pairs = [(i, j) for i in near for j in near if j - i >= CONTACT_LINKS]
                distances = [self._distance(poses, int(row), i, j) for i, j in pairs]
                if min(distances, default=CONTACT_PITCH) < CONTACT_PITCH:
                    return Meeting(frame=start + int(row), modules=pairs[int(np.argmin(distances))])
        return None

    def direct(self) -> tuple[Meeting | None, int | None]:
        """Return the first collision when all hinges turn at once, and after what per cent."""
        chain = self.chain
        if len(chain) > 1500:
            return None, None
        step = max(1, CHUNK_POSES // len(chain))
        shares = np.arange(1, DIRECT_STEPS + 1) / DIRECT_STEPS
        for start in range(0, DIRECT_STEPS, step):
            angles = shares[start : start + step, None] * chain.folded_rad
            poses = chain.poses(angles, np.zeros((len(angles), 3)), _upright(len(angles)))
            if hit := self._closest(poses, chain.module.apart, -OVERLAP_PITCH):
                share = shares[start + hit[0]]
                meeting = Meeting(frame=self._folded_by(float(share)), modules=hit[1])
                return meeting, round(100 * share)
        return None, None

    def knot(self) -> tuple[int | None, int | None]:
        """Return a frame at which the chain becomes knotted, and the determinant at the end."""
        if len(self.chain) > 1500:
            return None, None
        low, high = self.first, self.end - 1
        end = knot_of(self._centres(high))
        if end.verdict != "knotted" or knot_of(self._centres(low)).verdict != "unknot":
            return None, None
        while high - low > 1:
            middle = (low + high) // 2
            verdict = knot_of(self._centres(middle)).verdict
            if verdict == "undecided":
                return None, None
            low, high = (low, middle) if verdict == "knotted" else (middle, high)
        return high, end.determinant

    def _centres(self, frame: int) -> Array:
        return self.timeline.frames(frame, frame + 1).poses(self.chain).positions[0]

    def _poses(self, start: int, end: int) -> Iterator[tuple[int, Poses]]:
        """Yield poses with the number of their first frame, some frames at a time."""
        step = max(1, CHUNK_POSES // len(self.chain))
        for at in range(start, end, step):
            yield at, self.timeline.frames(at, min(at + step, end)).poses(self.chain)

    def _closest(
        self, poses: Poses, links: int, below: float
    ) -> tuple[int, tuple[int, int]] | None:
        """Return the first of some configurations with a clearance below, and its closest pair."""
        clearance, nearest = self._clearances(poses, links, max(below, 0.0))
        rows = np.flatnonzero((clearance < below).any(axis=1))
        if not len(rows):
            return None
        row = int(rows[0])
        module = int(clearance[row].argmin())
        nearest_module = int(nearest[row, module])
        return row, (min(module, nearest_module), max(module, nearest_module))

    def _clearances(
        self, poses: Poses, links: int, cutoff: float
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return the (F, n) gap of each module along its best separating axis, and to which."""
        module = self.chain.module
        shape = poses.positions.shape[:2]
        clearance, nearest = np.empty(shape, np.float32), np.empty(shape, np.int32)
        solid = Solid(module.hull, float(self.size), module.inner_radius)
        module_clearances(
            poses.positions, poses.rotations, solid, links, cutoff, clearance, nearest
        )
        return clearance, nearest

    def _distance(self, poses: Poses, row: int, first: int, second: int) -> float:
        """Return the distance of two modules: the least one of two of their parts."""
        one, other = (
            [
                part.placed(poses.positions[row, k], poses.rotations[row, k], size=self.size)
                for part in self.chain.module.piece(k).parts
            ]
            for k in (first, second)
        )
        return min(_distance(p.corners, q.corners) for p in one for q in other)

    def _folded_by(self, share: float) -> int:
        """Return the frame at which the chain is folded by nearly this share of all turns."""
        low, high = self.first, self.end - 1
        while high - low > self.timeline.chunk_frames:  # then all of them take one read
            middle = (low + high) // 2
            if self._foldedness(middle, middle + 1)[0] < share:
                low = middle
            else:
                high = middle
        if high <= low + 1:
            return high
        return low + 1 + int(np.searchsorted(self._foldedness(low + 1, high), share))

    def _foldedness(self, start: int, end: int) -> Array:
        """Return the share of all turns by which the chain is folded at some frames."""
        goal = self.chain.folded_rad
        turned = self.timeline.frames(start, end).joint_angles_rad * np.sign(goal)
        goal_angles = np.abs(goal)
        return np.clip(turned, 0.0, goal_angles).sum(axis=1) / max(goal_angles.sum(), OVERLAP_PITCH)


def _distance(a: Array, b: Array) -> float:
    """Return the distance of two convex bodies: that of the hull of all differences from zero."""
    from scipy.optimize import nnls  # late: pages start without it

    differences = (a[:, None] - b[None]).reshape(-1, 3)
    # Nonnegative weights of the nearest point; the last equation makes their sum 1.
    equations = np.vstack([differences.T, np.full(len(differences), SUM_WEIGHT)])
    weights, _ = nnls(equations, np.array([0.0, 0.0, 0.0, SUM_WEIGHT]))
    return float(np.linalg.norm(differences.T @ weights) / weights.sum())


def _torque(
    timeline: Timeline, plan: int, figures: FilePath | None, forces: FilePath | None
) -> Meeting | None:
    """Return the frame with the largest torque, and the modules that its hinge joins."""
    if forces is not None and forces.exists():
        table_forces = TableForces.load(forces)
        return _at_hinge(timeline.chain, plan, table_forces.torques)
    if figures is None or not figures.exists():
        return None
    try:
        largest = Curves.load(figures, plan).peak_torque_nm
    except TimelineError:
        return None
    if not np.isfinite(largest).any() or np.nanmax(largest) <= 0.0:
        return None
    frame = plan + int(np.nanargmax(largest))
    if not timeline.windowed:
        return _at_hinge(timeline.chain, frame, Figures.load(figures, frame, frame + 1).torque_nm)
    around = max(frame - 8, plan)
    torques = inverse_dynamics(
        timeline.chain, timeline.windows(around, min(frame + 9, len(timeline)))
    )
    rows = np.flatnonzero(torques.frames == frame - around)
    if not len(rows):
        return None
    return Meeting(frame=frame, modules=_joined(timeline.chain, int(torques.hinges[rows[0]])))


def _at_hinge(chain: Chain, start: int, torques: NDArray[np.float32]) -> Meeting | None:
    """Return the frame and hinge of the largest of (F, J) torques; None without any."""
    sizes = np.abs(torques)
    if not sizes.size or not np.isfinite(sizes).any() or np.nanmax(sizes) <= 0.0:
        return None
    row, hinge = np.unravel_index(int(np.nanargmax(sizes)), sizes.shape)
    return Meeting(frame=start + int(row), modules=_joined(chain, int(hinge)))


def _joined(chain: Chain, hinge: int) -> tuple[int, int]:
    """Return the two modules that a hinge joins."""
    return chain.module_before(hinge), chain.module_after(hinge)


def _upright(count: int) -> Array:
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
