"""What the compiled core takes and returns: named tuples of numbers and arrays, and constants.

Lengths are in pitches, masses in module masses, times in seconds and angles in radians.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
IndexT = TypeVar("IndexT", int, NDArray[np.int64])
Pairs = NDArray[np.int64]
Indices = NDArray[np.int64]
Int32s = NDArray[np.int32]
Flags = NDArray[np.bool_]
Grid = NDArray[np.int32]
Levels = NDArray[np.int8]
"""Levels of the hinges of a chain that turns by right angles: −1, 0 or 1 quarter turns each."""


class Joint(NamedTuple):
    """Poses of modules relative to the modules before them, in pitches.

    Rows of a table of T joints follow each other along a chain: the joint behind module i has row
    ``kinds[(first + i) % len(kinds)]``.

    Attributes:
        rigid_links: Number of links without hinges at the start of a chain.
        first: Number of module 0 in the chain that ``kinds`` begins with: not 0 in a window.
        kinds: (period,) rows of the joints.
        anchor: (T, 3) centre of the joint in the frame of the module before it.
        axes: (T, K, 3) unit hinge axes, outermost first.
        turn: (T, 3, 3) fixed rotation from the joint's frame to the next module's frame.
        offset: (T, 3) centre of the next module seen from the joint, in the next module's frame.
    """

    rigid_links: int
    first: int
    kinds: Ints
    anchor: Array
    axes: Array
    turn: Array
    offset: Array

    @property
    def hinges(self) -> int:
        """K, the number of hinges of one joint."""
        return self.axes.shape[1]

    def row(self, module: IndexT) -> IndexT:
        """Return the row of the joint behind a module, or behind each of an array."""
        return self.kinds[(self.first + module) % len(self.kinds)]

    def window(self, first: int, rigid_links: int = 0) -> Joint:
        """Return the joints of the modules from ``first`` on."""
        return self._replace(first=self.first + first, rigid_links=rigid_links)


class Hull(NamedTuple):
    """Convex parts of the modules of a chain at full size, about their centres, in pitches.

    A module is one of several pieces, and a piece is one or more parts.

    Attributes:
        vertices: (V, 3) corners of all parts, part by part.
        normals: (A, 3) unit normals of the faces, of each part one of each parallel pair.
        edges: (E, 3) unit directions of the edges, of each part one of each parallel set.
        parts: (Q, 6) numbers of the first vertex, the first normal and the first edge of each part,
            each before one past the last: ``vertices[parts[q, 0]:parts[q, 1]]``.
        pieces: (P, 2) number of the first part of each piece, and one past the last.
        kinds: (period,) the modules are the pieces ``kinds[0]``, ``kinds[1]``, …, over and over.
        first: The number among ``kinds`` at which module 0 begins.
        radius: Distance from the centre to the farthest corner of any piece.
    """

    vertices: Array
    normals: Array
    edges: Array
    parts: Ints
    pieces: Ints
    kinds: Ints
    first: int
    radius: float


class ModuleStates(NamedTuple):
    """Poses and velocities of all n modules, in the world frame.

    Attributes:
        positions: (n, 3) centres, in pitches.
        rotations: (n, 3, 3) orientations.
        velocities: (n, 3) velocities of the centres, in pitches per second.
        angular_velocities: (n, 3) ω, in rad/s.
    """

    positions: Array
    rotations: Array
    velocities: Array
    angular_velocities: Array

    @classmethod
    def empty(cls, modules: int) -> ModuleStates:
        """Return uninitialised arrays for a number of modules."""
        return cls(
            np.empty((modules, 3)),
            np.empty((modules, 3, 3)),
            np.empty((modules, 3)),
            np.empty((modules, 3)),
        )


class ReducedState(NamedTuple):
    """Generalised coordinates of a free chain and their velocities.

    Attributes:
        q: (J,) hinge angles, in rad.
        qd: (J,) hinge rates q̇, in rad/s.
        position: (3,) centre of the root, in pitches.
        rotation: (3, 3) orientation of the root.
        velocity: (3,) velocity of the root in the world frame.
        angular_velocity: (3,) ω of the root in its own frame.
    """

    q: Array
    qd: Array
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array


class Lumps(NamedTuple):
    """Rigid bodies fixed to the first and to the last module of a chain, of mass 0 for none.

    Attributes:
        masses: (2,) masses, in module masses.
        centres: (2, 3) centres of mass, in the frames of the modules, in pitches.
        axes: (2, 3, 3) principal axes of inertia as columns, in the frames of the modules.
        moments: (2, 3) principal moments about the centres of mass, in module mass · pitch².
    """

    masses: Array
    centres: Array
    axes: Array
    moments: Array

    @classmethod
    def none(cls) -> Lumps:
        """Return lumps of mass 0."""
        return cls(np.zeros(2), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)))


class ChainModel(NamedTuple):
    """Inertial parameters of a chain of n modules.

    Attributes:
        joint: The chain's joints.
        masses: (n,) masses of the modules, in module masses.
        inertia: (T, 3) principal moments of modules of mass 1 about their centres, in pitch²; a
            module's row is that of the joint behind it.
        lumps: Rigid bodies at both ends of the chain.
        fixed_base: True if module 0 is held.
        root: Index of the module whose motion is part of the reduced state.
    """

    joint: Joint
    masses: Array
    inertia: Array
    lumps: Lumps
    fixed_base: bool
    root: int


class Loads(NamedTuple):
    """Forces on a chain, and the rotor inertias of its hinges.

    Attributes:
        torques: (J,) τ of the hinges, in module mass · pitch² / s².
        rotor_inertias: (J,) rotor inertias of the hinges, in module mass · pitch².
        forces: (n, 3) forces at the modules' centres, in the world frame.
        end_torque: (3,) torque on the last module, in the world frame.
    """

    torques: Array
    rotor_inertias: Array
    forces: Array
    end_torque: Array


class ArticulatedBodies(NamedTuple):
    """Articulated-body quantities of the joint before each of n modules, of K hinges.

    Attributes:
        S: (n, K, 6) motion subspace: spatial accelerations of the module per q̈.
        U: (n, K, 6) IA S.
        D: (n, K, K) Sᵀ U, with the rotor inertias.
        root_inertia: (6, 6) IA of module 0.
        root_acceleration: (6,) spatial acceleration of module 0 without contacts.
    """

    S: Array
    U: Array
    D: Array
    root_inertia: Array
    root_acceleration: Array

    @classmethod
    def zeros(cls, modules: int, hinges: int) -> ArticulatedBodies:
        """Return arrays of zeros for a number of modules with K hinges a joint."""
        return cls(
            np.zeros((modules, hinges, 6)),
            np.zeros((modules, hinges, 6)),
            np.zeros((modules, hinges, hinges)),
            np.zeros((6, 6)),
            np.zeros(6),
        )


class Accelerations(NamedTuple):
    """Accelerations of a chain.

    Attributes:
        qdd: (J,) hinge accelerations q̈, in rad/s².
        root: (6,) spatial acceleration of the root at its centre, in the world frame.
    """

    qdd: Array
    root: Array


MAX_DIRECT_CONTACTS = 500
"""Maximum number of contact points of a simulation step whose forces are solved exactly, at a cost
that grows with the square of their number; with more, forces are approximate, off by some per cent.
Decision 0015."""


class PairContacts(NamedTuple):
    """Contact points between modules.

    Attributes:
        pairs: (m, 2) modules; the normal points to the second one.
        normals: (m, 3) unit normals in the world frame.
        points: (m, 3) points in the world frame, in pitches.
        depths: (m,) depths of penetration, in pitches.
    """

    pairs: Ints
    normals: Array
    points: Array
    depths: Array


class ContactModel(NamedTuple):
    """Stiffness of all contacts, in MuJoCo's parameters.

    Attributes:
        time_constant: Time in s in which a penetration decays, ``solref[0]``.
        damping_ratio: 1 for critical damping, ``solref[1]``.
        solimp: (5,) impedance as a function of depth.
        max_direct: Maximum number of contacts whose forces are solved exactly.
    """

    time_constant: float
    damping_ratio: float
    solimp: Array
    max_direct: int = MAX_DIRECT_CONTACTS


class DetectedContacts(NamedTuple):
    """Contacts that a collision has found.

    Attributes:
        points: m contact points.
        model: Stiffness of all of them.
    """

    points: PairContacts
    model: ContactModel


NO_CONTACTS = DetectedContacts(
    PairContacts(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)),
    ContactModel(1.0, 1.0, np.zeros(5)),
)
"""Contacts of a state in which nothing touches."""


class ControlLimits(NamedTuple):
    """Limits within which time step, drag and tension of an explosion adapt.

    Attributes:
        min_step_s, max_step_s: Smallest and largest time step, s.
        min_drag, max_drag: Smallest and largest drag α, 1/s.
        max_step_in_contact_s: Largest time step while modules touch, s.
        min_tension: Smallest factor of the tension.
        max_depth: Depth of contacts beyond which a step is refused, pitches.
        deep: Depth of contacts beyond which the tension falls, pitches.
    """

    min_step_s: float
    max_step_s: float
    min_drag: float
    max_drag: float
    max_step_in_contact_s: float
    min_tension: float
    max_depth: float
    deep: float


class Controlled(NamedTuple):
    """Numbers of an explosion that adapt from step to step.

    Attributes:
        step_s: Time step, s.
        drag: Drag α, 1/s.
        tension: Factor of the tension, 0…1.
        depth: Depth of the deepest contact in the last step, pitches.
        contacts: Number of contacts in the last step that moved on.
        steps: Number of steps so far.
    """

    step_s: float
    drag: float
    tension: float
    depth: float
    contacts: int
    steps: int


class RobotServos(NamedTuple):
    """Position servos of J hinges. Torques are in module mass · pitch² / s².

    Attributes:
        offsets: (J,) offsets of the encoders, in rad.
        friction: (J,) largest torques of dry friction.
        encoder_rad: Resolution of the encoders; 0 for none.
        stiffness: kp, torque per rad.
        damping: kv, torque per rad/s.
        expected_friction: Dry friction that the servos compensate.
        limit: Largest torque of a motor.
    """

    offsets: Array
    friction: Array
    encoder_rad: float
    stiffness: float
    damping: float
    expected_friction: float
    limit: float


class ServoTarget(NamedTuple):
    """Setpoint of J servos for the end of a step.

    Attributes:
        q, qd: (J,) hinge angles and rates.
        feedforward: (J,) torques that a robot without errors needs for them.
    """

    q: Array
    qd: Array
    feedforward: Array


class ServoTargets(NamedTuple):
    """Setpoints of J servos for the ends of S steps.

    Attributes:
        q, qd: (S, J) hinge angles and rates.
        feedforward: (S, J) torques that a robot without errors needs for them.
    """

    q: Array
    qd: Array
    feedforward: Array


class RobotTeam(NamedTuple):
    """R robots of the same chain, which differ in masses, friction and encoders alone.

    Attributes:
        joint: The chain's joints.
        masses: (R, n) masses of the modules.
        inertia: (T, 3) principal moments of modules of mass 1, see ``ChainModel``.
        lumps: Rigid bodies at both ends, the robots being the first axis.
        root: Index of the module whose pose is part of the state.
        servos: Their servos: offsets and friction are (R, J).
        hull: Full-size hull of a module.
        size: Scale of the hull for contacts.
        centres: (R, 3) centres of mass, which stay where they are, in pitches.
        step_s: Time step h.
        stops: (J, 2) smallest and largest angle of each hinge, rad; infinite for none.
    """

    joint: Joint
    masses: Array
    inertia: Array
    lumps: Lumps
    root: int
    servos: RobotServos
    hull: Hull
    size: float
    centres: Array
    step_s: float
    stops: Array


class RobotStates(NamedTuple):
    """States of R robots before S steps and after each, see ``ReducedState``.

    Attributes:
        q, qd: (R, S + 1, J) hinge angles and rates.
        position, rotation: (R, S + 1, 3), (R, S + 1, 3, 3) pose of the root.
        torques: (R, S, J) torques of the motors in each step.
    """

    q: Array
    qd: Array
    position: Array
    rotation: Array
    torques: Array

    @classmethod
    def empty(cls, robots: int, steps: int, hinges: int) -> RobotStates:
        """Return uninitialised arrays for a number of robots, steps and hinges."""
        return cls(
            np.empty((robots, steps + 1, hinges)),
            np.empty((robots, steps + 1, hinges)),
            np.empty((robots, steps + 1, 3)),
            np.empty((robots, steps + 1, 3, 3)),
            np.empty((robots, steps, hinges)),
        )


class SegmentLayout(NamedTuple):
    """Indices of a chain's S segments in MuJoCo's state.

    Attributes:
        starts: (S,) first modules of the segments.
        hinge_qpos, hinge_dofs: (J,) indices of the hinges in ``qpos`` and ``qvel``.
        root_qpos, root_dofs: (S,) first indices of the segments' free joints there.
    """

    starts: Ints
    hinge_qpos: Ints
    hinge_dofs: Ints
    root_qpos: Ints
    root_dofs: Ints


class PairLimits(NamedTuple):
    """Allowed displacements of two modules relative to each other in one step, in pitches.

    Attributes:
        radius: Radius of both modules; beyond twice that, they cannot touch.
        approach: By how much they may come nearer.
        slide: By how much they may slide along each other.
    """

    radius: float
    approach: float
    slide: float


class Solid(NamedTuple):
    """A module as a solid.

    Attributes:
        hull: Full-size hull.
        size: Scale of the hull.
        inner_radius: Radius of the largest ball about the full-size module's centre that fits into
            it, in pitches. Not used of modules of several parts.
    """

    hull: Hull
    size: float
    inner_radius: float


class Tolerance(NamedTuple):
    """Errors of hinges that a motion must stand: those of one hinge, and those of all hinges.

    Attributes:
        one_hinge_rad: Error of any one hinge while all others are exact, at any moment, in radians.
        each_hinge_rad: ε, largest error of each hinge, independent of the others, in radians.
        deviations: κ of lemma 12: how many standard deviations of a sum of errors are covered.
        spare: Distance in pitches that must remain besides.
    """

    one_hinge_rad: float
    each_hinge_rad: float
    deviations: float
    spare: float


class Levers(NamedTuple):
    """Distances of the joints between two modules a and b from points of these, in pitches.

    Attributes:
        longest: Largest over the joints of the smaller distance, from points of a or b: lemma 11.
        total, squares: Sum of the distances from points of b, and of their squares: lemma 12.
    """

    longest: float
    total: float
    squares: float


class Shape(NamedTuple):
    """A chain as the sweep sees it.

    Attributes:
        joint, hull: Of the module.
        size: Scale of the hull.
        min_checked_gap: Pairs fewer links apart are not checked.
        root: Module held still when there is no folded core; −1 when the core is.
        folded_rad: (J,) hinge angles of the folded core.
        core: (n, BODY_COLUMNS) the folded modules as bodies at rest.
        boxes: (n, 6) corners of the box around the centres of the folded modules up to each.
        origin, width, cells, starts, members: A grid of the folded centres: its corner (3,), the
            width of a cell in pitches, the number of cells along x, y and z; cell c holds
            ``members[starts[c]:starts[c + 1]]``, and c counts along z first.
        tail_positions, tail_rotations: (n, 3), (n, 3, 3) modules of a straight tail in the frame
            of the module that it begins at.
        tolerance: Errors of hinges whose effect is taken off every clearance.
    """

    joint: Joint
    hull: Hull
    size: float
    min_checked_gap: int
    root: int
    folded_rad: Array
    core: Array
    boxes: Array
    origin: Array
    width: float
    cells: Ints
    starts: Ints
    members: Ints
    tail_positions: Array
    tail_rotations: Array
    tolerance: Tolerance


class Angles(NamedTuple):
    """Hinge angles of frames.

    Attributes:
        first: (F,) first hinge of each frame's window.
        offsets: (F + 1,) start of each window among all angles.
        shift: Number of angles that come before ``values``.
        values: Angles in radians; window k begins at ``values[offsets[k] - shift]``.
    """

    first: Ints
    offsets: Ints
    shift: int
    values: Array


class SweepResult(NamedTuple):
    """The closest place of some frames and between them, see ``planner.clearance.sweep.Sweep``.

    Attributes:
        clearance: Least clearance seen, in pitches.
        frame: Frame number of it; a fraction means between two.
        first, second: The two modules, −1 if nothing is nearer than the cutoff.
        lower_bound: Lower bound of the clearance everywhere.
        unproved_at: Frame number around which nothing was proved; −1 if all is proved.
        midpoints: Configurations between frames that were checked.
    """

    clearance: float
    frame: float
    first: int
    second: int
    lower_bound: float
    unproved_at: float
    midpoints: int


class Link(NamedTuple):
    """The joints of a chain and the hulls that they link.

    Attributes:
        joint: The joints.
        hull: Full-size hull of the modules.
        size: Scale of the hulls.
        face: (T, 3) unit normals of the next module's near face, in that module's frame.
        distance: (T,) distances of that face from the joint in pitches.
    """

    joint: Joint
    hull: Hull
    size: float
    face: Array
    distance: Array


class Overlap(NamedTuple):
    """The deepest overlap of a motion.

    Attributes:
        depth: Deepest overlap seen, in pitches; 0 if nothing overlaps.
        frame: Frame number of it; a half means halfway between two frames.
        joint: Number of the joint; −1 if nothing overlaps.
        bound: Upper bound of the overlap over the whole motion, in pitches.
    """

    depth: float
    frame: float
    joint: int
    bound: float


class CoreCells(NamedTuple):
    """Cells of the modules that are still folded, beside a window.

    Attributes:
        grid: (X, Y, Z) index of the module in each cell when folded, −1 for none.
        low: (3,) cell of ``grid[0, 0, 0]``.
        box: (2, 3) smallest and largest cell of the core.
        first: Index of the window's first module in the chain.
    """

    grid: Grid
    low: Ints
    box: Ints
    first: int


class StepLimits(NamedTuple):
    """Allowed displacements in one step, see ``planner.parameters.parameters``.

    Attributes:
        joint_rad: Turn of a hinge.
        body: Displacement of a module, in pitches.
        tail_turn_rad: Turn of the tail.
        pair: Displacements of two modules relative to each other.
    """

    joint_rad: float
    body: float
    tail_turn_rad: float
    pair: PairLimits


class CoreField(NamedTuple):
    """Distances to the core.

    Attributes:
        distances: (X, Y, Z) distances of the cells of a grid, in pitches.
        low: (3,) first cell of the grid.
    """

    distances: Array
    low: Array


class FreeBodies(NamedTuple):
    """Modules and a tail as free bodies in MuJoCo's state.

    Attributes:
        qpos: Poses, seven numbers each: of the modules, others, and last of the tail.
        first: First module that may touch something.
        tail: Number of modules of the tail on the last module; 0 for none.
    """

    qpos: Array
    first: int
    tail: int


class SteppedChain(NamedTuple):
    """A chain that an explosion moves, with all that stays from step to step.

    Attributes:
        model: Inertial parameters.
        rotor_inertias: (J,) rotor inertias of the hinges.
        stops: (J, 2) smallest and largest angle of each hinge, rad; infinite for none.
        contact_model: Stiffness of contacts, with the smallest time constant; it is two steps.
        control: Limits of step, drag and tension.
    """

    model: ChainModel
    rotor_inertias: Array
    stops: Array
    contact_model: ContactModel
    control: ControlLimits


class SteppedState(NamedTuple):
    """State of such a chain; its arrays are changed by steps.

    Attributes:
        reduced: Hinges, and pose and velocity of the root.
        modules: Poses and velocities of all modules, as placed last.
        stiffness: (J,) stiffness of the hinges' springs.
        control: Step, drag and tension.
        time_s: Simulated time, s.
    """

    reduced: ReducedState
    modules: ModuleStates
    stiffness: Array
    control: Controlled
    time_s: float


class ChainLimits(NamedTuple):
    """Allowed displacements of a whole chain in one step.

    Attributes:
        joint_rad: Turn of a hinge.
        body: Displacement of a module, in pitches.
        loose_rad: The chain is loose if every hinge is bent less than this.
        packed, loose: Displacements of two modules relative to each other.
    """

    joint_rad: float
    body: float
    loose_rad: float
    packed: PairLimits
    loose: PairLimits


class ExplodingChain(NamedTuple):
    """A whole chain of n modules that explodes.

    Attributes:
        chain: Chain and joints.
        hull: Hull of a module of size 1.
        size: Size of the modules that touch, as a fraction of the pitch.
        cutoff: Distance in pitches beyond which modules do not repel each other.
        apart: Minimum number of links between modules that do.
        limits: Displacements that are allowed in one step.
    """

    chain: SteppedChain
    hull: Hull
    size: float
    cutoff: float
    apart: int
    limits: ChainLimits


class RadialDrive(NamedTuple):
    """Strengths of the forces on a whole chain.

    Attributes:
        weights: (n,) relative radial gains of the modules.
        creep: (n, 3) forces along the chain in one step; (0, 3) for none.
        bend_rad: Sum of the bends of the folded chain.
        length: Distance of the ends of the extended chain, in pitches.
        spring: Stiffness of the hinges' springs.
        tension: Largest force that may add up along the chain, as a multiple of ``spring``.
        gain: γ of the paper's eq. 3 while the chain is packed.
        loose_gain: Factor of γ once it is loose.
        weak_gain, weak_tension: Factors of γ and of the tension in the weak part of a pulse.
        ramp_begins, ramp_ends: Progress from which on and up to which γ grows.
        weak_steps: Number of the next steps that are in the weak part.
    """

    weights: Array
    creep: Array
    bend_rad: float
    length: float
    spring: float
    tension: float
    gain: float
    loose_gain: float
    weak_gain: float
    weak_tension: float
    ramp_begins: float
    ramp_ends: float
    weak_steps: int


class ChainSteps(NamedTuple):
    """States of a whole chain before each of N steps.

    Attributes:
        time_s: (N,) simulated times, s.
        angles: (N, J) hinge angles, rad.
        position: (N, 3) centres of the root, pitches.
        rotation: (N, 3, 3) its orientations.
        centres: (N, n, 3) centres of the modules, pitches.
    """

    time_s: Array
    angles: Array
    position: Array
    rotation: Array
    centres: Array

    @classmethod
    def empty(cls, steps: int, hinges: int, modules: int) -> ChainSteps:
        """Return arrays for a number of steps."""
        return cls(
            np.empty(steps),
            np.empty((steps, hinges)),
            np.empty((steps, 3)),
            np.empty((steps, 3, 3)),
            np.empty((steps, modules, 3)),
        )


class WindowBody(NamedTuple):
    """A window of m modules, with all that stays while it has the same modules.

    Attributes:
        chain: Modules and joints.
        core: Cells that are still folded.
        tail: Number of modules of the tail.
        bodies: Modules and tail in MuJoCo's state.
        cutoff: Distance in pitches beyond which modules and cells do not repel.
        loose_rad: The window is loose if every hinge is bent less than this.
        packed, loose: Displacements that are allowed in one step.
    """

    chain: SteppedChain
    core: CoreCells
    tail: int
    bodies: FreeBodies
    cutoff: float
    loose_rad: float
    packed: StepLimits
    loose: StepLimits


class FloatingDrive(NamedTuple):
    """Strengths and directions of the forces on a floating window.

    Attributes:
        weights: (m,) relative radial gains of the modules.
        centre: (3,) centre of the unit that was released last.
        aims: (A, 3) directions of the pull in the next steps; the last one stays.
        field: Distances to the core.
        spring: Stiffness of the springs near the core.
        stiffening: Factor of the stiffness far from it.
        gain: γ of the paper's eq. 3.
        tension: Largest sum of radial forces beyond a joint, as a multiple of ``spring``.
        pull: Force on the last module, as a multiple of ``spring``.
        alignment: Torque that turns the tail, as a multiple of ``spring``.
        weak_gain, weak_tension: Factors of γ, and of tension and pull, in the weak part of a pulse.
        weak_steps: Number of the next steps that are in that part.
        stiffness_period: Number of steps for which the springs keep their stiffness.
    """

    weights: Array
    centre: Array
    aims: Array
    field: CoreField
    spring: float
    stiffening: float
    gain: float
    tension: float
    pull: float
    alignment: float
    weak_gain: float
    weak_tension: float
    weak_steps: int
    stiffness_period: int


class GivenDrive(NamedTuple):
    """Forces on a window in one step.

    Attributes:
        forces: (m, 3) forces on the modules.
        end_torque: (3,) torque on the last module.
    """

    forces: Array
    end_torque: Array


class WindowSteps(NamedTuple):
    """States of a window before each of N steps.

    Attributes:
        time_s: (N,) simulated times, s.
        angles: (N, J) hinge angles, rad.
        centres: (N, m, 3) centres of the modules, pitches.
        along: (N, 3) unit vectors of the tail.
    """

    time_s: Array
    angles: Array
    centres: Array
    along: Array

    @classmethod
    def empty(cls, steps: int, hinges: int, modules: int) -> WindowSteps:
        """Return arrays for a number of steps."""
        return cls(
            np.empty(steps),
            np.empty((steps, hinges)),
            np.empty((steps, modules, 3)),
            np.empty((steps, 3)),
        )


class BentWindow(NamedTuple):
    """A configuration of a chain that is folded, then bent, then straight.

    Attributes:
        first: First module of the window, which is bent.
        angles: (H,) angles of the window's hinges, rad.
        centres: (m, 3) centres of the window's modules, pitches.
        along: (3,) unit vector of the straight rod.
    """

    first: int
    angles: Array
    centres: Array
    along: Array


MOVED, TOO_DEEP, NOT_FINITE = range(3)
"""How a step ended: it moved on, its contacts were too deep, or its numbers were not finite."""


class StepsDone(NamedTuple):
    """End of some steps.

    Attributes:
        control: Step, drag and tension after them.
        time_s: Simulated time, s.
        made: Number of steps that were made, with the last one.
        outcome: How the last one ended: ``MOVED``, ``TOO_DEEP`` or ``NOT_FINITE``.
    """

    control: Controlled
    time_s: float
    made: int
    outcome: int


EQUATIONS = 6
"""Number of rows that the balance of a chain that is not held has besides one for each hinge: three
for the sum of the forces and three for the sum of the moments."""


class FacetedHull(NamedTuple):
    """Convex parts of the modules of a chain with faces and edges, about their centres, in pitches.

    Attributes:
        vertices: (V, 3) corners of all parts, part by part.
        normals: (F, 3) outward unit normals of the faces.
        loops: (F, M) corners of each face, counterclockwise from outside, as numbers among those of
            the part; −1 behind the last one.
        edges: (E, 2) corners of each edge, as numbers among those of the part.
        directions: (D, 3) unit directions of the edges, of each part one of each parallel set.
        parts: (Q, 8) numbers of the first vertex, face, edge and direction of each part, each
            before one past the last.
        pieces: (P, 2) number of the first part of each piece, and one past the last.
        kinds: (period,) the modules are the pieces ``kinds[0]``, ``kinds[1]``, …, over and over.
        radius: Distance from the centre to the farthest corner of any piece.
    """

    vertices: Array
    normals: Array
    loops: Ints
    edges: Ints
    directions: Array
    parts: Ints
    pieces: Ints
    kinds: Ints
    radius: float


class ContactPoints(NamedTuple):
    """Contact points of a configuration.

    Attributes:
        first: (C,) modules that are pushed along the normals.
        second: (C,) modules that are pushed against them; −1 for the floor.
        feature: (C,) identifies a point of a pair, mostly with the same number in the next frame.
        points: (C, 3) points, in pitches.
        normals: (C, 3) unit normals.
        gaps: (C,) distances of the two surfaces, in pitches; negative where they overlap.
    """

    first: Ints
    second: Ints
    feature: Ints
    points: Array
    normals: Array
    gaps: Array


class Hinges(NamedTuple):
    """Hinges of a configuration, in the world frame.

    Attributes:
        axes: (J, 3) unit axes.
        anchors: (J, 3) points on them.
        before: (J,) modules before them.
    """

    axes: Array
    anchors: Array
    before: Ints


CLOSED: Final = -1
"""Fill of a cell that no path may enter."""


class Field(NamedTuple):
    """Cells that a path may use, and its goal.

    Attributes:
        fill: (m,) fill of each cell of a flat grid, 0…``FULL``, or ``CLOSED``; its rim is closed.
        cost: (m,) further energy of a path through each cell, in 1/``FULL`` cells.
        steps: (6,) differences of the flat indices of neighbours; k and k ^ 1 are opposite.
        volume: Volume of the solid, in cells.
        target: Requested number of cells, N.
        low, high: Smallest number, which is soft, and largest number of cells.
    """

    fill: Ints
    cost: Ints
    steps: Ints
    volume: float
    target: float
    low: int
    high: int


class Schedule(NamedTuple):
    """Moves of an annealing.

    Attributes:
        moves: Number of moves.
        hot: First temperature, in cells.
        cooling: Factor of the temperature after each 256 moves.
        thresholds: (1024,) exponentially distributed numbers, −ln u.
        kinds: (256,) kinds of moves, each as often as it is tried.
    """

    moves: int
    hot: float
    cooling: float
    thresholds: Array
    kinds: Ints


class SweptCells(NamedTuple):
    """Table of the cells near the way of a cube that turns by 90° about the origin of its layer.

    Attributes:
        start, stop: (R, R) rows of the cube at offset (a, b), a and b at least 0: entries
            ``start[a, b]`` to ``stop[a, b]``; start is −1 where the row is not computed yet.
        cells: (E, 2) offsets of cells that the cube comes near to.
        gaps: (E,) smallest distance of the cube from each during its turn, pitches.
        used: (1,) number of entries in use.
        half: Half the edge of a cube, pitches.
        reach: Distance up to which cells are entered, pitches.
    """

    start: NDArray[np.int32]
    stop: NDArray[np.int32]
    cells: NDArray[np.int16]
    gaps: NDArray[np.float32]
    used: NDArray[np.int64]
    half: float
    reach: float


class CubeScratch(NamedTuple):
    """Arrays that the kernels use for one state at a time.

    Attributes:
        cells: (N, 3) cell of each module.
        axes: (N, 3, 3) axes of each module as columns: ``axes[i, :, 0]`` is its x axis.
        grid: (G,) number of the module in each cell of the box around a state, plus 1; else 0.
        contacts: (N,) number of pairs of touching modules on either side of each module's joint.
        nearest, farthest: (N + 2 · ``BORDER``,) smallest and largest distance of the modules at
            rest in each layer from the axis of a turn.
    """

    cells: NDArray[np.int64]
    axes: NDArray[np.int64]
    grid: NDArray[np.int16]
    contacts: NDArray[np.int64]
    nearest: NDArray[np.float64]
    farthest: NDArray[np.float64]


class TurningGaps(NamedTuple):
    """Hash table of the smallest distances of two cells while one turns by +90° about a hinge.

    Attributes:
        keys: (H,) key of each entry, −1 where there is none; H is a power of two.
        gaps: (H,) smallest distance of each, pitches, at most ``reach``.
        used: (1,) number of entries.
        hull, size: Of the module.
        reach: Distance of neighbouring cells in pitches; larger gaps are not told apart.
    """

    keys: Ints
    gaps: NDArray[np.float32]
    used: Ints
    hull: Hull
    size: float
    reach: float


class TetrahedronScratch(NamedTuple):
    """Arrays that the kernels use for one state at a time.

    Attributes:
        nodes: (N + 1, 3) nodes of the trail.
        axes: (N, 3) direction of the hinge at the end of each module, one of its coordinates ±1.
        projected: (N, 3) cells as seen from a hinge: along its axis, and across.
        cells: (C,) hash table of the occupied cells: key, or −1.
        modules: (C,) their modules.
        contacts: (N,) number of pairs of touching modules on either side of each hinge.
    """

    nodes: Ints
    axes: Ints
    projected: Ints
    cells: Ints
    modules: NDArray[np.int32]
    contacts: Ints


class TurningChain(NamedTuple):
    """A chain as the search for turns by the hinges' own steps sees it; lengths are in pitches.

    Attributes:
        anchor: (N - 1, 3) centre of the joint behind each module but the last, in its frame.
        axes: (J, 3) axis of each hinge, in the frame of the hinge before it in its joint.
        turn: (N - 1, 3, 3) fixed rotation of each link, after its hinges.
        offset: (N - 1, 3) centre of the next module seen from the joint, in its own frame.
        hinge_of: (N,) first hinge of each link; the last entry is the number of hinges.
        steps: (J,) angle of a step of each hinge, rad.
        levels: (J, 2) smallest and largest angle of each hinge, in steps.
        period: (J,) number of steps of a full turn of each hinge, 0 where it cannot turn so far.
        hull: Of the modules.
        apart: Modules fewer links apart are not checked.
    """

    anchor: Array
    axes: Array
    turn: Array
    offset: Array
    hinge_of: Ints
    steps: Array
    levels: Ints
    period: Ints
    hull: Hull
    apart: int


class TurnSearch(NamedTuple):
    """Order and limits of a search for turns.

    Attributes:
        size: Size of the modules at first, at most 1.
        min_size: Size to which it is reduced if need be.
        depth_weight: Weight of a turn made in the score of a state; one that is left counts 1.
        near_weight: Weight of a pair of modules near each other.
        together: Maximum number of hinges that turn at once where no single one leads on, 1 to 3.
        max_states: Number of states after which the search stops.
        max_motions: Number of motions of several hinges after which it stops.
        max_work: Work of computing sizes after which it stops; 0 for no limit.
        seed: Seed of the order of states with the same score.
    """

    size: float
    min_size: float
    depth_weight: float
    near_weight: float
    together: int
    max_states: int
    max_motions: int
    max_work: int
    seed: int


class TurnSearchResult(NamedTuple):
    """Result of a search for turns.

    Attributes:
        outcome: 0 if the goal was reached, 1 if every state that can be reached was tried, 2 if the
            search stopped before.
        way: (T + 1, J) states to the goal, or to the one with the fewest turns left.
        states: (S, J) all states if every one was tried, else none.
        state_count: Number of states that can be reached, as far as they were tried.
        tried: Number of turns that were tried.
        motions: Number of motions of several hinges at once that were tried.
        work: Number of corners that were projected on axes to compute sizes.
        size: Size at which all turns of the way are free.
        next_size: Largest size of a turn that was not free; 0 for none.
    """

    outcome: int
    way: Levels
    states: Levels
    state_count: int
    tried: int
    motions: int
    work: int
    size: float
    next_size: float


class TurnTable(NamedTuple):
    """Outcome of each turn of each of some states.

    Attributes:
        next: (S, J, 2) number of the state after a turn of each hinge by −1 and by 1 step; −1 if
            modules meet on the way, −2 beyond a stop, −3 if the state is not among them.
        modules: (S, J, 2, 2) the two modules that meet.
        places: (S, J, 2) how much of the turn is made where they lie deepest in each other, 0 to 1.
    """

    next: Int32s
    modules: NDArray[np.int16]
    places: Array
