"""Proof of the clearance of many frames of a motion and of everything between them, compiled.

Lemmas 7 to 9 of docs/decisions/0012-sweep-bound.md. From one frame to the next, a chain has a
*folded core* that stays, a *stretch* whose hinges move, and a straight *tail* that is rigid with
the last module of the stretch. Without windows the stretch is the whole chain.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foldback.planner.kernels import INNER, KERNEL, ZERO
from foldback.planner.kernels.clearance import pair_separation, separation_along
from foldback.planner.kernels.clearance_bounds import (
    RELATIVE_COLUMNS,
    Tolerance,
    allowance,
    directional_motion_bound,
    levers,
    relative_motion_bound,
    write_largest_allowances,
)
from foldback.planner.kernels.kinematics import copy_vector
from foldback.planner.kernels.module import Hull, Joint
from foldback.planner.kernels.motion_bounds import (
    ANGULAR_SPEED_BOUND,
    BODY_COLUMNS,
    DISPLACEMENT_BOUND,
    RATE_SUM,
    ROTATION,
    VELOCITY,
    length,
    move_bodies,
    rod_body,
)
from foldback.planner.kernels.pairs import append_pair, near_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
MAX_BISECTIONS = 16
"""Maximum number of times that the interval between two frames is halved to prove that modules keep
clear in it. Beyond it the plan is refused as unproved. Decision 0012."""
LARGE_MOTION = 1.0
"""Displacement, pitches, above which a module moves too far within an interval of the motion for a
grid to find the pairs of modules that may meet: pairs are then searched along the chain, and the
interval is halved if the chain's end comes near others."""
MAX_PAIRS_PER_MODULE = 32
"""Mean number of near pairs per moving module above which an interval of large motion between two
frames is halved before its pairs are checked. Decision 0012."""
MAX_COARSE_BISECTIONS = 12
"""Maximum number of times that the interval between two frames is halved because motion in it is
too large to list all near pairs. Beyond it the plan is refused as unproved. Decision 0012."""
ROUNDING_MARGIN = 1e-9
"""Minimum lower bound of the clearance of two modules, pitches, for them to count as proved clear
(lemma 10 of decision 0012). It must exceed the rounding error, 1e-10 for 10 000 modules, for the
proof to hold."""
TIGHT_BISECTIONS = 8
"""Number of halvings of the interval between two frames up to which a proved lower bound must come
close to the smallest clearance seen; after it any positive bound will do. Decision 0012."""

MIDDLE, HALF_WIDTH = 0, 1
"""Columns of the interval stack: middle and half width, in units of the time between two frames."""
FIRST_PAIR, END_PAIR, BISECTIONS = 0, 1, 2
"""Columns of the pair range stack: which of the unresolved pairs belong to an interval (the first
is −1 if its pairs are still to be searched), and how many bisections led to it."""


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


class Stretch(NamedTuple):
    """Motion of a chain from one frame to another one.

    Attributes:
        low, high: First and last module of the stretch.
        joint: The module's joint, with the rigid links at the start of the stretch.
        root: Body of the stretch that is held still.
        start: Hinge angles of the stretch in the first frame, in radians.
        rates: What is added to them up to the other frame.
    """

    low: int
    high: int
    joint: Joint
    root: int
    start: Array
    rates: Array


class Scratch(NamedTuple):
    """Arrays that one interval after the other uses.

    Attributes:
        bodies: (m, BODY_COLUMNS) the modules of the stretch; the root's pose is given.
        points: (m, 3) their centres.
        relative: (RELATIVE_COLUMNS,) motion of a pair.
        tail: (BODY_COLUMNS,) a module of the tail.
        rotation: (3, 3).
        allowances: (2, n) largest allowance of a pair by the number of links between: of the
            folded and the moving modules, and of a pair with the tail.
    """

    bodies: Array
    points: Array
    relative: Array
    tail: Array
    rotation: Array
    allowances: Array


class PairList(NamedTuple):
    """The first ``filled`` rows of ``pairs`` (…, 2), which has room for more."""

    pairs: Ints
    filled: int


