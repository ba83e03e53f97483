"""Prove from a plan's file alone that a chain of modules folds without touching itself.

    python foldback_check.py plan.npz [--end shape.json] [--size S] [--claim C] [--json]

Needs NumPy, and nothing of foldback. docs/certificate.md states what is claimed: hinges turn evenly
from frame to frame, and every pair of modules keeps a clearance *all the time*, apart from pairs
that share a joint. Lengths are in pitches. Exits with 0: proved, 1: not proved, 2: no plan.
foldback_check_refusals.py, another file, checks why a fold failed.

POSES have four rows: the centre and three axes. A link is a matrix by which a pose is multiplied
from the left to get the next one; a hinge turns the first two axes about the third.
MOTION. Seen from module i, a point v of module j is y(t) = sum_m P_m(t) e_m + P(t) v, with products
P_m of hinge rotations and constant links e_m. A derivative brings down one hinge's rate and a cross
product with a unit vector, so |y^(p)| <= S^p (L + |v|): S is the sum of the |rates| of the hinges
between i and j, L the length of the links between. Interpolating y at the p Chebyshev nodes of w
frames is off by at most rem = c (w S)^p (L + |v|), c = 2 / (4^p p!), along each direction. The
interpolating polynomial is nowhere outside the hull of its Bernstein coefficients.
AXIS. For a unit vector n fixed in i, the least coefficient of n.y over all corners of j, less the
support of i along n, less rem, bounds the distance of the modules from below for all the interval.
If that is too little, the interval is halved. The choice of n cannot make a bound wrong.
CANDIDATES. Modules with centres 2 r + claim apart are clear, r being the radius of a module. Seen
from a root module, a centre stays in the box around its coefficients, widened by rem. Boxes around
parts of the chain are compared, then boxes around their halves, and so on.
RIGID PAIRS, between which no hinge turns, keep the distance that was proved before; in the first
interval all pairs are looked at. A plan is a sequence of windows: modules before the window are as
folded, modules behind it straight, and each of both parts moves as one rigid body. A plan that
has all angles is a window that holds all hinges.
ROUNDING, u = 2^-53. An angle is off by 4 u |step| + 2 u |angle|, sine and cosine by 8 u more: a in
all. A hinge mixes two columns of a rotation, each is off by 2 a + 3 u; a constant rotation whose
entries are not 0, 1 or -1 adds 40 u. Rotating keeps the Frobenius norm of an error. So m links on a
rotation is off by m e, with e the sum of one link, and a position by l m^2 (e/2 + 8 u), with l the
length of a link. Points of j seen from i are off by n (l n + 2 r) (2 e + 48 u) for n modules.
Bernstein coefficients multiply that by |B|; B itself, axes and supports add 256 u (l n + 2 r) |B|.
The sum is `rounding`, taken off every bound; 1e-8 for 160 cubes. Sums of rates have `slack`, and
factors near 1 are within 1e-9.
"""

import argparse
import hashlib
import json
import math
import sys
import time

import numpy as np

U = 2.0**-53
ORDER, MID = 5, 2  # nodes of an interval: odd, so that one of them is in the middle
NODES = (1 - np.cos((np.arange(ORDER) + 0.5) * np.pi / ORDER)) / 2
BERNSTEIN = np.linalg.inv([[math.comb(ORDER - 1, k) * t**k * (1 - t) ** (ORDER - 1 - k)
                            for k in range(ORDER)] for t in NODES])
