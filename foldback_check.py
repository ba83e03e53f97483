"""Prove from a plan file alone that a chain of modules folds without touching itself.

    python foldback_check.py plan.npz [--cells path.json] [--size S] [--claim C] [--json]

Needs NumPy and nothing of foldback. The claim is that of docs/certificate.md: frames, hinges that turn evenly between
them, modules of a given size, and a clearance that every pair of modules keeps *all the time*, apart from pairs that
share a joint. Exit status: 0 proved, 1 not proved (with modules, moment and gap), 2 no readable plan.

MOTION.  Seen from module i, a point v of module j is y(t) = sum_m P_m(t) e_m + P(t) v: products of hinge turns (and
constant turns), and constant links e_m. Each derivative brings down one hinge's rate and a cross product with a unit
vector, so |y^(p)| <= S^p (L + |v|): S the sum of |rates| of the hinges between, L the length of the links between.
INTERPOLATION.  For a unit n fixed in i, interpolating n.y at the p Chebyshev nodes of an interval of w frames is off by
at most rem = c (w S)^p (L + r), c = 2 / (4^p p!), r the radius of a module. A polynomial is nowhere below its least
Bernstein coefficient. So: the least coefficient over j's corners, less i's support along n, less rem, is a lower
bound of the distance of the two modules during the whole interval. If it is below the claim, the interval is halved.
The axis n may be chosen in any way: a bad one proves nothing, and cannot prove a falsehood. Same with i and j exchanged.
CANDIDATES.  Modules whose centres are 2 r + claim apart are clear. From mid-interval on a centre moves at most
D = min(Lambda max_k |x(t_k) - x(mid)| + c (w S)^p L, w S L / 2) as seen from a module held still (Lambda: Lebesgue
constant of the nodes), a vector fixed in a module turns by at most D with L = 1, and two centres approach by no more
than D + D or w S L / 2 of the hinges between them. Boxes about parts of the chain are compared, then boxes of halves.
RIGID PAIRS.  Between which no hinge turns keep the distance that was proved before. In a windowed plan the modules before
the moving part are as folded, those behind it straight: both shapes are proved once, with all their pairs.
ROUNDING (u = 2^-53).  Angles are off by at most 4 u |step| + 2 u |angle|, NumPy's sine and cosine by 4 ulp: a, all told.
A hinge mixes two columns of a rotation, each off by (2 a + 3 u), both by less than sqrt 2 times that; a constant turn
whose entries are not 0 and +-1 adds 15 u. Turning keeps the Frobenius norm of older errors, so after m links a rotation
is off by m e, e the sum for one link, a position by l m^2 (e/2 + 8 u), l the length of a link. Differences seen from
another module, with corners: at most E0 = n (l n + 2 r) (2 e + 48 u) for n modules; Bernstein coefficients multiply by
|B|, and B itself, axes and supports add 256 u: E = |B| (l n + 2 r) (n (2 e + 48 u) + 256 u) is taken off every bound.
Products of 1 + (few n) u and sums of rates are covered by factors 1 + 1e-9 and by `slack`. For 160 cubes E is 1e-9.
"""

import argparse
import hashlib
import json
import math
import pathlib
import sys
import time
import zipfile

import numpy as np

U = 2.0**-53
ORDER = 5  # nodes of an interval; odd, so that one of them is its middle
DEPTH = 14  # an interval is halved at most so many times
BATCH = 300_000  # poses that are computed at once
PAIRS = 20_000  # pairs that are looked at, at once
CROWD = 200  # pairs for each moving module from which on an interval is halved unseen
CUBE = dict(corners=[[x, y, z] for x in (-.5, .5) for y in (-.5, .5) for z in (-.5, .5)], anchor=[0, 0, 0], axes=[[0, 0, 1], [0, 1, 0]],
            turn=np.eye(3).tolist(), offset=[1, 0, 0], rigid_links=1, apart=2, limit_rad=math.radians(92), hinges=["_z", "_y"])
TETRAHEDRON = dict(corners=[[-.5, -1, 0], [-.5, 1, 0], [.5, 0, -1], [.5, 0, 1]], anchor=[.5, 0, 0], axes=[[0, 0, 1]],
                   turn=[[1, 0, 0], [0, 0, -1], [0, 1, 0]], offset=[.5, 0, 0], rigid_links=0, apart=1, limit_rad=math.radians(90.85), hinges=[""])
