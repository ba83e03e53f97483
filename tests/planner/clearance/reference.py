"""Proof of clearance in plain NumPy, lemma by lemma: docs/decisions/0012-sweep-bound.md.

It checks every pair without search structures, so that the code reads like the lemmas. Lengths are
in pitches and angles in radians; a unit of time is the interval between two frames. Vectors are
given in the frame of the root module, which is fixed. An interval is |s| ≤ h about its midpoint.
"""
# Capital letters are bounds, as in the lemmas.
# pyright: reportConstantRedefinition=false

from typing import NamedTuple

import numpy as np
from numpy import cross, minimum
from numpy.typing import NDArray

from foldback.planner import core
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.sweep import BOUND_RATIO
from foldback.planner.core.structures import Hull

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Moves = tuple[Array, Array, Array, Array]
"""Velocity, acceleration and angular velocity of bodies b relative to bodies a at s = 0, and a
bound of the remainder for any point of b."""


class Body(NamedTuple):
    """Module at s = 0 with bounds over |s| ≤ h; several modules have one more axis in front."""

    p: Array  # centre
    R: Array  # orientation
    v: Array  # velocity of the centre
    a: Array  # acceleration of the centre
    w: Array  # angular velocity ω
    dw: Array  # angular acceleration ω'
    W: Array  # bound of |ω|
    DW: Array  # bound of |ω'|
    DDW: Array  # bound of |ω''|
    J: Array  # bound of the centre's jerk |p'''|
    D: Array  # bound of the centre's displacement from s = 0
    S: Array  # sum of |q'| of the hinges from the root on; negative on the other side of it


class Interval(NamedTuple):
    """Angles from ``start`` to ``start + rates`` at constant rates; modules low … high move."""

    chain: Chain
    size: float
    start: Array
    rates: Array
    root: int  # fixed
    low: int  # rigid with all modules before it
    high: int  # rigid with all modules after it


def norm(x: Array) -> Array:
    """Return the lengths of (…, 3) vectors."""
    return np.sqrt((x * x).sum(axis=-1))


