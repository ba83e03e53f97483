"""Diagnosis: why an explosion did not come to its end, told from where it stopped.

It gives the reason, by which ``planner.pipeline.portfolio`` decides what is tried next, and the
modules at which people should look.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.kernels.pairs import near_pairs
from planner.motion.frames import PHASES, Frames
from planner.motion.record import Record
from planner.pathfinding.knots import knot_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Kind = Literal["knot", "buried", "contacts", "joints", "broken", "limit", "stopped"]
BENT_RAD: Final = 1.0
"""Bend from which on a joint is told as stuck: most of a right angle."""
MOST_BENT: Final = 0.5
"""Share of the largest bend from which on a joint is told, where none is bent by ``BENT_RAD``."""
TOUCHING: Final = 1.1
"""Pitches between centres up to which cubes count as touching; face to face it is 1."""
SLIGHT_RAD: Final = 0.1
"""Bends below this are not told at all."""
CLUSTER: Final = 0.25
"""Share of the chain's modules that touch in one cluster, from which on contacts are the reason."""
MOST_MODULES: Final = 200
"""Modules that a diagnosis names, at most."""
LARGEST_KNOT: Final = 4096
"""Modules up to which a knot is looked for: it takes time by their square."""
WORDS: Final[dict[str, str]] = {
    "knot": "its path is knotted, which pulling at its ends draws tight",
    "buried": "what comes next lies under modules that come later",
    "contacts": "too many modules press on each other at once",
    "joints": "some joints are held by their neighbours",
    "broken": "the simulation broke off",
    "limit": "it was on its way when the steps it may take were used up",
    "stopped": "it was still on its way",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """What keeps a chain from becoming straight.

    Attributes:
        kind: ``knot`` in the path, a ``buried`` unit, a cluster of ``contacts``, stuck ``joints``,
            a simulation that is ``broken`` off, or a ``limit`` that came first; ``stopped`` when
            it was ended from outside.
        modules: Where it sticks: modules whose joint is still bent, some of them at least.
    """

    kind: Kind
    modules: tuple[int, ...]

    @property
    def words(self) -> str:
        """The same in plain words."""
        return WORDS[self.kind]

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {**asdict(self), "modules": list(self.modules), "words": self.words}


def diagnose(chain: Chain, record: Record) -> Diagnosis | None:
    """Why a record does not end straight; None when it does, or when somebody stopped it.

    Args:
        chain: The chain.
        record: What was recorded.
    """
    if record.status in ("straight", "cancelled"):
        return None
    last = record.frames[-1:].dense(chain)
    bent, folded = _bends(chain, last)
    first = chain.module.rigid_links
    stuck = np.flatnonzero((bent > BENT_RAD) & (folded > BENT_RAD)) + first
    if len(chain) <= LARGEST_KNOT and knot_of(chain.folded_poses.positions).verdict == "knotted":
        return _found("knot", stuck if len(stuck) else _most_bent(bent) + first)
    if record.strategy == "peel":
        core = int(np.argmax(np.abs(bent - folded) > 1e-6)) if (bent != folded).any() else 0
        beside = np.flatnonzero(bent[core:] > BENT_RAD)
        if not len(beside):
            beside = _most_bent(bent[core:])
        return _found(_kind_beside(core, record), beside + core + first)
    if record.status == "diverged":
        return _found("broken", stuck if len(stuck) else _most_bent(bent) + first)
    if not len(stuck):
        if record.status == "timeout":
            return _found("limit", stuck)
        return _found("joints", _most_bent(bent) + first)
    poses = chain.poses(last.joint_angles_rad[0], last.root_position[0], last.root_wxyz[0])
    cluster = _largest_cluster(poses.positions, chain.module.apart)
    return _found("contacts" if len(cluster) >= CLUSTER * len(chain) else "joints", stuck)


def stopped(chain: Chain, last: Frames) -> Diagnosis:
    """Where a fold was that was ended from outside.

    Args:
        chain: The chain.
        last: Its last frame: of an explosion or a refold's unfolding on its way to be straight, or
            of a playback on its way to be folded.
    """
    bent, folded = _bends(chain, last)
    left = np.abs(bent - folded) if PHASES[int(last.phase[-1])] == "playback" else bent
    return _found("stopped", _most_bent(left) + chain.module.rigid_links)


def stuck_of(
    explosion: Mapping[str, Any] | None, attempts: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """Of an explosion that did not come to its end: why and where, as ``Diagnosis.as_dict``.

    Args:
        explosion: Its figures, as of ``Record.summary``.
        attempts: What was tried, as a plan tells it; one of them is that explosion.
    """
    for attempt in attempts:
        told = attempt.get("diagnosis")
        if told and explosion == {key: attempt.get(key) for key in explosion or ()}:
            return dict(told)
    return None


def _bends(chain: Chain, last: Frames) -> tuple[Array, Array]:
    """The largest angle of each joint, now and folded."""
    hinges = chain.module.hinges_per_joint
    now, folded = last.joint_angles_rad[0], chain.folded_rad
    return (
        np.abs(now).reshape(-1, hinges).max(axis=1),
        np.abs(folded).reshape(-1, hinges).max(axis=1),
    )


def _most_bent(bent: Array) -> Ints:
    """Joints that are bent the most, where none is bent far."""
    most = bent.max(initial=0.0)
    return np.flatnonzero(bent >= MOST_BENT * most) if most > SLIGHT_RAD else np.zeros(0, np.int64)


def _kind_beside(core: int, record: Record) -> Kind:
    """Why a peeling stopped beside a core of so many joints."""
    if record.status == "timeout":
        return "limit"
    return "buried" if core else "joints"


def _found(kind: Kind, modules: Ints) -> Diagnosis:
    return Diagnosis(kind=kind, modules=tuple(modules[:MOST_MODULES].tolist()))


def _largest_cluster(positions: NDArray[np.float64], apart: int) -> Ints:
    """The most modules that touch each other, directly or not, links of the chain apart."""
    from scipy.sparse import coo_array  # late: most folds come to their end
    from scipy.sparse.csgraph import connected_components

    count = len(positions)
    pairs = near_pairs(positions, TOUCHING, apart)
    if not len(pairs):
        return np.zeros(0, dtype=np.int64)
    ones = np.ones(len(pairs))
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.flatnonzero(labels == np.bincount(labels).argmax())