class Check(NamedTuple):
    """Result of checking pairs in one interval: lemma 8.

    Attributes:
        clearance: Least clearance at s = 0.
        first, second: The two modules that have it; −1 when none is below the cutoff.
        lower_bound: Least lower bound of the proved pairs, at most the cutoff.
        unresolved: Pairs whose lower bound does not exceed the target are appended here.
    """

    clearance: float
    first: int
    second: int
    lower_bound: float
    unresolved: PairList


@njit(**INNER)
def _moving_modules(shape: Shape, first: int, last: int) -> tuple[int, int]:
    """Return first and last module of the stretch whose hinges are ``first`` … ``last`` − 1."""
    if shape.root >= 0:
        return 0, shape.core.shape[0] - 1
    hinges = shape.joint.axes.shape[0]
    low = first // hinges + shape.joint.rigid_links
    if first % hinges:
        last = max(last, first + 1)
    high = (last - 1) // hinges + shape.joint.rigid_links + 1 if last > first else low
    return low, high


@njit(**INNER)
def _write_angles(shape: Shape, angles: Angles, frame: int, start: int, out: Array) -> None:
    """Write the angles of a frame for the hinges from ``start`` on, as many as ``out`` holds."""
    first = angles.first[frame]
    window_start = angles.offsets[frame] - angles.shift
    width = angles.offsets[frame + 1] - angles.offsets[frame]
    for k in range(out.shape[0]):
        hinge = start + k
        if hinge < first:
            out[k] = shape.folded_rad[hinge]
        elif hinge < first + width:
            out[k] = angles.values[window_start + hinge - first]
        else:
            out[k] = 0.0


@njit(**INNER)
def _stretch(shape: Shape, angles: Angles, frame: int, to: int) -> Stretch:
    """Return the motion from one frame to another one, or of one frame to itself."""
    first, offsets = angles.first, angles.offsets
    low, high = _moving_modules(
        shape,
        min(first[frame], first[to]),
        max(
            first[frame] + offsets[frame + 1] - offsets[frame],
            first[to] + offsets[to + 1] - offsets[to],
        ),
    )
    links, joint = shape.joint.rigid_links, shape.joint
    rigid = max(0, links - low)  # the first links of a chain have no joint
    hinges = joint.axes.shape[0]
    first_hinge = max(0, low - links) * hinges
    start = np.empty(max(0, high - low - rigid) * hinges)
    rates = np.empty_like(start)
    _write_angles(shape, angles, frame, first_hinge, start)
    _write_angles(shape, angles, to, first_hinge, rates)
    rates -= start
    part = Joint(rigid, joint.anchor, joint.axes, joint.turn, joint.offset)
    return Stretch(low, high, part, max(0, shape.root), start, rates)


@njit(**INNER)
def _append_core_pairs(
    shape: Shape, body: Array, module: int, low: int, reach: float, near: PairList
) -> PairList:
    """Append the pairs of a module with the folded core that have centres nearer than ``reach``."""
    below = min(low, module - shape.min_checked_gap + 1)
    if below <= 0:
        return near
    box = shape.boxes[below - 1]
    for r in range(3):
        if body[r] < box[r] - reach or body[r] > box[3 + r] + reach:
            return near
    o = shape.origin
    width = shape.width
    cells = shape.cells
    x0 = max(0, int(np.floor((body[0] - reach - o[0]) / width)))
    y0 = max(0, int(np.floor((body[1] - reach - o[1]) / width)))
    z0 = max(0, int(np.floor((body[2] - reach - o[2]) / width)))
    x1 = min(cells[0], int(np.floor((body[0] + reach - o[0]) / width)) + 1)
    y1 = min(cells[1], int(np.floor((body[1] + reach - o[1]) / width)) + 1)
    z1 = min(cells[2], int(np.floor((body[2] + reach - o[2]) / width)) + 1)
    pairs, count = near
    for x in range(x0, x1):
        for y in range(y0, y1):
            row = (x * cells[1] + y) * cells[2]
            for at in range(shape.starts[row + z0], shape.starts[row + max(z0, z1)]):
                i = shape.members[at]
                if i >= below:
                    continue
                core_body = shape.core[i]
                dx, dy, dz = body[0] - core_body[0], body[1] - core_body[1], body[2] - core_body[2]
                if dx * dx + dy * dy + dz * dz < reach * reach:
                    pairs = append_pair(pairs, count, i, module)
                    count += 1
    return PairList(pairs, count)


