"""Sweep: the proved clearance of a whole motion, at its frames and everywhere between them.

The proof is that of docs/decisions/0012-sweep-bound.md; ``planner/core/sweep.cpp`` computes
it. Some pairs are not checked:

* Pairs fewer links apart than ``Module.apart``: they share a joint
  (``planner.clearance.exempt_pairs``).
* Pairs that stay farther apart than the least clearance of the frame before, because they change
  no figure: lemma 7.
* In a windowed motion, pairs of modules that are rigid with each other from one frame to the next.
  Below both windows all modules are folded, above both all are straight. The folded shape and the
  straight chain are checked once, with all their pairs; a frame has the clearance of its own part
  of either.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import orthonormalised
from foldback.planner.core import (
    BODY_COLUMNS,
    ROTATION,
    ROUNDING_MARGIN,
    VELOCITY,
    closest_frame,
    least_separation,
    near_pairs,
    rigid_clearances,
    sweep_frames,
)
from foldback.planner.core.structures import Angles, Shape, SweepResult, Tolerance
from foldback.planner.motion.motion import Motion, as_motion
from foldback.planner.progress import Cancelled, never

CLEARANCE_CAP: Final = 0.2
"""Distance of two modules, in pitches, from which on a collision check does not compute it exactly,
as it only looks for the smallest distance in the motion. If no modules come nearer, the check is
repeated with a cap of 3 pitches."""
EXTENDED_CLEARANCE_CAP: Final = 3.0
"""Cap in pitches up to which the distances of modules are computed exactly for motions, mostly of
short chains, whose modules all keep farther apart than the usual cap of 0.2 pitches."""
BOUND_RATIO: Final = 0.9
"""Fraction, from 0 to 1, of the smallest clearance seen in a motion that its proved lower bound
should reach. Larger values tighten the bound and need more bisections between frames: table in
decision 0012."""

EXACT: Final = Tolerance(0.0, 0.0, 0.0, 0.0)
"""Tolerance of a motion whose hinges follow the plan without errors, in radians."""
ALLOWANCE_CAP: Final = 1e-3
"""Distance of two modules, in pitches, above which a proof that a motion tolerates errors of hinges
does not compute it exactly: the proof only needs a distance above 0 after these errors are
subtracted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClosestMoment:
    """The closest place of a motion.

    Attributes:
        clearance: Least clearance seen, in pitches; 0 where modules touch and overlap by no more
            than the rounding error.
        frame: Frame number of it; a fraction means between two frames.
        modules: The two modules; None if no pair is below the cap.
    """

    clearance: float
    frame: float
    modules: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep(ClosestMoment):
    """The closest place of a motion at frames and in-betweens, and what is proved of all of it.

    Attributes:
        bound: Lower bound of the clearance over the whole motion, in pitches; 0 or less if it could
            not be proved.
        unbounded: Frame number around which the bisection ended without a proof; None if it never
            did.
        in_betweens: Number of configurations that were checked between frames.
        per_frame: (F,) clearance at each frame in pitches, at most the cap.
    """

    bound: float
    unbounded: float | None
    in_betweens: int
    per_frame: Array


def sweep(
    chain: Chain,
    motion: Motion | Array,
    *,
    module_size: float,
    share: float = BOUND_RATIO,
    cancelled: Cancelled = never,
) -> Sweep:
    """Compute the clearance of a motion through all its frames, with a proved lower bound.

    Args:
        chain: The chain.
        motion: The motion, or the (F, J) hinge angles of one, rad.
        module_size: Module size as a fraction of the pitch.
        share: Fraction (0…1) of the least clearance seen that the bound should reach. With 0 any
            bound above 0 does, which saves bisections.
        cancelled: Polled between tasks; a cancelled sweep covers the tasks that were done.

    Raises:
        InputError: ``bad-windows`` for a windowed motion that is not of this chain.
    """
    motion = as_motion(motion)
    exact = _Query(size=module_size, share=share, enough=CLEARANCE_CAP, tolerance=EXACT)
    swept = _swept(chain, motion, exact, cancelled)
    if swept.modules is None and not cancelled():
        # A short chain may never come that near itself: then its clearance is above the cap.
        swept = _swept(chain, motion, replace(exact, enough=EXTENDED_CLEARANCE_CAP), cancelled)
    return swept