REMAINDER = 2 / (4.0**ORDER * math.factorial(ORDER)) * (1 + 1e-9)
DEPTH = 14  # times that an interval between two frames is halved at most
MODULES_AT_ONCE, PAIRS_AT_ONCE = 60_000, 20_000
CROWD = 200  # pairs for each moving module above which an interval is halved before it is looked at
ONE, H, T = np.eye(3).tolist(), math.sqrt(0.5), math.sqrt(1 / 3)
CUBE = {
    "corners": [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)],
    "faces": ONE, "edges": ONE, "anchor": [0.0, 0.0, 0.0], "offset": [1.0, 0.0, 0.0],
    "turns": [ONE, [ONE[1], ONE[2], ONE[0]], [ONE[2], ONE[0], ONE[1]]],
    "hinges": ["_z", "_y"], "rigid_links": 1, "apart": 2, "limit_rad": math.radians(92.0),
}
TETRAHEDRON = {
    "corners": [[-0.5, -1.0, 0.0], [-0.5, 1.0, 0.0], [0.5, 0.0, -1.0], [0.5, 0.0, 1.0]],
    "faces": [[-H, 0.0, H], [-H, 0.0, -H], [H, H, 0.0], [H, -H, 0.0]],
    "edges": [ONE[1], ONE[2], *([T, y, z] for y in (-T, T) for z in (-T, T))],
    "anchor": [0.5, 0.0, 0.0], "offset": [0.5, 0.0, 0.0],
    "turns": [ONE, [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]],
    "hinges": [""], "rigid_links": 0, "apart": 1, "limit_rad": math.radians(90.85),
}
MODULES = {"cube": CUBE, "tetrahedron": TETRAHEDRON}


class NotProved(Exception):
    """Something that could not be proved, with the place."""


def require(condition, message):
    """Raise NotProved unless the condition holds."""
    if not condition:
        raise NotProved(message)


def seen(one, other):
    """Return poses (..., 4, 3) of some modules as seen from others."""
    apart = other.copy()
    apart[..., 0, :] -= one[..., 0, :]
    return apart @ one[..., 1:, :].swapaxes(-1, -2)


class Module:
    """A convex module at its size: corners, directions of its parts, links from hinge to hinge."""

    def __init__(self, told, size):
        corners, anchor, offset, turns, self.faces, self.edges = (
            np.array(told[part], float)
            for part in ("corners", "anchor", "offset", "turns", "faces", "edges"))
        self.names, self.rigid, self.apart = told["hinges"], told["rigid_links"], told["apart"]
        self.corners, self.limit = corners * size, told["limit_rad"]
        self.solid = np.insert(self.corners, 0, 1.0, axis=1)  # for products with whole poses
        self.radius = np.linalg.norm(self.corners, axis=1).max() * (1 + 1e-12)
        self.length = (np.linalg.norm(anchor) + np.linalg.norm(offset)) * (1 + 1e-12)
        self.exact = np.isin(turns, (-1.0, 0.0, 1.0)).all()
        self.links = np.tile(np.eye(4), (len(self.names) + 1, 1, 1))
        self.links[:, 1:, 1:] = turns.swapaxes(1, 2)
        self.links[0, 0, 1:], self.links[-1, 0, 1:] = anchor, turns[-1] @ offset
        require(np.abs(turns @ turns.swapaxes(1, 2) - ONE).max() < 1e-15 and self.names and
                (np.linalg.det(turns) > 0).all() and len(turns) == len(self.links) and
                np.abs((self.faces**2).sum(1) - 1).max() < 1e-15 and self.apart in (1, 2) and
                np.isfinite(self.edges).all() and self.radius + self.length < 1e6 and
                self.rigid in (0, 1), "a module that cannot be")

    def poses(self, q, pose):
        """Return poses (m+1, M, 4, 3) of a module and m after it, from (m, K, M) and (4, 3, M)."""
        found, cos, sin = [pose], np.cos(q), np.sin(q)
        for m in range(len(q)):
            for k, link in enumerate(self.links):
                pose = (link @ pose.reshape(4, -1)).reshape(pose.shape)
                if k < len(self.names):
                    c, s = cos[m, k], sin[m, k]
                    pose[1], pose[2] = c * pose[1] + s * pose[2], c * pose[2] - s * pose[1]
            found.append(pose)
        return np.stack(found).transpose(0, 3, 1, 2)

    def chain(self, angles):
        """Return poses (n, 4, 3) of a chain with these angles, a slot each."""
        start = np.eye(4, 3, -1)[:, :, None]
        return self.poses(angles.reshape(-1, len(self.names), 1), start)[:, 0]

    def gaps(self, pose, by_edges):
        """Return axes (Q, A, 3), and how far they separate the module from those at (Q, 4, 3).

        Axes are the line of centres and all normals of faces, or cross products of two edges.
        """
        y, own = pose[:, :1], self.edges if by_edges else self.faces
        other = own @ pose[:, 1:]
        axes = (np.cross(own[:, None], other[:, None]).reshape(len(pose), len(own) ** 2, 3)
                if by_edges else np.hstack([y, np.broadcast_to(own, other.shape), other]))
        size = np.linalg.norm(axes, axis=2, keepdims=True)
        axes = np.where(axes @ y.swapaxes(1, 2) < 0.0, -axes, axes) / size.clip(1e-6)
        gaps = (axes @ pose.swapaxes(1, 2) @ self.solid.T).min(2) - (axes @ self.corners.T).max(2)
        return axes, np.where(size[..., 0] > 1e-6, gaps, -math.inf)


