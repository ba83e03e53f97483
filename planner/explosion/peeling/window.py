"""Peeling window: the moving modules between the folded core and the straight rod.

The modules before the window are held as boxes that do not move, the modules after it are one rod
on its last module. A release widens the window, a retirement shortens it; both build a new model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Final, Protocol

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.core import FIXED, chain_poses
from foldback.planner.core.structures import (
    BentWindow,
    CoreCells,
    CoreField,
    PairContacts,
    PairLimits,
    StepLimits,
    SteppedState,
    StepsDone,
    WindowBody,
    WindowSteps,
)
from foldback.planner.explosion.loop.step_control import (
    CONTACT_MODEL,
    StepControl,
)
from foldback.planner.explosion.peeling.core import Core, CoreOnTable, distance_at
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.fixed_base_window import FixedBaseWindow
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import State

MIN_LAST_UNIT_MODULES: Final = 6
"""Minimum number of modules of the last group that is released from the folded core; if fewer would
remain, they are released together with the group before."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowConfiguration:
    """A configuration of a chain that is folded, then bent, then straight.

    Attributes:
        time_s: Simulated time, s.
        first: First module of the window; it and the next one belong to the core.
        angles: (H,) angles of the window's hinges, rad; the modules after them are straight.
        centres: (m, 3) centres of the window's modules, pitches; None if unknown.
        along: (3,) unit vector of the rod; None if unknown.
    """

    time_s: float
    first: int
    angles: Array
    centres: Array | None = None
    along: Array | None = None

    @property
    def bent(self) -> BentWindow:
        """Window of a configuration whose centres and rod are known, as kernels take it."""
        assert self.centres is not None and self.along is not None
        return BentWindow(self.first, self.angles, self.centres, self.along)


class Peelable:
    """A chain that is peeled: its core, and the poses of its windows."""

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.core = Core(chain)
        self.hinges = chain.module.hinges_per_joint
        self._bent = np.concatenate([[0.0], np.cumsum(np.abs(chain.folded_rad))])

    def __len__(self) -> int:
        """Return the number of modules."""
        return len(self.chain)

    def modules(self, angles: Array) -> int:
        """Return the number of modules of a window with these hinges."""
        return len(angles) // self.hinges + 2

    def bent_below(self, first: int) -> float:
        """Return the sum of the folded angles before a window, rad."""
        return float(self._bent[self.hinges * first])

    def widened(self, bend: WindowConfiguration, first: int, hinges: int) -> Array:
        """Return the (hinges,) angles of a wider window that begins with an earlier module."""
        k = self.hinges
        angles = np.zeros(hinges)
        lead = k * (bend.first - first)
        angles[:lead] = self.chain.folded_rad[k * first : k * bend.first]
        angles[lead : lead + len(bend.angles)] = bend.angles
        return angles

    def base(self, first: int) -> tuple[Array, Array]:
        """Return the (3,) and (3, 3) pose of a window's first module, straight behind its second.

        The joint between them is folded, so this is not the pose of that module in the chain.
        """
        rotation = self.core.rotations[first + 1]
        return self.core.cells[first + 1] - rotation[:, 0], rotation

    def poses(self, first: int, angles: Array) -> tuple[Array, Array]:
        """Return (m, 3) centres and (m, 3, 3) orientations of a window's modules, see ``base``."""
        module = self.chain.module
        m = self.modules(angles)
        positions, rotations = np.empty((m, 3)), np.empty((m, 3, 3))
        chain_poses(
            angles,
            module.joint,
            0,
            *self.base(first),
            positions,
            rotations,
        )
        return positions, rotations


@dataclass(frozen=True, slots=True)
class Heading:
    """Direction of the rod; all vectors in the frame of the core.

    Attributes:
        aim: (3,) present direction, a unit vector; it turns towards the target.
        target: (3,) wanted direction, a unit vector.
        centre: (3,) centre of the unit that was released last, pitches.
    """

    aim: Array
    target: Array
    centre: Array

    def aims(self, count: int, turn_rad: float) -> list[Array]:
        """Return the (3,) directions in the next steps, up to the one that stays."""
        aims: list[Array] = []
        while len(aims) < count and (not aims or aims[-1] is not self.target):
            aims.append(rotate_towards(aims[-1] if aims else self.aim, self.target, turn_rad))
        return aims


@dataclass(frozen=True, slots=True)
class Held:
    """Modules that are held.

    Attributes:
        unit: Number of modules of the unit that was released last.
        cells: Cells of the core, and the first module of the window.
        field: Distance of each cell of the padded grid to the nearest folded one, pitches.
    """

    unit: int
    cells: CoreCells
    field: CoreField


