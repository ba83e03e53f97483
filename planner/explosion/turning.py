"""Turning: the record of a chain that unfolds in turns, without a simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.blocking import no_quarter_turn
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record, RecordStatus, Spent
from foldback.planner.progress import Cancelled, never
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.turns.turn_sequence import NoTurns, find_turns

MAX_TURNING_MODULES: Final = 500
"""Maximum number of modules of a chain that folds in turns; the time of a search grows with about
the third power of their number."""
MODULES_PER_STEP: Final = 10
"""Number of modules for each step that a roomy fold in turns may have. With so few steps, it takes
at most 1.3 times as long as an explosion at the same speed of the hinges:
docs/decisions/0028-turns.md."""


def unfold_in_turns(
    chain: Chain,
    strategy: str,
    *,
    module_size: float,
    at_once: int | None,
    seed: int,
    roomy: bool = False,
    max_work: int = 0,
    sink: Callable[[Motion], None] | None = None,
    cancelled: Cancelled = never,
) -> Record:
    """Return the record of a chain that unfolds in steps of quarter turns.

    Args:
        chain: The chain: cubes on the lattice, or tetrahedra in the honeycomb.
        strategy: Name of the strategy in the record.
        module_size: Module size as a fraction of the pitch.
        at_once: Maximum number of hinges that turn in one step; None for no limit.
        seed: Seed of the search.
        roomy: True for turns with the most room alone, in few steps.
        max_work: Work after which the search by the joints' steps stops; 0 for no limit.
        sink: Receives the snapshots.
        cancelled: Polled between turns.
    """
    start_s = time.perf_counter()
    turns = find_turns(
        chain,
        module_size=module_size,
        at_once=at_once,
        seed=seed,
        roomy=roomy,
        max_work=max_work,
        cancelled=cancelled,
    )
    status: RecordStatus = "straight"
    reason: Reason | None = None
    rests, spent, expanded = None, None, 0
    if isinstance(turns, NoTurns):
        status, reason, spent = _failure(chain, turns, module_size)
        frames, expanded = turns.last_rad, turns.expanded
    elif roomy and len(turns.hinges) > (max_turns := -(-len(chain) // MODULES_PER_STEP)):
        status, frames = "stalled", turns.rest_angles_rad[-1:]
        expanded = len(turns.hinges)
        reason = Reason.of(Code.MAX_TURNS, steps=expanded, max_steps=max_turns)
        spent = Spent(kind="turn_steps", allowed=max_turns, used=expanded)
    elif turns.hinges:
        frames, rests = _between(turns.rest_angles_rad[::-1])
    else:  # a straight chain has no turns to rest between
        frames = np.repeat(turns.rest_angles_rad, 2, axis=0)
    root = chain.folded_poses
    motion = Motion.from_frames(
        phase="explosion",
        time_s=_times(frames),
        joint_angles_rad=quantised(frames),
        root_position=np.tile(root.positions[chain.root], (len(frames), 1)),
        root_wxyz=np.tile(root.wxyzs[chain.root], (len(frames), 1)),
    )
    if sink is not None:
        sink(motion)
    return Record(
        status=status,
        reason=reason,
        frames=motion,
        steps=expanded,
        seconds=time.perf_counter() - start_s,
        strategy=strategy,
        rest_frames=rests,
        spent=spent,
    )


def _failure(
    chain: Chain, search: NoTurns, module_size: float
) -> tuple[RecordStatus, Reason, Spent | None]:
    """Return the status, reason and used-up limit of a search without a result."""
    if search.outcome == "cancelled":
        return "cancelled", Reason.of(Code.TURNS_CANCELLED), None
    # Modules that only come too near in a turn do not block it: the search has ended all the same.
    blocked = (
        no_quarter_turn(chain, module_size=module_size) if search.outcome == "blocked" else None
    )
    if blocked is not None:
        count, joints = len(blocked.turns), len(chain.folded_rad)
        return "stalled", Reason.of(Code.NO_QUARTER_TURN, turns=count, joints=joints), None
    bent = int((np.abs(search.last_rad[-1]) > 0.0).sum())
    return (
        "stalled",
        Reason.of(Code.NO_TURNS, bent=bent, states=search.expanded),
        Spent(kind="turns", allowed=search.expanded, used=search.expanded),
    )


def _between(rests: Array) -> tuple[Array, Ints]:
    """Return frames on the straight lines between rests, and the frames of the rests."""
    turns = np.abs(np.diff(rests, axis=0)).max(axis=1)
    counts = np.maximum(1, np.ceil(turns / 0.4).astype(np.int64))
    at = np.concatenate([[0], np.cumsum(counts)])
    frames = [rests[:1]]
    for start, end, count in zip(rests[:-1], rests[1:], counts.tolist(), strict=True):
        share = np.arange(1, count + 1)[:, None] / count
        frames.append((1.0 - share) * start + share * end)
    return np.concatenate(frames), at.astype(np.int64)


def _times(frames: Array) -> Array:
    turns = np.abs(np.diff(frames, axis=0)).max(axis=1)
    # only the times of the recorded frames depend on this rate, rad/s
    return np.concatenate([[0.0], np.cumsum(turns)]) / 0.25
