"""Sweep: the clearance of a whole motion, at its frames and everywhere between them.

Between two frames the hinge angles run evenly. Each interval is looked at in its middle; a pair of
modules passes when its clearance there is more than it can lose on the way to either end, measured
by the pair's own relative motion. Intervals with pairs that don't pass are halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.kernels.clearance import between, least_separation
from planner.kernels.pairs import near_pairs
from planner.kinematics import forward_kinematics
from planner.progress import Cancelled, never

Array = NDArray[np.float64]
CHUNK: Final = 64
MOST_HALVINGS: Final = 10
ENOUGH: Final = 0.2
"""Clearances of this and more are not told apart, unless there is nothing less."""
FAR: Final = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """The closest place of a motion.

    Attributes:
        clearance: Least clearance found at frames and in-betweens, in pitches.
        frame: Where, as a frame number; a half means between two.
        modules: The two modules, None when everything is far apart.
        bound: What the clearance is nowhere less than, as far as halving went.
        in_betweens: Configurations looked at between frames.
        per_frame: (F,) clearance at each frame, capped at ``ENOUGH``.
    """

    clearance: float
    frame: float
    modules: tuple[int, int] | None
    bound: float
    in_betweens: int
    per_frame: Array


def sweep(chain: Chain, angles_rad: Array, *, size: float, cancelled: Cancelled = never) -> Sweep:
    """The clearance of a motion through (F, J) configurations.

    Args:
        chain: The chain.
        angles_rad: Hinge angles of the frames.
        size: Module size as a fraction of the pitch.
        cancelled: Asked now and then; a cancelled sweep covers what was looked at so far.
    """
    found = _Sweeping(chain, angles_rad, size, ENOUGH).run(cancelled)
    if found.modules is None and not cancelled():
        # A short chain may never come that close to itself: then how far it stays off.
        found = _Sweeping(chain, angles_rad, size, FAR).run(cancelled)
    return found


class _Sweeping:
    def __init__(self, chain: Chain, angles: Array, size: float, enough: float) -> None:
        self.enough = enough
        self.chain = chain
        self.angles = angles
        self.size = size
        module = chain.module
        self.hull = (
            module.vertices,
            module.face_normals,
            module.edge_directions,
            module.radius,
            size,
        )
        self.reach = 2.0 * module.radius * size
        self.best = self.enough
        self.where = 0.0
        self.modules: tuple[int, int] | None = None
        self.bound = self.enough
        self.in_betweens = 0

    def run(self, cancelled: Cancelled) -> Sweep:
        frames = len(self.angles)
        per_frame = np.full(frames, self.enough)
        for start in range(0, frames, CHUNK):
            if cancelled():
                break
            part = self.angles[start : start + CHUNK + 1]
            at = self._poses(part)
            middles = self._poses(0.5 * (part[1:] + part[:-1]))
            for k in range(min(CHUNK, frames - start)):
                per_frame[start + k] = self._at_frame(start + k, at[0][k], at[1][k])
                if k + 1 < len(part):
                    self._between(start + k, part, at, middles, k)
        return Sweep(
            clearance=self.best,
            frame=self.where,
            modules=self.modules,
            bound=min(self.bound, self.best),
            in_betweens=self.in_betweens,
            per_frame=per_frame,
        )

    def _poses(self, angles: Array) -> tuple[Array, Array]:
        poses = forward_kinematics(self.chain.module, angles, root=self.chain.root)
        return poses.positions, poses.rotations

    def _at_frame(self, frame: int, positions: Array, rotations: Array) -> float:
        pairs = near_pairs(positions, self.reach + self.enough, self.chain.module.apart)
        value, first, second = least_separation(
            positions, rotations, pairs, *self.hull, self.enough
        )
        self._take(value, float(frame), first, second)
        return value

    def _between(
        self,
        frame: int,
        part: Array,
        at: tuple[Array, Array],
        middles: tuple[Array, Array],
        k: int,
    ) -> None:
        a = (at[0][k], at[1][k])
        b = (at[0][k + 1], at[1][k + 1])
        m = (middles[0][k], middles[1][k])
        moved = max(
            float(np.sqrt(((m[0] - a[0]) ** 2).sum(axis=1).max())),
            float(np.sqrt(((b[0] - m[0]) ** 2).sum(axis=1).max())),
        )
        pairs = near_pairs(m[0], self.reach + 2.5 * moved, self.chain.module.apart)
        self._look(float(frame), 0.5, part[k], part[k + 1], a, m, b, pairs, 0)

    def _look(
        self,
        start: float,
        half: float,
        angles_a: Array,
        angles_b: Array,
        a: tuple[Array, Array],
        m: tuple[Array, Array],
        b: tuple[Array, Array],
        pairs: NDArray[np.int64],
        depth: int,
    ) -> None:
        self.in_betweens += 1
        value, first, second, bound, left = between(*a, *m, *b, pairs, *self.hull, self.enough)
        self._take(value, start + half, first, second)
        self.bound = min(self.bound, bound)
        if not len(left):
            return
        if depth == MOST_HALVINGS or value <= 0.0:
            self.bound = min(self.bound, 0.0)
            return
        angles_m = 0.5 * (angles_a + angles_b)
        quarters = self._poses(np.stack([0.5 * (angles_a + angles_m), 0.5 * (angles_m + angles_b)]))
        low = (quarters[0][0], quarters[1][0])
        high = (quarters[0][1], quarters[1][1])
        half *= 0.5
        self._look(start, half, angles_a, angles_m, a, low, m, left, depth + 1)
        self._look(start + 2 * half, half, angles_m, angles_b, m, high, b, left, depth + 1)

    def _take(self, value: float, where: float, first: int, second: int) -> None:
        if value < self.best:
            self.best = float(value)
            self.where = where
            self.modules = (int(first), int(second))