KNOWN = {"cube": CUBE, "tetrahedron": TETRAHEDRON}


class NotProved(Exception):
    """What could not be proved, and where."""


class Unreadable(Exception):
    """The file holds no plan."""


def require(condition, message):
    if not condition:
        raise NotProved(message)


# ------------------------------------------------------------------ modules
def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def directions(vectors):
    """Unit vectors without repeats, of opposite ones only one."""
    found = []
    for v in vectors:
        if np.linalg.norm(v) > 1e-9 and not any(abs(unit(v) @ f) > 1 - 1e-9 for f in found):
            found.append(unit(v))
    return np.array(found)


class Module:
    """A convex module at its size, and the joint to the next one: pose' = pose anchor turn(axis, q)... turn offset."""

    def __init__(self, told, size):
        self.V = np.array(told["corners"], float) * size
        self.radius = float(np.linalg.norm(self.V, axis=1).max())
        self.half = np.abs(self.V).max(0)
        self.box = len(self.V) == 8 and (np.abs(self.V) == self.half).all() and len(np.unique(self.V, axis=0)) == 8
        planes = []  # corners on each face
        for a in range(len(self.V)):
            for b in range(a):
                for c in range(b):
                    normal = np.cross(self.V[a] - self.V[c], self.V[b] - self.V[c])
                    level = (self.V - self.V[c]) @ normal
                    flat = np.abs(level) < 1e-9
                    if np.linalg.norm(normal) > 1e-9 and ((level <= 1e-9).all() or (level >= -1e-9).all()):
                        planes.append((normal, frozenset(np.flatnonzero(flat).tolist())))
        require(planes, "the module's corners span no solid")
        self.faces = directions(p[0] for p in planes)
        sets = {p[1] for p in planes}
        self.edges = directions(self.V[a] - self.V[b] for a in range(len(self.V)) for b in range(a) if sum({a, b} <= s for s in sets) > 1)
        self.anchor, self.offset = np.array(told["anchor"], float), np.array(told["offset"], float)
        self.link = float(np.linalg.norm(self.anchor) + np.linalg.norm(self.offset)) * (1 + 1e-12)
        turn, axes = np.array(told["turn"], float), np.array(told["axes"], float)
        require(np.abs(turn @ turn.T - np.eye(3)).max() < 1e-15 * 8 and np.linalg.det(turn) > 0, "the joint's turn is no rotation")
        require(np.abs(np.linalg.norm(axes, axis=1) - 1).max() < 1e-15 * 8, "a hinge axis is no unit vector")
        frames = [np.eye(3)]  # each with a hinge axis as third column
        for axis in axes:
            one = unit(np.cross(axis, np.eye(3)[(np.abs(axis).argmax() + 2) % 3])) if np.count_nonzero(axis) > 1 else np.roll(np.eye(3), 1, 0)[np.abs(axis).argmax()]
            frames.append(np.stack([one, np.cross(axis, one), axis], axis=1))
        self.between = [frames[k].T @ frames[k + 1] for k in range(len(axes))] + [frames[-1].T @ turn]
        self.plain = all(np.isin(m, (-1, 0, 1)).all() for m in self.between)
        self.hinges, self.rigid, self.apart = len(axes), int(told["rigid_links"]), int(told["apart"])
        self.limit, self.names = float(told["limit_rad"]), told["hinges"]

    def least(self, v):
        """Least of v . corner over the corners, (..., 3) to (...)."""
        return -(np.abs(v) @ self.half) if self.box else (v @ self.V.T).min(-1)

    def poses(self, q, x, C):
        """Centres (W+1, M, 3) and axes as rows (W+1, M, 3, 3) of (W, K, M) angles, the first at x (3, M), C (3, 3, M)."""
        X, R = np.empty((len(q) + 1, *x.shape)), np.empty((len(q) + 1, *C.shape))
        X[0], R[0] = x, C
        cos, sin = np.cos(q), np.sin(q)
        for m in range(len(q)):
            before, C = C, R[m + 1]
            C[:] = before
            for k, turn in enumerate(self.between):
                if not np.array_equal(turn, np.eye(3)):
                    C[:] = (turn.T @ C.reshape(3, -1)).reshape(C.shape)
                if k < self.hinges:
                    c, s, first = cos[m, k], sin[m, k], C[0].copy()
                    C[0] = c * first + s * C[1]
                    C[1] = c * C[1] - s * first
            X[m + 1] = X[m] + sum(a * b for a, b in zip(self.anchor, before) if a) + sum(a * b for a, b in zip(self.offset, C) if a)
        return np.ascontiguousarray(X.transpose(0, 2, 1)), np.ascontiguousarray(R.transpose(0, 3, 1, 2))


