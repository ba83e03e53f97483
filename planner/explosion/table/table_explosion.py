"""Explosion on a table: a chain leaves its core under gravity and lies down on the table.

The folded core stands on the table. From the chain's far end on, joints are released by springs
whose torque is limited; modules fall, slide and come to lie, and the chain's end is drawn gently
towards free space. A guard tests every frame before it is recorded: one that needs more torque of a
hinge than the bound is dropped, and the forces are drawn anew.

It is a peeling (``planner.explosion.peeling_run``) with other forces, surroundings and rules.
Once all lies flat, what remains is a planar unfolding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import ClassVar, Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.chain.table_projection import TableProjection
from foldback.planner.explosion.loop.checkpoint import Pulses
from foldback.planner.explosion.loop.explosion_loop import End, Watch, run
from foldback.planner.explosion.loop.recorder import Mark, Refusal
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.explosion.peeling.core import CoreOnTable
from foldback.planner.explosion.peeling.peeling import build_peeling
from foldback.planner.explosion.peeling.run import Peeling
from foldback.planner.explosion.peeling.window import (
    Peelable,
    ReleasePoint,
    Window,
    WindowConfiguration,
)
from foldback.planner.explosion.table.guard import Guard
from foldback.planner.explosion.table.window_forces import TableForces
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record, Spent
from foldback.planner.parameters.explosion import TableParameters
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code

PERTURBATION_GROWTH: Final = 0.25
"""Fraction by which the random forces that loosen a jammed chain on a table grow with each attempt
that brings no progress: each time that new forces are drawn, or that modules which did not come
loose are held again."""


def explode_on_table(
    chain: Chain,
    parameters: TableParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Release a folded chain on a table, and record its motion until it lies straight.

    Args:
        chain: A chain of cubes, starting in its folded configuration; it stands on the table with
            its lowest modules, z up.
        parameters: Parameters of the explosion.
        seed: Seed of the random forces.
        sink: Receives the snapshots as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Returns:
        The record, whether straight or not.

    Raises:
        InputError: ``not-peelable`` for modules that are no cubes, or off the lattice.
    """
    peelable = Peelable(chain)
    projection = TableProjection(np.rint(matrix_from_wxyz(chain.folded_wxyz)[2]))
    guard = Guard(chain, peelable, parameters)
    forces = TableForces(parameters, len(chain), projection, seed=seed)
    pulses = Pulses(parameters.most_pushes)
    watch = Watch(progress, cancelled, "unfolding the chain onto the table")
    peeling = build_peeling(
        peelable,
        parameters,
        forces=forces,
        surroundings=CoreOnTable(peelable.core, projection),
        rules=TableRules(parameters, forces, guard, pulses),
        pulses=pulses,
        min_progress_rad=0.3,
        guard=guard.refusal,
        sink=sink,
        watch=watch,
    )
    return replace(run(peeling, "peel"), table=guard.record())


@dataclass(slots=True)
class TableRules:
    """Rules of a peeling on a table: random forces and earlier releases are its remedies.

    Attributes:
        parameters: Parameters of the explosion.
        forces: Forces on the window.
        guard: Test of frames.
        pulses: Count of draws in a row without progress.
        releases: States before the releases so far, and the ends of the record after them.
        returns: Number of returns to an earlier release since the last release of a new unit.
        farthest: First module of the widest window so far; None before the first release.
    """

    parameters: TableParameters
    forces: TableForces
    guard: Guard
    pulses: Pulses
    releases: list[tuple[ReleasePoint, Mark[WindowConfiguration]]] = field(default_factory=list)
    returns: int = 0
    farthest: int | None = None
    max_finish_contacts: ClassVar[float] = np.inf  # the table is no reason to wait

    def is_ready(self, window: Window, control: StepControl) -> bool:
        """Return True if the next unit may be released."""
        p, errors = self.parameters, self.forces.heading_errors
        return bool(
            control.is_shallow
            and window.modules < p.window
            and np.abs(np.diff(errors[p.skipped :])).sum() < p.unbent
            and abs(errors[-1]) < 1.2
            and not self._would_loop(window)
        )

    def is_ready_in_jam(self, window: Window, control: StepControl) -> bool:
        """Return True if the next unit may be released after some draws without progress."""
        del control
        return (
            self.pulses.count % 4 == 1  # other jams draw new random forces
            and abs(self.forces.heading_errors[-1]) < 2.4
            and not self._would_loop(window)
        )

    def _would_loop(self, window: Window) -> bool:
        """Return True if the tail lies over the next unit."""
        first, angles = window.setting.next_first(window.first), window.widened_angles()
        return self.guard.loops(
            WindowConfiguration(time_s=window.time_s, first=first, angles=angles)
        )

    def allows(self, configurations: Sequence[WindowConfiguration]) -> bool:
        """Return True if the guard accepts configurations, one after the other."""
        return self.guard.refusal(None, configurations) is None

    def committed(self) -> None:
        """Let the guard count recorded frames."""
        self.guard.count_checkpoint()

    def released(self, point: ReleasePoint, mark: Mark[WindowConfiguration], first: int) -> None:
        """Remember a release; progress makes all returns possible again."""
        self.releases.append((point, mark))
        if self.farthest is None or first < self.farthest:
            self.farthest, self.returns = first, 0

    def answer(self, refusal: Refusal, window: Window, step: int) -> None:
        """Count a refusal, and draw other forces."""
        self.guard.count(refusal, window.time_s)
        self.forces.draw(step, 1.0)

    def loosen(self, step: int) -> None:
        """Draw other forces."""
        self.forces.draw(step, 1.0)

    def loosen_jam(self, step: int) -> None:
        """Draw forces that are larger the longer nothing has moved."""
        self.forces.draw(step, 1.0 + PERTURBATION_GROWTH * self.pulses.count)

    def progressed(self) -> None:
        """End the perturbation."""
        self.forces.calm()

    def retreat(self, peeling: Peeling) -> bool:
        """Return to an earlier release, farther each time; return False at the limit of returns."""
        if self.returns >= self.parameters.most_returns or not self.releases:
            return False
        count = min(3 * 2**self.returns, len(self.releases))
        self.returns += 1
        point, mark = self.releases[-count]
        del self.releases[-count:]
        control, window = peeling.control, peeling.world
        window.return_to(point)
        peeling.recorder.return_to(mark)
        peeling.save()
        self.guard.taken_back += 1
        control.depth, self.pulses.count = 0.0, 0
        peeling.progress.begin_anew(window.remaining_rad, control.steps)
        self.forces.draw(control.steps, 1.0 + PERTURBATION_GROWTH * self.returns)
        return True

    def end(self, window: Window) -> End | None:
        """Return the end of a run that needs more torque than the motors have."""
        limits = self.parameters
        if not self.guard.is_exhausted:
            return None
        return End(
            "stalled",
            Reason.of(Code.STUCK_ON_TABLE, folded=window.first + 1, limit_torque=self.guard.bound),
            Spent("refusals", limits.refusals, ceil(self.guard.refused)),
        )
