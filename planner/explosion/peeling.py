"""Peeling: a long chain comes off its folded core unit by unit, from its far end.

Only a window of modules near the last unit that was let go is simulated. What is still folded is
the core, boxes that don't move; what is straight already is one rod on the window's last module. So
a step costs the same whatever the chain's length, and the whole grows linearly with it.

Within the window it is the explosion of the paper with three additions: the radial force comes from
behind the unit, the last module is pulled along the ray by which the unit gets away, and a torque
turns the rod into that ray.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.explosion.explosion import (
    MAX_CHECKPOINT_RETRIES,
    MAX_STALLED_PULSES,
    PULSE_REPULSION_SCALE,
    PULSE_STEPS,
    PULSE_TENSION_SCALE,
    STOP_COMPLIANCE_RAD,
    ContactDepth,
    Ended,
    Explosion,
)
from planner.explosion.peeling_core import Core
from planner.explosion.peeling_proof import Proof
from planner.explosion.peeling_recorder import WindowRecorder
from planner.explosion.peeling_window import Peelable, WindowConfiguration
from planner.explosion.straightening import KINEMATIC_FRAME_S
from planner.kernels.folded_core import FIXED, CoreCells
from planner.kernels.pairs import PairLimits
from planner.kernels.window_forces import (
    StepLimits,
    WindowLoads,
    window_forces,
    window_inverse_step_limit,
)
from planner.motion.motion import Motion
from planner.motion.record import Record, Spent
from planner.parameters.explosion import PeelingParameters
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.anchored import Anchored, ContactFinder
from planner.simulation.model import Material
from planner.simulation.reduced import Acceleration, State

Array = NDArray[np.float64]
RELEASE_CHECK_STEPS: Final = 5
"""Steps between two checks for the release of the next unit. Chosen."""
RETIRE_CHECK_STEPS: Final = 20
"""Steps between two checks for outer joints that may become part of the rod. Chosen."""
STIFFNESS_UPDATE_STEPS: Final = 5
"""Steps between two updates of the springs' stiffness. Chosen."""
MIN_RETIRED_JOINTS: Final = 6
"""Minimum number of joints that become part of the rod together: each time the model of the window
is built anew. Chosen."""
MIN_LAST_UNIT_MODULES: Final = 6
"""Minimum number of modules of the last unit; fewer are released together with the unit before.
Chosen."""
WINDOW_FINISH_STEPS: Final = 25
"""Steps between two attempts to straighten the last window by kinematics. Chosen."""
PROGRESS_CHECK_STEPS: Final = 50
"""Steps between two checks of the progress. Chosen."""
MIN_PEELING_PROGRESS_RAD: Final = 0.5
"""Minimum decrease of the sum of all bends, rad, that counts as progress. Larger values start
pulses earlier. Chosen."""
MAX_PEELING_DEPTH_PITCH: Final = 0.016
"""Maximum depth of contacts, pitches; less where the module size to verify leaves less. Larger
values allow faster steps and less clearance. Chosen."""
CONTACT_ROOM_SHARE: Final = 0.9
"""Fraction of the room between the simulated hull and the size to verify that contacts may use.
Chosen."""
MIN_RELEASE_COSINE: Final = 0.5
"""Minimum cosine of the angle between the rod and its wanted direction before the next unit is
released. Larger values release later. Chosen."""
SAME_HEADING_COSINE: Final = 0.9
"""Minimum cosine of the angle between two directions of the rod that count as the same. Chosen."""
MIN_SNAPSHOT_CLEARANCE_PITCH: Final = 0.002
"""Minimum clearance of snapshots at the size to verify, pitches. Chosen."""
CLEARANCE_ROUNDING_PITCH: Final = 1e-9
"""Clearance that rounding may take from a snapshot, or from the motion to it, pitches."""