# ------------------------------------------------------------------ plans
class Motion:
    """Angles of all hinges at each frame: those before a window as folded, those behind it 0. Slots count rigid links too."""

    def __init__(self, module, n, first, offsets, values, folded, windowed):
        pad = module.rigid * module.hinges
        self.slots, self.windowed = (n - 1) * module.hinges, windowed
        self.first, self.offsets, self.values = np.asarray(first, "i8") + pad * windowed, np.asarray(offsets, "i8"), values
        self.folded = np.concatenate([np.zeros(pad), folded])
        self.last = self.first + np.diff(self.offsets)

    def frame(self, k, low, high):
        """Angles of the slots low to high, those beyond the chain 0."""
        out, a, b = np.zeros(high - low), self.first[k], self.last[k]
        core = max(min(a, high), low)
        out[:core - low] = self.folded[low:core]
        s, e = max(min(a, high), low), max(min(b, high), low)
        out[s - low:e - low] = self.values[self.offsets[k] + s - a:self.offsets[k] + e - a]
        return out


def whole(planes):
    codes = np.ascontiguousarray(planes.T).view("<u4").astype("i8").ravel()
    return (codes >> 1) ^ -(codes & 1)


def window_values(told, first, offsets, folded, f):
    """Angles of windowed frames; stored are changes since the frame before, a hinge that enters counts as folded or as 0."""
    if "angle_planes" not in f:
        return np.asarray(f["angles_rad"], float)
    changes, step = whole(f["angle_planes"]), told["angles"]["step_rad"]
    require(len(changes) == offsets[-1], "another number of angles than the windows need")
    at_rest = np.rint(folded / step).astype("i8")
    now, out, low, high = np.zeros(len(folded), "i8"), np.empty(len(changes), "f4"), 0, 0
    for k, a in enumerate(first):
        b = a + offsets[k + 1] - offsets[k]
        if k:
            now[a:min(low, b)], now[max(high, a):b] = at_rest[a:min(low, b)], 0
        low, high = a, b
        now[a:b] += changes[offsets[k]:offsets[k + 1]]
        out[offsets[k]:offsets[k + 1]] = now[a:b] * step
    return out.astype(float)


