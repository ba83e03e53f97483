"""Explosion on a table: a chain comes off its core under gravity and lies down on the table.

The folded core stands on the table. From the chain's far end on, joints are let go by springs whose
torque is limited; modules fall, slide and come to lie, and the chain's end is drawn gently towards
where there is room. A guard looks at every frame that is to be kept: one that would ask more torque
of a hinge than the bound is taken back, and the forces are drawn anew.

It is a peeling (``planner.explosion.peeling``) with other forces: the core is held, what is
straight and out of the way is one rod. Once all lies flat, what is left is a planar unfolding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.rotations import matrix_from_wxyz
from planner.explosion.explosion import MOST_RETRIES, Ended
from planner.explosion.from_above import Above, nearest_way
from planner.explosion.peeling import Peeling, crossed
from planner.explosion.peeling_recorder import Mark, WindowRecorder
from planner.explosion.peeling_window import Bend
from planner.explosion.table_guard import Guard
from planner.explosion.table_way import way_out
from planner.kernels.folded_core import FIXED
from planner.motion.record import Record, Spent
from planner.motion.windows import Windows
from planner.parameters.explosion import TableParameters
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.reduced import Acceleration, State

Array = NDArray[np.float64]
THICK: Final = 40.0
"""Pitches of the box that stands for the table."""
WIDE: Final = 1000.0
"""Pitches to its edges, more than any chain is long."""
LEAST_PROGRESS_RAD: Final = 0.3
"""Sum of bends that must go from look to look."""
LEAST_BEND_RAD: Final = 1e-3
"""Of a hinge, below which its spring is not made stiffer any more."""
LIFTED: Final = 0.006
"""Pitches by which the simulated table is too high, as contacts give."""
ROUND: Final = 0.8
"""Torque on each link that lies, for each radian that it is off, as a multiple of the pull."""
MOST_OFF_RAD: Final = 0.5 * np.pi
"""Being farther off makes that torque no larger."""
LYING: Final = 0.5
"""Height from a link's one end to the other, in pitches, below which it lies."""
RELEASED_WITHIN_RAD: Final = 1.2
"""How far the rod may be off when the next unit is let go."""
HELD_BEYOND_RAD: Final = 2.4
"""The same when it is let go for want of progress."""
SIDEWAYS: Final = 5
"""Neighbouring modules that are pushed about alike."""
STRONGEST_SPRING: Final = 8.0
"""Largest torque of a spring, in w·p."""
FIRST_RETURN: Final = 3
"""Releases that a run goes back when it is stuck, and twice as many each time after that."""
STRONGER: Final = 0.25
"""How much more the forces may be each time that they are drawn in vain."""
RELEASED_EVERY: Final = 4
"""Times without progress, at the first of which the next unit is let go all the same."""