def closest_at_frames(
    chain: Chain, motion: Motion, *, module_size: float, cancelled: Cancelled = never
) -> ClosestMoment:
    """Return the least clearance at the frames of a motion of which nothing is to be proved.

    Args:
        chain: The chain.
        motion: The motion.
        module_size: Module size as a fraction of the pitch.
        cancelled: Polled between tasks; then the result covers the tasks that were done.

    Raises:
        InputError: ``bad-windows`` for a windowed motion that is not of this chain.
    """
    query = _Query(
        size=module_size,
        share=0.0,
        enough=CLEARANCE_CAP,
        tolerance=EXACT,
        frames_only=True,
    )
    closest = _swept(chain, motion, query, cancelled)
    if closest.modules is None and not cancelled():
        closest = _swept(chain, motion, replace(query, enough=EXTENDED_CLEARANCE_CAP), cancelled)
    return ClosestMoment(clearance=closest.clearance, frame=closest.frame, modules=closest.modules)


def frame_clearances(chain: Chain, angles: Array, *, module_size: float) -> Array:
    """Return the (F,) clearances of configurations, in pitches, at most ``CLEARANCE_CAP``.

    Args:
        chain: The chain.
        angles: (F, J) hinge angles, rad.
        module_size: Module size as a fraction of the pitch.
    """
    query = _Query(
        size=module_size,
        share=0.0,
        enough=CLEARANCE_CAP,
        tolerance=EXACT,
        frames_per_task=1,  # of a task, only the closest frame is known
        frames_only=True,
    )
    return _swept(chain, as_motion(angles), query, never).per_frame


def disturbed_sweep(
    chain: Chain,
    motion: Motion,
    tolerance: Tolerance,
    *,
    module_size: float,
    cancelled: Cancelled = never,
) -> Sweep:
    """Compute what errors of hinges leave of the clearance, up to ``ALLOWANCE_CAP``.

    All clearances of the result are less the allowance of lemmas 11 and 12. A windowed motion's
    pairs that are rigid with each other are not checked: see ``rest_motions``.

    Args:
        chain: The chain.
        motion: The motion.
        tolerance: The errors.
        module_size: Module size as a fraction of the pitch.
        cancelled: Polled between tasks; a cancelled sweep covers the tasks that were done.
    """
    query = _Query(
        size=module_size,
        share=0.0,
        enough=ALLOWANCE_CAP,
        tolerance=tolerance,
        frames_per_task=8,  # few, so that threads share the end, at which most trials fail
    )
    return _swept(chain, motion, query, cancelled)


def rest_motions(chain: Chain) -> tuple[Motion, Motion]:
    """Return the folded and the straight chain, each as a motion of one frame."""
    return as_motion(chain.folded_rad[None]), as_motion(np.zeros_like(chain.folded_rad)[None])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Query:
    """Parameters of a sweep.

    Attributes:
        size: Module size as a fraction of the pitch.
        share: Fraction (0…1) of the least clearance seen that the bound should reach.
        enough: Cutoff in pitches: clearances of this and more are not told apart.
        tolerance: Errors of hinges whose effect is taken off.
        frames_per_task: Number of frames that a thread takes at a time.
        frames_only: Look at the frames alone; then there is no bound.
    """

    size: float
    share: float
    enough: float
    tolerance: Tolerance
    frames_per_task: int = 64
    frames_only: bool = False