class Plan:
    """A plan file, checked against what it says of itself."""

    def __init__(self, path, size=None, claim=None):
        try:
            with np.load(path, allow_pickle=False) as file:
                f = {name: file[name] for name in file.files}
            self.told = told = json.loads(str(f["plan"]))
            said, chain = told["certificate"], told["chain"]
            self.size = float(said["module_size"] if size is None else size)
            geometry = told.get("claim", {}).get("module") or KNOWN[chain["module"]]
            require(chain["module"] not in KNOWN or json.dumps(geometry) == json.dumps(KNOWN[chain["module"]]), f"another module than a {chain['module']}")
            require(0 < self.size <= 1, f"a module size of {self.size:g}")
            self.module, self.n = Module(geometry, self.size), int(chain["modules"])
            self.claim = float(said["clearance_bound"] or 0.0) if claim is None else claim
            folded = np.array(chain["folded_rad"], float)
            self.read(f, folded)
        except (KeyError, TypeError, ValueError, OSError, zipfile.BadZipFile, EOFError) as error:
            raise Unreadable(f"{path}: no readable plan ({type(error).__name__}: {error})") from error
        self.agrees(f, said, folded)

    def read(self, f, folded):
        m, n, told, J = self.module, self.n, self.told, len(folded)
        require(n >= 2 and J == (n - 1 - m.rigid) * m.hinges, f"{J} hinges for {n} modules")
        names = [f"joint_{i}{h}" for i in range(m.rigid, n - 1) for h in m.names]
        require([str(name) for name in f["joint_names"]] == names, "other names of the hinges, or another order")
        self.windowed = "first" in f
        if self.windowed:
            first, offsets = f["first"].astype("i8"), f["offsets"].astype("i8")
            widths = np.diff(offsets)
            require(len(widths) == len(first) and len(first) and offsets[0] == 0 and (widths >= 0).all() and (first >= 0).all()
                    and (first + widths <= J).all(), "windows that do not lie within the chain")
            values = window_values(told, first, offsets, folded, f)
            require(len(values) == offsets[-1], "another number of angles than the windows need")
            self.digest = (first, offsets, values)
        else:
            q = f.get("joint_angles_rad")
            if q is None:
                q = whole(f["angle_planes"]).reshape(told["angles"]["shape"])
                for _ in range(told["angles"]["differences"]):
                    q = q.cumsum(axis=0)
                q = q * told["angles"]["step_rad"]
            q = np.asarray(q, float)
            require(q.ndim == 2 and q.shape[1] == J and len(q), f"angles of the shape {q.shape} for {J} hinges")
            self.digest = (q,)
            q = np.concatenate([np.zeros((len(q), m.rigid * m.hinges)), q], axis=1)
            first, offsets, values = np.zeros(len(q), "i8"), np.arange(len(q) + 1) * q.shape[1], q.ravel()
        self.motion, self.F = Motion(m, n, first, offsets, values, folded, self.windowed), len(first)

    def agrees(self, f, said, folded):
        m, motion = self.module, self.motion
        require(str(said["verdict"]).startswith("verified"), f"the plan itself says: {said['verdict']}")
        require(math.isfinite(self.claim) and self.claim > 0, "the plan claims no clearance")
        exempt = said.get("exempt_pairs") or dict(apart=m.apart, count=(m.apart - 1) * (self.n - 1))
        require((exempt["apart"], exempt["count"]) == (m.apart, (m.apart - 1) * (self.n - 1)), "other pairs are exempt than those that share a joint")
        require(np.isfinite(motion.values).all() and np.isfinite(folded).all(), "angles that are not finite")
        most = max(np.abs(motion.values).max(initial=0), np.abs(folded).max(initial=0))
        require(most <= m.limit + 1e-6, f"a hinge turns to {math.degrees(most):.3f} degrees, beyond {math.degrees(m.limit):.2f}")
        self.most = float(most)
        times = f["time_s"]
        require(len(times) == self.F and np.isfinite(times).all() and (np.diff(times) >= 0).all(), "times that do not rise from frame to frame")
        begin = self.told.get("start")
        start = np.zeros(len(folded)) if begin is None else np.array(begin["folded_rad"], float)
        pad = m.rigid * m.hinges
        require(len(start) == len(folded) and np.abs(motion.frame(0, pad, motion.slots) - start).max(initial=0) <= 1e-6,
                "does not begin straight" if begin is None else "does not begin as it says")
        require(np.abs(motion.frame(self.F - 1, pad, motion.slots) - folded).max(initial=0) <= 1e-6, "does not end folded")
        self.sha256 = hashlib.sha256(b"".join(np.ascontiguousarray(a).astype(a.dtype.newbyteorder("<")).tobytes() for a in self.digest)).hexdigest()
        told = self.told.get("claim", {}).get("angles_sha256", self.sha256)
        require(told == self.sha256, "the angles are not those of the digest")


# ------------------------------------------------------------------ candidates
def levels(low, high):
    """Centres and half sizes of boxes about 1, 2, 4, ... neighbours along axis 0."""
    found = [((low + high) / 2, (high - low) / 2)]
    while len(low) > 1:
        if len(low) % 2:
            low, high = np.concatenate([low, low[-1:]]), np.concatenate([high, high[-1:]])
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        found.append(((low + high) / 2, (high - low) / 2))
    return found


def largest(values):
    found = [values]
    while len(values) > 1:
        values = np.concatenate([values, values[-1:]]) if len(values) % 2 else values
        values = np.maximum(values[::2], values[1::2])
        found.append(values)
    return found