def explode_on_table(
    chain: Chain,
    parameters: TableParameters,
    *,
    seed: int = 0,
    sink: Callable[[Windows], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Lets a folded chain go on a table, and records how it comes to lie straight.

    Args:
        chain: A chain of cubes, starting in its folded configuration; it stands on the table with
            its lowest modules, z up.
        parameters: How it is let go.
        seed: Decides which forces are drawn.
        sink: Gets the snapshots as they are made.
        progress: Told how far it is, a few times a second.
        cancelled: Asked now and then whether to stop.

    Returns:
        The record, whatever came of it.

    Raises:
        InputError: ``not-peelable`` for modules that are no cubes, or off the lattice.
    """
    return TablePeeling(chain, parameters, seed, sink).run(progress, cancelled)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Release:
    """A run at the moment in which a unit was let go: it may return there.

    Attributes:
        first, unit: Of the window before.
        state: The window's.
        aim, target: Of the rod.
        centre: Of the unit that had been let go before.
        time_s: When.
        mark: Of the record.
    """

    first: int
    unit: int
    state: State
    aim: Array
    target: Array
    centre: Array
    time_s: float
    mark: Mark


class TablePeeling(Peeling):
    """A run on a table. For what it takes, see ``explode_on_table``."""

    doing = "lying down"

    def __init__(
        self,
        chain: Chain,
        parameters: TableParameters,
        seed: int,
        sink: Callable[[Windows], None] | None,
    ) -> None:
        self.table = parameters
        rotation = matrix_from_wxyz(chain.folded_wxyz)
        self.up: Array = np.rint(rotation[2])
        """(3,) in the frame of the core, which is that of module 0."""
        self.above = Above(self.up)
        self.off: Array = np.zeros(1)
        """(m - 2,) how far the window's links are off from where the rod is to point."""
        self.pushed: Array | None = None
        """(n, 3) forces that were drawn, in weights of a module."""
        self._drawn_at: int | None = None
        self._draws = np.random.default_rng(seed)
        self._exhausted = self._unheld = False
        self._releases: list[Release] = []
        self._returns = 0
        """Times that it has returned to an earlier release since it last got farther than ever."""
        self._farthest = len(chain)
        self._calm(parameters)
        super().__init__(chain, parameters, seed, sink)
        self.guard = Guard(chain, self.peelable, parameters)
        self.windows = self.recorder = WindowRecorder(
            self.peelable,
            self.proof,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            sink=sink,
            holds=self._holds,
        )

    def run(self, progress: Report, cancelled: Cancelled) -> Record:
        """As any explosion, with what the guard has done."""
        return replace(super().run(progress, cancelled), table=self.guard.record())

    @property
    def most_pushes(self) -> int:
        """Maximum number of draws in a row without progress; one more ends the run."""
        return self.table.most_pushes

    @property
    def stall_limit(self) -> Spent:
        """Limit that is used up when the run has stalled: pushes, or refusals of the guard."""
        if self._exhausted:
            return Spent("refusals", self.table.refusals, ceil(self.guard.refused))
        return super().stall_limit

    # The forces.

    def _calm(self, p: TableParameters) -> None:
        """The forces as they are when nothing is in the way."""
        self._drawn_at = None
        self.spring_torque = p.largest_spring_torque
        self.pull, self.turning = p.pull, p.turning
        self.pushed = None

    def _draw(self, stronger: float) -> None:
        """Draws the forces anew, for a while."""
        p, draws = self.table, self._draws
        self._drawn_at = self.steps
        size = stronger * draws.uniform(0.0, 0.5)
        each = draws.normal(size=(len(self.chain), 3))
        each -= 0.5 * np.outer(each @ self.up, self.up)
        alike = np.full(SIDEWAYS, 2.0 / SIDEWAYS)
        self.pushed = size * np.column_stack(
            [np.convolve(each[:, axis], alike, "same") for axis in range(3)]
        )
        self.pull, self.turning = draws.uniform(0.0, 1.0), draws.uniform(0.0, 2.0)
        largest = p.largest_spring_torque * draws.uniform(0.75, 1.5 * stronger)
        self.spring_torque = min(largest, STRONGEST_SPRING)

    @property
    def _rod_mass(self) -> float:
        return float(min(self.rod, self.table.rod_modules))

    def _forces(self, positions: Array) -> Array:
        """(m, 3) forces: weights, the pull at the end, and what was drawn."""
        p, count = self.table, self.modules
        forces = np.zeros((count, 3))
        forces[FIXED:] = -self.up
        if self.pushed is not None:
            forces[FIXED:] += self.pushed[self.first + FIXED : self.first + count]
        forces[-1] += self.pull * self.aim - self._rod_mass * self.up
        forces += self._turning_round(positions)
        return p.weight * forces

    def _turning_round(self, positions: Array) -> Array:
        """(m, 3) forces that turn what lies on the table to where the rod is to point.

        A pull at the end would turn what is far off no more, or the wrong way round.
        """
        forces = np.zeros_like(positions)
        links = np.diff(positions[FIXED:], axis=0)
        off = np.clip(self.off[1:], -MOST_OFF_RAD, MOST_OFF_RAD)
        lies = np.abs(links @ self.up) < LYING
        couples = ROUND * self.pull * (off * lies)[:, None] * np.cross(links, self.up)
        forces[FIXED + 1 :] += couples
        forces[FIXED:-1] -= couples
        return forces

    def _look_round(self) -> None:
        """Tells how far all links are off."""
        window = self.window
        first, last = window.rotations[1][:, 0], window.rotations[-1][:, 0]
        if abs(first @ self.up) > LYING:
            first = self.target
        turned = self.above.turned(window.positions[1:], first, last)
        wanted = self.above.angle(self.target) - self.above.angle(first)
        self.off = turned - nearest_way(wanted, turned[-1])

    def _end_torque(self) -> Array:
        """(3,) the rod's weight, and what turns it on the table to where it is to point."""
        along = self.window.rotations[-1][:, 0]
        flat = along - (along @ self.up) * self.up
        turn = crossed(flat / max(float(np.linalg.norm(flat)), 1e-6), self.aim)
        mass = self._rod_mass
        lever = 0.5 * (1.0 + mass) * along if mass else np.zeros(3)
        return self.table.weight * (self.turning * turn - mass * crossed(lever, self.up))

    def _stiffen(self, positions: Array) -> None:
        """Springs whose torque is limited: the more a hinge is bent, the softer its spring."""
        p = self.table
        bends = np.maximum(np.abs(self.state.angles), LEAST_BEND_RAD)
        springs = np.minimum(p.spring_torque, self.spring_torque / bends)
        self.window.set_stiffness(p.weight * springs)

    # The table.

    @property
    def _lowest(self) -> float:
        """Where the centres of modules are that stand on the table, upwards."""
        return float((self.core.cells @ self.up).min())

    def _boxes(self, first: int) -> tuple[Array, Array]:
        centres, halves = super()._boxes(first)
        # Not where the chain begins on the floor: its first free module would be jammed there.
        raised = float(self.core.cells[first + 1] @ self.up) > self._lowest + 0.5
        top = self._lowest - 0.5 + (LIFTED if raised else 0.0)
        table = np.where(self.up != 0.0, 0.5 * THICK, WIDE)
        return (
            np.concatenate([centres, [(top - 0.5 * THICK) * self.up]]),
            np.concatenate([halves, [table]]),
        )

    def _way_out(self) -> Array:
        """(3,) unit vector along the table: where the rod points, clear of the core."""
        ahead = self.core.rotations[self.first + 1][:, 0]
        there = self.core.cells[: self.first + FIXED]
        return way_out(self.above, self.centre, there, ahead, self.target)

    # What is kept.

    def _clear(self, bends: list[Bend]) -> bool:
        return super()._clear(bends) and self.guard.holds(None, bends)

    def commit(self) -> None:
        """Makes the steps so far final."""
        # Of a frame that does not hold, waiting would not make one that does.
        if super()._clear([self.snapshot()]) and self._settle():
            self.saved = (self.time_s, self.state.copy())
            self.retries = 0
            self.guard.keep()

    def _holds(self, before: Bend | None, bends: Sequence[Bend]) -> bool:
        """What the guard says of snapshots; what it refuses is not a matter of contacts."""
        holds = self.guard.holds(before, bends)
        self._unheld = not holds
        return holds

    def _refused(self) -> None:
        self.go_back()
        if self._unheld:
            self._unheld = False
            self._exhausted = not self.guard.refuse(self.time_s)
            self._draw(1.0)
        elif self.retries > MOST_RETRIES:
            self.retries = 0
            self._draw(1.0)
            self.state.scale_velocities(0.0)

    def accelerations(self) -> Acceleration | None:
        """Under all forces; None when the run went back."""
        self._stiffen(self.window.positions)
        self._look_round()
        found = super().accelerations()
        self.contacts = 0  # the table is no reason to wait
        return found

    def look(self) -> Ended | None:
        """Lets the next unit go when it may be; whether it is straight, or stuck."""
        if self._drawn_at is not None and self.steps > self._drawn_at + self.table.drawn_steps:
            self._calm(self.table)
        return "stalled" if self._exhausted else super().look()

    def _ready(self) -> bool:
        p = self.table
        return bool(
            self.depth < self.allowed.back_off
            and self.modules < p.window
            and np.abs(np.diff(self.off[p.skipped :])).sum() < p.unbent
            and abs(self.off[-1]) < RELEASED_WITHIN_RAD
            and not self._would_loop()
        )

    def _would_loop(self) -> bool:
        """Whether the tail lies over the next unit."""
        hinges, first = self.peelable.hinges, self.next_first
        fresh = self.chain.folded_rad[hinges * first : hinges * self.first]
        angles = np.concatenate([fresh, self.state.angles])
        return self.guard.loops(Bend(time_s=self.time_s, first=first, angles=angles))

    def _release(self) -> None:
        before = Release(
            first=self.first,
            unit=self.unit,
            state=self.state.copy(),
            aim=self.aim,
            target=self.target,
            centre=self.centre,
            time_s=self.time_s,
            mark=self.windows.mark(),
        )
        super()._release()
        if self.first < before.first:
            self._releases.append(replace(before, mark=self.windows.mark()))
            if self.first < self._farthest:
                self._farthest, self._returns = self.first, 0

    # When it sticks.

    def _return(self) -> bool:
        """Goes back to an earlier release, farther each time; False when that was tried enough."""
        if self._returns >= self.table.most_returns or not self._releases:
            return False
        back = min(FIRST_RETURN * 2**self._returns, len(self._releases))
        self._returns += 1
        there = self._releases[-back]
        del self._releases[-back:]
        self.first, self.unit, self.centre = there.first, there.unit, there.centre
        self.aim, self.target = there.aim, there.target
        self._hold(there.first)
        self._build(there.state.angles.copy(), np.zeros_like(there.state.rates))
        self.windows.return_to(there.mark)
        self.time_s = there.time_s + 2e-6
        self.saved = (self.time_s, self.state.copy())
        self.guard.taken_back += 1
        self.depth, self.pushes = 0.0, 0
        self.progressed, self.least_left = self.steps, self._left()
        self._draw(1.0 + STRONGER * self._returns)
        return True

    def _unjam(self) -> bool:
        p = self.table
        left = self._left()
        if left < self.least_left - LEAST_PROGRESS_RAD:
            self.least_left = left
            self.progressed = self.steps
            if self.pushes:
                self._calm(p)
            self.pushes = 0
        elif self.steps - self.progressed >= p.patience:
            self.pushes += 1
            self.progressed = self.steps
            if (
                self.pushes % RELEASED_EVERY == 1
                and self.first
                and abs(self.off[-1]) < HELD_BEYOND_RAD
                and not self._would_loop()
            ):
                self._release()
            else:
                self._draw(1.0 + STRONGER * self.pushes)
        return self.pushes <= self.most_pushes or self._return()

    def stall_reason(self) -> str:
        """How much of it is let go, and what the guard refuses."""
        if self._exhausted:
            return (
                f"the chain is stuck with modules 0 to {self.first + 1} still folded: "
                f"{self.guard.why}, and the torque limit is {self.table.most_torque:g} w·p. Try "
                "another path, or stronger motors."
            )
        return super().stall_reason()