def _swept(chain: Chain, motion: Motion, query: _Query, cancelled: Cancelled) -> Sweep:
    frames, at_rest, enough, size = len(motion), None, query.enough, query.size
    if motion.is_windowed:
        motion.check(chain)
    if motion.is_windowed and len(chain.module.pattern) > 1:
        # The straight tail of a window would depend on the module that it begins at.
        motion = as_motion(motion.angles(chain))
    if motion.is_windowed:
        at_rest = _AtRest.of(chain, size, enough) if query.tolerance is EXACT else None
    first = np.ascontiguousarray(motion.first, dtype=np.int64)
    offsets = np.ascontiguousarray(motion.offsets, dtype=np.int64)
    rigid, closest = (
        (np.full(frames, enough), np.full((frames, 2), -1))
        if at_rest is None
        else at_rest.frames(chain, first, np.diff(offsets))
    )
    ends = (chain.folded_poses, _straight(chain)) if motion.is_windowed else None
    shape = _shape(chain, size, ends, query.tolerance)
    per_frame = np.full(frames, enough)

    def part(start: int) -> SweepResult:
        stop = min(start + query.frames_per_task, frames)
        begins, ends = int(offsets[start]), int(offsets[min(stop + 1, frames)])
        values = np.ascontiguousarray(motion.angles_rad[begins:ends], dtype=np.float64)
        angles = Angles(first=first, offsets=offsets, shift=begins, values=values)
        if query.frames_only:
            return closest_frame(shape, angles, start, stop, enough, rigid, per_frame)
        return sweep_frames(shape, angles, start, stop, enough, rigid, per_frame, query.share)

    best, bound, unbounded, in_betweens = enough, enough, -1.0, 0
    best_frame, modules = 0.0, (-1, -1)
    for chunk in _in_turn(part, range(0, frames, query.frames_per_task), cancelled):
        bound = min(bound, chunk.lower_bound)
        in_betweens += chunk.midpoints
        if unbounded < 0.0:
            unbounded = chunk.unproved_at
        if chunk.clearance < best:
            best, best_frame, modules = chunk.clearance, chunk.frame, (chunk.first, chunk.second)
    if best < enough and modules[0] < 0:
        # Nothing that moves is closer than what is at rest.
        modules = tuple(closest[int(best_frame)].tolist())
    best = 0.0 if _is_contact(best) else best
    per_frame[_is_contact(per_frame)] = 0.0
    return Sweep(
        clearance=float(best),
        frame=float(best_frame),
        modules=None if modules[0] < 0 else (int(modules[0]), int(modules[1])),
        bound=float(min(0.0 if _is_contact(bound) else bound, best)),
        unbounded=None if unbounded < 0.0 else float(unbounded),
        in_betweens=in_betweens,
        per_frame=per_frame,
    )


def _is_contact(clearance: Array | float) -> Flags | bool:
    """Return True where an overlap, in pitches, is no larger than the rounding error."""
    return (clearance < 0.0) & (clearance >= -ROUNDING_MARGIN)


class Between:
    """Clearance on the way from one configuration of a chain to another, for many queries.

    Args:
        chain: The chain.
        module_size: Module size as a fraction of the pitch.
    """

    def __init__(self, chain: Chain, module_size: float) -> None:
        self._shape = _shape(chain, module_size, None, EXACT)

    def clearance(self, start: Array, end: Array, enough: float) -> float:
        """Return the least clearance from ``start`` (J,) on, before ``end``, in pitches.

        At most ``enough``; 0 if nothing could be proved.
        """
        hinges = len(start)
        angles = Angles(
            first=np.zeros(2, np.int64),
            offsets=np.array([0, hinges, 2 * hinges]),
            shift=0,
            values=np.concatenate([start, end]),
        )
        rigid, per_frame = np.full(2, enough), np.full(2, enough)
        swept = sweep_frames(self._shape, angles, 0, 1, enough, rigid, per_frame, 0.0)
        return 0.0 if swept.unproved_at >= 0.0 else float(swept.clearance)


def between_frames(chain: Chain, motion: Motion, frame: float) -> Array:
    """Return the (J,) hinge angles of one moment, rad; a fraction means between two frames."""
    before = int(frame)
    after = min(before + 1, len(motion) - 1)
    start, end = (motion.angles_at(chain, k) for k in (before, after))
    return start + (frame - before) * (end - start)


def clearance_at(
    chain: Chain, motion: Motion, frame: float, modules: tuple[int, int], *, module_size: float
) -> float:
    """Return the clearance of two modules at one moment of a motion, in pitches.

    Args:
        chain: The chain.
        motion: The motion.
        frame: Frame number; a fraction means between two frames.
        modules: The two, the earlier one first.
        module_size: Module size as a fraction of the pitch.
    """
    poses = forward_kinematics(chain.module, between_frames(chain, motion, frame))
    return pair_clearance(chain.module, poses, modules, module_size=module_size)


def pair_clearance(
    module: Module, poses: Poses, modules: tuple[int, int], *, module_size: float
) -> float:
    """Return the clearance of two modules of a configuration, in pitches."""
    separation, _, _ = least_separation(
        np.ascontiguousarray(poses.positions),
        np.ascontiguousarray(poses.rotations),
        np.array([modules], dtype=np.int64),
        module.hull,
        module_size,
        EXTENDED_CLEARANCE_CAP,
    )
    return float(separation)