def rotation(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit axis (Rodrigues)."""
    k = cross(np.eye(3), axis)  # k @ r = axis × r
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


def point_motion(body: Body, r: Array) -> tuple[Array, Array]:
    """Return velocity and acceleration of a point of a body, r from its centre, due to rotation."""
    return cross(body.w, r), cross(body.dw, r) + cross(body.w, cross(body.w, r))


def rotation_jerk(body: Body) -> Array:
    """Return a bound of |R'''|: lemma 2."""
    return body.DDW + 3.0 * body.W * body.DW + body.W**3


def walk(interval: Interval, middle: float, h: float, bodies: dict[int, Body], step: int) -> None:
    """Add all modules from the root, the only one of ``bodies``, to one end: lemmas 1 to 4."""
    joint, root, end = interval.chain.module.joint, interval.root, len(interval.chain) - 1
    q = interval.start + middle * interval.rates
    hinges: list[Array] = []
    for i in range(root, end if step > 0 else 0, step):
        body, link = bodies[i], min(i, i + step) - joint.rigid_links
        row = joint.row(min(i, i + step))
        anchor, axes, turn, offset = (table[row] for table in joint[3:])
        near, far = (anchor, offset) if step > 0 else (-offset, -anchor)
        near_arm, far_arm = norm(near), norm(far)
        dv, da = point_motion(body, body.R @ near)
        p, v, a = body.p + body.R @ near, body.v + dv, body.a + da  # of the joint's centre
        # Lemma 3: bounds of the centre's distance from the root, its speed and acceleration.
        C = norm(body.p - bodies[root].p) + body.D + near_arm
        dC = norm(body.v) + h * (norm(body.a) + 0.5 * h * body.J) + near_arm * body.W
        ddC = norm(body.a) + h * body.J + near_arm * (body.DW + body.W**2)
        R, w, dw, W, DW, DDW, S = body.R, body.w, body.dw, body.W, body.DW, body.DDW, body.S
        R = R if step > 0 else R @ turn.T
        for k in range(len(axes))[::step] if link >= 0 else ():
            hinge = link * len(axes) + k
            rate = step * interval.rates[hinge]
            axis, size = R @ axes[k], abs(rate)
            hinges.append(np.array([size, W, DW + W**2, C, dC, ddC]))
            # Lemma 1: exact; lemma 2: bounds.
            w, dw, DDW = w + rate * axis, dw + rate * cross(w, axis), DDW + size * (DW + W**2)
            S = S + step * size
            DW = min(norm(dw) + h * DDW, 0.5 * S**2)
            W = min(norm(w) + h * (norm(dw) + 0.5 * h * DDW), abs(S))
            R = R @ rotation(axes[k], step * q[hinge])
        R = R @ turn if step > 0 else R
        turned = body._replace(R=R, w=w, dw=dw, W=W, DW=DW, DDW=DDW, S=S)
        dv, da = point_motion(turned, R @ far)
        p, v, a = p + R @ far, v + dv, a + da
        J = body.J + near_arm * rotation_jerk(body) + far_arm * rotation_jerk(turned)
        if hinges:
            size, dn, ddn, C, dC, ddC = np.array(hinges).T
            P = norm(p - bodies[root].p) + h * (norm(v) + 0.5 * h * norm(a))
            lever = ddn * (P + C) + 2.0 * dn * (norm(v) + h * norm(a) + dC) + norm(a) + ddC
            power_remainder = 1.0 - (size * (h + h**2 * dn + h**3 / 6.0 * ddn)).sum()
            J = min(J, (size * lever).sum() / power_remainder) if power_remainder > 0.0 else J
        by_taylor = h * (norm(v) + h * (0.5 * norm(a) + h * J / 6.0))
        by_hinges = h * abs(S) * abs(i + step - root) * (near_arm + far_arm)
        bodies[i + step] = turned._replace(p=p, v=v, a=a, J=J, D=min(by_taylor, by_hinges))


def motion(interval: Interval, middle: float, h: float) -> Body:
    """Return all modules at one instant, with bounds: lemmas 1 to 4."""
    bodies = {interval.root: Body(np.zeros(3), np.eye(3), *np.zeros((4, 3)), *np.zeros(6))}
    walk(interval, middle, h, bodies, 1)
    walk(interval, middle, h, bodies, -1)
    straight = forward_kinematics(interval.chain.module, np.zeros_like(interval.start))
    last = bodies[interval.high]
    for t in range(1, len(interval.chain) - interval.high):
        r, R = last.R @ straight.positions[t], last.R @ straight.rotations[t]
        dv, da = point_motion(last, r)
        J, D = last.J + norm(r) * rotation_jerk(last), last.D + norm(r) * min(2.0, h * last.W)
        tail = last._replace(p=last.p + r, R=R, v=last.v + dv, a=last.a + da, J=J, D=D)
        bodies[interval.high + t] = tail
    return Body(*(np.array(x) for x in zip(*(bodies[i] for i in sorted(bodies)), strict=True)))


def relative_motion(a: Body, b: Body, h: float, rho: float, links: Array) -> Moves:
    """Return the motion of bodies b relative to a: lemma 5."""
    d, dd, ddd, y, dy = b.p - a.p, b.v - a.v, b.a - a.a, b.w - a.w, b.dw - a.dw
    x1 = dd - cross(a.w, d)
    x2 = ddd - cross(a.dw, d) - 2.0 * cross(a.w, dd) + cross(a.w, cross(a.w, d))
    dpsi, S, J, DDY = dy - cross(a.w, y), abs(b.S - a.S), a.J + b.J, a.DDW + b.DDW
    # Bounds over the interval: of |d|, |d'|, |d''| and |ω_b − ω_a|, then of the motion relative to
    # a.
    DDD = norm(ddd) + h * J
    DD = norm(dd) + h * (norm(ddd) + 0.5 * h * J)
    D = norm(d) + h * DD
    Y = norm(y) + h * (norm(dy) + 0.5 * h * DDY)
    X3 = J + 3.0 * a.W * DDD + 3.0 * (a.DW + a.W**2) * DD + rotation_jerk(a) * D
    X3 = minimum(X3, S**3 * links)
    DDPSI = minimum(DDY + 2.0 * a.W * (a.DW + b.DW) + (a.DW + a.W**2) * Y, 0.5 * S**3)
    DPSI = norm(dpsi) + h * DDPSI
    PSI = minimum(norm(y) + h * (norm(dpsi) + 0.5 * h * DDPSI), S)
    Q3 = minimum(DDPSI + 3.0 * PSI * DPSI + PSI**3, S**3)
    return x1, x2, y, 0.5 * h**2 * rho * (norm(dpsi) + norm(y) ** 2) + h**3 / 6.0 * (X3 + rho * Q3)


def loss(moves: Moves, h: float, rho: float, n: Array | None = None) -> Array:
    """Return the largest approach of points of b along n or along any axis: lemma 6."""
    u, p, y, remainder = moves
    if n is None:
        return h * (norm(u) + 0.5 * h * norm(p) + rho * norm(y)) + remainder
    return h * (abs(u @ n) + 0.5 * h * abs(p @ n) + rho * norm(cross(n, y))) + remainder


def separation(hull: Hull, size: float, d: Array, Ra: Array, Rb: Array) -> tuple[float, Array]:
    """Return the largest separation of two modules over the candidate axes, and its axis."""
    crossed = cross((hull.edges @ Ra.T)[:, None], hull.edges @ Rb.T).reshape(-1, 3)
    crossed = crossed[norm(crossed) > 1e-9]
    crossed = crossed / norm(crossed)[:, None]
    axes = np.concatenate([hull.normals @ Ra.T, hull.normals @ Rb.T, crossed])
    a, b = size * hull.vertices @ Ra.T @ axes.T, size * hull.vertices @ Rb.T @ axes.T
    gap = axes @ d
    apart = np.maximum(gap + b.min(0) - a.max(0), a.min(0) - b.max(0) - gap)
    return float(apart.max()), axes[apart.argmax()]


def near_pairs(bodies: Body, interval: Interval, h: float, reach: float) -> tuple[Ints, bool]:
    """Return pairs that may be closer than ``reach``, and True if motion is too large: lemma 7."""
    chain, size, *_, low, high = interval
    i, j = np.triu_indices(len(chain), chain.module.apart)
    nearing, bent = bodies.D[i] + bodies.D[j], (low <= i) & (j <= high)
    large = bodies.D[low : high + 1].max() > core.LARGE_MOTION
    if large:
        by_hinges = h * abs(bodies.S[j] - bodies.S[i]) * (j - i)
        nearing = np.where(bent, minimum(nearing, by_hinges), nearing)
    near = norm(bodies.p[j] - bodies.p[i]) - 2.0 * chain.module.radius * size - reach < nearing
    near &= (j > low) & (i < high)  # the others are rigid with each other
    too_many = large and (near & bent).sum() > core.MAX_PAIRS_PER_MODULE * (high - low + 1)
    swinging = near & (j > high) & (bodies.D[j] > core.LARGE_MOTION)
    return np.stack([i, j], axis=1)[near], bool(too_many or swinging.any())


def check(
    bodies: Body, interval: Interval, pairs: Ints, h: float, cutoff: float, target: float
) -> tuple[float, float, Ints]:
    """Return minimum clearance at s = 0, minimum bound of proved pairs, other pairs: lemma 8."""
    module, (i, j) = interval.chain.module, pairs.T
    rho = module.radius * interval.size
    a, b = (Body(*(field[index] for field in bodies)) for index in (i, j))
    u, p, y, series_remainder = moves = relative_motion(
        a, b, h, rho, j - np.maximum(i, interval.low)
    )
    any_loss, balls = loss(moves, h, rho), norm(b.p - a.p) - 2.0 * rho
    clearance, bound, unresolved = cutoff, cutoff if h > 0.0 else -np.inf, []
    for k, (i, j) in enumerate(pairs):
        if balls[k] >= clearance and balls[k] - any_loss[k] >= bound:
            continue
        d = bodies.p[j] - bodies.p[i]
        gap, n = separation(module.hull, interval.size, d, bodies.R[i], bodies.R[j])
        clearance = min(clearance, gap)
        if h > 0.0 and gap - any_loss[k] < bound:
            lower_bound = gap - float(loss((u[k], p[k], y[k], series_remainder[k]), h, rho, n))
            if lower_bound > target:
                bound = min(bound, lower_bound)
            else:
                unresolved.append((i, j))
    return clearance, bound, np.array(unresolved, dtype=np.int64).reshape(-1, 2)


def prove_interval(interval: Interval, cutoff: float, minimum: float) -> tuple[float, float | None]:
    """Return the minimum clearance observed between two frames and its bound, or None: lemma 9."""
    clearance = bound = cutoff
    stack: list[tuple[float, float, int, Ints | None]] = [(0.5, 0.5, 0, None)]
    while stack:
        middle, h, bisections, unresolved = stack.pop()
        bodies, pairs, too_large = motion(interval, middle, h), unresolved, False
        if pairs is None:
            pairs, too_large = near_pairs(bodies, interval, h, cutoff)
        if too_large:
            bodies = motion(interval, middle, 0.0)
            pairs, _ = near_pairs(bodies, interval, 0.0, 0.0)
        tight = BOUND_RATIO * min(minimum, clearance) * (bisections < core.TIGHT_BISECTIONS)
        target, width = max(core.ROUNDING_MARGIN, tight), 0.0 if too_large else h
        now, proved, unresolved = check(bodies, interval, pairs, width, cutoff, target)
        clearance = min(clearance, now)
        bound = bound if too_large else min(bound, proved)
        if not too_large and len(unresolved) == 0:
            continue
        limit = core.MAX_COARSE_BISECTIONS if too_large else core.MAX_BISECTIONS
        if now <= 0.0 or bisections == limit:
            return clearance, None
        pairs = None if too_large else unresolved
        stack += [(middle + side * h, 0.5 * h, bisections + 1, pairs) for side in (0.5, -0.5)]
    return clearance, bound


def prove(intervals: list[Interval], cutoff: float) -> tuple[float, float | None]:
    """Return the minimum clearance observed in a motion and its bound; None if unproved.

    The start of the last interval is the end of the motion; its rates are ignored.
    """
    smallest_cutoff = bound = cutoff
    for interval in intervals:
        changed = interval._replace(low=0, high=len(interval.chain) - 1)
        bodies = motion(changed, 0.0, 0.0)
        pairs, _ = near_pairs(bodies, changed, 0.0, cutoff)
        at_frame, _, _ = check(bodies, changed, pairs, 0.0, cutoff, 0.0)
        smallest_cutoff = min(smallest_cutoff, at_frame)
        if interval is not intervals[-1]:
            between, proved = prove_interval(interval, at_frame, smallest_cutoff)
            smallest_cutoff = min(smallest_cutoff, between)
            if proved is None:
                return smallest_cutoff, None
            bound = min(bound, proved)
    return smallest_cutoff, min(bound, smallest_cutoff) if smallest_cutoff > 0.0 else None