class WindowForces(Protocol):
    """Forces on a window, of the place where it is peeled: afloat or on a table."""

    max_steps: ClassVar[int]
    """Maximum number of steps that are made at a time."""

    def make_steps(self, window: Window, body: WindowBody, run: WindowRun) -> StepsDone:
        """Make steps of a window under these forces."""
        ...

    def stiffness(self, window: Window) -> Array:
        """Return the (H,) stiffness of the springs."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowSetting:
    """Parts of a window that do not change when it does.

    Attributes:
        peelable: The chain.
        parameters: Parameters of the peeling.
        material: Joints and surfaces of the modules.
        finder: Finds contacts, with the boxes of the core.
        forces: Forces on the window.
        surroundings: Obstacles.
    """

    peelable: Peelable
    parameters: PeelingParameters
    material: Material
    finder: ContactFinder
    forces: WindowForces
    surroundings: Core | CoreOnTable

    def next_first(self, first: int) -> int:
        """Return the first module of a window after the next release."""
        after = first - self.parameters.unit
        return after if after >= MIN_LAST_UNIT_MODULES else 0

    def folded_between(self, first: int, end: int) -> Array:
        """Return the folded angles of the joints of some modules, rad."""
        hinges = self.peelable.hinges
        return self.peelable.chain.folded_rad[hinges * first : hinges * end]

    def hold(self, first: int, unit: int) -> Held:
        """Hold the modules 0 to ``first`` still, ``unit`` modules having been released after it."""
        core = self.peelable.core
        field = core.distances(first)
        self.finder.set_boxes(*self.surroundings.boxes(first))
        box = core.extent(first + FIXED - 1)
        return Held(unit, CoreCells(core.grid, core.low, box, first), field)

    def heading(self, group: Held, before: Heading | None) -> Heading:
        """Return the heading after a release."""
        core, first = self.peelable.core, group.cells.first
        if first:
            centre = core.cells[first + FIXED : first + FIXED + group.unit].mean(axis=0)
            target = self.surroundings.exit_direction(
                group.field, centre, first + 1, None if before is None else before.target
            )
        else:
            # Nothing is left in the way: all goes where the first link points.
            centre = core.cells[1]
            target = core.rotations[1][:, 0].copy()  # contiguous, as kernels take it
        return Heading(target if before is None else before.aim, target, centre)

    def model(self, first: int, angles: Array) -> FixedBaseWindow:
        """Build the model of the window that begins at a module and has (H,) angles, rad."""
        chain = self.peelable.chain
        window = Chain(
            name=chain.name,
            module=chain.module,
            folded_rad=angles,
            folded_position=self.peelable.base(first)[0],
            folded_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        )
        return FixedBaseWindow(
            window,
            self.material,
            self.finder,
            rod=len(chain) - first - self.peelable.modules(angles),
            heaviest_rod=self.parameters.rod_modules,
        )

    def step_limits(self) -> tuple[StepLimits, StepLimits]:
        """Return the limits of a step of a packed window, and of a loose one."""
        p = self.parameters
        radius = self.peelable.chain.module.radius
        packed = StepLimits(
            joint_rad=p.joint_cap_rad,
            body=p.body_cap,
            tail_turn_rad=p.turn_rad,
            pair=PairLimits(radius, p.pair_cap, p.slide_cap),
        )
        return packed, packed._replace(pair=packed.pair._replace(approach=p.pair_cap_loose))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReleasePoint:
    """State of a window at the release of a unit: a run may return there."""

    held: Held
    heading: Heading
    state: State
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class WindowRun:
    """Some steps of a window.

    Attributes:
        state: State, which the steps change.
        control: Step, drag and tension.
        find: Returns the contacts of modules that were placed.
        steps: States before each step; written.
    """

    state: SteppedState
    control: StepControl
    find: Callable[[], PairContacts | None]
    steps: WindowSteps


class Window:
    """World of a window, which begins with the chain's last unit.

    Args:
        setting: Parts that do not change.
    """

    def __init__(self, setting: WindowSetting) -> None:
        last = len(setting.peelable) - FIXED
        first = setting.next_first(last)
        angles = setting.folded_between(first, last)
        self.setting = setting
        self.held = setting.hold(first, last - first)
        self.heading = setting.heading(self.held, None)
        self.model = setting.model(first, angles)
        self.state = State.at_rest(angles, *setting.peelable.base(first))
        self.time_s = 0.0
        self._limits = setting.step_limits()
        self.model.place(self.state)
        self.model.set_stiffness(setting.forces.stiffness(self))

    @property
    def first(self) -> int:
        """First module of the window; it and the next one belong to the core."""
        return self.held.cells.first

    @property
    def modules(self) -> int:
        """Number of modules of the window."""
        return self.setting.peelable.modules(self.state.angles)

    @property
    def rod_modules(self) -> int:
        """Number of modules of the rod."""
        return len(self.setting.peelable) - self.first - self.modules

    @property
    def rod_direction(self) -> Array:
        """(3,) unit vector of the rod, as placed last."""
        return self.model.rotations[-1][:, 0]

    @property
    def bends_rad(self) -> Array:
        """(J,) largest bend of each joint of the window, rad."""
        return np.abs(self.state.angles).reshape(-1, self.setting.peelable.hinges).max(axis=1)

    @property
    def remaining_rad(self) -> float:
        """Sum of all bends that remain, rad."""
        bent = self.setting.peelable.bent_below(self.first)
        return float(np.abs(self.state.angles).sum()) + bent

    def heights(self, points: Array) -> Array:
        """Return rough (...,) distances of (..., 3) points to the core, pitches.

        Distances above ``MAX_FIELD_CELLS`` are not told apart.
        """
        return distance_at(self.held.field, points)

    def place(self) -> None:
        """Compute the poses of the present state."""
        self.model.place(self.state)

    def snapshot(self) -> WindowConfiguration:
        """Return the present state as a snapshot."""
        return WindowConfiguration(
            time_s=self.time_s,
            first=self.first,
            angles=self.state.angles.copy(),
            centres=self.model.positions.copy(),
            along=self.rod_direction.copy(),
        )

    def bent_to(self, angles: Array, time_s: float) -> WindowConfiguration:
        """Return a configuration of the window that was not simulated."""
        positions, rotations = self.setting.peelable.poses(self.first, angles)
        return WindowConfiguration(
            time_s=time_s,
            first=self.first,
            angles=angles,
            centres=positions,
            along=rotations[-1][:, 0].copy(),
        )

    def make_steps(self, control: StepControl, count: int) -> tuple[list[WindowConfiguration], int]:
        """Make steps until one is not finite or its contacts are too deep.

        Args:
            control: Step, drag and tension; they adapt.
            count: Maximum number of steps.

        Returns:
            The states before each step, and how the last step ended: ``MOVED``, ``TOO_DEEP`` or
            ``NOT_FINITE``.
        """
        setting, model, state = self.setting, self.model, self.state
        steps = WindowSteps.empty(count, len(state.angles), self.modules)
        window_state = SteppedState(
            state.reduced, model.modules, model.stiffness, control.controlled, self.time_s
        )
        run = WindowRun(window_state, control, setting.finder.find_placed, steps)
        done = setting.forces.make_steps(self, self._body(control), run)
        self.time_s = done.time_s
        control.go_on_with(done.control)
        configurations = [
            WindowConfiguration(
                time_s=time_s, first=self.first, angles=angles, centres=centres, along=along
            )
            for time_s, angles, centres, along in zip(
                steps.time_s[: done.made].tolist(),
                steps.angles,
                steps.centres,
                steps.along,
                strict=False,
            )
        ]
        return configurations, done.outcome

    def _body(self, control: StepControl) -> WindowBody:
        """Return the window as kernels take it."""
        p = self.setting.parameters
        return WindowBody(
            self.model.stepped_chain(CONTACT_MODEL, control.limits),
            self.held.cells,
            self.rod_modules,
            self.setting.finder.bodies,
            p.repulsion_cutoff,
            p.loose_rad,
            *self._limits,
        )

    def unfolded(self) -> float:
        """Return the progress, 0 to 1, by the bends that remain."""
        peelable = self.setting.peelable
        return 1.0 - self.remaining_rad / max(peelable.bent_below(len(peelable) - 2), 1e-9)

    def widened_angles(self) -> Array:
        """Return the (H,) angles of the window after the next release, rad."""
        first = self.setting.next_first(self.first)
        fresh = self.setting.folded_between(first, self.first)
        return np.concatenate([fresh, self.state.angles])

    def release(self) -> None:
        """Widen the window by the next unit."""
        setting, first = self.setting, self.setting.next_first(self.first)
        angles = self.widened_angles()
        rates = np.concatenate([np.zeros(len(angles) - len(self.state.rates)), self.state.rates])
        self.held = setting.hold(first, self.first - first)
        self._rebuild(angles, rates)
        self.heading = setting.heading(self.held, self.heading)

    def retire(self, angles: Array) -> None:
        """Make all joints part of the rod but those with (H,) angles, rad."""
        self._rebuild(angles.copy(), self.state.rates[: len(angles)].copy())

    def release_point(self) -> ReleasePoint:
        """Return the present state, for ``return_to``."""
        return ReleasePoint(
            held=self.held, heading=self.heading, state=self.state.copy(), time_s=self.time_s
        )

    def return_to(self, point: ReleasePoint) -> None:
        """Hold units again that were released after a state, and rest there."""
        self.held = self.setting.hold(point.held.cells.first, point.held.unit)
        self.heading = point.heading
        self._rebuild(point.state.angles.copy(), np.zeros_like(point.state.rates))
        self.time_s = point.time_s + 2e-6

    def _rebuild(self, angles: Array, rates: Array) -> None:
        """Build the model of another number of modules."""
        self.model = self.setting.model(self.first, angles)
        self.state = State.at_rest(angles, *self.setting.peelable.base(self.first))
        self.state.rates = rates
        self.model.place(self.state)
        self.model.set_stiffness(self.setting.forces.stiffness(self))


def rotate_towards(a: Array, b: Array, max_rad: float) -> Array:
    """Return the (3,) unit vector ``a`` turned towards ``b`` by ``max_rad`` at most."""
    if a is b:
        return b
    angle = float(np.arccos(np.clip(a @ b, -1.0, 1.0)))
    if angle <= max_rad:
        return b
    side = b - (a @ b) * a
    length = float(np.linalg.norm(side))
    if length < 1e-6:
        side = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        length = float(np.linalg.norm(side))
    return np.cos(max_rad) * a + np.sin(max_rad) * side / length