def load(path):
    """Return the arrays of a file by name."""
    with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
        return dict(file)


def decoded(arrays, told, first, last, offsets):
    """Return a plan's angles: (F, J), or those of its windows one after another."""
    if "angle_planes" not in arrays:
        return arrays.get("joint_angles_rad", arrays.get("angles_rad"))
    codes = np.ascontiguousarray(arrays["angle_planes"].T).view("<u4").astype("i8").ravel()
    codes, step = (codes >> 1) ^ -(codes & 1), told["angles"]["step_rad"]
    if "first" not in arrays:
        codes = codes.reshape(told["angles"]["shape"])
        for _ in range(told["angles"]["differences"]):
            codes = codes.cumsum(axis=0)
        return codes * step
    rest, found = np.rint(np.array(told["chain"]["folded_rad"]) / step).astype("i8"), []
    now = np.zeros(len(rest), "i8")
    for a, b, changes in zip(first, last, np.split(codes, offsets[1:-1]), strict=True):
        now[a:b] += changes
        found.append((now[a:b] * step).astype("f4"))
        now[:a], now[b:] = rest[:a], 0  # a hinge enters as folded in front, as straight behind
    return np.concatenate(found)


class Plan:
    """A plan's file, checked against what it says of itself.

    A slot is a hinge of the chain, or one that a rigid link would have. In a frame, angles of slots
    `first` to `last` are `values` from `offsets` on, those before as `folded`, those behind 0.

    Raises:
        NotProved: It contradicts itself, or claims nothing. Any other error: it cannot be read.
    """

    def __init__(self, path, size=None, claim=None):
        arrays = load(path)
        told = json.loads(str(arrays["plan"]))
        verdict = str(told["certificate"]["verdict"])
        require(verdict.startswith("verified"), f"the plan says of itself: {verdict} "
                "(foldback_check_refusals.py can check some reasons)")
        self.read(arrays, told, size, claim)

    def read(self, arrays, told, size, claim, whole=True):
        """Take up what a plan says; if it is not whole, it neither ends folded nor has a digest."""
        said, self.kind, self.count = (
            told["certificate"], str(told["chain"]["module"]), told["chain"]["modules"])
        known = MODULES.get(self.kind)
        geometry = told.get("claim", {}).get("module", known)
        require(known in (None, geometry), f"{self.kind}s of another kind")
        self.kind += ", as the plan describes it" * (known is None)
        self.size = float(said["module_size"] if size is None else size)
        self.claim = float(said["clearance_bound"] or 0.0) if claim is None else claim
        self.step = float(said.get("max_joint_step_rad") or math.inf)
        self.module = Module(geometry, self.size)
        for fact, holds in self._facts(arrays, told, whole):
            require(holds, f"the plan contradicts itself or claims nothing: {fact}")

    def _facts(self, arrays, told, whole):
        """Yield what holds of a plan that does not contradict itself; reads its angles as well."""
        module, n, times = self.module, self.count, arrays["time_s"]
        said, folded, windowed = told["certificate"], told["chain"]["folded_rad"], "first" in arrays
        names = [f"joint_{k}{end}" for k in range(module.rigid, n - 1) for end in module.names]
        stored = {"joint_angles_rad", "angles_rad", "angle_planes"} & arrays.keys()
        J, pad = len(names), [0.0] * (module.rigid * len(module.names))
        yield "hinges", n > 1 and arrays["joint_names"].tolist() == names and len(folded) == J
        first = arrays["first"].astype("i8") if windowed else np.zeros(len(times), "i8")
        offsets = arrays["offsets"].astype("i8") if windowed else np.arange(len(times) + 1) * J
        yield "windows", len(first) + 1 == len(offsets) and offsets[0] == 0 <= first.min()
        last = first + np.diff(offsets)
        yield "windows in the chain", (first <= last).all() and last.max() <= J
        values = decoded(arrays, told, first, last, offsets)
        shape = (offsets[-1],) if windowed else (len(times), J)
        yield "angles of all hinges, once", values.shape == shape and len(stored) == 1
        hashed = hashlib.sha256()
        for array in (first, offsets, values) if windowed else (values,):
            hashed.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")))
        self.digest, self.frames, self.pad = hashed.hexdigest(), len(first), len(pad)
        self.values, self.folded = values.ravel().astype(float), np.array(pad + folded)
        self.first, self.last, self.offsets = first + self.pad, last + self.pad, offsets
        self.largest = np.abs(np.append(self.values, self.folded)).max()
        yield "angles within the limit", self.largest <= module.limit + 1e-6
        yield "module size and clearance", 0.0 < self.size <= 1.0 and 0.0 < self.claim < math.inf
        self.windowed, self.exempt = windowed, (module.apart - 1) * (n - 1)
        exempt = {"apart": module.apart, "count": self.exempt}
        yield "exempt pairs", exempt.items() <= (said.get("exempt_pairs") or exempt).items()
        yield "frames", said.get("frames") in (None, self.frames) and len(times) == self.frames
        yield "increasing times", np.isfinite(times).all() and (np.diff(times) >= 0.0).all()
        start = (told.get("start") or {"folded_rad": [0.0] * J})["folded_rad"]
        for words, frame, angles in ("start", 0, start), ("end", self.frames - 1, folded):
            off = np.abs(self.angles(frame, 0, len(self.folded)) - (pad + angles)).max()
            near = off <= 1e-6 or (words == "end" and not whole)
            yield f"{words} of the motion; a hinge is off by {off:.7f} rad", near
        stated = told.get("claim", {}).get("angles_sha256", self.digest)
        yield "the checksum of the angles", stated == self.digest or not whole

    def angles(self, frame, low, high):
        """Return the angles of slots low to high in a frame."""
        a, b = np.clip((self.first[frame], self.last[frame]), low, high)
        begin = self.offsets[frame] - self.first[frame]
        values = self.values[begin + a : begin + b]
        return np.concatenate([self.folded[low:a], values, np.zeros(high - b)])