@njit(**INNER)
def _pairs_along(
    bodies: Array,
    max_displacement: float,
    half: float,
    low: int,
    reach: float,
    min_checked_gap: int,
    near: PairList,
) -> tuple[PairList, bool]:
    """Find the pairs of a stretch of large motion that may come nearer than ``reach``: lemma 7.

    Returns:
        The pairs, and whether they are too many to be checked; then not all are there.
    """
    pairs, count = near
    m = bodies.shape[0]
    for i in range(m):
        j = i + min_checked_gap
        while j < m:
            dx = bodies[j, 0] - bodies[i, 0]
            dy = bodies[j, 1] - bodies[i, 1]
            dz = bodies[j, 2] - bodies[i, 2]
            spare = length(dx, dy, dz) - reach
            displacement = bodies[i, DISPLACEMENT_BOUND] + bodies[j, DISPLACEMENT_BOUND]
            between = half * abs(bodies[j, RATE_SUM] - bodies[i, RATE_SUM]) * (j - i)
            if spare < min(displacement, between):
                pairs = append_pair(pairs, count, low + i, low + j)
                count += 1
                if count > MAX_PAIRS_PER_MODULE * m:
                    return PairList(pairs, count), True
            # Modules j + 1 … j + leap are too far away for the bounds that hold at ``to``.
            leap = int(spare)
            while leap > 0:
                to = min(j + leap, m - 1)
                between = half * abs(bodies[to, RATE_SUM] - bodies[i, RATE_SUM]) * (to - i)
                displacement = bodies[i, DISPLACEMENT_BOUND] + max_displacement
                if spare - leap >= min(displacement, between):
                    break
                leap //= 2
            j += 1 + max(leap, 0)
    return PairList(pairs, count), False


@njit(**INNER)
def _stretch_pairs(
    shape: Shape, part: Stretch, work: Scratch, half: float, reach: float, near: PairList
) -> tuple[PairList, bool]:
    """Find the pairs of a stretch that may come nearer than ``reach``: lemma 7.

    Returns:
        The pairs, and whether the motion is too large to check them; then not all are there.
    """
    bodies, points, low = work.bodies, work.points, part.low
    max_displacement = 0.0
    for k in range(bodies.shape[0]):
        max_displacement = max(max_displacement, bodies[k, DISPLACEMENT_BOUND])
    allowances, gap = work.allowances[0], shape.min_checked_gap
    max_reach = reach + allowances[bodies.shape[0] - 1]
    if max_displacement > LARGE_MOTION:
        return _pairs_along(bodies, max_displacement, half, low, max_reach, gap, near)
    pairs, count = near
    candidates = near_pairs(points, max_reach + 2.0 * max_displacement, gap)
    for p in range(candidates.shape[0]):
        i, j = candidates[p, 0], candidates[p, 1]
        dx = points[j, 0] - points[i, 0]
        dy = points[j, 1] - points[i, 1]
        dz = points[j, 2] - points[i, 2]
        nearing = reach + allowances[j - i]
        nearing += bodies[i, DISPLACEMENT_BOUND] + bodies[j, DISPLACEMENT_BOUND]
        if dx * dx + dy * dy + dz * dz < nearing * nearing:
            pairs = append_pair(pairs, count, low + i, low + j)
            count += 1
    return PairList(pairs, count), False


