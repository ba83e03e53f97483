"""Types of the compiled core; the sources beside it say how each function works."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.core.structures import (
    Accelerations,
    Angles,
    Array,
    ArticulatedBodies,
    BentWindow,
    ChainLimits,
    ChainModel,
    ChainSteps,
    ContactPoints,
    Controlled,
    ControlLimits,
    CoreCells,
    CubeScratch,
    DetectedContacts,
    ExplodingChain,
    FacetedHull,
    Field,
    Flags,
    FloatingDrive,
    FreeBodies,
    GivenDrive,
    Grid,
    Hinges,
    Hull,
    Indices,
    Int32s,
    Ints,
    Joint,
    Levels,
    Levers,
    Link,
    Loads,
    ModuleStates,
    Overlap,
    PairContacts,
    Pairs,
    RadialDrive,
    ReducedState,
    RobotServos,
    RobotStates,
    RobotTeam,
    Schedule,
    SegmentLayout,
    ServoTarget,
    ServoTargets,
    Shape,
    Solid,
    StepLimits,
    SteppedState,
    StepsDone,
    SweepResult,
    SweptCells,
    TetrahedronScratch,
    Tolerance,
    TurningChain,
    TurningGaps,
    TurnSearch,
    TurnSearchResult,
    TurnTable,
    WindowBody,
    WindowSteps,
)

BODY_COLUMNS: Final[int]
"""Number of columns of a row that describes the motion of one module about a moment: pose, first
and second derivatives, and bounds of higher ones over the interval around that moment."""
RELATIVE_COLUMNS: Final[int]
"""Number of columns of a row that describes the motion of one module relative to another: velocity,
acceleration and angular velocity (3 each), and a bound of the remaining motion (1)."""
ROTATION: Final[int]
"""First column of a module's rotation matrix, row by row, in a row of BODY_COLUMNS."""
VELOCITY: Final[int]
"""First column of the velocity of a module's centre in a row of BODY_COLUMNS."""
DISPLACEMENT_BOUND: Final[int]
"""Column of the bound of the displacement of a module's centre (lemma 4 of decision 0012)."""
FIXED: Final[int]
"""Number of modules at the start of a window (the section of the chain that is simulated) that
still belong to the core (the part that is folded and held): two, as the pose of a joint follows
from the two modules that it links."""
FULL: Final[int]
"""Fill of a cell that is wholly inside the solid; the unit of fills and costs is 1/4096 cell."""
MOVES: Final[int]
"""Number of kinds of moves."""
DETOUR: Final[int]
CUT: Final[int]
CORNER: Final[int]
GROW: Final[int]
RETRACT: Final[int]
SLITHER: Final[int]
BACKBITE: Final[int]
PARALLEL: Final[int]
BORDER: Final[int]
"""Number of empty cells on each side of a state in its grid, so that all cells beside one that
touches the state are in the grid."""
TABLE_FULL: Final[int]
"""Result of a function of the core whose table has no room for more."""
MAX_BISECTIONS: Final[int]
"""Maximum number of times that the interval between two frames is halved to prove that modules keep
clear in it. Beyond it the plan is refused as unproved. Decision 0012."""
MAX_COARSE_BISECTIONS: Final[int]
"""Maximum number of times that the interval between two frames is halved because motion in it is
too large to list all near pairs. Beyond it the plan is refused as unproved. Decision 0012."""
TIGHT_BISECTIONS: Final[int]
"""Number of halvings of the interval between two frames up to which a proved lower bound must come
close to the smallest clearance seen; after it any positive bound will do. Decision 0012."""
MAX_PAIRS_PER_MODULE: Final[int]
"""Mean number of near pairs per moving module above which an interval of large motion between two
frames is halved before its pairs are checked. Decision 0012."""
MAX_SERVO_PASSES: Final[int]
"""Maximum number of times that a step of a robot is computed: motors found beyond their limit in
one pass give the limit in the next."""
MIN_CELL_POINTS: Final[int]
"""Number of points from which on near pairs are searched in cells; for fewer, a walk along the
chain is as fast. Measured."""
ROUNDING_MARGIN: Final[float]
"""Minimum lower bound of the clearance of two modules, pitches, for them to count as proved clear
(lemma 10 of decision 0012). It must exceed the rounding error, 1e-10 for 10 000 modules, for the
proof to hold."""
GAP_TOLERANCE: Final[float]
"""Maximum amount, pitches, by which a stored gap is below the smallest distance of a turn."""
LARGE_MOTION: Final[float]
"""Displacement, pitches, above which a module moves too far within an interval of the motion for a
grid to find the pairs of modules that may meet: pairs are then searched along the chain, and the
interval is halved if the chain's end comes near others."""