class Batch:
    """Some intervals: poses of `bodies` at the nodes, and how much all hinges up to a module turn.

    Bodies are all that is in front of module c, this module, and m modules after it. What is behind
    belongs to the last one. Module i belongs to body `at[i]`.
    """

    def __init__(self, proof, items):
        plan, module, n = proof.plan, proof.plan.module, proof.plan.count
        self.proof, hinges = proof, len(module.names)
        self.k, t, w = (np.array([item[a] for item in items]) for a in range(3))
        ends = self.k, np.minimum(self.k + 1, plan.frames - 1)
        self.c = c = min(plan.first[list(ends)].min() // hinges, n - 2)
        self.m = m = max(-(-plan.last[list(ends)].max() // hinges) - c, 1)
        q, rate = (np.array([plan.angles(f, c * hinges, (c + m) * hinges) for f in frames])
                   for frames in ends)
        rate -= q
        proof.step = max(proof.step, np.abs(rate).max())
        turn = np.abs(rate).reshape(len(t), m, hinges).sum(2)
        self.at = np.clip(np.arange(n) - c + 1, 0, m + 1)
        self.turning, self.S = (np.pad(v.cumsum(1), ((0, 0), (2, 0)))[:, self.at]
                                for v in (turn > 0.0, turn * w[:, None] * (1 + 1e-9)))
        self.slack = 4 * (m * hinges + 4) * U * self.S[:, -1]
        t = t[:, None] + w[:, None] * NODES
        self.middle = self.k + t[:, MID]
        q = (q[:, None] + t[:, :, None] * rate[:, None]).reshape(t.size, m, hinges)
        start = np.repeat(proof.folded[c, :, 1:, None], t.size, axis=2)
        bodies = np.insert(module.poses(q.transpose(1, 2, 0), start), 0, np.eye(4, 3, -1), axis=0)
        self.bodies = bodies.reshape(m + 2, *t.shape, 4, 3)

    def poses(self, i, b):
        """Return poses (Q, ORDER, 4, 3) of modules i in intervals b."""
        found, last = self.bodies[self.at[i], b], self.c + self.m
        front, behind = np.flatnonzero(i < self.c), np.flatnonzero(i > last)
        found[front] = self.proof.folded[i[front]][:, None] @ found[front]
        found[behind] = self.proof.straight[i[behind] - last][:, None] @ found[behind]
        return found

    def boxes(self):
        """Return corners (n, B, 3) of boxes in which centres stay (CANDIDATES)."""
        c, n = self.c, len(self.at)
        root = c if self.proof.plan.windowed else n // 2
        hull = seen(self.bodies[self.at[root]], self.bodies)
        hull = np.tensordot(BERNSTEIN, hull, (1, 2)).swapaxes(0, 1)
        front = np.tensordot(self.proof.folded[:c, 0], hull[0], (1, 2))
        behind = np.tensordot(self.proof.straight[1 : n - c - self.m, 0], hull[-1], (1, 2))
        hull = np.concatenate([front, hull[1:, ..., 0, :], behind])
        turn = np.abs(self.S - self.S[:, [root]]).T + self.slack
        links = np.abs(np.arange(n) - root)[:, None] * self.proof.plan.module.length
        lost = (REMAINDER * turn**ORDER * links + self.proof.rounding)[..., None]
        return hull.min(1) - lost, hull.max(1) + lost

    def pairs(self, wanted):
        """Return rows (b, i, j) of pairs that may come too near, and intervals with too many."""
        levels, n, crowded = [self.boxes()], len(self.at), np.zeros(len(self.k), bool)
        crowd = CROWD * (np.where(self.k == 0, n, self.m) + 10)
        while len(levels[-1][0]) > 1:
            two = np.arange(0, len(levels[-1][0]), 2)
            low, high = levels[-1]
            levels.append((np.minimum.reduceat(low, two), np.maximum.reduceat(high, two)))
        i = j = np.zeros(len(wanted), int)
        b = wanted
        for level in reversed(range(len(levels))):
            (low, high), first = levels[level], i << level
            last = np.minimum((j + 1) << level, n) - 1
            gap = np.maximum(low[j, b] - high[i, b], low[i, b] - high[j, b]).clip(0.0)
            keep = ~(np.linalg.norm(gap, axis=1) >= self.proof.reach) & ~crowded[b]
            keep &= (self.k[b] == 0) | (self.turning[b, last] > self.turning[b, first])
            keep &= last - first >= self.proof.plan.module.apart
            b, i, j = b[keep], i[keep], j[keep]
            if level:  # the halves of both boxes
                crowded |= np.bincount(b, minlength=len(crowded)) > crowd
                half = np.arange(4)[:, None]
                i, j, b = (2 * i + half // 2).ravel(), (2 * j + half % 2).ravel(), np.tile(b, 4)
                keep = (i <= j) & (j < len(levels[level - 1][0]))
                b, i, j = b[keep], i[keep], j[keep]
        return np.stack([b, i, j], axis=1)[~crowded[b]], np.flatnonzero(crowded)


class Proof:
    """The proof that a motion keeps a clearance; what it came across is in its attributes."""

    def __init__(self, plan):
        module, n, hinges = plan.module, plan.count, len(plan.module.names)
        self.plan, self.tightest, self.looks, self.step = plan, (math.inf, 0.0, 0, 0), 0, 0.0
        a = (4 * 2 + 2) * plan.largest * U + 8 * U
        e = hinges * math.sqrt(2) * (2 * a + 3 * U) + (not module.exact) * (hinges + 1) * 40 * U
        size = np.abs(BERNSTEIN).sum(1).max() * (module.length * n + 2 * module.radius)
        self.rounding = float(size * (n * (2 * e + 48 * U) + 256 * U))
        self.reach = 2 * module.radius + plan.claim + self.rounding
        self.folded, self.straight = (np.insert(module.chain(angles), 0, [1, 0, 0, 0], axis=2)
                                      for angles in (plan.folded, 0.0 * plan.folded))
        todo = [(k, 0.0, 1.0, None) for k in reversed(range(max(1, plan.frames - 1)))]
        while todo:
            items = todo[-max(1, MODULES_AT_ONCE // n) :]
            todo[-len(items) :] = self._halves(items)
        require(self.step <= plan.step + 1e-9, f"a step of {self.step:.6f} rad, the plan says less")

    def _halves(self, items):
        """Return the halves of the intervals in which something is not proved."""
        batch, halves = Batch(self, items), []
        rows, crowded = batch.pairs(np.flatnonzero([item[3] is None for item in items]))
        rows = np.concatenate([rows, *(np.insert(item[3], 0, b, axis=1)
                                       for b, item in enumerate(items) if item[3] is not None)])
        self.looks += len(rows)
        parts = np.array_split(rows, len(rows) // PAIRS_AT_ONCE + 1)
        left = np.concatenate([self._left(batch, part) for part in parts])
        for b in np.union1d(crowded, left[:, 0]):
            k, t, w, _ = items[b]
            rest = None if b in crowded else left[left[:, 0] == b, 1:]
            pair = "" if rest is None else " between modules {} and {}".format(*rest[0])
            require(w > 2.0**-DEPTH, f"no bound{pair} at frame {k + t:.5f}")
            halves += [(k, t + w / 2, w / 2, rest), (k, t, w / 2, rest)]
        return halves

    def _left(self, batch, rows):
        """Return the rows (b, i, j) whose modules are not proved clear."""
        module, claim, (b, i, j) = self.plan.module, self.plan.claim, rows.T
        pose = seen(batch.poses(i, b), batch.poses(j, b))
        turn = batch.S[b, j] - batch.S[b, i] + batch.slack[b]
        lost = REMAINDER * turn**ORDER * ((j - i) * module.length + module.radius) + self.rounding
        bound, gap = np.full((2, len(rows)), -math.inf)
        for by_edges in (False, True):
            q = np.flatnonzero(~(bound >= claim))
            axes, gaps = module.gaps(pose[q, MID], by_edges)
            n = np.take_along_axis(axes, gaps.argmax(1)[:, None, None], axis=1)[:, 0]
            line = BERNSTEIN @ np.einsum("qkax,qx->qka", pose[q], n)
            low = (line @ module.solid.T).min((1, 2)) - (n @ module.corners.T).max(1) - lost[q]
            bound[q], gap[q] = np.maximum((bound[q], gap[q]), (low, gaps.max(1)))
        if gap.min(initial=math.inf) < self.tightest[0]:
            q = gap.argmin()
            self.tightest = float(gap[q]), float(batch.middle[b[q]]), int(i[q]), int(j[q])
        least, frame, *pair = self.tightest
        require(least >= claim, "modules {} and {}: no gap above {:.9f} at frame {:.5f}".format(
            *pair, least, frame))
        return rows[~(bound >= claim)]


def check_end(plan, path):
    """Require that the plan ends on the cells, or with the angles, of a path's or chain's file."""
    with open(path, encoding="utf-8") as file:
        told = json.load(file)
    x, off, folded = plan.module.chain(plan.folded)[:, 0], math.inf, plan.folded[plan.pad :]
    cells, angles = np.array(told.get("cells", ()), float), told.get("joint_angles_deg", ())
    for y in (cells, cells[::-1]) if cells.shape == x.shape else ():  # up to a rigid motion
        u, _, v = np.linalg.svd((x - x.mean(0)).T @ (y - y.mean(0)))
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
        off = min(off, np.abs((x - x.mean(0)) @ turn - (y - y.mean(0))).max())
    if len(angles) == len(folded):
        off = np.abs(folded - np.radians(angles)).max()
    require(off <= 1e-6, f"it does not end as {path} says: off by {off:.7f}")


def prove(plan, found, end=None):
    """Return the proof of what a plan claims; tell what it is about, and what came out."""
    found |= {"modules": plan.count, "module": plan.kind, "size": plan.size,
              "exempt": plan.exempt, "frames": plan.frames, "clearance": plan.claim,
              "angles_sha256": plan.digest}
    if end:
        check_end(plan, end)
    proof = Proof(plan)
    gap, frame, *pair = proof.tightest
    found |= {"verdict": "proved", "rounding": proof.rounding, "looks": proof.looks,
              "tightest": {"gap": gap, "frame": frame, "modules": pair} if any(pair) else None}
    return proof


def answer(path, work):
    """Return what some work finds out about a file, or why nothing is proved, as plain values.

    Raises:
        ValueError: The file cannot be read.
    """
    began, found = time.perf_counter(), {}
    try:
        work(found)
    except NotProved as error:
        found |= {"verdict": "not proved", "reason": str(error)}
    except Exception as error:  # the file holds something else than was expected
        raise ValueError(f"{path}: {type(error).__name__}: {error}") from error
    return found | {"seconds": round(time.perf_counter() - began, 3)}


def check(path, size=None, claim=None, end=None):
    """Return what was proved of a plan, or why it was not (`answer`)."""
    return answer(path, lambda found: prove(Plan(path, size, claim), found, end))


SAYS = """proved: {modules} modules ({module}) of size {size:g}, {frames} frames.
They begin as the plan says and end folded. All the way, each pair stays at least {clearance:.6f}
pitches apart, apart from {exempt} pairs that share a joint.
Rounding {rounding:.1e} pitches, {seconds:.1f} s.
SHA-256 of the angles: {angles_sha256}"""


def show(found, as_json, says=SAYS, good="proved"):
    """Print an answer; return True if it is the good one."""
    says = says if found["verdict"] == good else "{verdict}: {reason}"
    print(json.dumps(found) if as_json else says.format(**found))
    return found["verdict"] == good


def main(arguments=None):
    """Check a plan and print the result."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("plan", help="plan.npz of a fold")
    parser.add_argument("--end", help="file of the path or chain that the plan must end as")
    parser.add_argument("--size", type=float, help="module size instead of the plan's")
    parser.add_argument("--claim", type=float, help="clearance instead of the plan's, in pitches")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    told = parser.parse_args(arguments)
    try:
        return 1 - show(check(told.plan, told.size, told.claim, told.end), told.json)
    except ValueError as error:
        print(f"no plan: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