@njit(**INNER)
def _box_of_others(shape: Shape, part: Stretch, work: Scratch) -> Array:
    """Return the corners (6,) of a box that all centres but those of the tail stay in."""
    bodies, low = work.bodies, part.low
    box = np.empty(6)
    for r in range(3):
        box[r] = bodies[0, r]
        box[3 + r] = bodies[0, r]
        for k in range(bodies.shape[0]):
            box[r] = min(box[r], bodies[k, r] - bodies[k, DISPLACEMENT_BOUND])
            box[3 + r] = max(box[3 + r], bodies[k, r] + bodies[k, DISPLACEMENT_BOUND])
        if low > 0:
            box[r] = min(box[r], shape.boxes[low - 1, r])
            box[3 + r] = max(box[3 + r], shape.boxes[low - 1, 3 + r])
    return box


@njit(**INNER)
def _write_allowances(shape: Shape, part: Stretch, work: Scratch) -> None:
    """Write the largest allowances of pairs in an interval; none for a motion without errors."""
    if shape.tolerance.spare == 0.0:
        return
    box = _box_of_others(shape, part, work)
    extent = length(box[3] - box[0], box[4] - box[1], box[5] - box[2])
    tail = shape.core.shape[0] - 1 - part.high
    hinges = float(shape.joint.axes.shape[0])
    for row in range(2 if tail > 0 else 1):
        write_largest_allowances(
            shape.tolerance, extent + row * tail, _arm(shape), hinges, work.allowances[row]
        )


@njit(**INNER)
def _arm(shape: Shape) -> float:
    """Return the largest distance of a module's points and joint from its centre, added."""
    anchor = shape.joint.anchor
    return shape.hull.radius * shape.size + length(anchor[0], anchor[1], anchor[2])


@njit(**INNER)
def _distance_to_box(last: Array, position: Array, box: Array) -> float:
    """Return the distance to a box of the point at ``position`` in the frame of a body."""
    frame = last[ROTATION:VELOCITY].reshape((3, 3))
    outside = 0.0
    for r in range(3):
        at = last[r]
        for c in range(3):
            at += frame[r, c] * position[c]
        off = max(0.0, box[r] - at, at - box[3 + r])
        outside += off * off
    return np.sqrt(outside)


@njit(**INNER)
def _append_tail_pairs(
    shape: Shape, part: Stretch, work: Scratch, half: float, reach: float, near: PairList
) -> tuple[PairList, bool]:
    """Append the pairs of the tail that may come nearer than ``reach``: lemma 7.

    Returns:
        The pairs, and whether a tail module of large motion has one; then not all are there.
    """
    bodies, points, low, high, tail = work.bodies, work.points, part.low, part.high, work.tail
    m = bodies.shape[0]
    box = _box_of_others(shape, part, work)
    last = bodies[m - 1]
    sway = min(2.0, half * last[ANGULAR_SPEED_BOUND])
    t = 1
    while t < shape.core.shape[0] - high:
        position = shape.tail_positions[t]
        lever = length(position[0], position[1], position[2])
        gap = _distance_to_box(last, position, box) - reach - last[DISPLACEMENT_BOUND]
        gap -= lever * sway
        if gap > 0.0:
            # Per link the distance and the displacement change by no more than 1 + sway together.
            t += 1 + int(gap / (1.0 + sway))
            continue
        rod_body(last, position, shape.tail_rotations[t], half, work.rotation, tail)
        had = near.filled
        nearing = reach + tail[DISPLACEMENT_BOUND]
        pairs, count = near
        for k in range(m - 1):  # the last module of the stretch is rigid with the tail
            if high + t - low - k < shape.min_checked_gap:
                continue
            dx, dy, dz = tail[0] - points[k, 0], tail[1] - points[k, 1], tail[2] - points[k, 2]
            max_distance = nearing + bodies[k, DISPLACEMENT_BOUND]
            if dx * dx + dy * dy + dz * dz < max_distance**2:
                pairs = append_pair(pairs, count, low + k, high + t)
                count += 1
        near = PairList(pairs, count)
        near = _append_core_pairs(shape, tail, high + t, low, nearing, near)
        if near.filled > had and tail[DISPLACEMENT_BOUND] > LARGE_MOTION:
            return near, True
        t += 1
    return near, False