def chain_poses(
    q: Array,
    joint: Joint,
    root: int,
    root_position: Array,
    root_rotation: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Write the poses of all modules of one configuration, outward from the root both ways.

    Args:
        q: (J,) hinge angles, in rad.
        joint: The chain's joints.
        root: Index of the module whose pose is given.
        root_position: (3,) its centre.
        root_rotation: (3, 3) its orientation.
        positions: (n, 3) written: the centres.
        rotations: (n, 3, 3) written: the orientations.
    """

def many_chain_poses(
    q: Array,
    joint: Joint,
    root: int,
    root_positions: Array,
    root_rotations: Array,
    positions: Array,
    rotations: Array,
) -> None:
    """Write the poses of F configurations, see ``chain_poses``.

    Args:
        q: (F, J) hinge angles, in rad.
        joint: The chain's joints.
        root: Index of the module whose poses are given.
        root_positions: (F, 3) its centres.
        root_rotations: (F, 3, 3) its orientations.
        positions: (F, n, 3) written: the centres.
        rotations: (F, n, 3, 3) written: the orientations.
    """

def chain_velocities(
    q: Array,
    qd: Array,
    joint: Joint,
    root: int,
    root_velocity: Array,
    root_angular_velocity: Array,
    modules: ModuleStates,
) -> None:
    """Write the velocities of all modules, in the world frame.

    From module to module v' = v + ω × (pivot − p) + ω' × (p' − pivot).

    Args:
        q, qd: (J,) hinge angles and rates.
        joint: The chain's joints.
        root: Index of the module whose velocities are given.
        root_velocity: (3,) velocity of its centre in the world frame.
        root_angular_velocity: (3,) ω in the world frame.
        modules: Poses as ``chain_poses`` writes them for ``q``; the velocities are written.
    """

def constrained_accelerations(
    model: ChainModel,
    state: ReducedState,
    loads: Loads,
    modules: ModuleStates,
    contacts: DetectedContacts,
    stops: Array,
    aba: ArticulatedBodies,
    out: Accelerations,
) -> bool:
    """Write the accelerations of a chain, hinges at their stops locked if they push outwards.

    Args:
        model: Inertial parameters of the chain.
        state: Hinges, and pose and velocity of the root.
        loads: Forces, and rotor inertias.
        modules: Poses and velocities of all modules.
        contacts: Contacts of the state.
        stops: (J, 2) smallest and largest angle of each hinge, rad; infinite for none.
        aba: Written.
        out: Written; ``qdd`` is NaN where the numbers are not finite.

    Returns:
        True if they are finite.
    """

def adapt_tension(control: Controlled, limits: ControlLimits, depth: float) -> Controlled:
    """Return the control of a step after its tension has adapted to the depth of contacts.

    Args:
        control: Control of the step.
        limits: Its limits.
        depth: Depth of the deepest contact, pitches.
    """

def limit_speeds(
    control: Controlled, limits: ControlLimits, inverse_step_limit: float, contacts: int
) -> tuple[Controlled, float]:
    """Return the control of the next step, and the factor by which speeds are to be scaled.

    Args:
        control: Control of the step.
        limits: Its limits.
        inverse_step_limit: 1/Δt_max, 1/s: a step is allowed while its product with it is at most 1.
        contacts: Number of contacts.
    """

def servo_torques(
    q: Array,
    qd: Array,
    target: ServoTarget,
    noise: Array,
    servos: RobotServos,
    step_s: float,
    commanded: Array,
    friction_damping: Array,
) -> None:
    """Write the torques of servos as if the present angles were those at the end of the step.

    τ = kp (q* − q_measured − h q̇) + kv (q̇* − q̇) + τ_feedforward + τ_friction.

    Args:
        q, qd: (J,) present hinge angles and rates.
        target: Setpoint for the end of the step.
        noise: (J,) noise of the encoders, in rad.
        servos: The servos.
        step_s: Time step h.
        commanded: (J,) written: torques.
        friction_damping: (J,) written: torque of dry friction per rad/s.
    """

def advance(
    state: ReducedState,
    accelerations: Accelerations,
    step_s: float,
    stops: Array,
    model: ChainModel,
    modules: ModuleStates,
) -> bool:
    """Integrate by semi-implicit Euler: q̇ ← q̇ + h q̈, q ← q + h q̇; hinges halt at their stops.

    Args:
        state: Changed.
        accelerations: Accelerations at the beginning of the step.
        step_s: Time step h.
        stops: (J, 2) smallest and largest angle of each hinge, rad; infinite for none.
        model: Inertial parameters of the chain.
        modules: Written: poses and velocities of all modules.

    Returns:
        True if all hinge angles are finite.
    """

def remove_net_momentum(
    model: ChainModel, centre: Array, state: ReducedState, modules: ModuleStates
) -> None:
    """Remove momentum and angular momentum of a free chain, and restore its centre of mass.

    Args:
        model: Inertial parameters of the chain.
        centre: (3,) centre of mass to restore.
        state: State of the chain; the root's part is changed.
        modules: Poses and velocities of all modules; changed.
    """

def robot_steps(
    team: RobotTeam,
    targets: ServoTargets,
    noise: Array,
    state: ReducedState,
    modules: ModuleStates,
    out: RobotStates,
    made: Ints,
) -> None:
    """Make steps of robots until all are made, or modules touch or a hinge is at its stop.

    Args:
        team: R robots, free chains.
        targets: S setpoints for the ends of the steps.
        noise: (R, S, J) noise of the encoders, in rad.
        state: Changed; the robots are the first axis of each array.
        modules: Poses and velocities of all modules of the state, changed; (R, n, …).
        out: States after the steps that are made, written; those before them are left.
        made: (R,) number of steps that each robot has made, changed. Where it stays below S, the
            next step needs contacts or stops, or would not be finite.
    """

def write_free_bodies(positions: Array, rotations: Array, bodies: FreeBodies) -> None:
    """Write the poses of modules, and of a tail on the last one, as MuJoCo takes them.

    Args:
        positions: (n, 3) centres of the modules, in pitches.
        rotations: (n, 3, 3) their orientations.
        bodies: MuJoCo's state; written.
    """

def write_state(
    q: Array, qd: Array, modules: ModuleStates, layout: SegmentLayout, qpos: Array, qvel: Array
) -> None:
    """Write the hinges, and the poses and velocities of the segments' roots.

    Args:
        q, qd: (J,) hinge angles and rates.
        modules: Poses and velocities of all modules.
        layout: Indices in MuJoCo's state.
        qpos, qvel: MuJoCo's state; written.
    """

def write_root_velocities(modules: ModuleStates, starts: Ints, root_dofs: Ints, out: Array) -> None:
    """Write the velocities of the segments' roots: MuJoCo has ω in the frame of the body.

    Args:
        modules: Poses and velocities of all modules.
        starts: (S,) first modules of the segments.
        root_dofs: (S,) first indices of their free joints in ``qvel``.
        out: MuJoCo's ``qvel``; written.
    """

def near_pairs(points: Array, cutoff: float, apart: int) -> Pairs:
    """Return pairs (i, j), i < j, closer than ``cutoff`` and at least ``apart`` links apart.

    Consecutive points must be at most 1 apart. Long chains are sorted into a hashed grid of cells
    as wide as the cutoff: the cost is linear in the points.

    Args:
        points: (n, 3) positions, in pitches.
        cutoff: Largest distance, in pitches.
        apart: Smallest j − i.

    Returns:
        (P, 2) indices, ordered by i.
    """

def repulsion(points: Array, pairs: Pairs, gain: float, out: Array) -> None:
    """Add the repulsion of near modules, gain / distance², to (n, 3) forces: the paper's eq. 3.

    Args:
        points: (n, 3) centres of the modules.
        pairs: (P, 2) near pairs.
        gain: γ of the equation.
        out: (n, 3) forces, changed.
    """

def pair_separation(
    gap: Array,
    rotation_a: Array,
    rotation_b: Array,
    hull: Hull,
    size: float,
    enough: float,
    first: int = 0,
    second: int = 0,
) -> float:
    """Return the separation of two modules of a chain, see the top of this file.

    Args:
        gap: (3,) centre of b minus centre of a, in pitches.
        rotation_a, rotation_b: (3, 3) orientations.
        hull: Full-size hull of the modules.
        size: Scale of the hull.
        enough: Pitches; the search stops when the separation is known to be at least this.
        first, second: Numbers of the two modules, which tell their pieces.
    """

def least_separation(
    positions: Array, rotations: Array, pairs: Pairs, hull: Hull, size: float, enough: float
) -> tuple[float, int, int]:
    """Return the least separation over pairs of one configuration, and the pair that has it.

    If all pairs are at least ``enough`` apart, the result is ``enough`` with the pair (−1, −1).

    Args:
        positions, rotations: (n, 3) centres in pitches, (n, 3, 3) orientations.
        pairs: (P, 2) modules.
        hull, size: Full-size hull of each module, and its scale.
        enough: Pitches from which on separations are not told apart.
    """

def module_clearances(
    positions: Array,
    rotations: Array,
    solid: Solid,
    min_checked_gap: int,
    cutoff: float,
    clearance: NDArray[np.float32],
    nearest: NDArray[np.int32],
) -> None:
    """Write the least separation of every module in every configuration, and the other module.

    A separation lies between the centres' distance less two radii and less two inner radii, so the
    nearest centre of a module bounds its result, and most pairs need no separating axes.

    Args:
        positions: (F, n, 3) centres.
        rotations: (F, n, 3, 3) orientations.
        solid: Each module.
        min_checked_gap: Pairs fewer links apart don't count.
        cutoff: Pitches from which on separations are not told apart.
        clearance: (F, n) written; ``cutoff`` where nothing is nearer.
        nearest: (F, n) written: the other module of the pair; −1 where nothing is nearer.
    """

def rod_body(last: Array, place: Array, rotation: Array, half: float, body: Array) -> None:
    """Write the body of a module that is rigidly joined to the module ``last``: lemma 4.

    Args:
        last: (BODY_COLUMNS,) the module that it moves with.
        place, rotation: (3,), (3, 3) its pose in the frame of ``last``.
        half: h.
        body: (BODY_COLUMNS,) written.
    """

def move_bodies(
    angles: Array, rates: Array, half: float, joint: Joint, root: int, bodies: Array
) -> None:
    """Write all bodies of a stretch of a chain: lemmas 1 to 4.

    Args:
        angles, rates: q at s = 0 and q̇, for the joints of the stretch.
        half: h.
        joint: The chain's joints; the rigid links are those at the start of the stretch.
        root: The body that is held still; its pose is given.
        bodies: (m, BODY_COLUMNS) written.
    """

def relative_motion_bound(
    a: Array, b: Array, half: float, radius: float, reach: float, relative: Array
) -> tuple[float, float]:
    """Bound how near body b gets to body a: lemmas 5 and 6.

    Args:
        a, b: (BODY_COLUMNS,) bodies, see ``planner/core/motion_bounds.hpp``.
        half: h: the interval is |s| ≤ h.
        radius: ρ, of the ball about a module.
        reach: Largest length of the links between the two that move against each other, in
            pitches: k of lemma 5, where each is one pitch long.
        relative: (RELATIVE_COLUMNS,) written.

    Returns:
        Pitches by which any point of b may get nearer to a than at s = 0, along whatever axis; and
        the distance of the centres at s = 0.
    """

def directional_motion_bound(relative: Array, axis: Array, half: float, radius: float) -> float:
    """Return loss(n) of lemma 6: how near any point of b gets along an axis fixed in a.

    Args:
        relative: (RELATIVE_COLUMNS,) of ``relative_motion_bound``.
        axis: (3,) n, of length 1.
        half, radius: h and ρ.
    """

def allowance(tolerance: Tolerance, lever: Levers, joints: float, hinges: float) -> float:
    """Return the distance by which errors bring two modules nearer, in pitches; ∞ if unbounded.

    Args:
        tolerance: The errors.
        lever: Bounds of the levers of the pair.
        joints: Number of joints between the two.
        hinges: Number of hinges of a joint.
    """

def rigid_clearances(
    positions: Array, rotations: Array, pairs: Ints, hull: Hull, size: float, cutoff: float
) -> tuple[Array, Ints]:
    """Return the clearance of the modules 0 … j of a rigid chain for each j, and the pair.

    Args:
        positions, rotations: (n, 3) centres in pitches, (n, 3, 3) orientations.
        pairs: (P, 2) modules that are checked, the earlier one first.
        hull, size: Full-size hull of each module, and its scale.
        cutoff: Pitches from which on clearances are not told apart.

    Returns:
        (n,) and (n, 2); (−1, −1) where no pair is below ``cutoff``.
    """

def sweep_frames(
    shape: Shape,
    angles: Angles,
    start: int,
    stop: int,
    cutoff: float,
    rigid: Array,
    per_frame: Array,
    ratio: float,
) -> SweepResult:
    """Prove the clearance of the frames ``start`` … ``stop`` − 1 and from each to the next.

    Args:
        shape: The chain.
        angles: All frames, and of the angles at least those of ``start`` to ``stop`` (included).
        start, stop: Frame numbers.
        cutoff: Pitches from which on clearances are not told apart.
        rigid: (F,) clearance of what is rigid in each frame.
        per_frame: (F,) written: clearance of each frame.
        ratio: Part of the least clearance seen that the lower bound should reach, where it can.
    """

def closest_frame(
    shape: Shape,
    angles: Angles,
    start: int,
    stop: int,
    cutoff: float,
    rigid: Array,
    per_frame: Array,
) -> SweepResult:
    """Return the least clearance of the frames ``start`` … ``stop`` − 1; nothing is proved.

    Args:
        shape, angles, start, stop, cutoff, rigid: See ``sweep_frames``.
        per_frame: (F,) written: clearance of each frame, at most the least of those before.
    """

def deepest_overlap(
    link: Link, folded: Array, first: Ints, offsets: Ints, values: Array
) -> Overlap:
    """Find the deepest overlap of linked modules at all frames and halfway between them.

    Args:
        link: The joints and their hulls.
        folded: (J,) hinge angles before a window in radians; behind it they are 0.
        first: (F,) first hinge of each frame's window.
        offsets: (F + 1,) start of each window in ``values``.
        values: Angles of all windows in radians.
    """

def box_cover(grid: Grid, last: int, out: Ints) -> int:
    """Cover the cells with indices 0 to ``last`` with boxes, greedily.

    Args:
        grid: (X, Y, Z) index of the module in each cell; negative in an empty one.
        last: Largest index that is covered.
        out: (B, 6) written: smallest cell and size of each box; B is enough for all.

    Returns:
        Number of boxes.
    """

def write_core_distances(grid: Grid, last: int, reach: int, box: Ints, field: Array) -> None:
    """Write the distances of cells to the core, in a box of a padded grid.

    Args:
        grid: (X, Y, Z) index of the module in each cell; negative in an empty one.
        last: Largest index of a module of the core.
        reach: Distances above it count as this many cells.
        box: (2, 3) first and last cell of the box, in the padded grid.
        field: (X + 2 p, Y + 2 p, Z + 2 p) distances of the padded grid; written in the box.
    """

def distances_at(field: Array, low: Array, points: Array, out: Array) -> None:
    """Write (k,) approximate distances of points to the cells that a distance field is about.

    Args:
        field: (X, Y, Z) distance of each cell, whose centres are whole numbers apart.
        low: (3,) centre of the first cell.
        points: (k, 3) positions; outside the field, the distance to it is added.
        out: (k,) written.
    """

def chain_steps(
    chain: ExplodingChain,
    drive: RadialDrive,
    state: SteppedState,
    find: Callable[[], PairContacts | None],
    out: ChainSteps,
) -> tuple[StepsDone, float]:
    """Make steps of a whole chain until one is not finite or its contacts are too deep.

    Args:
        chain: The chain.
        drive: Forces on it; with creep, of one step.
        state: State; its arrays are changed.
        find: Returns the contacts of the state, or None if there are none; called where modules
            may touch or a hinge is at its stop.
        out: States before each step; written.

    Returns:
        The end of the steps, and the looseness in the last one: 0 while the chain is packed, 1
        once it has come apart.
    """

def chain_forces(
    drive: RadialDrive, tension: float, angles: Array, positions: Array, pairs: Pairs, out: Array
) -> float:
    """Write the forces on a whole chain in one step: eq. 1 and 3 of the paper, and creep.

    Args:
        drive: Strengths.
        tension: Factor of the tension.
        angles: (J,) hinge angles, rad.
        positions: (n, 3) centres of the modules, in pitches.
        pairs: (P, 2) modules that repel each other.
        out: (n, 3) forces; written.

    Returns:
        The looseness of the chain, see ``chain_steps``.
    """

def chain_inverse_step_limit(
    state: ReducedState, modules: ModuleStates, pairs: Pairs, limits: ChainLimits
) -> float:
    """Return 1/Δt_max, 1/s, of hinges, near modules, and all modules.

    Args:
        state: Hinges.
        modules: Poses and velocities of all modules.
        pairs: (P, 2) near modules.
        limits: Displacements that are allowed in one step.
    """

def unfolded_share(angles: Array, positions: Array, folded_rad: float, length: float) -> float:
    """Return the progress of a chain from 0 to 1: half by its bends, half by its span.

    Args:
        angles: (J,) hinge angles, rad.
        positions: (n, 3) centres of the modules, in pitches.
        folded_rad: Sum of the bends of the folded chain.
        length: Distance of the ends of the extended chain, in pitches.
    """

def floating_peel_steps(
    window: WindowBody,
    drive: FloatingDrive,
    state: SteppedState,
    find: Callable[[], PairContacts | None],
    out: WindowSteps,
) -> StepsDone:
    """Make steps of a floating window until one is not finite or its contacts are too deep.

    Args:
        window: Modules of the window.
        drive: Forces on them.
        state: State; its arrays are changed.
        find: Returns the contacts of the modules in MuJoCo's state, or None if there are none.
        out: States before each step; written.
    """

def peel_step(
    window: WindowBody,
    drive: GivenDrive,
    state: SteppedState,
    find: Callable[[], PairContacts | None],
    out: WindowSteps,
) -> StepsDone:
    """Make a step of a window under given forces; see ``floating_peel_steps``."""

def window_stiffness(positions: Array, drive: FloatingDrive, out: Array) -> None:
    """Write the (J,) stiffness of the springs of a floating window.

    Args:
        positions: (m, 3) centres of the window's modules.
        drive: Forces on them.
        out: Written.
    """

def window_distances(
    a: BentWindow, b: BentWindow, folded: Array, hinges: int
) -> tuple[float, float, float]:
    """Return how far two windows of a chain are apart.

    Args:
        a, b: The windows.
        folded: Angles of the folded chain's hinges.
        hinges: Number of hinges of a joint.

    Returns:
        The largest turn of a hinge, in rad; the largest distance of a module of both windows, in
        pitches; and the cosine of the angle between their rods.
    """

def window_inverse_step_limit(
    qd: Array, modules: ModuleStates, core: CoreCells, tail: int, cutoff: float, limits: StepLimits
) -> float:
    """Return 1/Δt_max in 1/s of window and tail: the largest ratio of speed to displacement limit.

    Args:
        qd: (J,) rates of the window's hinges.
        modules: Poses and velocities of the window's modules.
        core: Cells that are still folded.
        tail: Number of modules of the tail.
        cutoff: Distance in pitches beyond which pairs are not checked.
        limits: Displacements that are allowed in one step.
    """

def contact_points(
    positions: Array,
    rotations: Array,
    solid: FacetedHull,
    apart: int,
    floor_gap: float,
    module_gap: float,
) -> ContactPoints:
    """Return all contact points of one configuration that stands on the plane z = 0.

    Args:
        positions: (n, 3) centres, in pitches.
        rotations: (n, 3, 3) orientations.
        solid: Hull of a module.
        apart: Pairs fewer links apart are exempt.
        floor_gap: Largest height of a corner that stands on the floor, in pitches.
        module_gap: Largest distance of two modules that touch, in pitches.
    """

def torque_columns(
    hinges: Hinges,
    root: int,
    is_clamped: bool,
    first: Ints,
    second: Ints,
    points: Array,
    forces: Array,
) -> tuple[Int32s, Int32s, Array]:
    """Return the hinge torques that balance each of C forces, as sparse columns.

    A hinge's torque is what the module before it exerts on the one behind. Unless the root is held,
    force and moment on the whole chain follow as ``EQUATIONS`` rows; forces between modules have
    none of them.

    Args:
        hinges: Hinges of the configuration.
        root: Module from which the forces are reached along the chain; the held one, if any.
        is_clamped: True if the root is held still, by any force that this needs.
        first: (C,) modules on which the forces act.
        second: (C,) modules on which their opposites act; negative for none.
        points: (C, 3) points at which they act, in pitches.
        forces: (C, 3) forces on the first modules.

    Returns:
        (C + 1,) starts of the columns, and row and value of each element.
    """

def anneal(
    field: Field, schedule: Schedule, start: Ints, seed: int, rises: bool
) -> tuple[Ints, float, Ints]:
    """Anneal a path.

    Args:
        field: The cells and the goal.
        schedule: The moves.
        start: (s,) flat indices of the first path, at least 2 and at most ``field.high`` cells.
        seed: Random seed, 0…2⁴⁸ − 1.
        rises: True if every path shall keep the rules of paths that rise (``_rises``), along the
            last axis; ``start`` must keep them.

    Returns:
        (n,) flat indices of the best path, its energy, and (``MOVES``,) numbers of accepted moves.
    """

def cube_turning_gap(a: int, b: int, c: int, d: int, half: float) -> float:
    """Return the smallest distance of two squares while one turns by +90° about the origin.

    Squares that are apart at first come nearest at a corner of one of them. So the distance is that
    of the arcs of the corners of either square, seen from the other one, to that square: exact up
    to rounding errors.

    Args:
        a, b: Centre of the square that turns, with edges parallel to the axes at first.
        c, d: Centre of the square at rest.
        half: Half the edge of both.
    """

def count_cube_contacts(levels: Levels, scratch: CubeScratch, contacts: NDArray[np.int64]) -> None:
    """Count the touching pairs that are not linked after each turn of a state, clear or not.

    Args:
        levels: (J,) levels of the state.
        scratch: Arrays for the work.
        contacts: (J, 2) receives the number of pairs after each hinge has turned by −90° and by
            90°; −1 where it cannot, or where two modules would be in the same cell.
    """

def test_cube_turns(
    levels: Levels,
    hinges: NDArray[np.int64],
    changes: NDArray[np.int64],
    room: float,
    table: SweptCells,
    scratch: CubeScratch,
    clear: NDArray[np.bool_],
) -> int:
    """Test which turns of a state are clear.

    Args:
        levels: (J,) levels of the state, in which no two modules share a cell.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room: Distance that modules must keep, pitches.
        table: Swept cells; missing rows are entered.
        scratch: Arrays for the work.
        clear: (T,) receives True for turns that are clear.

    Returns:
        0, or ``TABLE_FULL``.
    """

def clear_cube_turns(
    start: Levels,
    hinges: NDArray[np.int64],
    changes: NDArray[np.int64],
    room: float,
    table: SweptCells,
    scratch: CubeScratch,
) -> int:
    """Count the turns of a sequence, made one by one from a state on, up to one that is not clear.

    Args:
        start: (J,) levels of the state.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room, table, scratch: As in ``test_turns``.

    Returns:
        Number of turns before the first that is not clear, T if all are; or ``TABLE_FULL``.
    """

def without_cube_overlaps(states: Levels, scratch: CubeScratch) -> NDArray[np.bool_]:
    """Return (B,) True for states in which no two modules are in the same cell.

    Args:
        states: (B, J) levels.
        scratch: Arrays for the work.
    """

def tetrahedron_turning_gap(
    moving: Ints, resting: Ints, hull: Hull, size: float, reach: float
) -> float:
    """Return the smallest distance of two tetrahedra while one turns by +90° about a hinge.

    The distance of two bodies changes by at most ρ times the angle, where ρ is the largest distance
    of a corner of either from the hinge's axis: of the one for which it is smaller, as only the
    relative motion counts. Intervals of the angle are halved until that bound decides.

    Args:
        moving, resting: (3,) cells as seen from the hinge, which runs along the first coordinate.
        hull, size: Of the module.
        reach: Distance, pitches, at and above which gaps are not told apart.

    Returns:
        A lower bound of the distance, less than ``GAP_TOLERANCE`` below it, at most ``reach``; 0
        where the tetrahedra meet.
    """

def count_tetrahedron_contacts(levels: Levels, scratch: TetrahedronScratch, contacts: Ints) -> None:
    """Count the touching pairs that are not linked after each turn of a state, clear or not.

    Args:
        levels: (J,) levels of the state.
        scratch: Arrays for the work.
        contacts: (J, 2) receives the number of pairs after each hinge has turned by −90° and by
            90°; −1 where it cannot, or where two modules would be in the same cell.
    """

def test_tetrahedron_turns(
    levels: Levels,
    hinges: Ints,
    changes: Ints,
    room: float,
    table: TurningGaps,
    scratch: TetrahedronScratch,
    clear: NDArray[np.bool_],
) -> int:
    """Test which turns of a state are clear.

    Args:
        levels: (J,) levels of the state, in which no two modules share a cell.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room: Distance that modules must keep, pitches.
        table: Turning gaps; missing ones are entered.
        scratch: Arrays for the work.
        clear: (T,) receives True for turns that are clear.

    Returns:
        0, or ``TABLE_FULL``.
    """

def clear_tetrahedron_turns(
    start: Levels,
    hinges: Ints,
    changes: Ints,
    room: float,
    table: TurningGaps,
    scratch: TetrahedronScratch,
) -> int:
    """Count the turns of a sequence, made one by one from a state on, up to one that is not clear.

    Args:
        start: (J,) levels of the state.
        hinges, changes: (T,) hinge of each turn, and −1 or 1.
        room, table, scratch: As in ``test_turns``.

    Returns:
        Number of turns before the first that is not clear, T if all are; or ``TABLE_FULL``.
    """

def without_tetrahedron_overlaps(states: Levels, scratch: TetrahedronScratch) -> NDArray[np.bool_]:
    """Return (B,) True for states in which no two modules are in the same cell.

    Args:
        states: (B, J) levels.
        scratch: Arrays for the work.
    """

def grow(near: Ints, ends: Flags, start: int, moves: int, seed: int) -> tuple[int, Ints]:
    """Grows a path by extending and turning its ends until it visits every cell.

    Args:
        near: (n, 6) neighbours of each cell, −1 where there is none.
        ends: (n,) cells that a complete path may begin and end with.
        start: The cell that it begins with, −1 for any.
        moves: How many moves at most.
        seed: Of the choices.

    Returns:
        How many cells are on the longest path found, and (n,) that path when it is complete and
        its ends may be ends; a complete one with other ends counts as one cell less.
    """

def ease(path: Ints, near: Ints, ends: Flags, start: int, moves: int, seed: int) -> Ints:
    """Brings cells that touch closer along a path, by turning its ends while that cools down.

    Args:
        path: (n,) a complete path.
        near: (n, 6) neighbours of each cell, −1 where there is none.
        ends: (n,) cells that it may begin and end with.
        start: The cell that it begins with, −1 for any.
        moves: How many turns are tried.
        seed: Of the choices.

    Returns:
        (n,) the path with the least sum of distances that was met, with ends that may be ends.
    """

def mark_crossings(us: Array, vs: Array, ws: Array, faces: Ints, marks: NDArray[np.int16]) -> None:
    """Marks where rays along w, one for each sample (u, v), go into and out of a mesh.

    Args:
        us, vs, ws: (V,) coordinates of the vertices, in samples.
        faces: (F, 3) triangles.
        marks: (U, V, W) int16, added to: +1 at the first sample behind a triangle that is entered,
            −1 where it is left.
    """

def fill_by_winding(marks: NDArray[np.int16], inside: Flags) -> int:
    """Sets the samples that the mesh goes around, and counts those with more than one turn."""

def vote_by_parity(marks: NDArray[np.int16], votes: NDArray[np.int8]) -> None:
    """Adds a vote where the crossings passed are odd; a ray with an odd total has no vote."""

def window_sums(parts: NDArray[np.int16], size: int) -> Int32s:
    """Return (X−s+1, Y−s+1, Z−s+1) int32 sums of the parts in each cube of s³ of them.

    A full cell of 32 samples a side holds 32768 of them, one more than int16 does.
    """

def window_histograms(sums: Int32s, size: int, full: int, levels: int) -> tuple[Ints, Ints]:
    """Two (s, s, s, levels + 1): for each offset how many windows are how full, and their sums.

    Args:
        sums: (X, Y, Z) of windows of ``size`` parts along each axis.
        size: Offsets along each axis.
        full: What the sum of a full window is.
        levels: Into how many steps fullness is told apart.
    """

def many_floating_torques(q: Array, qd: Array, qdd: Array, model: ChainModel, out: Array) -> None:
    """Write the (F, J) hinge torques of motions of a free chain that has no momentum.

    Args:
        q, qd, qdd: (F, J) hinge angles, rates and accelerations.
        model: Inertial parameters of the chain; it has no fixed base, and no root counts.
        out: (F, J) written, in module mass · pitch² / s²; NaN where the motion is not finite.
    """

def many_path_torques(
    q: Array,
    first: Array,
    second: Array,
    model: ChainModel,
    a: Array,
    b: Array,
) -> None:
    """Write (F, J) a and b of the torques a ü + b u̇² along a path q(u) of such a chain.

    Args:
        q, first, second: (F, J) hinge angles and their derivatives by u.
        model: Inertial parameters of the chain; it has no fixed base, and no root counts.
        a, b: (F, J) written; NaN where the path is not finite.
    """

def simplified(polygon: Array) -> Array:
    """Return a closed polygon (n, 3) without all vertices that its knot does not need."""

def tightened(polygon: Array, pull: float) -> Array:
    """Return a closed polygon with each vertex moved towards the middle of its neighbours.

    A vertex stays where an edge is in the way, so that the knot does.

    Args:
        polygon: (n, 3) vertices.
        pull: Fraction of the way, 0 to 1; one half or one quarter of it is tried next.
    """

def crossings(points: Array) -> tuple[Array, Ints]:
    """Return the crossings of a closed polygon (n, 3) in its projection along z.

    Returns:
        (c, 2) parameters of the upper and the lower strand, as edge plus fraction, and (c,) signs.
    """

def determinant(matrix: Ints, prime: int) -> int:
    """Return the determinant of a square matrix of integers modulo a prime below 2^31."""

def count_points(points: Array, stride: int, pitch: float, offset: Array, span: Ints) -> Ints:
    """Count the points in each cell.

    Args:
        points: (p, 3) points; every ``stride``-th counts.
        stride: See above.
        pitch: Edge of a cell.
        offset: (3,) shift: a point x lies in the cell ``floor(x / pitch + offset)``.
        span: (3,) cells along the axes; all points must lie in them.

    Returns:
        (X · Y · Z,) numbers of points.
    """

def count_in_tetrahedra(
    points: Array, stride: int, pitch: float, offset: Array, span: Ints
) -> Ints:
    """Count the points in each tetrahedron.

    A point lies between the nearest node-lattice point with even coordinates and the farthest
    corner of their unit cube; the two axes along which it is farthest from the former tell the
    tetrahedron.

    Args:
        points: (p, 3) points; every ``stride``-th counts.
        stride: See above.
        pitch: Distance of two nodes.
        offset: (3,) shift: a point x has the node coordinates x / pitch + offset, at least 1.
        span: (3,) nodes along the axes; all tetrahedra with points must lie in them.

    Returns:
        (3 · X · Y · Z,) numbers of points.
    """

def best_overlap(counts: Ints, full: float, total: float, low: int, high: int) -> float:
    """Return the IoU of the best set of cells with a solid, connected or not.

    Args:
        counts: (m,) points of the solid in each cell.
        full: Points in a cell that is wholly inside.
        total: Points in the solid.
        low, high: Smallest and largest number of cells.
    """

def mark_blamed_hinges(
    q: Array,
    joint: Joint,
    hull: Hull,
    apart: int,
    size: float,
    margin: float,
    blamed: NDArray[np.bool_],
) -> int:
    """Mark the hinges between two modules that are closer than a margin.

    The relative pose of two modules depends on the hinges between them and on no others.

    Args:
        q: (F, J) configurations, in rad.
        joint, hull: The chain's joints and hulls.
        apart: Pairs fewer links apart are exempt.
        size: Module size as a fraction of the pitch.
        margin: Smallest clearance, in pitches.
        blamed: (F, J) written.

    Returns:
        Number of configurations with such a pair.
    """

def write_displacements(q: Array, joint: Joint, largest: Array, mean: Array) -> None:
    """Write the displacements of modules from frame to frame, in pitches.

    The centre of mass and the orientation of the middle module are held still.

    Args:
        q: (F, J) configurations, in rad.
        joint: The chain's joints.
        largest, mean: (F − 1,) written: over all modules.
    """

def fastest_profile(
    slopes: Array,
    left: Indices,
    right: Indices,
    fractions: Array,
    lengths: Array,
    speed: float,
    acceleration: float,
) -> Array:
    """Return the (N + 1,) largest ṡ² at the knots that the bounds allow, at rest at both ends.

    Args:
        slopes: (K, J) slopes q' between which those of each cell lie.
        left, right: (N,) indices of these two.
        fractions: (N, 2) fraction from the left to the right one at both knots of a cell; q' is
            zero at one of them at most.
        lengths: (N,) lengths of the cells, in s.
        speed: Bound of every |q̇|, in rad/s.
        acceleration: Bound of every |q̈|, in rad/s².
    """

def torque_passes(a: Array, b: Array, ceiling: Array, step: float) -> Array:
    """Return (U,) z = u̇² at even steps of a path along which the torques are τ = a ü + b u̇².

    It is never above the ceiling and 0 at both ends; ü = z' / 2 is what |τ| ≤ 1 leaves of it: a
    forward and a backward pass (Bobrow, Dubowsky, Gibson: Time-optimal control, 1985).

    Args:
        a, b: (U, J) torques per ü and per u̇², as fractions of their bounds.
        ceiling: (U,) upper bound of z.
        step: Step of u.
    """

def one_circuit(ends_at: Ints, counts: Ints, partner: Ints) -> int:
    """Joins edges at all nodes so that they make as few circuits as can be.

    Args:
        ends_at: (N, 4) edge ends at each node, opposite ones in places 0 and 1, 2 and 3 where four
            are there; the end ``2 e`` or ``2 e + 1`` of edge ``e``; −1 where none is.
        counts: (N,) how many of them there are: 2 or 4.
        partner: (2 E,) filled in: the edge end that each edge end is joined to.

    Returns:
        How many circuits there are: as many as the edges have connected parts.
    """

def circuit_order(partner: Ints, first: int, order: Ints) -> int:
    """Follows a circuit from the edge end ``first`` on; fills in the ends by which edges are left.

    Returns:
        The number of edges in it.
    """

def anneal_trail(
    field: Field, schedule: Schedule, parities: Ints, corner: int, seed: int
) -> tuple[Ints, float]:
    """Anneal a set of tetrahedra with a closed trail.

    Args:
        field: The tetrahedra and the goal; ``fill`` and ``cost`` by their numbers.
        schedule: The moves; their kinds are not used.
        parities: (m,) 4, 2 and 1 added for odd coordinates x, y and z of each node.
        corner: Flat index of the lowest corner of the unit cube with the first ring.
        seed: Random seed, 0…2⁴⁸ − 1.

    Returns:
        (n,) numbers of the best tetrahedra, and their energy.
    """

def window_steps(
    first: Ints,
    offsets: Ints,
    angles: NDArray[np.float32],
    folded: Array,
    fraction: float,
    largest: Array,
    moving: Ints,
) -> None:
    """The largest hinge step between every frame and the next, and how many hinges take part.

    Args:
        first, offsets, angles: See ``planner.motion.motion.Motion``.
        folded: (J,) the folded angles.
        fraction: A hinge takes part when its step is more than this share of the largest.
        largest: (F − 1,) written, in radians.
        moving: (F − 1,) written.
    """

def draw_triangles(
    picture: NDArray[np.uint8],
    nearness: NDArray[np.float32],
    corners: NDArray[np.float32],
    colours: NDArray[np.float32],
) -> None:
    """Draw triangles over a picture, the nearest one at each pixel.

    Args:
        picture: (H, W, 3) sRGB bytes, changed in place.
        nearness: (H, W) inverse depths of what is drawn, 0 for nothing; changed in place.
        corners: (T, 3, 3) pixels from the left, pixels from the top, and depths. Triangles that
            are clockwise in the picture face away and are not drawn.
        colours: (T, 3, 3) sRGB values 0 to 255 at the corners.
    """

def face_light(
    middles: NDArray[np.float32],
    normals: NDArray[np.float32],
    positions: NDArray[np.float32],
    radius: float,
    light: NDArray[np.float32],
    max_distance: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the fractions of sky light and of key light that reach each face, (n, F) each.

    Args:
        middles: (n, F, 3) centres of the faces of the modules.
        normals: (n, F, 3) unit normals of the faces.
        positions: (n, 3) centres of the modules.
        radius: Radius of the balls that stand for modules, in pitches.
        light: (3,) unit vector towards the key light.
        max_distance: Distance beyond which a module casts no shadow on a face, in pitches.
    """

def snake_cube_paths(
    near: NDArray[np.int64],
    symmetries: NDArray[np.int64],
    starts: NDArray[np.bool_],
    pieces: NDArray[np.int8],
    corners: int,
    choices: NDArray[np.int64],
    max_steps: int,
    max_paths: int,
) -> tuple[NDArray[np.int64], bool, int, NDArray[np.int64]]:
    """Find paths of equal pieces through one solid or two, each of which visits all cells.

    Of paths that symmetries of their solid map to each other, the one with the smallest numbers of
    cells is found.

    Args:
        near: (k, n, 6) neighbours of the n cells of k solids, one or two, in the order of
            ``STEPS``; −1 without one.
        symmetries: (k, s, n) permutations of the cells, at most 64; some may occur repeatedly.
        starts: (k, n) cells in which a path may begin.
        pieces: (n,) 0 straight, 1 corner, −1 either; those of the two ends mean nothing.
        corners: Number of corners; −1 for any.
        choices: Choices to go on with: one zero to begin, then those of the last call.
        max_steps: Number of attempts to place a piece after which the search is interrupted.
        max_paths: Number of paths after which it is interrupted.

    Returns:
        (m, k, n) paths, True if there are no further ones, number of steps, and choices.
    """

SIZE_TOLERANCE: Final[float]
"""Maximum amount by which the size of a turn may be above the true one."""
MIN_TURN_SIZE: Final[float]
"""Size below which sizes of turns are not told apart."""

class JointTurns:
    """Turns of the hinges of a chain, each by its own step, and their sizes.

    The *size* of a turn is the largest size of the modules, each scaled about its centre and at
    most 1, at which the turn is free: no two modules share inner points on the way. What is
    known of pairs of poses is kept.
    """

    def __init__(self, chain: TurningChain) -> None:
        """Prepare the turns of a chain."""

    def resting_size(self, levels: Levels) -> tuple[float, int, int]:
        """Return the largest size at which a state is free, and the modules that limit it.

        Args:
            levels: (J,) levels of the state: angles in steps.

        Returns:
            The size, at most 1, and two modules, −1 where the size is 1.
        """

    def turn_size(self, levels: Levels, hinge: int, change: int) -> tuple[float, int, int, float]:
        """Return the size of a turn of a hinge by −1 or 1 step.

        Returns:
            The size, which is at most ``SIZE_TOLERANCE`` above the true one; the module at rest and
            the module that turns which limit it; and the share of the turn at which they do.
        """

    def motion_size(
        self, levels: Levels, hinges: Ints, changes: Ints
    ) -> tuple[float, int, int, float]:
        """Return the size of turns of (T,) hinges by −1 or 1 step each at the same time.

        Returns:
            As ``turn_size``.
        """

    def search(self, start: Levels, goal: Levels, limits: TurnSearch) -> TurnSearchResult:
        """Search for turns from a state to a goal.

        Args:
            start, goal: (J,) levels; those of hinges that turn freely are from 0 on.
            limits: What is tried first, and where the search ends.
        """

    def turn_table(self, states: Levels, size: float) -> TurnTable:
        """Return what each turn of each of (S, J) states leads to at a size of the modules."""