def _in_turn(
    part: Callable[[int], SweepResult], starts: range, cancelled: Cancelled
) -> Iterator[SweepResult]:
    """Yield the results of all tasks in their order, computed in threads, until cancelled."""
    if len(starts) == 1:  # a short motion is done sooner than a thread begins
        if not cancelled():
            yield part(starts[0])
        return
    threads = min(4, len(starts), os.cpu_count() or 1)
    waiting: deque[Future[SweepResult]] = deque()
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for start in starts:
            if cancelled():
                break
            if len(waiting) > 2 * threads:
                yield waiting.popleft().result()
            waiting.append(pool.submit(part, start))
        for task in waiting:
            yield task.result()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _AtRest:
    """Clearances of the folded shape and of the straight chain, for modules 0 … j of either."""

    folded: tuple[Array, Ints]
    straight: tuple[Array, Ints]

    @classmethod
    def of(cls, chain: Chain, module_size: float, enough: float) -> _AtRest:
        module = chain.module

        def clearances(poses: Poses) -> tuple[Array, Ints]:
            pairs = near_pairs(
                poses.positions, 2.0 * module.radius * module_size + enough, module.apart
            )
            return rigid_clearances(
                poses.positions, poses.rotations, pairs, module.hull, module_size, enough
            )

        return cls(folded=clearances(chain.folded_poses), straight=clearances(_straight(chain)))

    def frames(self, chain: Chain, first: Ints, widths: Ints) -> tuple[Array, Ints]:
        """Return (F,) clearance of the core and the tail of each frame, and (F, 2) the modules."""
        hinges = chain.module.hinges_per_joint
        core = chain.module_before(first)
        last = np.maximum(first + widths, np.where(first % hinges, first + 1, 0))
        tail = np.where(last > first, chain.module_after(last - 1), core)
        below, above = self.folded[0][core], self.straight[0][len(chain) - 1 - tail]
        pairs = self.straight[1][len(chain) - 1 - tail]
        pairs = np.where(pairs >= 0, pairs + tail[:, None], -1)
        pairs = np.where((below <= above)[:, None], self.folded[1][core], pairs)
        return np.minimum(below, above), pairs


def windows_shape(chain: Chain, module_size: float) -> Shape:
    """Return the shape of a chain whose motion is windows, for ``planner/core/sweep.cpp``."""
    return _shape(chain, module_size, (chain.folded_poses, _straight(chain)), EXACT)


def _straight(chain: Chain) -> Poses:
    return forward_kinematics(chain.module, np.zeros_like(chain.folded_rad))


def _shape(
    chain: Chain, module_size: float, at_rest: tuple[Poses, Poses] | None, tolerance: Tolerance
) -> Shape:
    """Return a shape; with a core and a tail if the folded and the straight chain are given."""
    module, n = chain.module, len(chain)
    core = np.zeros((n, BODY_COLUMNS))
    core[:, ROTATION:VELOCITY] = np.eye(3).ravel()
    if at_rest is not None:
        core[:, :ROTATION] = at_rest[0].positions
        core[:, ROTATION:VELOCITY] = orthonormalised(at_rest[0].rotations).reshape(n, 9)
    centres = core[:, :ROTATION]
    low, high = centres.min(axis=0), centres.max(axis=0)
    # About as many cells as modules, even where a shape is thin and far apart.
    width = max(1.0, float(np.prod(high - low + 1.0) / (8.0 * n)) ** (1.0 / 3.0))
    origin = low - 0.5 * width
    index = np.floor((centres - origin) / width).astype(np.int64)
    cells = index.max(axis=0) + 1
    flat = (index[:, 0] * cells[1] + index[:, 1]) * cells[2] + index[:, 2]
    counts = np.bincount(flat, minlength=int(np.prod(cells)))
    return Shape(
        joint=module.joint,
        hull=module.hull,
        size=float(module_size),
        min_checked_gap=module.apart,
        root=chain.root if at_rest is None else -1,
        folded_rad=chain.folded_rad.copy(),
        core=core,
        boxes=np.hstack(
            [np.minimum.accumulate(centres, axis=0), np.maximum.accumulate(centres, axis=0)]
        ),
        origin=origin,
        width=width,
        cells=cells,
        starts=np.concatenate([[0], np.cumsum(counts)]),
        members=np.argsort(flat, kind="stable"),
        tail_positions=np.zeros((0, 3)) if at_rest is None else at_rest[1].positions,
        tail_rotations=np.zeros((0, 3, 3)) if at_rest is None else at_rest[1].rotations,
        tolerance=tolerance,
    )