@njit(**INNER)
def _broad_phase(
    shape: Shape, part: Stretch, work: Scratch, half: float, reach: float, room: Ints
) -> tuple[PairList, bool]:
    """Find the pairs that move against each other and may come nearer than ``reach``: lemma 7.

    Args:
        shape, part, work: The chain, its motion, and its bodies in this interval.
        half: h.
        reach: Distance of centres in pitches.
        room: (…, 2) array for the pairs.

    Returns:
        The pairs, and whether the motion is too large to check them; then not all are there.
    """
    points, bodies = work.points, work.bodies
    for k in range(bodies.shape[0]):
        copy_vector(bodies[k, :3], points[k])
    near, too_large = _stretch_pairs(shape, part, work, half, reach, PairList(room, ZERO))
    if too_large or shape.root >= 0:
        return near, too_large
    for k in range(1, bodies.shape[0]):
        body = bodies[k]
        nearing = reach + work.allowances[0, part.low + k] + body[DISPLACEMENT_BOUND]
        near = _append_core_pairs(shape, body, part.low + k, part.low, nearing, near)
    reach += work.allowances[1, shape.core.shape[0] - 1]
    return _append_tail_pairs(shape, part, work, half, reach, near)


@njit(**INNER)
def _pair_allowance(
    shape: Shape,
    work: Scratch,
    a: Array,
    b: Array,
    joints: tuple[int, int, int],
    half: float,
    share: float,
) -> float:
    """Return the allowance of two modules in an interval, in pitches: lemmas 11 and 12.

    Args:
        shape, work: The chain, and its bodies in this interval.
        a, b: (BODY_COLUMNS,) the two modules.
        joints: Their numbers, and that of the first moving module.
        half: h.
        share: 1 for the interval, 0 for s = 0.
    """
    rows, tail = work.bodies, shape.tail_positions
    lever = levers(a, b, joints, shape.core, rows, tail, _arm(shape), half, share)
    links, hinges = float(joints[1] - joints[0]), float(shape.joint.axes.shape[0])
    return allowance(shape.tolerance, lever, links, hinges)


@njit(**INNER)
def _check_pairs(
    shape: Shape,
    part: Stretch,
    work: Scratch,
    half: float,
    pairs: Ints,
    cutoff: float,
    target: float,
    unresolved: PairList,
) -> Check:
    """Check pairs at the middle of an interval and bound their clearance in it: lemma 8.

    Args:
        shape, part, work: The chain, its motion, and its bodies in this interval.
        half: h; 0 to check only the middle.
        pairs: (P, 2) modules, the earlier one first; may be part of ``unresolved``.
        cutoff: Clearances of this and more are not told apart.
        target: Lower bound that a pair must exceed to be proved.
        unresolved: Where pairs that are not proved are appended.
    """
    best, bound = cutoff, cutoff if half > 0.0 else -np.inf
    first = second = -1
    gap, axis = np.empty(3), np.empty(3)
    radius = shape.hull.radius * shape.size
    waiting, count = unresolved
    low, high, bodies, relative = part.low, part.high, work.bodies, work.relative
    positions, rotations, last = shape.tail_positions, shape.tail_rotations, bodies[high - low]
    erring = shape.tolerance.one_hinge_rad > 0.0 or shape.tolerance.each_hinge_rad > 0.0
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        a = shape.core[i] if i < low else bodies[i - low]
        if j <= high:
            b = bodies[j - low]
        else:
            b = work.tail
            rod_body(last, positions[j - high], rotations[j - high], half, work.rotation, b)
        max_loss = 0.0
        if half > 0.0:
            links = float(j - max(i, low))
            max_loss, distance = relative_motion_bound(a, b, half, radius, links, relative)
        else:
            distance = length(b[0] - a[0], b[1] - a[1], b[2] - a[2])
        # Lemmas 11 and 12: a bound that costs nothing first.
        error = work.allowances[0 if j <= high else 1, j - i]
        balls = distance - 2.0 * radius - error
        if balls >= best and balls - max_loss >= bound:
            continue
        for r in range(3):
            gap[r] = b[r] - a[r]
        separation = separation_along(
            gap,
            a[ROTATION:VELOCITY].reshape((3, 3)),
            b[ROTATION:VELOCITY].reshape((3, 3)),
            shape.hull,
            shape.size,
            max(best, bound + max_loss) + error,
            axis,
        )
        nearing = error
        if erring and separation - error < max(best, bound + max_loss):
            joints = (i, j, low)
            error = nearing = min(error, _pair_allowance(shape, work, a, b, joints, half, 1.0))
            if half > 0.0 and separation - error < best:
                nearing = min(error, _pair_allowance(shape, work, a, b, joints, half, 0.0))
        if separation - nearing < best:
            best, first, second = separation - nearing, i, j
        separation -= error
        if half > 0.0 and separation < bound + max_loss:
            # Lemma 6, along the axis of the separation.
            lower = separation - directional_motion_bound(relative, axis, half, radius)
            if lower <= target:
                waiting = append_pair(waiting, count, i, j)
                count += 1
            else:
                bound = min(bound, lower)
    return Check(best, first, second, bound, PairList(waiting, count))


