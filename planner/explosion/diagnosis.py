"""Diagnosis: why an explosion did not come to its end, derived from where it stopped.

``planner.pipeline.retry_policy`` chooses the next attempt by its kind; its modules show people
where to look. Its evidence is the reason: a knot, modules in each other's way, or a used-up limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.extension import bending_hinges
from foldback.planner.core import FIXED, near_pairs
from foldback.planner.explosion.blocking import STUCK_JOINT_BEND_RAD, blocked, no_quarter_turn
from foldback.planner.explosion.failure_evidence import (
    BlockEvidence,
    BudgetEvidence,
    Crossing,
    Diagnosis,
    Kind,
    KnotEvidence,
    Point,
)
from foldback.planner.explosion.peeling.window import MIN_LAST_UNIT_MODULES
from foldback.planner.motion.failure_schemas import StuckFigures
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.parameters import BASELINE, TURNS, Parameters
from foldback.planner.pathfinding.knot_diagram import diagram_of

SLIGHT_BEND_RAD: Final = 0.1
"""Angle, rad, up to which a hinge counts as straight in the report on a failed unfolding."""
MAX_DIAGNOSED_MODULES: Final = 200
"""Maximum number of bent modules that the report on a failed unfolding lists; further ones are left
out."""


def diagnose(chain: Chain, record: Record, parameters: Parameters) -> Diagnosis | None:
    """Diagnose a record that does not end straight; None if it does, or if it was cancelled.

    Args:
        chain: The chain.
        record: Record of the explosion.
        parameters: Parameters of the fold.
    """
    if record.status in ("straight", "cancelled"):
        return None
    last = record.frames[-1:].dense(chain)
    kind, modules = _where(chain, record, last)
    turns = (
        no_quarter_turn(chain, module_size=parameters.module_size) if kind == "blocked" else None
    )
    knot = None if turns else _knot(chain, last)
    return Diagnosis(
        kind=kind if knot is None else "knot",
        modules=tuple(modules[:MAX_DIAGNOSED_MODULES].tolist()),
        evidence=turns or knot or _blocks(chain, record, last, parameters) or _budget(record, last),
    )


def _where(chain: Chain, record: Record, last: Motion) -> tuple[Kind, Ints]:
    """Return the kind of the stall, knots left aside, and the modules whose joints are bent."""
    bent, folded = _bends(chain, last)
    first = chain.module.rigid_links
    stuck = np.flatnonzero((bent > STUCK_JOINT_BEND_RAD) & (folded > STUCK_JOINT_BEND_RAD)) + first
    if record.strategy == "peel":
        core = int(np.argmax(np.abs(bent - folded) > 1e-6)) if (bent != folded).any() else 0
        beside = np.flatnonzero(bent[core:] > STUCK_JOINT_BEND_RAD)
        if not len(beside):
            beside = _most_bent(bent[core:])
        return _kind_beside(core, record), beside + core + first
    if record.strategy in (TURNS, BASELINE) and record.status == "stalled" and not record.spent:
        return "blocked", stuck
    if record.status == "diverged":
        return "broken", stuck if len(stuck) else _most_bent(bent) + first
    if not len(stuck):
        if record.status == "timeout":
            return "limit", stuck
        return "joints", _most_bent(bent) + first
    cluster = _largest_cluster(last.poses(chain).positions[0], chain.module.apart)
    return "contacts" if len(cluster) >= 0.25 * len(chain) else "joints", stuck


def _knot(chain: Chain, last: Motion) -> KnotEvidence | None:
    """Return the knot of the chain where it stopped: as folded it may have been another one."""
    if len(chain) > 4096:  # the test takes time by the square of the number
        return None
    diagram = diagram_of(last.poses(chain).positions[0])
    if diagram is None:
        return None
    return KnotEvidence(
        determinant=diagram.knot.determinant,
        closings=tuple(tuple(map(_point, corners)) for corners in diagram.closings),
        polygon=tuple(map(_point, diagram.vertices)),
        sight=_point(diagram.sight),
        diagram=tuple(
            Crossing(over=over, under=under, sign=sign)
            for (over, under), sign in zip(
                diagram.places.tolist(), diagram.signs.tolist(), strict=True
            )
        ),
    )


def _blocks(
    chain: Chain, record: Record, last: Motion, parameters: Parameters
) -> BlockEvidence | None:
    """Find the modules that block each other after pulses without progress."""
    if record.status != "stalled":
        return None
    size, hinges, unit, first = parameters.module_size, chain.module.hinges_per_joint, None, 0
    if record.strategy == "peel":
        if record.table is None:  # on a table, frames are clear at the size to verify
            size = max(size, parameters.peeling.verify_size)
        peeling = parameters.peeling if record.table is None else parameters.table
        first = _first_released(chain, record, last)
        joint = first // hinges
        if joint:
            before = joint - peeling.unit
            unit = ((before if before >= MIN_LAST_UNIT_MODULES else 0) + FIXED, joint + FIXED - 1)
    elif record.strategy not in (TURNS, BASELINE) and isinstance(
        parameters.explosion, ExplosionParameters
    ):
        size = max(size, parameters.explosion.verify_size)
    return blocked(chain, last.joint_angles_rad[0], module_size=size, first_hinge=first, unit=unit)


def _budget(record: Record, last: Motion) -> BudgetEvidence | None:
    """Return the limit that an explosion has used up; None if its record does not state it."""
    if record.spent is None:
        return None
    angles = np.abs(last.joint_angles_rad[0])
    return BudgetEvidence(
        spent=record.spent.kind,
        allowed=record.spent.allowed,
        used=record.spent.used,
        bent_hinges=int((angles > SLIGHT_BEND_RAD).sum()),
        largest_bend_rad=float(angles.max(initial=0.0)),
    )


def _first_released(chain: Chain, record: Record, last: Motion) -> int:
    """Return the first hinge that a peeling has released."""
    if record.frames.is_windowed:
        return int(record.frames.first[-1])
    moved = np.abs(last.joint_angles_rad[0] - chain.folded_rad) > 1e-6
    hinges = chain.module.hinges_per_joint
    return hinges * (int(np.argmax(moved)) // hinges) if moved.any() else 0


def _point(values: Array) -> Point:
    x, y, z = values.tolist()
    return (x, y, z)


def stopped(chain: Chain, last: Motion) -> Diagnosis:
    """Diagnose a fold that was ended from outside.

    Args:
        chain: The chain.
        last: Its last frame: of an explosion or a refold's unfolding on its way to be straight, or
            of a playback on its way to be folded.
    """
    bent, folded = _bends(chain, last)
    remaining_bend = np.abs(bent - folded) if PHASES[int(last.phase[-1])] == "playback" else bent
    modules = _most_bent(remaining_bend) + chain.module.rigid_links
    return Diagnosis(kind="stopped", modules=tuple(modules[:MAX_DIAGNOSED_MODULES].tolist()))


def stuck_of(
    explosion: Mapping[str, Any] | None, attempts: Sequence[Mapping[str, Any]]
) -> StuckFigures | None:
    """Return the diagnosis of a failed explosion, as ``Diagnosis.as_dict``; None if unknown.

    Args:
        explosion: Its figures, as of ``Record.summary``.
        attempts: Attempts as stored in a plan; one of them is that explosion.
    """
    for attempt in attempts:
        diagnosis = attempt.get("diagnosis")
        if diagnosis and explosion == {key: attempt.get(key) for key in explosion or ()}:
            return cast("StuckFigures", dict(diagnosis))
    return None


def _bends(chain: Chain, last: Motion) -> tuple[Array, Array]:
    """Return the largest bend of each joint, rad, in a frame and when folded.

    Hinges that twist the chain about its own line do not bend it.
    """
    hinges, bending = chain.module.hinges_per_joint, bending_hinges(chain)
    now, folded = last.joint_angles_rad[0] * bending, chain.folded_rad * bending
    return (
        np.abs(now).reshape(-1, hinges).max(axis=1),
        np.abs(folded).reshape(-1, hinges).max(axis=1),
    )


def _most_bent(bent: Array) -> Ints:
    """Return the joints that are bent the most, where none is bent far."""
    max_bend = bent.max(initial=0.0)
    return (
        np.flatnonzero(bent >= 0.5 * max_bend)
        if max_bend > SLIGHT_BEND_RAD
        else np.zeros(0, np.int64)
    )


def _kind_beside(core: int, record: Record) -> Kind:
    """Return the kind of the stall of a peeling with ``core`` joints still folded."""
    if record.status == "timeout":
        return "limit"
    return "buried" if core else "joints"


def _largest_cluster(positions: Array, apart: int) -> Ints:
    """Return the largest set of modules that touch, directly or not; chain links do not count."""
    from scipy.sparse import coo_array  # late: most folds come to their end
    from scipy.sparse.csgraph import connected_components

    count = len(positions)
    pairs = near_pairs(positions, 1.1, apart)  # 1 if they share a face
    if not len(pairs):
        return np.zeros(0, dtype=np.int64)
    weights = np.ones(len(pairs))
    graph = coo_array((weights, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    return np.flatnonzero(labels == np.bincount(labels).argmax())