def peel(
    chain: Chain,
    parameters: PeelingParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Peel a folded chain off its core, from its last module on, and record the motion.

    Args:
        chain: A chain of cubes, starting in its folded configuration.
        parameters: Parameters of the peeling.
        seed: Seed of the slight unevenness of the radial gain.
        sink: Receives the snapshots as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Returns:
        The record, whether straight or not.

    Raises:
        InputError: ``not-peelable`` for modules that are no cubes, or off the lattice.
    """
    return Peeling(chain, parameters, seed, sink).run(progress, cancelled)


class Peeling(Explosion[WindowConfiguration, PeelingParameters]):
    """A run in which one unit after the other is released; the arguments are those of ``peel``."""

    strategy = "peel"
    doing = "peeling"

    def __init__(
        self,
        chain: Chain,
        parameters: PeelingParameters,
        seed: int,
        sink: Callable[[Motion], None] | None,
    ) -> None:
        self.chain = chain
        self.peelable = Peelable(chain)
        self.core: Core = self.peelable.core
        self.proof = Proof(chain, parameters.verify_size)
        self.windows = WindowRecorder(
            self.peelable,
            self.proof,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            sink=sink,
        )
        room = CONTACT_ROOM_SHARE * (parameters.geom_size - parameters.verify_size)
        super().__init__(
            parameters,
            ContactDepth.within(room, MAX_PEELING_DEPTH_PITCH),
            self.windows,
            seed=seed,
            modules=len(chain),
        )
        self.material = Material(
            geom_size=parameters.geom_size,
            stiffness=parameters.spring,
            armature=parameters.armature,
            stop_rad=chain.module.angle_limit_rad - STOP_COMPLIANCE_RAD,
        )
        self.finder = ContactFinder(chain, self.material)
        # Folded neighbours are no farther apart than the module size leaves.
        self.least = min(
            MIN_SNAPSHOT_CLEARANCE_PITCH,
            0.5 * (1.0 - parameters.verify_size) - CLEARANCE_ROUNDING_PITCH,
        )
        self.caps = StepLimits(
            joint_rad=parameters.joint_cap_rad,
            body=parameters.body_cap,
            tail_turn_rad=parameters.turn_rad,
            pair=PairLimits(chain.module.radius, parameters.pair_cap, parameters.slide_cap),
        )
        loose = self.caps.pair._replace(approach=parameters.pair_cap_loose)
        self.caps_loose = self.caps._replace(pair=loose)
        self.contacts = 0
        self.progressed = 0
        self.least_left = np.inf
        self.first = len(chain) - FIXED
        self.modules = 0
        self.unit = 0
        self.aim: Array = np.zeros(3)
        self.target: Array = np.zeros(3)
        self._let_go(np.zeros(0), np.zeros(0))

    @property
    def rod(self) -> int:
        """Number of modules of the rod."""
        return len(self.chain) - self.first - self.modules

    @property
    def most_steps(self) -> int:
        """Maximum number of steps of the run, by the chain's length."""
        return self.parameters.most_steps(len(self.chain))

    @property
    def error_limit(self) -> Spent:
        """Number of pushes without progress after which an error ends the run."""
        return Spent("pushes", MAX_STALLED_PULSES[self.strategy], self.pushes)

    @property
    def next_first(self) -> int:
        """First module of the window after the next release."""
        first = self.first - self.parameters.unit
        return first if first >= MIN_LAST_UNIT_MODULES else 0

    def place(self) -> None:
        """Compute the poses of the present state."""
        self.window.place(self.state)

    def motion(self) -> Motion:
        """Return all snapshots."""
        return self.windows.motion()

    def step(self) -> bool:
        """Make one step, after which no hinge is beyond its stop."""
        moved = super().step()
        if moved:
            self.state.stop_at(self.material.stop_of(self.chain.module))
        return moved

    def look(self) -> Ended | None:
        """Release the next unit if it may go; return how the run ended, if it has."""
        if self.steps % RETIRE_CHECK_STEPS == 0:
            self._retire()
        if self.first and self.steps % RELEASE_CHECK_STEPS == 0 and self._ready():
            self._release()
        if not self.first and self.steps % WINDOW_FINISH_STEPS == 0 and self._finish():
            return "straight"
        if self.steps % PROGRESS_CHECK_STEPS == 0 and not self._unjam():
            return "stalled"
        return None

    # What is simulated.

    def _let_go(self, angles: Array, rates: Array) -> None:
        """Widen the window by the next unit and build its model."""
        hinges = self.peelable.hinges
        first = self.next_first
        fresh = self.chain.folded_rad[hinges * first : hinges * self.first]
        self.unit = self.first - first
        self.first = first
        self._hold(first)
        self._build(np.concatenate([fresh, angles]), np.concatenate([0.0 * fresh, rates]))
        unit = self.core.cells[first + FIXED : first + FIXED + self.unit]
        if first:
            self.centre = unit.mean(axis=0)
            self.target = self._way_out()
        else:
            # Nothing is left in the way: all goes where the first link points.
            self.centre = self.core.cells[1]
            self.target = self.core.rotations[1][:, 0]
        if not self.aim.any():
            self.aim = self.target

    def _hold(self, first: int) -> None:
        """Hold the modules 0 to ``first`` still."""
        self.field = self.core.distances(first)
        self.finder.set_boxes(*self._boxes(first))
        self.core_box = self.core.extent(first + FIXED - 1)

    def _boxes(self, first: int) -> tuple[Array, Array]:
        """Return (B, 3) centres and half sides of boxes around the modules 0 to ``first``."""
        return self.core.boxes(first)

    def _way_out(self) -> Array:
        """Return the (3,) unit vector that the rod is to point along beside the core."""
        before = self.target if self.target.any() else None
        return self.core.way_out(self.field, self.centre, self.first + 1, before)

    def _build(self, angles: Array, rates: Array) -> None:
        p = self.parameters
        self.modules = self.peelable.modules(angles)
        position, rotation = self.peelable.base(self.first)
        chain = Chain(
            name=self.chain.name,
            module=self.chain.module,
            folded_rad=angles,
            folded_position=position,
            folded_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        )
        self.window = Anchored(
            chain, self.material, self.finder, rod=self.rod, heaviest_rod=p.rod_modules
        )
        self.state = State.at_rest(angles, position, rotation)
        self.state.rates = rates
        self.saved = (self.time_s, self.state.copy())
        self.retries = 0
        self.window.place(self.state)
        self._stiffen(self.window.positions)

    def _forces(self, positions: Array) -> Array:
        """Return (m, 3) forces: radial with the wanted tension, the pull at the end, and eq. 3."""
        p = self.parameters
        weak = self.advance_pulse()
        scale = p.spring * self.tension * (PULSE_TENSION_SCALE if weak else 1.0)
        loads = WindowLoads(
            weights=self.weights[self.first : self.first + self.modules],
            source=self.centre - 2.0 * self.aim,
            heading=self.aim,
            cutoff=p.repulsion_cutoff,
            gain=p.repulsion_gain * (PULSE_REPULSION_SCALE if weak else 1.0),
            tension=p.tension * scale,
            pull=p.pull * scale,
        )
        return window_forces(positions, loads, self._core_cells)

    @property
    def _core_cells(self) -> CoreCells:
        """Cells of the modules that are still folded."""
        return CoreCells(self.core.grid, self.core.low, self.core_box, self.first)

    def _stiffen(self, positions: Array) -> None:
        """Set the springs' stiffness: it grows with the distance from the core."""
        p = self.parameters
        heights = self.core.distance_at(self.field, positions)
        share = np.clip((heights[1:-1] - 2.0) / 6.0, 0.0, 1.0)
        stiffness = p.spring * (1.0 + (p.stiffening - 1.0) * share)
        self.window.set_stiffness(np.repeat(stiffness, self.peelable.hinges))

    def accelerations(self) -> Acceleration | None:
        """Return the acceleration under all forces; None if the run went back."""
        p = self.parameters
        window = self.window
        self.finder.set_contact_time_constant(self.contact_time_constant())
        self.aim = turned_towards(self.aim, self.target, p.turn_rad)
        forces = self._forces(window.positions)
        if self.steps % STIFFNESS_UPDATE_STEPS == 0:
            self._stiffen(window.positions)
        try:
            acceleration = window.accelerations(self.state, forces, self._end_torque())
        except SimulationError:
            if self.pushes >= self.error_limit.allowed:
                raise
            self._refused()
            return None
        if self.adapt_tension(acceleration.depth):
            self._refused()
            return None
        self.contacts = acceleration.contacts
        return acceleration

    def _end_torque(self) -> Array:
        """Return the (3,) torque on the last module that turns the rod to its direction."""
        p = self.parameters
        return p.alignment * p.spring * crossed(self.window.rotations[-1][:, 0], self.aim)

    def excess(self) -> float:
        """Return 1/Δt_max, 1/s, of hinges, modules near each other, and the rod."""
        p = self.parameters
        state, window = self.state, self.window
        window.place_velocities(state)
        loose = np.abs(state.angles).max() < p.loose_rad
        return window_inverse_step_limit(
            state.rates,
            window.modules,
            self._core_cells,
            self.rod,
            p.repulsion_cutoff,
            self.caps_loose if loose else self.caps,
        )

    # What changes the window.

    def _ready(self) -> bool:
        """Return True if the next unit may be released."""
        p = self.parameters
        # The joints next to the core may have to wait for what lies in their way.
        hinges = self.peelable.hinges
        unit = np.abs(self.state.angles[hinges * p.skipped : hinges * self.unit])
        return bool(
            self.depth < self.allowed.back_off
            and self.contacts <= p.release_contacts
            and self.modules < max(p.window, 1.2 * p.unit)
            and unit.max(initial=0.0) < p.release_rad
            and self.window.rotations[-1][:, 0] @ self.aim > MIN_RELEASE_COSINE
            and self.aim @ self.target > SAME_HEADING_COSINE
        )

    def _release(self) -> None:
        if self._settle():
            self._let_go(self.state.angles, self.state.rates)

    def _retire(self) -> None:
        """Make the outer hinges that are nearly straight part of the rod."""
        p = self.parameters
        hinges = self.peelable.hinges
        if self.depth >= self.allowed.back_off:
            return
        self.window.place(self.state)
        bent = np.abs(self.state.angles).reshape(-1, hinges).max(axis=1)
        if bent[-MIN_RETIRED_JOINTS:].max() >= p.retire_rad:
            return
        heights = self.core.distance_at(self.field, self.window.positions)
        good = (bent < p.retire_rad) & (heights[1:-1] > p.retire_height)
        count = len(good) if good.all() else int(np.argmin(good[::-1]))
        count = min(count, len(good) - 4)
        while count >= MIN_RETIRED_JOINTS:
            bends = self._straightened(count)
            if bends is not None:
                break
            count //= 2
        else:
            return
        if not self._settle():
            return
        self.windows.append(bends)
        self.time_s = bends[-1].time_s + 1e-6
        left = bends[-1].angles
        self._build(left.copy(), self.state.rates[: len(left)].copy())

    def _straightened(self, count: int) -> list[WindowConfiguration] | None:
        """Return snapshots that straighten the last ``count`` joints; None if modules touch."""
        p = self.parameters
        angles = self.state.angles
        left = angles[: len(angles) - self.peelable.hinges * count]
        _, rotations = self.peelable.poses(self.first, left)
        turned = float(rotations[-1][:, 0] @ self.window.rotations[-1][:, 0])
        if turned < SAME_HEADING_COSINE:
            return None
        bent = float(np.abs(angles[len(left) :]).max())
        largest = max(float(np.arccos(min(turned, 1.0))), bent)
        frames = int(np.ceil(largest / p.retire_step_rad))
        bends: list[WindowConfiguration] = []
        for k in range(1, frames):
            partly = angles.copy()
            partly[len(left) :] *= 1.0 - k / frames
            bends.append(self._bent(self.time_s + k * KINEMATIC_FRAME_S, partly))
        bends.append(self._bent(self.time_s + frames * KINEMATIC_FRAME_S, left.copy()))
        return bends if self._clear([self.snapshot(), *bends]) else None

    def _settle(self) -> bool:
        """Keep the present state as a snapshot: the window changes after it.

        Returns:
            False if modules touch on the way to it: then the run went back.
        """
        self.window.place(self.state)
        self.recorder.add(self.snapshot())
        if not self.windows.commit(least=self.least):
            self._refused()
            return False
        self.time_s += 1e-6
        return True

    def _refused(self) -> None:
        """Reject the steps since the last checkpoint; start a pulse when that did not help."""
        self.go_back()
        if self.retries > MAX_CHECKPOINT_RETRIES:
            self.retries = 0
            self.push()
            self.state.scale_velocities(0.0)

    def _clear(self, bends: list[WindowConfiguration]) -> bool:
        """Return True if configurations, and the motion between them, keep the clearance."""
        return self.proof.keeps(bends, self.least)[0] >= self.least

    def snapshot(self) -> WindowConfiguration:
        """Return the present state as a snapshot."""
        return WindowConfiguration(
            time_s=self.time_s,
            first=self.first,
            angles=self.state.angles.copy(),
            centres=self.window.positions.copy(),
            along=self.window.rotations[-1][:, 0].copy(),
        )

    def _bent(self, time_s: float, angles: Array) -> WindowConfiguration:
        """Return a configuration of the window that was not simulated."""
        positions, rotations = self.peelable.poses(self.first, angles)
        return WindowConfiguration(
            time_s=time_s,
            first=self.first,
            angles=angles,
            centres=positions,
            along=rotations[-1][:, 0],
        )

    def commit(self) -> None:
        """Make the steps so far final, if they keep the clearance."""
        if self._clear([self.snapshot()]) and self._settle():
            self.saved = (self.time_s, self.state.copy())
            self.retries = 0

    def go_back(self) -> None:
        """Return to the last checkpoint, slower."""
        super().go_back()
        # Its contacts may be deeper than allowed already: what makes them less deep is no reason
        # to go back again.
        self.depth = np.inf

    def _finish(self) -> bool:
        """End the run by pure kinematics if the window can be straightened without contact."""
        p = self.parameters
        angles = self.state.angles.copy()
        largest = float(np.abs(angles).max(initial=0.0))
        if largest > p.finish_rad or self.contacts:
            return False
        count = int(np.ceil(max(largest / p.snapshot_rad, 1.0)))
        bends = [
            self._bent(self.time_s + k * KINEMATIC_FRAME_S, (1.0 - k / count) * angles)
            for k in range(1, count + 1)
        ]
        if not self._clear([self.snapshot(), *bends]) or not self._settle():
            return False
        self.windows.append(bends)
        return True

    # When it sticks.

    def _left(self) -> float:
        """Return the sum of all bends that remain, rad."""
        return float(np.abs(self.state.angles).sum()) + self.peelable.bent_below(self.first)

    def _unjam(self) -> bool:
        """Release a unit or start a pulse if nothing moves; return False at the limit of tries."""
        p = self.parameters
        left = self._left()
        if left < self.least_left - MIN_PEELING_PROGRESS_RAD:
            self.least_left = left
            self.progressed = self.steps
            self.pushes = 0
        elif self.steps - self.progressed >= p.patience:
            self.pushes += 1
            self.progressed = self.steps
            room = self.modules + p.unit <= p.most_modules
            if self.first and room and self.depth < self.allowed.back_off:
                self._release()
            else:
                self.pulse_left = PULSE_STEPS[1]
        return self.pushes <= self.most_pushes

    def stall_reason(self) -> str:
        """Describe how many modules are released, and which joint stays bent."""
        angles = np.abs(self.state.angles).reshape(-1, self.peelable.hinges).max(axis=1)
        worst = int(np.argmax(angles))
        let_go = (
            f"with modules 0 to {self.first + 1} still folded"
            if self.first
            else "with all modules released"
        )
        return (
            f"the chain is stuck {let_go}: {self.pushes} random pushes in a row made no progress. "
            f"The joint of module {self.first + 1 + worst} is still bent by "
            f"{np.rad2deg(angles[worst]):.0f}°. Try to start at the other end, or try another path."
        )

    def unfolded(self) -> float:
        """Return the progress, 0 to 1, by the bends that remain."""
        whole = self.peelable.bent_below(len(self.chain) - 2)
        return 1.0 - self._left() / max(whole, 1e-9)


def turned_towards(a: Array, b: Array, most_rad: float) -> Array:
    """Return the (3,) unit vector ``a`` turned towards ``b`` by ``most_rad`` at most."""
    if a is b:
        return b
    angle = float(np.arccos(np.clip(a @ b, -1.0, 1.0)))
    if angle <= most_rad:
        return b
    side = b - (a @ b) * a
    length = float(np.linalg.norm(side))
    if length < 1e-6:
        side = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        length = float(np.linalg.norm(side))
    return np.cos(most_rad) * a + np.sin(most_rad) * side / length


def crossed(a: Array, b: Array) -> Array:
    """Return the (3,) cross product; NumPy's takes many times as long for two vectors."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