@njit(**KERNEL)
def rigid_clearances(
    positions: Array,
    rotations: Array,
    pairs: Ints,
    hull: Hull,
    size: float,
    cutoff: float,
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
    n = positions.shape[0]
    nearest = np.full(n, cutoff)
    closest = np.full((n, 2), -1)
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        separation = pair_separation(
            positions[j] - positions[i], rotations[i], rotations[j], hull, size, float(nearest[j])
        )
        if separation < nearest[j]:
            nearest[j] = separation
            closest[j, 0] = i
            closest[j, 1] = j
    for j in range(1, n):
        if nearest[j - 1] <= nearest[j]:
            nearest[j] = nearest[j - 1]
            closest[j, 0] = closest[j - 1, 0]
            closest[j, 1] = closest[j - 1, 1]
    return nearest, closest


@njit(**INNER)
def _move(shape: Shape, part: Stretch, middle: float, half: float, work: Scratch) -> None:
    """Write the bodies of a stretch for the interval of width 2 ``half`` about ``middle``."""
    angles = part.start + middle * part.rates
    move_bodies(angles, part.rates, half, part.joint, part.root, work.bodies)
    _write_allowances(shape, part, work)


@njit(**INNER)
def _check_interval(
    shape: Shape, part: Stretch, work: Scratch, cutoff: float, min_clearance: float, ratio: float
) -> SweepResult:
    """Prove the clearance between two frames by bisection: lemma 9.

    Args:
        shape, part, work: The chain, its motion, and scratch.
        cutoff: Clearance of the first of the frames: what stays so far apart changes no figure.
        min_clearance: Least clearance that was seen so far.
        ratio: Part of it that the lower bound should reach.

    Returns:
        The result; its moments are fractions of the interval. The modules are −1 when no clearance
        is below ``cutoff``.
    """
    reach = 2.0 * shape.hull.radius * shape.size
    room = np.empty((1024, 2), dtype=np.int64)
    unresolved = PairList(np.empty((64, 2), dtype=np.int64), ZERO)
    interval_stack = np.empty((2 * MAX_BISECTIONS + 2, 2))
    pair_range_stack = np.empty((2 * MAX_BISECTIONS + 2, 3), dtype=np.int64)
    best, at, first, second = cutoff, 0.5, -1, -1
    bound, unproved_at = cutoff, -1.0
    midpoints = 0
    interval_stack[0, MIDDLE], interval_stack[0, HALF_WIDTH] = 0.5, 0.5
    pair_range_stack[0, FIRST_PAIR], pair_range_stack[0, END_PAIR] = -1, 0
    pair_range_stack[0, BISECTIONS] = 0
    depth = 1
    while depth > 0:
        depth -= 1
        middle, half = interval_stack[depth, MIDDLE], interval_stack[depth, HALF_WIDTH]
        first_pair, end = pair_range_stack[depth, FIRST_PAIR], pair_range_stack[depth, END_PAIR]
        bisections = pair_range_stack[depth, BISECTIONS]
        _move(shape, part, middle, half, work)
        midpoints += 1
        too_large = False
        pairs = unresolved.pairs[first_pair:end]
        if first_pair < 0:
            near, too_large = _broad_phase(shape, part, work, half, reach + cutoff, room)
            if too_large:
                # Only collisions at the middle can be found: a pair's motion is not bounded.
                _move(shape, part, middle, 0.0, work)
                near, _ = _broad_phase(shape, part, work, 0.0, reach, near.pairs)
            room = near.pairs
            pairs = room[: near.filled]
        target = ratio * min(min_clearance, best) if bisections < TIGHT_BISECTIONS else 0.0
        target = max(ROUNDING_MARGIN, target)
        width = 0.0 if too_large else half
        check = _check_pairs(shape, part, work, width, pairs, cutoff, target, unresolved)
        filled_before, unresolved = unresolved.filled, check.unresolved
        if check.clearance < best:
            best, at, first, second = check.clearance, middle, check.first, check.second
        if not too_large:
            bound = min(bound, check.lower_bound)
            if unresolved.filled == filled_before:
                continue
        limit = MAX_COARSE_BISECTIONS if too_large else MAX_BISECTIONS
        if check.clearance <= 0.0 or bisections == limit:
            bound = min(bound, 0.0)
            unproved_at = middle
            continue
        for side in (1.0, -1.0):
            interval_stack[depth, MIDDLE] = middle + side * (0.5 * half)
            interval_stack[depth, HALF_WIDTH] = 0.5 * half
            pair_range_stack[depth, FIRST_PAIR] = -1 if too_large else filled_before
            pair_range_stack[depth, END_PAIR] = unresolved.filled
            pair_range_stack[depth, BISECTIONS] = bisections + 1
            depth += 1
    return SweepResult(best, at, first, second, bound, unproved_at, midpoints)


@njit(**KERNEL, nogil=True)
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
    modules = shape.core.shape[0]
    reach = 2.0 * shape.hull.radius * shape.size
    best, at, first, second = cutoff, float(start), -1, -1
    bound, unproved_at = cutoff, -1.0
    midpoints = 0
    room = np.empty((4096, 2), dtype=np.int64)
    none = PairList(np.empty((1, 2), dtype=np.int64), ZERO)
    bodies, points = np.empty((modules, BODY_COLUMNS)), np.empty((modules, 3))
    relative, tail, rotation = np.empty(RELATIVE_COLUMNS), np.empty(BODY_COLUMNS), np.empty((3, 3))
    allowances = np.zeros((2, modules))
    frames = angles.first.shape[0]
    for k in range(start, stop):
        # Of disturbed motions, only bounds count, and intervals contain their frames.
        skipped = shape.tolerance.spare > 0.0 and frames > 1
        for to in range(k + 1 if skipped else k, min(k + 2, frames)):
            part = _stretch(shape, angles, k, to)
            m = part.high - part.low + 1
            work = Scratch(bodies[:m], points[:m], relative, tail, rotation, allowances)
            copy_vector(shape.core[part.low + part.root], bodies[part.root])
            if to == k:
                _move(shape, part, 0.0, 0.0, work)
                cap = min(cutoff, rigid[k])
                near, _ = _broad_phase(shape, part, work, 0.0, reach + cap, room)
                room = near.pairs
                pairs = room[: near.filled]
                check = _check_pairs(shape, part, work, 0.0, pairs, cap, 0.0, none)
                per_frame[k] = check.clearance
                if check.clearance < best:
                    best, at = check.clearance, float(k)
                    first, second = check.first, check.second
                continue
            # Pairs farther apart than the closest of a frame change neither figure.
            between = _check_interval(
                shape, part, work, per_frame[k], min(best, per_frame[k]), ratio
            )
            bound = min(bound, between.lower_bound)
            midpoints += between.midpoints
            if between.unproved_at >= 0.0:
                unproved_at = k + between.unproved_at
            if between.clearance < best:
                best, at = between.clearance, k + between.frame
                first, second = between.first, between.second
    return SweepResult(best, at, first, second, min(bound, best), unproved_at, midpoints)
