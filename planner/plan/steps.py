"""Steps: a fold as turns between poses at which the whole chain rests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.errors import InputError
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.rests import rest_frames

MIN_TURN_RAD: Final = 1e-3
"""Smallest difference of a hinge's angle between two rests that counts as a turn, in radians; a
smaller one comes from rounding."""

Modules = tuple[int, int]
"""First and last of several consecutive modules, counted from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Turn of one hinge during a step.

    Attributes:
        hinge: Index of the hinge among the joint angles of the chain.
        module: Module in front of the hinge; the modules after it turn against it.
        from_rad: Angle of the hinge at the beginning of the step.
        to_rad: Angle of the hinge at the end of the step.
        moves: Modules on the hinge's side away from the held part.
    """

    hinge: int
    module: int
    from_rad: float
    to_rad: float
    moves: Modules

    @property
    def angle_rad(self) -> float:
        """Angle by which the hinge turns."""
        return self.to_rad - self.from_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Motion from one rest of the chain to the next; all its hinges turn together.

    Attributes:
        number: Number of the step, from 1.
        turns: Its turns along the chain; more than one if turns are merged.
        parts: Rigid parts of the chain during the step, in order.
        held: The largest part, the first of equals: it stays still and all others move.
    """

    number: int
    turns: tuple[Turn, ...]
    parts: tuple[Modules, ...]
    held: Modules

    @property
    def moving(self) -> tuple[Modules, ...]:
        """The parts that move against the held one."""
        return tuple(part for part in self.parts if part != self.held)


def steps_between(module: Module, rests_rad: Array) -> tuple[Step, ...]:
    """Return the steps between poses of rest; poses that do not differ make no step.

    Args:
        module: Kind of the chain's modules.
        rests_rad: (R, J) joint angles of the rests, in the order of time.
    """
    steps: list[Step] = []
    for before, after in zip(rests_rad[:-1], rests_rad[1:], strict=True):
        hinges = np.flatnonzero(np.abs(after - before) > MIN_TURN_RAD).tolist()
        if hinges:
            steps.append(_step(len(steps) + 1, module, hinges, before, after))
    return tuple(steps)


def _step(number: int, module: Module, hinges: Sequence[int], before: Array, after: Array) -> Step:
    count = module.module_count(len(before))
    fronts = [module.module_before(hinge) for hinge in hinges]
    ends = [*sorted(set(fronts)), count - 1]
    parts = tuple(zip([0, *(end + 1 for end in ends[:-1])], ends, strict=True))
    held_part = max(parts, key=lambda part: part[1] - part[0])
    turns = tuple(
        Turn(
            hinge=hinge,
            module=front,
            from_rad=float(before[hinge]),
            to_rad=float(after[hinge]),
            moves=(front + 1, count - 1) if front >= held_part[1] else (0, front),
        )
        for hinge, front in zip(hinges, fronts, strict=True)
    )
    return Step(number=number, turns=turns, parts=parts, held=held_part)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Steps:
    """All steps of a fold.

    The poses are those of a person who holds the held part of each step still: it has one pose at
    both rests of the step. In the last pose, the chain is where its folded shape is.

    Attributes:
        chain: The chain.
        rests_rad: (S + 1, J) joint angles at the rests.
        steps: S steps, each from one rest to the next.
        frames: (S + 1) frames of the plan at the rests.
        times_s: (S + 1) times of the rests in the plan, in seconds.
    """

    chain: Chain
    rests_rad: Array
    steps: tuple[Step, ...]
    frames: tuple[int, ...]
    times_s: tuple[float, ...]

    @property
    def turn_count(self) -> int:
        """Number of turns in all steps."""
        return sum(len(step.turns) for step in self.steps)

    def poses(self) -> tuple[Poses, ...]:
        """Return the poses of all modules at each rest, with the held parts still."""
        chain = self.chain
        poses = [chain.folded_poses]
        for step, angles in zip(reversed(self.steps), self.rests_rad[-2::-1], strict=True):
            root = step.held[0]
            poses.append(
                forward_kinematics(
                    chain.module,
                    angles,
                    root=root,
                    root_position=poses[-1].positions[root],
                    root_wxyz=wxyz_from_matrix(poses[-1].rotations[root]),
                )
            )
        return tuple(reversed(poses))


def hinge_axis(module: Module, turn: Turn, poses: Poses) -> tuple[Array, Array]:
    """Return the axis of a turn and a point on it, where the chain rests before the turn.

    The moving modules turn about the axis by the turn's angle, by the right-hand rule.

    Args:
        module: Kind of the modules.
        turn: The turn.
        poses: Poses of all modules before the turn.

    Returns:
        (3,) unit vector and (3,) point in pitches, in the frame of the poses.
    """
    front = poses.rotations[turn.module]
    anchor, axes, joint_turn, _ = module.link(turn.module)
    pivot = poses.positions[turn.module] + front @ anchor
    inner = turn.hinge % module.hinges_per_joint
    # The inner hinge of a universal joint turns with the outer one; it is fixed in the next module.
    axis = axes[inner]
    if inner == module.hinges_per_joint - 1:
        world = poses.rotations[turn.module + 1] @ joint_turn.T @ axis
    else:
        world = front @ axis
    side = 1.0 if turn.moves[0] > turn.module else -1.0
    return side * world, pivot


def steps_of(plan: Plan) -> Steps:
    """Return the steps of a plan.

    Raises:
        InputError: ``no-steps`` if the plan does not rest between steps, or nothing turns.
    """
    frames = rest_frames(plan.playback)
    if len(frames) < 2 and not plan.motion.angles_rad.any():
        raise InputError(
            "no-steps", "got a plan of a straight chain, expected one in which hinges turn."
        )
    if len(frames) < 2:
        raise InputError(
            "no-steps",
            "got a plan that does not rest between steps, expected one made by the strategy turns; "
            "fold the shape again with --strategy turns.",
        )
    rests = np.concatenate([plan.part(frame, frame + 1).joint_angles_rad for frame in frames])
    moved = np.abs(np.diff(rests, axis=0)).max(axis=1) > MIN_TURN_RAD
    rest_numbers = [0, *(np.flatnonzero(moved) + 1).tolist()]
    return Steps(
        chain=plan.chain,
        rests_rad=rests[rest_numbers],
        steps=steps_between(plan.chain.module, rests),
        frames=tuple(frames[k] for k in rest_numbers),
        times_s=tuple(float(plan.time_s[frames[k]]) for k in rest_numbers),
    )


def find_steps(plan: Plan) -> Steps | None:
    """Return the steps of a plan; None if it does not rest between steps."""
    return steps_of(plan) if len(rest_frames(plan.playback)) > 1 else None
