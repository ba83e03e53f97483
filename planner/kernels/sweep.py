"""The clearance of many frames of a motion and of all between them, compiled.

A frame has a *core* of folded modules that stay, a *stretch* whose hinges move, and a straight
*rod* that is rigid with the stretch's last module. Without windows the stretch is the whole chain.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kernels import INNER, KERNEL, ZERO
from planner.kernels.approach import approach, loss_along
from planner.kernels.bodies import (
    DRIFT,
    MOST_SPIN,
    RATES,
    ROTATION,
    VELOCITY,
    WIDTH,
    length,
    move_bodies,
    rod_body,
)
from planner.kernels.clearance import pair_separation, separation_along
from planner.kernels.kinematics import copy_vector
from planner.kernels.module import Hull, Joint
from planner.kernels.pairs import append_pair, near_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
MOST_HALVINGS = 16
"""Times that an interval is halved to prove a pair clear."""
WILD = 1.0
"""Way of a module in pitches above which pairs are looked for along the chain."""
MOST_NEAR = 32
"""Pairs for a module, in the mean, above which such an interval is halved first."""
MOST_TAMINGS = 12
"""Times that an interval is halved for that: docs/decisions/0012-sweep-bound.md."""
ROUNDING = 1e-9
"""Clearance in pitches that a bound must prove for a pair to pass."""
TIGHT_HALVINGS = 8
"""Halvings up to which a bound must prove a share of the least clearance seen."""


class Shape(NamedTuple):
    """What a sweep knows of the chain.

    Attributes:
        joint, hull: Of the module.
        size: Scale of the hull.
        apart: Pairs fewer links apart don't count.
        root: The module held still when there is no core; −1 when the core is.
        folded: (J,) hinge angles of the core.
        core: (n, WIDTH) the folded modules as bodies at rest.
        boxes: (n, 6) corners of the box around the centres of the folded modules up to each.
        origin, width, cells, starts, members: A grid of the folded centres: its corner, how wide
            its cells are and how many there are along x, y and z; cell c holds
            ``members[starts[c]:starts[c + 1]]``, and c counts along z first.
        places, rotations: (n, 3), (n, 3, 3) modules of a rod as seen from the one it starts at.
    """

    joint: Joint
    hull: Hull
    size: float
    apart: int
    root: int
    folded: Array
    core: Array
    boxes: Array
    origin: Array
    width: float
    cells: Ints
    starts: Ints
    members: Ints
    places: Array
    rotations: Array


class Angles(NamedTuple):
    """Frames: window k begins at hinge ``first[k]`` with ``values[offsets[k] - shift]``.

    ``shift`` is what comes before ``values`` begin.
    """

    first: Ints
    offsets: Ints
    shift: int
    values: Array


class Found(NamedTuple):
    """The closest place of a stretch of frames: see ``planner.clearance.sweep.Sweep``.

    ``unbounded`` is −1 where everything is bounded.
    """

    clearance: float
    where: float
    first: int
    second: int
    bound: float
    unbounded: float
    in_betweens: int


@njit(**INNER)
def _stretch(shape: Shape, first: int, last: int, count: int) -> tuple[int, int]:
    """First and last module of the stretch of a window: everything before and behind is rigid."""
    if shape.root >= 0:
        return 0, count - 1
    hinges = shape.joint.axes.shape[0]
    low = first // hinges + shape.joint.rigid_links
    if first % hinges:
        last = max(last, first + 1)
    high = (last - 1) // hinges + shape.joint.rigid_links + 1 if last > first else low
    return low, high


@njit(**INNER)
def _fill(shape: Shape, angles: Angles, frame: int, start: int, out: Array) -> None:
    """Writes the angles of a frame for the hinges from ``start`` on, as many as ``out`` holds."""
    first = angles.first[frame]
    begin = angles.offsets[frame] - angles.shift
    width = angles.offsets[frame + 1] - angles.offsets[frame]
    for k in range(out.shape[0]):
        hinge = start + k
        if hinge < first:
            out[k] = shape.folded[hinge]
        elif hinge < first + width:
            out[k] = angles.values[begin + hinge - first]
        else:
            out[k] = 0.0


@njit(**INNER)
def _near_core(
    shape: Shape, body: Array, module: int, low: int, most: float, pairs: Ints, count: int
) -> tuple[Ints, int]:
    """Adds the pairs of a module with those of the core whose centres are nearer than ``most``."""
    below = min(low, module - shape.apart + 1)
    if below <= 0:
        return pairs, count
    box = shape.boxes[below - 1]
    for r in range(3):
        if body[r] < box[r] - most or body[r] > box[3 + r] + most:
            return pairs, count
    o = shape.origin
    width = shape.width
    cells = shape.cells
    x0 = max(0, int(np.floor((body[0] - most - o[0]) / width)))
    y0 = max(0, int(np.floor((body[1] - most - o[1]) / width)))
    z0 = max(0, int(np.floor((body[2] - most - o[2]) / width)))
    x1 = min(cells[0], int(np.floor((body[0] + most - o[0]) / width)) + 1)
    y1 = min(cells[1], int(np.floor((body[1] + most - o[1]) / width)) + 1)
    z1 = min(cells[2], int(np.floor((body[2] + most - o[2]) / width)) + 1)
    for x in range(x0, x1):
        for y in range(y0, y1):
            row = (x * cells[1] + y) * cells[2]
            for at in range(shape.starts[row + z0], shape.starts[row + max(z0, z1)]):
                i = shape.members[at]
                if i >= below:
                    continue
                other = shape.core[i]
                dx, dy, dz = body[0] - other[0], body[1] - other[1], body[2] - other[2]
                if dx * dx + dy * dy + dz * dz < most * most:
                    pairs = append_pair(pairs, count, i, module)
                    count += 1
    return pairs, count


@njit(**INNER)
def _near_along(
    bodies: Array,
    drift: float,
    half: float,
    low: int,
    reach: float,
    apart: int,
    pairs: Ints,
) -> tuple[Ints, int, bool]:
    """Pairs of a stretch that swings far, and whether they are too many to be looked at.

    Seen from one of them, the other goes no farther than both go as seen from the root, and no
    farther than the hinges between turn times the links between. So few pairs of a nearly straight
    chain can meet, however far its ends go. Distances shrink by a pitch a link at most and both
    bounds only grow, so that where a pair is too far for a bound with more links, all with fewer
    are passed over.
    """
    count = ZERO
    m = bodies.shape[0]
    for i in range(m):
        j = i + apart
        while j < m:
            dx = bodies[j, 0] - bodies[i, 0]
            dy = bodies[j, 1] - bodies[i, 1]
            dz = bodies[j, 2] - bodies[i, 2]
            spare = length(dx, dy, dz) - reach
            own = bodies[i, DRIFT] + bodies[j, DRIFT]
            between = half * abs(bodies[j, RATES] - bodies[i, RATES]) * (j - i)
            if spare < min(own, between):
                pairs = append_pair(pairs, count, low + i, low + j)
                count += 1
                if count > MOST_NEAR * m:
                    return pairs, count, True
            leap = int(spare)
            while leap > 0:
                to = min(j + leap, m - 1)
                between = half * abs(bodies[to, RATES] - bodies[i, RATES]) * (to - i)
                if spare - leap >= min(bodies[i, DRIFT] + drift, between):
                    break
                leap //= 2
            j += 1 + max(leap, 0)
    return pairs, count, False


@njit(**INNER)
def _near(
    shape: Shape,
    bodies: Array,
    points: Array,
    half: float,
    low: int,
    high: int,
    reach: float,
    rod: Array,
    turned: Array,
    pairs: Ints,
) -> tuple[Ints, int, bool]:
    """Pairs that move against each other and may come nearer than ``reach``, and whether it's wild.

    Wild: something moves so far that there would be too many; then not all pairs are there.
    """
    count = ZERO
    m = bodies.shape[0]
    drift = 0.0
    for k in range(m):
        copy_vector(bodies[k, :3], points[k])
        drift = max(drift, bodies[k, DRIFT])
    if drift > WILD:
        pairs, count, wild = _near_along(bodies, drift, half, low, reach, shape.apart, pairs)
        if wild:
            return pairs, 0, True
    else:
        near = near_pairs(points, reach + 2.0 * drift, shape.apart)
        for p in range(near.shape[0]):
            i, j = near[p, 0], near[p, 1]
            dx = points[j, 0] - points[i, 0]
            dy = points[j, 1] - points[i, 1]
            dz = points[j, 2] - points[i, 2]
            most = reach + bodies[i, DRIFT] + bodies[j, DRIFT]
            if dx * dx + dy * dy + dz * dz < most * most:
                pairs = append_pair(pairs, count, low + i, low + j)
                count += 1
    if shape.root >= 0:
        return pairs, count, False
    for k in range(1, m):
        pairs, count = _near_core(
            shape, bodies[k], low + k, low, reach + bodies[k, DRIFT], pairs, count
        )
    # The rod: along it as far as nothing of it can be near the box of all others.
    box = np.empty(6)
    for r in range(3):
        box[r] = points[0, r]
        box[3 + r] = points[0, r]
        for k in range(m):
            box[r] = min(box[r], points[k, r] - bodies[k, DRIFT])
            box[3 + r] = max(box[3 + r], points[k, r] + bodies[k, DRIFT])
        if low > 0:
            box[r] = min(box[r], shape.boxes[low - 1, r])
            box[3 + r] = max(box[3 + r], shape.boxes[low - 1, 3 + r])
    last = bodies[m - 1]
    sway = min(2.0, half * last[MOST_SPIN])
    frame = last[ROTATION:VELOCITY].reshape((3, 3))
    behind = shape.core.shape[0] - high
    t = 1
    while t < behind:
        place = shape.places[t]
        outside = 0.0
        for r in range(3):
            at = last[r]
            for c in range(3):
                at += frame[r, c] * place[c]
            off = max(0.0, box[r] - at, at - box[3 + r])
            outside += off * off
        away = length(place[0], place[1], place[2])
        gap = np.sqrt(outside) - reach - last[DRIFT] - away * sway
        if gap > 0.0:
            # Per link the distance and the way change by no more than 1 + sway together.
            t += 1 + int(gap / (1.0 + sway))
            continue
        rod_body(last, place, shape.rotations[t], half, turned, rod)
        had = count
        most = reach + rod[DRIFT]
        for k in range(m - 1):  # the last module of the stretch is rigid with the rod
            if high + t - low - k < shape.apart:
                continue
            dx, dy, dz = rod[0] - points[k, 0], rod[1] - points[k, 1], rod[2] - points[k, 2]
            if dx * dx + dy * dy + dz * dz < (most + bodies[k, DRIFT]) ** 2:
                pairs = append_pair(pairs, count, low + k, high + t)
                count += 1
        pairs, count = _near_core(shape, rod, high + t, low, most, pairs, count)
        if count > had and rod[DRIFT] > WILD:
            return pairs, 0, True
        t += 1
    return pairs, count, False


@njit(**INNER)
def _look(
    shape: Shape,
    bodies: Array,
    half: float,
    low: int,
    high: int,
    pairs: Ints,
    start: int,
    stop: int,
    cap: float,
    worth: float,
    work: Array,
    turned: Array,
    left: Ints,
    count: int,
) -> tuple[float, int, int, float, Ints, int]:
    """The least clearance of pairs at s = 0 and the least that those keep that keep ``worth``.

    Appends the others to ``left``, which may be ``pairs`` itself.

    Returns:
        Least clearance at s = 0 and its pair (``cap`` and (−1, −1) when none is below), the least
        bound of those that pass, ``left`` and how many it holds.
    """
    best = cap
    bound = cap if half > 0.0 else -np.inf
    first = second = -1
    gap = np.empty(3)
    axis = np.empty(3)
    radius = shape.hull.radius * shape.size
    for p in range(start, stop):
        i, j = pairs[p, 0], pairs[p, 1]
        a = shape.core[i] if i < low else bodies[i - low]
        if j <= high:
            b = bodies[j - low]
        else:
            b = work[1]
            at = j - high
            rod_body(bodies[high - low], shape.places[at], shape.rotations[at], half, turned, b)
        lose = 0.0
        if half > 0.0:
            lose, distance = approach(a, b, half, radius, float(j - max(i, low)), work[0])
        else:
            distance = length(b[0] - a[0], b[1] - a[1], b[2] - a[2])
        apart = distance - 2.0 * radius
        if apart >= best and apart - lose >= bound:
            continue
        for r in range(3):
            gap[r] = b[r] - a[r]
        separation = separation_along(
            gap,
            a[ROTATION:VELOCITY].reshape((3, 3)),
            b[ROTATION:VELOCITY].reshape((3, 3)),
            shape.hull,
            shape.size,
            max(best, bound + lose),
            axis,
        )
        if separation < best:
            best = separation
            first = i
            second = j
        if half > 0.0 and separation < bound + lose:
            keeps = separation - loss_along(work[0], axis, half, radius)
            if keeps <= worth:
                left = append_pair(left, count, i, j)
                count += 1
            else:
                bound = min(bound, keeps)
    return best, first, second, bound, left, count


@njit(**KERNEL)
def rigid_clearances(
    positions: Array,
    rotations: Array,
    pairs: Ints,
    hull: Hull,
    size: float,
    enough: float,
) -> tuple[Array, Ints]:
    """The clearance of the modules up to each, and the pair that has it; (−1, −1) for ``enough``.

    Returns:
        (n,) and (n, 2).
    """
    n = positions.shape[0]
    least = np.full(n, enough)
    who = np.full((n, 2), -1)
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        separation = pair_separation(
            positions[j] - positions[i], rotations[i], rotations[j], hull, size, float(least[j])
        )
        if separation < least[j]:
            least[j] = separation
            who[j, 0] = i
            who[j, 1] = j
    for j in range(1, n):
        if least[j - 1] <= least[j]:
            least[j] = least[j - 1]
            who[j, 0] = who[j - 1, 0]
            who[j, 1] = who[j - 1, 1]
    return least, who


@njit(**INNER)
def _with_rigid_links(joint: Joint, rigid_links: int) -> Joint:
    """The same joint in a chain, or a stretch of one, with so many links at its start."""
    return Joint(rigid_links, joint.anchor, joint.axes, joint.turn, joint.offset)


@njit(**INNER)
def _between(
    shape: Shape,
    origin: Array,
    rates: Array,
    rigid: int,
    root: int,
    low: int,
    bodies: Array,
    points: Array,
    cap: float,
    least: float,
    share: float,
) -> tuple[float, float, int, int, float, float, int]:
    """Looks at all between two frames, of which the first is no closer than ``cap`` anywhere.

    Args:
        shape: The chain.
        origin, rates: Angles of the stretch's joints in the first frame, and how far they go.
        rigid: Links at the stretch's start without a joint.
        root: The body that is held still; its pose is given.
        low: The stretch's first module.
        bodies, points: (m, WIDTH), (m, 3) scratch for the modules of the stretch.
        cap: Pairs that stay this far apart are not looked at.
        least: The least clearance that was seen so far.
        share: Which part of that the bound should reach.

    Returns:
        Least clearance found, when that is, its pair (−1 when none is below ``cap``), the bound,
        a moment around which there is none (−1 when there is one everywhere), and how many moments
        were looked at.
    """
    high = low + bodies.shape[0] - 1
    reach = 2.0 * shape.hull.radius * shape.size
    joint = _with_rigid_links(shape.joint, rigid)
    work = np.empty((2, WIDTH))
    turned = np.empty((3, 3))
    pairs = np.empty((1024, 2), dtype=np.int64)
    left = np.empty((64, 2), dtype=np.int64)
    whiles = np.empty((2 * MOST_HALVINGS + 2, 2))
    ranges = np.empty((2 * MOST_HALVINGS + 2, 3), dtype=np.int64)
    found, where, first, second = cap, 0.5, -1, -1
    bound = cap
    unbounded = -1.0
    moments = 0
    held = ZERO
    whiles[0, 0], whiles[0, 1] = 0.5, 0.5
    ranges[0, 0], ranges[0, 1], ranges[0, 2] = -1, 0, 0
    depth = 1
    while depth > 0:
        depth -= 1
        middle, half = whiles[depth, 0], whiles[depth, 1]
        begins, ends, halvings = ranges[depth, 0], ranges[depth, 1], ranges[depth, 2]
        angles = origin + middle * rates
        move_bodies(angles, rates, half, joint, root, bodies)
        moments += 1
        wild = False
        who = left
        if begins < 0:
            pairs, ends, wild = _near(
                shape, bodies, points, half, low, high, reach + cap, work[1], turned, pairs
            )
            begins = 0
            who = pairs
        if wild:
            # Only whether it collides right now: then there is nothing to be proved.
            move_bodies(angles, rates, 0.0, joint, root, bodies)
            pairs, ends, _ = _near(
                shape, bodies, points, 0.0, low, high, reach, work[1], turned, pairs
            )
            who = pairs
            half = 0.0
        worth = share * min(least, found) if halvings < TIGHT_HALVINGS else 0.0
        value, i, j, keeps, left, now = _look(
            shape,
            bodies,
            half,
            low,
            high,
            who,
            begins,
            ends,
            cap,
            max(ROUNDING, worth),
            work,
            turned,
            left,
            held,
        )
        if value < found:
            found, where, first, second = value, middle, i, j
        if not wild:
            bound = min(bound, keeps)
            if now == held:
                continue
        if value <= 0.0 or halvings == (MOST_TAMINGS if wild else MOST_HALVINGS):
            bound = min(bound, 0.0)
            unbounded = middle
            continue
        quarter = 0.5 * whiles[depth, 1]
        for side in (1.0, -1.0):
            whiles[depth, 0], whiles[depth, 1] = middle + side * quarter, quarter
            ranges[depth, 0] = -1 if wild else held
            ranges[depth, 1], ranges[depth, 2] = now, halvings + 1
            depth += 1
        held = now
    return found, where, first, second, bound, unbounded, moments


@njit(**KERNEL, nogil=True)
def sweep_frames(
    shape: Shape,
    angles: Angles,
    start: int,
    stop: int,
    enough: float,
    known: Array,
    per_frame: Array,
    share: float,
) -> Found:
    """Looks at the frames from ``start`` to ``stop`` and between each and the next, if there is.

    Args:
        shape: The chain.
        angles: All frames, and of the angles at least those of ``start`` to ``stop`` (included).
        start, stop: Frame numbers.
        enough: Clearances of this and more are not told apart.
        known: (F,) clearance of what is rigid in each frame.
        per_frame: (F,) written: clearance of each frame.
        share: Which part of the least clearance seen the bound should reach where it can.
    """
    frames = angles.first.shape[0]
    modules = shape.core.shape[0]
    hinges = shape.joint.axes.shape[0]
    reach = 2.0 * shape.hull.radius * shape.size
    found, where, one, other = enough, float(start), -1, -1
    bound = enough
    unbounded = -1.0
    in_betweens = 0
    pairs = np.empty((4096, 2), dtype=np.int64)
    none = np.empty((1, 2), dtype=np.int64)
    work = np.empty((2, WIDTH))
    turned = np.empty((3, 3))
    room = np.empty((modules, WIDTH))
    place = np.empty((modules, 3))
    for k in range(start, stop):
        for to in range(k, min(k + 2, frames)):
            low, high = _stretch(
                shape,
                min(angles.first[k], angles.first[to]),
                max(
                    angles.first[k] + angles.offsets[k + 1] - angles.offsets[k],
                    angles.first[to] + angles.offsets[to + 1] - angles.offsets[to],
                ),
                modules,
            )
            # The first links of a chain have no joint.
            rigid = max(0, shape.joint.rigid_links - low)
            root = max(0, shape.root)
            bodies, points = room[: high - low + 1], place[: high - low + 1]
            copy_vector(shape.core[low + root], bodies[root])
            begin = max(0, low - shape.joint.rigid_links) * hinges
            origin = np.empty(max(0, high - low - rigid) * hinges)
            rates = np.empty_like(origin)
            _fill(shape, angles, k, begin, origin)
            _fill(shape, angles, to, begin, rates)
            rates -= origin
            if to == k:
                joint = _with_rigid_links(shape.joint, rigid)
                move_bodies(origin, rates, 0.0, joint, root, bodies)
                cap = min(enough, known[k])
                pairs, many, _ = _near(
                    shape, bodies, points, 0.0, low, high, reach + cap, work[1], turned, pairs
                )
                value, i, j, _, _, _ = _look(
                    shape,
                    bodies,
                    0.0,
                    low,
                    high,
                    pairs,
                    ZERO,
                    many,
                    cap,
                    0.0,
                    work,
                    turned,
                    none,
                    ZERO,
                )
                per_frame[k] = value
                at = float(k)
            else:
                # Pairs farther apart than the closest of a frame change neither figure.
                value, middle, i, j, keeps, loose, moments = _between(
                    shape,
                    origin,
                    rates,
                    rigid,
                    root,
                    low,
                    bodies,
                    points,
                    per_frame[k],
                    min(found, per_frame[k]),
                    share,
                )
                at = k + middle
                bound = min(bound, keeps)
                in_betweens += moments
                if loose >= 0.0:
                    unbounded = k + loose
            if value < found:
                found, where, one, other = value, at, i, j
    return Found(found, where, one, other, min(bound, found), unbounded, in_betweens)