class Batch:
    """Some intervals: poses at their nodes, of the moving modules; modules before are at rest, those behind are straight."""

    def __init__(self, proof, items):
        self.proof, self.items, m, motion, n = proof, items, proof.module, proof.motion, proof.n
        self.k, self.t, self.w = k, t, w = [np.array([item[a] for item in items]) for a in range(3)]
        after = np.minimum(k + 1, len(motion.first) - 1)
        low, high = np.minimum(motion.first[k], motion.first[after]), np.maximum(motion.last[k], motion.last[after])
        self.c = c = np.minimum(low // m.hinges, n - 2)
        self.W = W = int(max((-(-high // m.hinges) - c).max(), 1))
        ends = [[motion.frame(f, a * m.hinges, (a + W) * m.hinges) for a, f in zip(c, frames)] for frames in (k, after)]
        q, step = np.array(ends[0]), np.array(ends[1]) - np.array(ends[0])
        rates = np.abs(step).reshape(len(k), W, -1).sum(2) * w[:, None]
        self.S = np.concatenate([np.zeros((len(k), 1)), rates.cumsum(1)], axis=1) * (1 + 1e-9)
        self.slack = 4 * (W * m.hinges + 4) * U * self.S[:, -1]
        self.turning = np.concatenate([np.zeros((len(k), 1), int), (rates > 0).cumsum(1)], axis=1)
        at = t[:, None] + w[:, None] * proof.nodes
        q = (q[:, None] + at[:, :, None] * step[:, None]).reshape(len(k) * ORDER, W, m.hinges).transpose(1, 2, 0)
        base = np.repeat(c, ORDER)
        x, C = m.poses(q, proof.core_x[base].T, proof.core_C[base].transpose(1, 2, 0))
        self.x, self.C = x.reshape(W + 1, len(k), ORDER, 3), C.reshape(W + 1, len(k), ORDER, 3, 3)
        self.fresh = k == 0

    def boxes(self):
        """What is needed to find pairs: boxes about the moving modules, and how far they and the tail go."""
        p, root, mid = self.proof, 0 if self.proof.motion.windowed else self.W // 2, ORDER // 2
        seen = np.einsum("bkax,nbkx->nbka", self.C[root], self.x - self.x[root])
        way = np.sqrt(((seen - seen[:, :, mid:mid + 1])**2).sum(3)).max(2)
        turn = np.abs(self.S - self.S[:, root:root + 1]).T + self.slack
        L = np.abs(np.arange(self.W + 1) - root)[:, None] * p.module.link
        self.way = largest((np.minimum(p.lebesgue * way + p.c * turn**ORDER * L, .5 * turn * L) + p.E) * (1 + 1e-9))
        C = np.einsum("bkax,bkcx->bkac", self.C[root], self.C[-1])
        way = np.sqrt(((C - C[:, mid:mid + 1])**2).sum((2, 3))).max(1)
        self.swing = (np.minimum(p.lebesgue * way + p.c * turn[-1]**ORDER, .5 * turn[-1]) + p.E) * (1 + 1e-9)
        self.local = levels(self.x[:, :, mid], self.x[:, :, mid])
        self.tail_x, self.tail_C = self.x[-1, :, mid], self.C[-1, :, mid]

    def node(self, kind, level, i, b):
        """Centre, half size, and way of a box about part of the chain; its first and last module."""
        p, n = self.proof, self.proof.n
        first, last = i << level, ((i + 1) << level) - 1
        if kind == "core":
            centre, half = p.core[level]
            return centre[i], half[i], 0.0, first, np.minimum(last, self.c[b] - 1)
        if kind == "local":
            (centre, half), way = self.local[level], self.way[level]
            return centre[i, b], half[i, b], way[i, b], self.c[b] + first, self.c[b] + np.minimum(last, self.W)
        centre, half = p.tail[level]
        C = self.tail_C[b]
        way = self.way[0][-1, b] + p.tail_far[level][i] * self.swing[b]
        begin = self.c[b] + self.W + 1
        return self.tail_x[b] + np.einsum("qax,qa->qx", C, centre[i]), np.einsum("qax,qa->qx", np.abs(C), half[i]), way, begin + first, begin + last

    def between(self, table, i, j, b):
        return table[b, np.clip(j - self.c[b], 0, self.W)] - table[b, np.clip(i - self.c[b], 0, self.W)]

    def near(self, one, two, tops, open_):
        """Pairs (b, i, j), i before j, that may come too near; closes intervals with a crowd of them."""
        p, n = self.proof, self.proof.n
        b = np.flatnonzero(open_)
        i = j = np.zeros(len(b), int)
        li, lj = tops
        while True:
            ci, hi, wi, fi, ei = self.node(one, li, i, b)
            cj, hj, wj, fj, ej = self.node(two, lj, j, b)
            ej = np.minimum(ej, n - 1)
            S = self.between(self.S, fi, ej, b) + self.slack[b]
            gap = np.maximum(np.abs(ci - cj) - hi - hj, 0)
            way = np.minimum(wi + wj, .5 * S * (ej - fi) * p.module.link) * (1 + 1e-9)
            keep = (np.sqrt((gap * gap).sum(1)) < p.reach + way) & (ej - fi >= p.module.apart) & (fj < n) & (ei >= fi)
            keep &= self.fresh[b] | (self.between(self.turning, fi, ej, b) > 0)
            b, i, j = b[keep], i[keep], j[keep]
            crowd = np.bincount(b, minlength=len(self.k)) > CROWD * (self.W + 10)
            if crowd.any():
                open_ &= ~crowd
                keep = ~crowd[b]
                b, i, j = b[keep], i[keep], j[keep]
            if not li and not lj:
                return b, self.node(one, 0, i, b)[3], self.node(two, 0, j, b)[3]
            if li >= lj:
                li -= 1
                i = np.concatenate([2 * i, 2 * i + 1])
                b, j = np.tile(b, 2), np.tile(j, 2)
                keep = i < p.sizes(self, one)[li]
            else:
                lj -= 1
                j = np.concatenate([2 * j, 2 * j + 1])
                b, i = np.tile(b, 2), np.tile(i, 2)
                keep = j < p.sizes(self, two)[lj]
            b, i, j = b[keep], i[keep], j[keep]

    def poses(self, modules, b):
        """Centres (Q, p, 3) and axes (Q, p, 3, 3) of any modules."""
        at = modules - self.c[b]
        inside = np.clip(at, 0, self.W)
        x, C = self.x[inside, b], self.C[inside, b]
        core, tail = np.flatnonzero(at < 0), np.flatnonzero(at > self.W)
        x[core], C[core] = self.proof.core_x[modules[core], None], self.proof.core_C[modules[core], None]
        xs, Cs = self.proof.straight_x[at[tail] - self.W], self.proof.straight_C[at[tail] - self.W]
        x[tail] += np.einsum("qpax,qa->qpx", C[tail], xs)
        C[tail] = np.einsum("qab,qpbx->qpax", Cs, C[tail])
        return x, C


# ------------------------------------------------------------------ proof
class Proof:
    """The proof of one motion."""

    def __init__(self, plan):
        self.module, self.motion, self.n, self.claim = m, _, n, _ = plan.module, plan.motion, plan.n, plan.claim
        p, grid = ORDER, np.linspace(0, 1, 20001)
        self.nodes = np.sort((1 - np.cos((2 * np.arange(p) + 1) * np.pi / (2 * p))) / 2)
        lagrange = [np.prod([(grid - s) / (t - s) for s in self.nodes if s != t], axis=0) for t in self.nodes]
        self.lebesgue = float(np.abs(lagrange).sum(0).max()) * 1.001
        self.B = np.linalg.inv([[math.comb(p - 1, k) * t**k * (1 - t)**(p - 1 - k) for k in range(p)] for t in self.nodes])
        self.c = 2 / (4.0**p * math.factorial(p)) * (1 + 1e-9)
        a = 4 * U * 2 * plan.most + 2 * U * plan.most + 4 * U
        e = m.hinges * math.sqrt(2) * (2 * a + 3 * U) + (0 if m.plain else (m.hinges + 1) * 15 * U)
        self.E = float(np.abs(self.B).sum(1).max()) * (m.link * n + 2 * m.radius) * (n * (2 * e + 48 * U) + 256 * U)
        self.reach = 2 * m.radius + self.claim + self.E
        self.least, self.gap, self.where, self.looks, self.pairs = math.inf, math.inf, None, 0, 0

    def at_rest(self, slots):
        """Centres and axes of the chain with these angles."""
        x, C = self.module.poses(slots.reshape(self.n - 1, self.module.hinges, 1), np.zeros((3, 1)), np.eye(3)[:, :, None])
        return x[:, 0], C[:, 0]

    def run(self, report=None):
        moving = self.motion
        self.core_x, self.core_C = self.straight_x, self.straight_C = np.zeros((1, 3)), np.eye(3)[None]
        if moving.windowed:
            shapes = [moving.folded, np.zeros(moving.slots)]
            for slots in shapes:
                self.motion = Motion(self.module, self.n, [0], [0, len(slots)], slots, slots[self.module.rigid * self.module.hinges:], False)
                self.prove([(0, 0.0, 1.0, None)])
            (self.core_x, self.core_C), (self.straight_x, self.straight_C) = map(self.at_rest, shapes)
            self.core = levels(self.core_x, self.core_x)
            tail = self.straight_x[1:]
            self.tail, self.tail_far = levels(tail, tail), largest(np.linalg.norm(tail, axis=1) * (1 + 1e-9))
            self.motion = moving
        self.prove([(k, 0.0, 1.0, None) for k in range(max(1, len(moving.first) - 1))][::-1], report)
        return self

    def prove(self, todo, report=None):
        m, motion = self.module, self.motion
        while todo:
            items, width = [], 1
            while todo and len(items) < 2000:
                k = todo[-1][0]
                after = min(k + 1, len(motion.first) - 1)
                width = max(width, (max(motion.last[k], motion.last[after]) - min(motion.first[k], motion.first[after])) // m.hinges + 2)
                if items and (len(items) + 1) * width * ORDER > BATCH:
                    break
                items.append(todo.pop())
            todo += self.look(items)
            if report:
                report(items[-1][0], self)

    def sizes(self, batch, kind):
        return [len(c) for c, _ in {"core": lambda: self.core, "local": lambda: batch.local, "tail": lambda: self.tail}[kind]()]

    def look(self, items):
        batch = Batch(self, items)
        self.looks += len(items)
        open_ = np.array([item[3] is None for item in items])
        found = [np.zeros((0, 3), int)]
        unseen = np.zeros(len(items), bool)
        if open_.any():
            batch.boxes()
            was = open_.copy()
            kinds = [("local", "local")]
            if self.motion.windowed:
                kinds += [("core", "local"), ("core", "tail"), ("local", "tail")]
            for one, two in kinds:
                found.append(np.stack(batch.near(one, two, [len(self.sizes(batch, kind)) - 1 for kind in (one, two)], open_), axis=1))
            unseen = was & ~open_
        found += [np.column_stack([np.full(len(item[3]), s), item[3]]) for s, item in enumerate(items) if item[3] is not None]
        found = np.concatenate(found)
        found = found[~unseen[found[:, 0]]]
        found = found[np.lexsort((found[:, 2], found[:, 1], found[:, 0]))]
        left = np.concatenate([np.zeros((0, 3), int)] + [self.look_at(batch, found[s:s + PAIRS]) for s in range(0, len(found), PAIRS)])
        halves = []
        for s in np.flatnonzero(unseen | np.isin(np.arange(len(items)), left[:, 0]))[::-1]:
            k, t, w, _ = items[s]
            rest = None if unseen[s] else left[left[:, 0] == s, 1:]
            if w <= 2.0**-DEPTH:
                raise NotProved(f"no proof around frame {k + t:.6f}" + ("" if rest is None else f", modules {rest[0, 0]} and {rest[0, 1]}"))
            halves += [(k, t + w / 2, w / 2, rest), (k, t, w / 2, rest)]
        return halves

    def look_at(self, batch, found):
        """Proves pairs (b, i, j) clear, and returns those that it cannot."""
        m, (b, i, j), mid = self.module, found.T, ORDER // 2
        rem = self.c * (batch.between(batch.S, i, j, b) + batch.slack[b])**ORDER * ((j - i) * m.link + m.radius)
        lost = rem + self.E
        (xi, Ci), (xj, Cj) = batch.poses(i, b), batch.poses(j, b)
        y = np.matmul(Ci, (xj - xi)[..., None])[..., 0]
        n = y[:, mid] / np.sqrt((y[:, mid]**2).sum(1)).clip(1e-300)[:, None]
        bound = ((y * n[:, None]).sum(2) @ self.B.T).min(1) - 2 * m.radius - lost
        rest = np.flatnonzero(bound < self.claim)
        if len(rest):
            y, G = y[rest], np.matmul(Ci[rest], Cj[rest].swapaxes(-1, -2))
            bound[rest] = self.axes(y, G, n[rest], lost[rest], [(b[rest], i[rest], j[rest]), batch])
        self.pairs += len(found)
        good = bound >= self.claim
        self.least = min(self.least, bound[good].min(initial=math.inf))
        return found[~good]

    def axes(self, y, G, centre, lost, where):
        """Bounds along the axis that separates best in the middle: of faces and centres, and if it must be, of edges."""
        m, mid = self.module, ORDER // 2
        best, bound = np.full(len(y), -math.inf), np.full(len(y), -math.inf)
        some = np.arange(len(y))
        for edges in (False, True):
            Y, M = y[some, mid], G[some, mid]
            if edges:
                u = np.cross(m.edges[None, :, None], np.einsum("qab,eb->qea", M, m.edges)[:, None]).reshape(len(some), -1, 3)
                size = np.sqrt((u * u).sum(2, keepdims=True))
                u = np.where(size > 1e-6, u / size.clip(1e-6), centre[some, None])
            else:
                u = np.concatenate([centre[:, None], np.broadcast_to(m.faces, (len(y), *m.faces.shape)), np.einsum("qab,fb->qfa", M, m.faces)], axis=1)
            along = np.einsum("qfa,qa->qf", u, Y)
            u = u * np.where(along < 0, -1.0, 1.0)[..., None]
            gaps = np.abs(along) + m.least(-u) + m.least(np.matmul(u, M))
            which = gaps.argmax(1)
            every = np.arange(len(some))
            best[some] = np.maximum(best[some], gaps[every, which])
            n = u[every, which]
            of_j = (which > len(m.faces)) & (not edges)
            for turned in (False, True):
                part = np.flatnonzero((of_j == turned) & (gaps[every, which] - lost[some] >= self.claim))
                Yp, Gp, N = y[some[part]], G[some[part]], n[part]
                if turned:  # seen from j
                    N = -np.einsum("qab,qa->qb", M[part], N)
                    Yp, Gp = -np.einsum("qpab,qpa->qpb", Gp, Yp), Gp.swapaxes(-1, -2)
                line = np.concatenate([(Yp * N[:, None]).sum(2)[..., None], np.einsum("qa,qpab->qpb", N, Gp)], axis=2)
                line = np.matmul(self.B, line)
                low = (line[..., 0] + m.least(line[..., 1:])).min(1) + m.least(-N) - lost[some[part]]
                bound[some[part]] = np.maximum(bound[some[part]], low)
            some = np.flatnonzero(bound < self.claim)
            if not len(some):
                break
        (b, i, j), batch = where
        s = best.argmin()
        if best[s] < self.gap:
            self.gap, self.where = float(best[s]), (float(batch.k[b[s]] + batch.t[b[s]] + batch.w[b[s]] / 2), int(i[s]), int(j[s]))
        s = np.where(bound < self.claim, best, math.inf).argmin()
        if bound[s] < self.claim and best[s] < self.claim:
            frame = float(batch.k[b[s]] + batch.t[b[s]] + batch.w[b[s]] / 2)
            raise NotProved(f"modules {i[s]} and {j[s]} are {best[s]:.9f} apart at frame {frame:.6f}, less than {self.claim:.9f}")
        return bound


def main(arguments=None):
    parser = argparse.ArgumentParser()
    parser.add_argument("plan")
    parser.add_argument("--size", type=float)
    parser.add_argument("--claim", type=float)
    o = parser.parse_args(arguments)
    began = time.perf_counter()
    plan = Plan(pathlib.Path(o.plan), o.size, o.claim)
    try:
        p = Proof(plan).run()
    except NotProved as error:
        print("not proved:", error, round(time.perf_counter() - began, 2))
        return 1
    print(dict(claim=p.claim, least=p.least, E=p.E, looks=p.looks, pairs=p.pairs, gap=p.gap, where=p.where, seconds=round(time.perf_counter() - began, 2)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
