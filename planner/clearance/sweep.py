"""Sweep: the clearance of a whole motion, at its frames and everywhere between them.

Between two frames the hinge angles run evenly. Each interval is looked at in its middle; a pair of
modules passes when its clearance there is more than it can lose on the way to either end. What it
can lose is bounded by Taylor from the middle: exact velocity and acceleration of the pair against
each other, and a bound of their change (``planner.kernels.bodies``, ``planner.kernels.approach``).
Intervals with pairs that don't pass are halved.

What is never looked at, and why that is safe:

* Pairs fewer links apart than ``Module.apart``: the joint's nature.
* Pairs whose balls stay farther apart than the least clearance of the frame before: their
  clearance is more than that, so they change no figure. How far they go is bounded by the way of
  both, and by the turns of the hinges between them.
* Of ``Windows``, pairs of modules that are rigid with each other from one frame to the next:
  below both windows all are folded, above both all are straight. The folded shape is looked at
  once with all its pairs, and so is a straight rod; a frame has the clearance of its own part of
  either.
* Of a rod, modules that can't come near the box around everything else. Along the rod the distance
  to that box and the way a module goes change by at most a known amount a link, so that most of
  the rod is passed over in leaps. A rod that swings too far for that has its interval halved first.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import Poses, forward_kinematics
from planner.errors import InputError
from planner.kernels.bodies import ROTATION, VELOCITY, WIDTH
from planner.kernels.clearance import least_separation
from planner.kernels.pairs import near_pairs
from planner.kernels.sweep import Angles, Found, Shape, rigid_clearances, sweep_frames
from planner.motion.windows import Windows
from planner.progress import Cancelled, never

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
CHUNK: Final = 64
"""Frames that one task of a thread sweeps."""
MOST_THREADS: Final = 4
ENOUGH: Final = 0.2
"""Pitches up to which the least clearance is looked for."""
FAR: Final = 3.0
"""Pitches up to which it is looked for where no pair is nearer than ``ENOUGH``."""
SHARE: Final = 0.9
"""Share of the least clearance seen that is to be proved, where a few halvings more can do so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The closest place of a motion.

    Attributes:
        clearance: Least clearance found at frames and in-betweens, in pitches.
        frame: Where, as a frame number; a half means between two.
        modules: The two modules, None when everything is far apart.
        bound: What the clearance is nowhere less than; 0 where halving ended without an answer.
        unbounded: A moment around which it did, as a frame number; None where it never did.
        in_betweens: Configurations looked at between frames.
        per_frame: (F,) clearance at each frame, capped at ``ENOUGH``.
    """

    clearance: float
    frame: float
    modules: tuple[int, int] | None
    bound: float
    unbounded: float | None
    in_betweens: int
    per_frame: Array


def sweep(
    chain: Chain,
    motion: Array | Windows,
    *,
    size: float,
    share: float = SHARE,
    cancelled: Cancelled = never,
) -> Sweep:
    """The clearance of a motion through all its frames.

    Args:
        chain: The chain.
        motion: (F, J) hinge angles of the frames, or windows.
        size: Module size as a fraction of the pitch.
        share: Which part of the least clearance seen the bound should reach; 0 where it is enough
            that it is above 0, for halvings cost time.
        cancelled: Asked now and then; a cancelled sweep covers what was looked at so far.

    Raises:
        InputError: ``bad-windows`` for windows that are not of this chain.
    """
    found = _swept(chain, motion, size, share, ENOUGH, cancelled)
    if found.modules is None and not cancelled():
        # A short chain may never come that close to itself: then how far it stays off.
        found = _swept(chain, motion, size, share, FAR, cancelled)
    return found


def _swept(
    chain: Chain,
    motion: Array | Windows,
    size: float,
    share: float,
    enough: float,
    cancelled: Cancelled,
) -> Sweep:
    frames = len(motion)
    first, offsets = _extents(chain, motion)
    at_rest = _AtRest.of(chain, size, enough) if isinstance(motion, Windows) else None
    known, who = (
        (np.full(frames, enough), np.full((frames, 2), -1))
        if at_rest is None
        else at_rest.frames(chain, first, np.diff(offsets))
    )
    shape = _shape(chain, size, None) if at_rest is None else windows_shape(chain, size)
    per_frame = np.full(frames, enough)

    def part(start: int) -> Found:
        stop = min(start + CHUNK, frames)
        begins, ends = int(offsets[start]), int(offsets[min(stop + 1, frames)])
        if isinstance(motion, Windows):
            values = motion.angles_rad[begins:ends].astype(np.float64)
        else:
            # A copy: a read-only array would be another type, for which all is compiled anew.
            values = np.array(motion[start : stop + 1], dtype=np.float64).reshape(-1)
        angles = Angles(first=first, offsets=offsets, shift=begins, values=values)
        return sweep_frames(shape, angles, start, stop, enough, known, per_frame, share)

    best, bound, unbounded, in_betweens = enough, enough, -1.0, 0
    where, modules = 0.0, (-1, -1)
    for found in _in_turn(part, range(0, frames, CHUNK), cancelled):
        bound = min(bound, found.bound)
        in_betweens += found.in_betweens
        if unbounded < 0.0:
            unbounded = found.unbounded
        if found.clearance < best:
            best, where, modules = found.clearance, found.where, (found.first, found.second)
    if best < enough and modules[0] < 0:
        # Nothing that moves is closer than what is at rest.
        modules = tuple(who[int(where)].tolist())
    return Sweep(
        clearance=float(best),
        frame=float(where),
        modules=None if modules[0] < 0 else (int(modules[0]), int(modules[1])),
        bound=float(min(bound, best)),
        unbounded=None if unbounded < 0.0 else float(unbounded),
        in_betweens=in_betweens,
        per_frame=per_frame,
    )


class Between:
    """The least clearance on the way from one configuration of a chain to another, asked often.

    Args:
        chain: The chain.
        size: Module size as a fraction of the pitch.
    """

    def __init__(self, chain: Chain, size: float) -> None:
        self._shape = _shape(chain, size, None)

    def clearance(self, start: Array, end: Array, enough: float) -> float:
        """The least seen from ``start`` on, before ``end``; of ``enough`` and more only that."""
        hinges = len(start)
        angles = Angles(
            first=np.zeros(2, np.int64),
            offsets=np.array([0, hinges, 2 * hinges]),
            shift=0,
            values=np.concatenate([start, end]),
        )
        known, per_frame = np.full(2, enough), np.full(2, enough)
        found = sweep_frames(self._shape, angles, 0, 1, enough, known, per_frame, 0.0)
        return 0.0 if found.unbounded >= 0.0 else float(found.clearance)


def clearance_at(
    chain: Chain, motion: Array | Windows, frame: float, modules: tuple[int, int], *, size: float
) -> float:
    """The clearance of two modules at one moment of a motion, as a sweep sees it.

    Args:
        chain: The chain.
        motion: As for ``sweep``.
        frame: The moment, as a frame number.
        modules: The two, the earlier one first.
        size: Module size as a fraction of the pitch.
    """
    before = int(frame)
    after = min(before + 1, len(motion) - 1)
    if isinstance(motion, Windows):
        ends = [motion.angles(chain, k, k + 1)[0].astype(np.float64) for k in (before, after)]
    else:
        ends = [motion[before], motion[after]]
    angles = ends[0] + (frame - before) * (ends[1] - ends[0])
    poses = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    found, _, _ = least_separation(
        np.ascontiguousarray(poses.positions),
        np.ascontiguousarray(poses.rotations),
        np.array([modules], dtype=np.int64),
        chain.module.hull,
        size,
        FAR,
    )
    return float(found)


def _in_turn(part: Callable[[int], Found], starts: range, cancelled: Cancelled) -> Iterator[Found]:
    """Results of all parts in their order, some of them at the same time, until cancelled."""
    if len(starts) == 1:  # a short motion is done sooner than a thread begins
        if not cancelled():
            yield part(starts[0])
        return
    threads = min(MOST_THREADS, len(starts), os.cpu_count() or 1)
    waiting: deque[Future[Found]] = deque()
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for start in starts:
            if cancelled():
                break
            if len(waiting) > 2 * threads:
                yield waiting.popleft().result()
            waiting.append(pool.submit(part, start))
        for left in waiting:
            yield left.result()


def check_windows(chain: Chain, windows: Windows) -> None:
    """Refuses windows that are not of this chain.

    Raises:
        InputError: ``bad-windows``.
    """
    _extents(chain, windows)


def _extents(chain: Chain, motion: Array | Windows) -> tuple[Ints, Ints]:
    """Where each frame's window begins, (F,), and where its angles do among all, (F + 1,)."""
    hinges = len(chain.folded_rad)
    frames = len(motion)
    if not isinstance(motion, Windows):
        return np.zeros(frames, np.int64), np.arange(frames + 1, dtype=np.int64) * hinges
    first = np.ascontiguousarray(motion.first, dtype=np.int64)
    offsets = np.ascontiguousarray(motion.offsets, dtype=np.int64)
    widths = np.diff(offsets)
    if (
        first.shape != (frames,)
        or offsets.shape != (frames + 1,)
        or (first < 0).any()
        or (widths < 0).any()
        or (first + widths > hinges).any()
        or int(offsets[0]) != 0
        or int(offsets[-1]) != len(motion.angles_rad)
    ):
        raise InputError(
            "bad-windows",
            f"got windows that are not within {hinges} hinges or not as long as they say, "
            "expected windows of this chain.",
        )
    if not np.isfinite(motion.angles_rad).all():
        raise InputError("bad-windows", "got angles that are not finite, expected numbers.")
    return first, offsets


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _AtRest:
    """The folded shape and the straight rod, with the clearance of all their beginnings."""

    folded: tuple[Array, Ints]
    straight: tuple[Array, Ints]

    @classmethod
    def of(cls, chain: Chain, size: float, enough: float) -> _AtRest:
        module = chain.module

        def clearances(poses: Poses) -> tuple[Array, Ints]:
            pairs = near_pairs(poses.positions, 2.0 * module.radius * size + enough, module.apart)
            return rigid_clearances(
                poses.positions, poses.rotations, pairs, module.hull, size, enough
            )

        return cls(folded=clearances(chain.folded_poses), straight=clearances(_straight(chain)))

    def frames(self, chain: Chain, first: Ints, widths: Ints) -> tuple[Array, Ints]:
        """(F,) clearance of what is at rest in each window's frame, and (F, 2) the modules."""
        hinges, rigid = chain.module.hinges_per_joint, chain.module.rigid_links
        core = first // hinges + rigid
        last = np.maximum(first + widths, np.where(first % hinges, first + 1, 0))
        rod = np.where(last > first, (last - 1) // hinges + rigid + 1, core)
        below, above = self.folded[0][core], self.straight[0][len(chain) - 1 - rod]
        who = self.straight[1][len(chain) - 1 - rod]
        who = np.where(who >= 0, who + rod[:, None], -1)
        who = np.where((below <= above)[:, None], self.folded[1][core], who)
        return np.minimum(below, above), who


def windows_shape(chain: Chain, size: float) -> Shape:
    """What ``planner.kernels.sweep`` knows of a chain whose motion is windows."""
    return _shape(chain, size, (chain.folded_poses, _straight(chain)))


def _straight(chain: Chain) -> Poses:
    return forward_kinematics(chain.module, np.zeros_like(chain.folded_rad))


def _shape(chain: Chain, size: float, at_rest: tuple[Poses, Poses] | None) -> Shape:
    """A shape: with a core and a rod where the folded and the straight chain are given."""
    module, n = chain.module, len(chain)
    core = np.zeros((n, WIDTH))
    core[:, ROTATION:VELOCITY] = np.eye(3).ravel()
    if at_rest is not None:
        core[:, :ROTATION] = at_rest[0].positions
        core[:, ROTATION:VELOCITY] = at_rest[0].rotations.reshape(n, 9)
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
        size=float(size),
        apart=module.apart,
        root=chain.root if at_rest is None else -1,
        folded=chain.folded_rad.copy(),
        core=core,
        boxes=np.hstack(
            [np.minimum.accumulate(centres, axis=0), np.maximum.accumulate(centres, axis=0)]
        ),
        origin=origin,
        width=width,
        cells=cells,
        starts=np.concatenate([[0], np.cumsum(counts)]),
        members=np.argsort(flat, kind="stable"),
        places=np.zeros((0, 3)) if at_rest is None else at_rest[1].positions,
        rotations=np.zeros((0, 3, 3)) if at_rest is None else at_rest[1].rotations,
    )
