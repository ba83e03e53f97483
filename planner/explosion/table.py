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
from planner.explosion.explosion import MAX_CHECKPOINT_RETRIES, Ended
from planner.explosion.from_above import Above, nearest_way
from planner.explosion.peeling import Peeling, crossed
from planner.explosion.peeling_recorder import Mark, WindowRecorder
from planner.explosion.peeling_window import WindowConfiguration
from planner.explosion.table_guard import Guard
from planner.explosion.table_way import way_out
from planner.kernels.folded_core import FIXED
from planner.motion.motion import Motion
from planner.motion.record import Record, Spent
from planner.parameters.explosion import TableParameters
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.reduced import Acceleration, State

Array = NDArray[np.float64]
TABLE_THICKNESS_PITCH: Final = 40.0
"""Thickness of the box that stands for the table, pitches: no contact passes through it. Chosen."""
TABLE_HALF_WIDTH_PITCH: Final = 1000.0
"""Distance from its centre to its edges, pitches: more than any chain is long. Chosen."""
MIN_TABLE_PROGRESS_RAD: Final = 0.3
"""Minimum decrease of the sum of all bends, rad, that counts as progress. Larger values draw new
forces earlier. Chosen."""
MIN_SPRING_BEND_RAD: Final = 1e-3
"""Bend of a hinge, rad, below which its spring is not made stiffer any more. Chosen."""
TABLE_LIFT_PITCH: Final = 0.006
"""Height of the simulated table above the real one, pitches, as contacts give. Larger values keep
modules higher. Chosen."""
TURNING_TORQUE_SCALE: Final = 0.8
"""Torque on each lying link per radian of its heading error, as a multiple of the pull. Larger
values turn the chain faster. Chosen."""
MAX_TURNING_ERROR_RAD: Final = 0.5 * np.pi
"""Heading error, rad, beyond which that torque grows no more. Chosen."""
MAX_LYING_RISE_PITCH: Final = 0.5
"""Maximum height difference of the ends of a lying link, pitches. Chosen."""
MAX_RELEASE_ERROR_RAD: Final = 1.2
"""Maximum heading error of the rod at the release of the next unit, rad. Larger values release
earlier. Chosen."""
MAX_FORCED_RELEASE_ERROR_RAD: Final = 2.4
"""Maximum heading error of the rod at a release for want of progress, rad. Chosen."""
PERTURBED_NEIGHBOURS: Final = 5
"""Number of neighbouring modules over which random forces are averaged. Larger values push longer
pieces alike. Chosen."""
MAX_SPRING_TORQUE_WP: Final = 8.0
"""Maximum torque of a spring, w·p (module weight × pitch). Chosen."""
FIRST_BACKTRACK_RELEASES: Final = 3
"""Number of releases that a stuck run goes back the first time; it doubles each time. Chosen."""
PERTURBATION_GROWTH: Final = 0.25
"""Relative growth of the random forces after each draw without progress. Chosen."""
FORCED_RELEASE_PERIOD: Final = 4
"""Checks without progress per forced release of the next unit: the first of so many. Chosen."""


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
    return TablePeeling(chain, parameters, seed, sink).run(progress, cancelled)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Release:
    """State of a run at the release of a unit: it may return there.

    Attributes:
        first, unit: First module of the window before, and number of modules of its last unit.
        state: State of the window.
        aim, target: (3,) present and wanted direction of the rod, unit vectors.
        centre: (3,) centre of the unit released before, pitches.
        time_s: Simulated time, s.
        mark: End of the record.
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
    """A run on a table; the arguments are those of ``explode_on_table``."""

    doing = "lying down"

    def __init__(
        self,
        chain: Chain,
        parameters: TableParameters,
        seed: int,
        sink: Callable[[Motion], None] | None,
    ) -> None:
        self.table = parameters
        rotation = matrix_from_wxyz(chain.folded_wxyz)
        self.up: Array = np.rint(rotation[2])
        """(3,) unit vector upwards, in the frame of the core, which is that of module 0."""
        self.above = Above(self.up)
        self.off: Array = np.zeros(1)
        """(m - 2,) heading errors of the window's links against the wanted direction, rad."""
        self.pushed: Array | None = None
        """(n, 3) random forces, in module weights; None while there are none."""
        self._drawn_at: int | None = None
        self._draws = np.random.default_rng(seed)
        self._exhausted = self._unheld = False
        self._releases: list[Release] = []
        self._returns = 0
        """Number of returns to an earlier release since the last record of progress."""
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
        """Run the explosion; the record includes the figures of the guard."""
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
        """Reset the forces to those without perturbation."""
        self._drawn_at = None
        self.spring_torque = p.largest_spring_torque
        self.pull, self.turning = p.pull, p.turning
        self.pushed = None

    def _draw(self, stronger: float) -> None:
        """Draw random forces, for a while; ``stronger`` scales them."""
        p, draws = self.table, self._draws
        self._drawn_at = self.steps
        size = stronger * draws.uniform(0.0, 0.5)
        each = draws.normal(size=(len(self.chain), 3))
        each -= 0.5 * np.outer(each @ self.up, self.up)
        alike = np.full(PERTURBED_NEIGHBOURS, 2.0 / PERTURBED_NEIGHBOURS)
        self.pushed = size * np.column_stack(
            [np.convolve(each[:, axis], alike, "same") for axis in range(3)]
        )
        self.pull, self.turning = draws.uniform(0.0, 1.0), draws.uniform(0.0, 2.0)
        largest = p.largest_spring_torque * draws.uniform(0.75, 1.5 * stronger)
        self.spring_torque = min(largest, MAX_SPRING_TORQUE_WP)

    @property
    def _rod_mass(self) -> float:
        return float(min(self.rod, self.table.rod_modules))

    def _forces(self, positions: Array) -> Array:
        """Return (m, 3) forces: weights, the pull at the end, and the random ones."""
        p, count = self.table, self.modules
        forces = np.zeros((count, 3))
        forces[FIXED:] = -self.up
        if self.pushed is not None:
            forces[FIXED:] += self.pushed[self.first + FIXED : self.first + count]
        forces[-1] += self.pull * self.aim - self._rod_mass * self.up
        forces += self._turning_round(positions)
        return p.weight * forces

    def _turning_round(self, positions: Array) -> Array:
        """Return (m, 3) forces that turn lying links to the wanted direction of the rod.

        A pull at the end would turn links that are far off no more, or the wrong way round.
        """
        forces = np.zeros_like(positions)
        links = np.diff(positions[FIXED:], axis=0)
        off = np.clip(self.off[1:], -MAX_TURNING_ERROR_RAD, MAX_TURNING_ERROR_RAD)
        lies = np.abs(links @ self.up) < MAX_LYING_RISE_PITCH
        couples = (
            TURNING_TORQUE_SCALE * self.pull * (off * lies)[:, None] * np.cross(links, self.up)
        )
        forces[FIXED + 1 :] += couples
        forces[FIXED:-1] -= couples
        return forces

    def _look_round(self) -> None:
        """Compute the heading errors of all links."""
        window = self.window
        first, last = window.rotations[1][:, 0], window.rotations[-1][:, 0]
        if abs(first @ self.up) > MAX_LYING_RISE_PITCH:
            first = self.target
        turned = self.above.turned(window.positions[1:], first, last)
        wanted = self.above.angle(self.target) - self.above.angle(first)
        self.off = turned - nearest_way(wanted, turned[-1])

    def _end_torque(self) -> Array:
        """Return the (3,) torque of the rod's weight, and that which turns it on the table."""
        along = self.window.rotations[-1][:, 0]
        flat = along - (along @ self.up) * self.up
        turn = crossed(flat / max(float(np.linalg.norm(flat)), 1e-6), self.aim)
        mass = self._rod_mass
        lever = 0.5 * (1.0 + mass) * along if mass else np.zeros(3)
        return self.table.weight * (self.turning * turn - mass * crossed(lever, self.up))

    def _stiffen(self, positions: Array) -> None:
        """Set springs of limited torque: the more a hinge is bent, the softer its spring."""
        p = self.table
        bends = np.maximum(np.abs(self.state.angles), MIN_SPRING_BEND_RAD)
        springs = np.minimum(p.spring_torque, self.spring_torque / bends)
        self.window.set_stiffness(p.weight * springs)

    # The table.

    @property
    def _lowest(self) -> float:
        """Height of the centres of modules that stand on the table, pitches along ``up``."""
        return float((self.core.cells @ self.up).min())

    def _boxes(self, first: int) -> tuple[Array, Array]:
        centres, halves = super()._boxes(first)
        # Not where the chain begins on the floor: its first free module would be jammed there.
        raised = float(self.core.cells[first + 1] @ self.up) > self._lowest + 0.5
        top = self._lowest - 0.5 + (TABLE_LIFT_PITCH if raised else 0.0)
        table = np.where(self.up != 0.0, 0.5 * TABLE_THICKNESS_PITCH, TABLE_HALF_WIDTH_PITCH)
        return (
            np.concatenate([centres, [(top - 0.5 * TABLE_THICKNESS_PITCH) * self.up]]),
            np.concatenate([halves, [table]]),
        )

    def _way_out(self) -> Array:
        """Return the (3,) unit vector along the table in which the rod is clear of the core."""
        ahead = self.core.rotations[self.first + 1][:, 0]
        there = self.core.cells[: self.first + FIXED]
        return way_out(self.above, self.centre, there, ahead, self.target)

    # What is kept.

    def _clear(self, bends: list[WindowConfiguration]) -> bool:
        return super()._clear(bends) and self.guard.holds(None, bends)

    def commit(self) -> None:
        """Make the steps so far final, if they keep the clearance and the guard accepts them."""
        # Of a frame that does not hold, waiting would not make one that does.
        if super()._clear([self.snapshot()]) and self._settle():
            self.saved = (self.time_s, self.state.copy())
            self.retries = 0
            self.guard.keep()

    def _holds(
        self, before: WindowConfiguration | None, bends: Sequence[WindowConfiguration]
    ) -> bool:
        """Return True if the guard accepts snapshots; a refusal is no matter of contacts."""
        holds = self.guard.holds(before, bends)
        self._unheld = not holds
        return holds

    def _refused(self) -> None:
        self.go_back()
        if self._unheld:
            self._unheld = False
            self._exhausted = not self.guard.refuse(self.time_s)
            self._draw(1.0)
        elif self.retries > MAX_CHECKPOINT_RETRIES:
            self.retries = 0
            self._draw(1.0)
            self.state.scale_velocities(0.0)

    def accelerations(self) -> Acceleration | None:
        """Return the acceleration under all forces; None if the run went back."""
        self._stiffen(self.window.positions)
        self._look_round()
        found = super().accelerations()
        self.contacts = 0  # the table is no reason to wait
        return found

    def look(self) -> Ended | None:
        """Release the next unit if it may go; return how the run ended, if it has."""
        if self._drawn_at is not None and self.steps > self._drawn_at + self.table.drawn_steps:
            self._calm(self.table)
        return "stalled" if self._exhausted else super().look()

    def _ready(self) -> bool:
        p = self.table
        return bool(
            self.depth < self.allowed.back_off
            and self.modules < p.window
            and np.abs(np.diff(self.off[p.skipped :])).sum() < p.unbent
            and abs(self.off[-1]) < MAX_RELEASE_ERROR_RAD
            and not self._would_loop()
        )

    def _would_loop(self) -> bool:
        """Return True if the tail lies over the next unit."""
        hinges, first = self.peelable.hinges, self.next_first
        fresh = self.chain.folded_rad[hinges * first : hinges * self.first]
        angles = np.concatenate([fresh, self.state.angles])
        return self.guard.loops(WindowConfiguration(time_s=self.time_s, first=first, angles=angles))

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
        """Return to an earlier release, farther each time; return False at the limit of returns."""
        if self._returns >= self.table.most_returns or not self._releases:
            return False
        back = min(FIRST_BACKTRACK_RELEASES * 2**self._returns, len(self._releases))
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
        self._draw(1.0 + PERTURBATION_GROWTH * self._returns)
        return True

    def _unjam(self) -> bool:
        p = self.table
        left = self._left()
        if left < self.least_left - MIN_TABLE_PROGRESS_RAD:
            self.least_left = left
            self.progressed = self.steps
            if self.pushes:
                self._calm(p)
            self.pushes = 0
        elif self.steps - self.progressed >= p.patience:
            self.pushes += 1
            self.progressed = self.steps
            if (
                self.pushes % FORCED_RELEASE_PERIOD == 1
                and self.first
                and abs(self.off[-1]) < MAX_FORCED_RELEASE_ERROR_RAD
                and not self._would_loop()
            ):
                self._release()
            else:
                self._draw(1.0 + PERTURBATION_GROWTH * self.pushes)
        return self.pushes <= self.most_pushes or self._return()

    def stall_reason(self) -> str:
        """Describe how many modules are released, and the refusals of the guard."""
        if self._exhausted:
            return (
                f"the chain is stuck with modules 0 to {self.first + 1} still folded: "
                f"{self.guard.why}, and the torque limit is {self.table.most_torque:g} w·p. Try "
                "another path, or stronger motors."
            )
        return super().stall_reason()
