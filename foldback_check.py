"""Prove from a plan's file alone that a chain of modules folds without touching itself.

    python foldback_check.py plan.npz [--end shape.json] [--size S] [--claim C] [--json]
    python foldback_check.py plan.npz --record record.npz    (why a fold failed)

Needs NumPy, and nothing of foldback. docs/certificate.md states what is claimed: hinges turn evenly
from frame to frame, and every pair of modules keeps a clearance *all the time*, apart from pairs
that share a joint. Lengths are in pitches. Exits with 0: proved, 1: not proved or not checked,
2: no plan, 3: refusal confirmed.

MOTION. Seen from module i, a point v of module j is y(t) = sum_m P_m(t) e_m + P(t) v, with products
P_m of hinge rotations and constant links e_m. A derivative brings down one hinge's rate and a cross
product with a unit vector, so |y^(p)| <= S^p (L + |v|): S is the sum of the |rates| of the hinges
between i and j, L the length of the links between.
AXIS. For a unit vector n fixed in i, interpolating n.y at the p Chebyshev nodes of w frames is off
by at most rem = c (w S)^p (L + r), c = 2 / (4^p p!), with r the radius of a module. A polynomial is
nowhere below its least Bernstein coefficient. So the least coefficient over all corners of j, less
the support of i along n, less rem, bounds the distance of the modules from below for all the
interval. Otherwise it is halved. The choice of n cannot make a bound wrong.
CANDIDATES. Modules with centres 2 r + claim apart are clear. Seen from a module that is held still,
a centre goes no farther from where it is in mid-interval than D = min(A max_k |x_k - x_mid| +
c (w S)^p L, w S L / 2), A the Lebesgue constant of the nodes; a vector fixed in a module turns by
no more than D with L = 1; two centres approach by at most D_i + D_j, and by w S L / 2 of the hinges
between them. Boxes about parts of the chain are compared, then boxes about their halves, and so on.
RIGID PAIRS, between which no hinge turns, keep the distance that was proved before. In a windowed
plan the modules before the window are as folded, those behind it are straight: both shapes are
proved once, with all their pairs.
ROUNDING, u = 2^-53. An angle is off by 4 u |step| + 2 u |angle|, sine and cosine by 8 u more: a in
all. A hinge mixes two columns of a rotation, each is off by 2 a + 3 u; a constant rotation whose
entries are not 0, 1 or -1 adds 40 u. Rotating keeps the Frobenius norm of an error. So m links on a
rotation is off by m e, with e the sum of one link, and a position by l m^2 (e/2 + 8 u), with l the
length of a link. Points of j seen from i are off by n (l n + 2 r) (2 e + 48 u) for n modules.
Bernstein coefficients multiply that by |B|; B itself, axes and supports add 256 u (l n + 2 r) |B|.
The sum is `rounding`, taken off every bound; 1e-8 for 160 cubes. Sums of rates have `slack`, and
factors near 1 are within 1e-9.
REFUSALS. The record of a search that failed is proved like a plan: folded at first, no contact. Its
last frame then shows one of two things. BLOCKS: cubes or tetrahedra overlap if no face and no two
edges give a separating axis. Edges parallel to 1e-6 are left out, so overlaps count from 1e-4 on. A
hinge, or a group, that makes modules overlap somewhere on its way cannot pass there by itself.
KNOT: the line through all centres, lengthened at both ends and closed outside, is knotted. Look at
it along any direction and give a number to each arc, so that 2 over = before + after wherever one
passes under another (Fox). The matrix of these equations, less a row and a column, has the same
determinant up to sign whatever the direction; for the unknot 1. It is computed modulo a prime. A
view counts if nothing in it changes when every point moves by b, more than ROUNDING. An area of
sides p, q then changes by less than 4 b (p + q), a volume of sides p, q, r by 4 b (p + q + r)^2.
"""

import argparse
import contextlib
import hashlib
import itertools
import json
import math
import sys
import time

import numpy as np

U = 2.0**-53
ORDER, MID = 5, 2  # nodes of an interval: odd, so that one of them is in the middle
DEPTH = 14  # times that an interval between two frames is halved at most
BATCH, PAIRS = 300_000, 20_000  # poses and pairs that are computed at once
CROWD = 200  # pairs for each moving module above which an interval is halved before it is looked at
TOUCH, DEEP = 1e-9, 1e-4  # clearance of a record; least overlap that blocks
PRIME, CROSSINGS, VIEWS = 2**31 - 1, 1500, 8  # modulus; most crossings of a view; views of a knot
ONE, H, T = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], math.sqrt(0.5), math.sqrt(1 / 3)
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


class NotChecked(NotProved):
    """A refusal for a reason that is no property of the shape."""


@contextlib.contextmanager
def reading(path):
    """Raise ValueError where a file holds something else than was expected: nothing is proved."""
    try:
        yield
    except NotProved:
        raise
    except Exception as error:
        raise ValueError(f"{path}: {type(error).__name__}: {error}") from error


def require(condition, message):
    """Raise NotProved unless the condition holds."""
    if not condition:
        raise NotProved(message)


class Module:
    """A convex module at its size. From one to the next: anchor, turn, hinge, turn, ..., offset."""

    def __init__(self, told, size):
        parts = ("corners", "faces", "edges", "anchor", "offset", "turns")
        self.corners, self.faces, self.edges, self.anchor, self.offset, self.turns = (
            np.array(told[part], float) for part in parts)
        self.names, self.rigid, self.apart = told["hinges"], told["rigid_links"], told["apart"]
        self.limit, square = told["limit_rad"], self.turns @ self.turns.swapaxes(1, 2)
        solid = np.concatenate([self.corners.ravel(), self.anchor, self.offset])
        require(np.abs(square - ONE).max() < 1e-15 and (np.linalg.det(self.turns) > 0).all() and
                np.abs((self.faces**2).sum(1) - 1).max() < 1e-15 and np.isfinite(solid).all() and
                self.apart in (1, 2) and self.rigid in (0, 1) and np.isfinite(self.edges).all() and
                len(self.turns) == len(self.names) + 1, "a module that cannot be")
        self.corners *= size
        self.radius = np.linalg.norm(self.corners, axis=1).max() * (1 + 1e-12)
        self.link = (np.linalg.norm(self.anchor) + np.linalg.norm(self.offset)) * (1 + 1e-12)
        self.half = np.abs(self.corners).max(0)
        box = itertools.product(*np.stack([-self.half, self.half], axis=1))
        self.box = {*map(tuple, self.corners)} == {*box}
        self.exact = np.isin(self.turns, (-1.0, 0.0, 1.0)).all()

    def least(self, v):
        """Return the least v . corner, (..., 3) to (...)."""
        return -(np.abs(v) @ self.half) if self.box else (v @ self.corners.T).min(-1)

    def poses(self, q, x, axes):
        """Return centres (m+1, M, 3) and axes as rows (m+1, M, 3, 3) for angles (m, K, M)."""
        X, R = np.empty((len(q) + 1, *x.shape)), np.empty((len(q) + 1, *axes.shape))
        X[0], R[0], cos, sin = x, axes, np.cos(q), np.sin(q)
        for m in range(len(q)):
            C = R[m + 1]
            C[:] = R[m]
            for k, turn in enumerate(self.turns):
                if (turn != ONE).any():
                    C[:] = (turn.T @ C.reshape(3, -1)).reshape(C.shape)
                if k < len(self.names):  # a hinge about the third axis
                    c, s, first = cos[m, k], sin[m, k], C[0].copy()
                    C[0], C[1] = c * first + s * C[1], c * C[1] - s * first
            X[m + 1] = X[m] + sum(a * v for a, v in zip(self.anchor, R[m], strict=True) if a)
            X[m + 1] += sum(a * v for a, v in zip(self.offset, C, strict=True) if a)
        return X.transpose(0, 2, 1).copy(), R.transpose(0, 3, 1, 2).copy()

    def chain(self, angles):
        """Return centres (n, 3) and axes (n, 3, 3) of a chain with these angles, a slot each."""
        q = angles.reshape(-1, len(self.names), 1)
        x, axes = self.poses(q, np.zeros((3, 1)), np.eye(3)[:, :, None])
        return x[:, 0], axes[:, 0]


class Motion:
    """Hinge angles at all frames: before the window as folded, in it `values`, behind it 0.

    A slot is a hinge of the chain, or one that a rigid link would have.
    """

    def __init__(self, slots, first, offsets, values, folded):
        self.slots, self.first, self.offsets = slots, np.asarray(first), np.asarray(offsets)
        self.values, self.folded, self.last = values, folded, self.first + np.diff(self.offsets)
        self.frames = len(self.first)
        self.windowed = bool(self.first.any() or (self.last != slots).any())

    def angles(self, frame, low, high):
        """Return the angles of slots low to high; those beyond the chain are 0."""
        a, b = (min(max(int(end[frame]), low), high) for end in (self.first, self.last))
        begin = self.offsets[frame] - self.first[frame]
        out = np.zeros(high - low)
        out[: a - low] = self.folded[low:a]
        out[a - low : b - low] = self.values[begin + a : begin + b]
        return out


def whole_numbers(planes):
    """Return the whole numbers that four planes of bytes hold as zigzag codes."""
    codes = np.ascontiguousarray(planes.T).view("<u4").astype("i8").ravel()
    return (codes >> 1) ^ -(codes & 1)


def window_values(changes, step, first, offsets, folded):
    """Return a windowed plan's angles from changes since the frame before."""
    at_rest = np.rint(folded / step).astype("i8")
    now, values, low, high = np.zeros(len(folded), "i8"), np.empty(len(changes), "f4"), 0, 0
    for k, a in enumerate(first):
        b = a + offsets[k + 1] - offsets[k]
        if k:  # a hinge that enters the window counts as folded before it, as straight behind it
            now[a : min(low, b)], now[max(high, a) : b] = at_rest[a : min(low, b)], 0
        now[a:b] += changes[offsets[k] : offsets[k + 1]]
        values[offsets[k] : offsets[k + 1]] = now[a:b] * step
        low, high = a, b
    return values


def load(path):
    """Return the arrays of a file by name."""
    with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


class Plan:
    """A plan's file, checked against what it says of itself; of a failed one the record's motion.

    Raises:
        NotProved: It contradicts itself, or claims nothing.
        ValueError: It cannot be read.
    """

    def __init__(self, path, size=None, claim=None, record=None):
        with reading(path):
            arrays, self.evidence = load(path), None
            told = json.loads(str(arrays["plan"]))
            chain, said = told["chain"], told["certificate"]
            if not str(said["verdict"]).startswith("verified"):
                arrays = self._refused(arrays, told, record)
                size, claim = self.evidence.get("module_size", said["module_size"]), TOUCH
            require(not record or self.evidence, "the plan does not fail")
            self.kind, self.count = str(chain["module"]), int(chain["modules"])
            geometry = told.get("claim", {}).get("module", MODULES.get(self.kind))
            require(geometry == MODULES.get(self.kind, geometry), f"{self.kind}s of another kind")
            self.kind += "" if self.kind in MODULES else ", as the plan describes it"
            self.size = float(said["module_size"] if size is None else size)
            require(0.0 < self.size <= 1.0, f"a module size of {self.size:g}")
            self.module = Module(geometry, self.size)
            self.claim = float(said["clearance_bound"] or 0.0) if claim is None else claim
            self._read(arrays, told)
            self._agree(arrays, told, said)

    def _refused(self, arrays, told, record):
        """Return the arrays of the search that failed, and keep the evidence of its reason."""
        ran = told["explosion"] or {}
        tried = [a.get("diagnosis") for a in told["attempts"] if ran and ran.items() <= a.items()]
        self.evidence = next((each["evidence"] for each in tried if each), None) or {}
        kind = self.evidence.get("kind")
        if kind == "budget":
            raise NotChecked("this is a limit of foldback's search, not a property of the shape")
        hint = "; --record record.npz checks why" * (kind in REASONS)
        require(record and hint, f"the plan says of itself: {told['certificate']['verdict']}{hint}")
        found = load(record)
        root, of = (0, "base_") if "first" in found else (told["root_module"], "root_")
        self.pose = root, found[of + "position"][-1], found[of + "wxyz"][-1]
        return found | {"joint_names": arrays["joint_names"]}

    def _read(self, arrays, told):
        module, folded = self.module, np.array(told["chain"]["folded_rad"], float)
        pad = module.rigid * len(module.names)
        hinges, slots = len(folded), (self.count - 1) * len(module.names)
        require(self.count > 1 and hinges == slots - pad, f"{hinges} hinges, {self.count} modules")
        names = [f"joint_{k}{end}" for k in range(module.rigid, self.count - 1)
                 for end in module.names]
        require(arrays["joint_names"].tolist() == names, "other hinges, or in another order")
        stored = {"joint_angles_rad", "angles_rad", "angle_planes"} & arrays.keys()
        require(len(stored) == 1, f"angles that are stored {len(stored)} times")
        codes = whole_numbers(arrays["angle_planes"]) if "angle_planes" in arrays else None
        step = told["angles"]["step_rad"] if codes is not None else 0.0
        if "first" in arrays:
            first, offsets = arrays["first"].astype("i8"), arrays["offsets"].astype("i8")
            width = np.diff(offsets)
            require(len(width) == len(first) > 0 == offsets[0] and width.min() >= 0 <= first.min()
                    and (first + width).max() <= hinges, "windows that do not fit the chain")
            values = (arrays["angles_rad"] if codes is None else
                      window_values(codes, step, first, offsets, folded))
            require(len(values) == offsets[-1], "more or fewer angles than the windows hold")
            self.digest = _digest(first, offsets, values)
            first += pad
        else:
            q = arrays.get("joint_angles_rad")
            if q is None:
                q = codes.reshape(told["angles"]["shape"])
                for _ in range(told["angles"]["differences"]):
                    q = q.cumsum(axis=0)
                q = q * step
            require(q.ndim == 2 and q.shape[1] == hinges and len(q), "angles of other hinges")
            self.digest = _digest(q)
            values = np.hstack([np.zeros((len(q), pad)), q]).ravel()
            first, offsets = np.zeros(len(q), "i8"), np.arange(len(q) + 1) * slots
        folded = np.concatenate([np.zeros(pad), folded])
        self.motion = Motion(slots, first, offsets, values.astype(float), folded)

    def _agree(self, arrays, told, said):
        module, motion, slots = self.module, self.motion, self.motion.slots
        self.exempt = (module.apart - 1) * (self.count - 1)
        require(0.0 < self.claim < math.inf, "the plan claims no clearance")
        exempt = said.get("exempt_pairs") or {"apart": module.apart, "count": self.exempt}
        require(exempt["apart"] == module.apart and exempt["count"] == self.exempt, "exempt pairs")
        require(said.get("frames") in (None, motion.frames), "more or fewer frames than certified")
        require(np.isfinite(motion.values).all() and np.isfinite(motion.folded).all(), "no numbers")
        self.largest = max(np.abs(v).max(initial=0.0) for v in (motion.values, motion.folded))
        require(self.largest <= module.limit + 1e-6, f"a hinge at {self.largest:.6f} rad")
        self.step = float(said.get("max_joint_step_rad") or math.inf)
        times = arrays["time_s"]
        require(len(times) == motion.frames and np.isfinite(times).all() and
                (np.diff(times) >= 0.0).all(), "times that do not rise")
        start = np.zeros(slots)
        if told.get("start") is not None:
            start[module.rigid * len(module.names) :] = told["start"]["folded_rad"]
        ends = (0, start, "begin as it should"), (motion.frames - 1, motion.folded, "end folded")
        for frame, angles, words in [(0, motion.folded, "begin folded")] if self.evidence else ends:
            off = np.abs(motion.angles(frame, 0, slots) - angles).max()
            require(off <= 1e-6, f"it does not {words}: a hinge is off by {off:.7f} rad")
        stated = told.get("claim", {}).get("angles_sha256", self.digest)
        require(self.evidence or stated == self.digest,
                "angles that do not have the digest which the plan states")


def _digest(*arrays):
    found = hashlib.sha256()
    for values in arrays:
        found.update(np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")))
    return found.hexdigest()


def levels(x, way):
    """Return (low, high, way) of boxes about 1, 2, 4, ... neighbours along axis 0."""
    found = [(x, x, way)]
    while len(found[-1][2]) > 1:
        low, high, way = (np.concatenate([v, v[-1:]])[: len(v) + len(v) % 2] for v in found[-1])
        found.append((np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2]),
                      np.maximum(way[::2], way[1::2])))
    return found


class Batch:
    """Some intervals: poses of the moving modules at their nodes, and pairs that may come near."""

    def __init__(self, proof, items):
        self.proof, motion, module = proof, proof.motion, proof.module
        self.k, t, w = (np.array([item[a] for item in items]) for a in range(3))
        frames, hinges = (self.k, np.minimum(self.k + 1, motion.frames - 1)), len(module.names)
        low, high = motion.first[list(frames)].min(0), motion.last[list(frames)].max(0)
        self.c = np.minimum(low // hinges, proof.count - 2)  # the last module before what moves
        self.m = m = int(max((-(-high // hinges) - self.c).max(), 1))
        q, end = (np.array([motion.angles(f, c * hinges, (c + m) * hinges)
                            for c, f in zip(self.c, frame, strict=True)]) for frame in frames)
        proof.step = max(proof.step, np.abs(end - q).max())
        rate = np.abs(end - q).reshape(len(t), m, hinges).sum(2)
        zero = np.zeros((len(t), 1))
        self.turning = np.hstack([zero, (rate > 0.0).cumsum(1)])
        self.S = np.hstack([zero, (rate * w[:, None]).cumsum(1)]) * (1 + 1e-9)
        self.slack = 4 * (m * hinges + 4) * U * self.S[:, -1]
        t = t[:, None] + w[:, None] * proof.nodes
        self.middle = self.k + t[:, MID]
        q = (q[:, None] + t[:, :, None] * (end - q)[:, None]).reshape(t.size, m, hinges)
        base = np.repeat(self.c, ORDER) if motion.windowed else np.zeros(t.size, int)
        x, axes = proof.folded[0][base].T, proof.folded[1][base].transpose(1, 2, 0)
        x, axes = module.poses(q.transpose(1, 2, 0), x, axes)
        self.x, self.axes = x.reshape(m + 1, *t.shape, 3), axes.reshape(m + 1, *t.shape, 3, 3)

    def between(self, sums, i, j, b):
        """Return the part of sums along the chain that belongs to hinges between i and j."""
        return np.subtract(*(sums[b, np.clip(k - self.c[b], 0, self.m)] for k in (j, i)))

    def poses(self, modules, b):
        """Return centres (Q, p, 3) and axes as rows (Q, p, 3, 3) of modules."""
        at = modules - self.c[b]
        x, axes = (v[np.clip(at, 0, self.m), b] for v in (self.x, self.axes))
        front, tail = np.flatnonzero(at < 0), np.flatnonzero(at > self.m)
        x[front], axes[front] = (v[modules[front], None] for v in self.proof.folded)
        offset, turn = (v[at[tail] - self.m] for v in self.proof.straight)
        x[tail] += np.einsum("qpax,qa->qpx", axes[tail], offset)
        axes[tail] = np.einsum("qab,qpbx->qpax", turn, axes[tail])
        return x, axes

    def ways(self):
        """Return how far each module's centre may go from its place in mid-interval, (n, B)."""
        proof, root = self.proof, 0 if self.proof.motion.windowed else self.m // 2
        turn = np.abs(self.S - self.S[:, [root]]).T + self.slack
        links = np.abs(np.arange(self.m + 1) - root)[:, None] * proof.module.link
        seen = np.einsum("bkax,nbkx->nbka", self.axes[root], self.x - self.x[root])
        way = proof.way(np.linalg.norm(seen - seen[:, :, [MID]], axis=3).max(2), turn, links)
        last = np.einsum("bkax,bkcx->bkac", self.axes[root], self.axes[-1])
        swing = proof.way(np.linalg.norm(last - last[:, [MID]], axis=(2, 3)).max(1), turn[-1], 1.0)
        at = np.arange(proof.count)[:, None] - self.c
        behind = np.maximum(at - self.m, 0) * proof.module.link * swing
        return np.where(at < 0, 0.0, way[np.clip(at, 0, self.m), np.arange(len(self.c))] + behind)

    def pairs(self, wanted):
        """Return rows (b, i, j) of pairs that may come too near, and intervals with too many."""
        proof, count, b = self.proof, self.proof.count, np.flatnonzero(wanted)
        x, crowded = np.zeros((count, len(wanted), 3)), np.zeros(len(wanted), bool)
        for s in b:
            c, end = self.c[s], min(self.c[s] + self.m + 1, count)
            x[:c, s], x[c:end, s] = proof.folded[0][:c], self.x[: end - c, s, MID]
            tail = proof.straight[0][1 : count - end + 1] @ self.axes[-1, s, MID]
            x[end:, s] = self.x[-1, s, MID] + tail
        boxes = levels(x, self.ways()) if len(b) else []
        i = j = np.zeros(len(b), int)
        for level in reversed(range(len(boxes))):
            low, high, way = boxes[level]
            first, last = i << level, np.minimum((j + 1) << level, count) - 1
            gap = np.maximum(np.maximum(low[j, b] - high[i, b], low[i, b] - high[j, b]), 0.0)
            near = (self.between(self.S, first, last, b) + self.slack[b]) * (last - first) / 2
            near = np.minimum(way[i, b] + way[j, b], near * proof.module.link) * (1 + 1e-9)
            keep = (np.linalg.norm(gap, axis=1) < near + proof.reach) & ~crowded[b]
            keep &= (self.k[b] == 0) | (self.between(self.turning, first, last, b) > 0)
            keep &= last - first >= proof.module.apart
            b, i, j = b[keep], i[keep], j[keep]
            if level:  # the halves of both boxes
                crowded |= np.bincount(b, minlength=len(crowded)) > CROWD * (self.m + 10)
                half = np.arange(4)[:, None]
                i, j, b = (2 * i + half // 2).ravel(), (2 * j + half % 2).ravel(), np.tile(b, 4)
                keep = (i <= j) & (j < len(boxes[level - 1][2]))
                b, i, j = b[keep], i[keep], j[keep]
        return np.stack([b, i, j], axis=1)[~crowded[b]], crowded


class Proof:
    """The proof that a motion keeps a clearance; what it came across is in its attributes."""

    def __init__(self, plan):
        self.module, self.motion, self.count = module, _, n = plan.module, plan.motion, plan.count
        self.claim, self.tightest, self.looks = plan.claim, (math.inf, 0.0, 0, 0), 0
        self.step = 0.0
        p, fine = ORDER, np.linspace(0.0, 1.0, 20001)
        self.nodes = np.sort(1 - np.cos((2 * np.arange(p) + 1) * np.pi / (2 * p))) / 2
        lagrange = [np.prod([(fine - s) / (t - s) for s in self.nodes if s != t], axis=0)
                    for t in self.nodes]
        self.lebesgue = np.abs(lagrange).sum(0).max() * 1.001
        self.B = np.linalg.inv([[math.comb(p - 1, k) * t**k * (1 - t) ** (p - 1 - k)
                                 for k in range(p)] for t in self.nodes])
        self.c = 2 / (4.0**p * math.factorial(p)) * (1 + 1e-9)
        a, hinges = (4 * 2 + 2) * plan.largest * U + 8 * U, len(module.names)
        e = hinges * math.sqrt(2) * (2 * a + 3 * U) + (not module.exact) * (hinges + 1) * 40 * U
        size = np.abs(self.B).sum(1).max() * (module.link * n + 2 * module.radius)
        self.rounding = float(size * (n * (2 * e + 48 * U) + 256 * U))
        self.reach = 2 * module.radius + self.claim + self.rounding
        self.folded = self.straight = np.zeros((1, 3)), np.eye(3)[None]
        motion, slots = plan.motion, plan.motion.slots
        if motion.windowed:
            shapes = motion.folded, np.zeros(slots)
            for angles in shapes:
                self.motion = Motion(slots, [0], [0, slots], angles, angles)
                self._prove(1)
            self.folded, self.straight = map(module.chain, shapes)
            self.motion = motion
        self._prove(max(1, motion.frames - 1))
        require(self.step <= plan.step + 1e-9, f"a step of {self.step:.6f} rad, the plan says less")

    def way(self, seen, turn, links):
        """Return how far points may go of which the nodes show so much (CANDIDATES)."""
        most = np.minimum(self.lebesgue * seen + self.c * turn**ORDER * links, turn * links / 2)
        return most * (1 + 1e-9) + self.rounding

    def _prove(self, intervals):
        todo = [(k, 0.0, 1.0, None) for k in range(intervals)][::-1]
        motion, hinges = self.motion, len(self.module.names)
        while todo:
            items, most = [], self.count // ORDER
            while todo:
                both = [todo[-1][0], min(todo[-1][0] + 1, motion.frames - 1)]
                most = max(most, np.ptp([motion.first[both], motion.last[both]]) // hinges + 2)
                if items and (len(items) + 1) * most * ORDER > BATCH:
                    break
                items.append(todo.pop())
            todo += self._halves(items)

    def _halves(self, items):
        """Return the halves of the intervals in which something is not proved."""
        batch, known, halves = Batch(self, items), [item[3] for item in items], []
        rows, crowded = batch.pairs([pairs is None for pairs in known])
        again = [np.insert(v, 0, b, axis=1) for b, v in enumerate(known) if v is not None]
        rows = np.concatenate([rows, *again])
        parts = [self._left(batch, rows[s : s + PAIRS]) for s in range(0, len(rows), PAIRS)]
        left, self.looks = np.concatenate([rows[:0], *parts]), self.looks + len(rows)
        for b in np.union1d(np.flatnonzero(crowded), left[:, 0])[::-1]:
            k, t, w, _ = items[b]
            rest = None if crowded[b] else left[left[:, 0] == b, 1:]
            pair = "" if rest is None else " between modules {} and {}".format(*rest[0])
            require(w > 2.0**-DEPTH, f"no bound{pair} at frame {k + t:.5f}")
            halves += [(k, t + w / 2, w / 2, rest), (k, t, w / 2, rest)]
        return halves

    def _left(self, batch, rows):
        """Return the rows (b, i, j) whose modules are not proved clear."""
        module, (b, i, j) = self.module, rows.T
        turn = batch.between(batch.S, i, j, b) + batch.slack[b]
        lost = self.c * turn**ORDER * ((j - i) * module.link + module.radius) + self.rounding
        (xi, Ci), (xj, Cj) = (batch.poses(k, b) for k in (i, j))
        y = np.einsum("qpax,qpx->qpa", Ci, xj - xi)
        n = y[:, MID] / np.linalg.norm(y[:, MID], axis=1, keepdims=True).clip(1e-300)
        bound = (np.einsum("qpa,qa->qp", y, n) @ self.B.T).min(1) - 2 * module.radius - lost
        rest = np.flatnonzero(bound < self.claim)
        y, n, turn = y[rest], n[rest, None], np.matmul(Ci[rest], Cj[rest].swapaxes(-1, -2))
        faces = np.broadcast_to(module.faces, (len(rest), *module.faces.shape))
        faces = [n, faces, np.einsum("qab,fb->qfa", turn[:, MID], module.faces)]
        low, gaps = self._along(y, turn, np.concatenate(faces, axis=1), lost[rest])
        some = np.flatnonzero(~(low >= self.claim))
        edges = np.einsum("qab,eb->qea", turn[some, MID], module.edges)
        edges = np.cross(module.edges[:, None], edges[:, None])
        edges = edges.reshape(len(some), len(module.edges) ** 2, 3)
        size = np.linalg.norm(edges, axis=2, keepdims=True)
        edges = np.where(size > 1e-6, edges / size.clip(1e-6), n[some])
        other = self._along(y[some], turn[some], edges, lost[rest[some]])
        low[some], gaps[some] = np.maximum((low[some], gaps[some]), other)
        bound[rest] = low
        if len(rest) and gaps.min() < self.tightest[0]:
            q = rest[gaps.argmin()]
            self.tightest = float(gaps.min()), float(batch.middle[b[q]]), int(i[q]), int(j[q])
        for q in rest[~(bound[rest] >= self.claim) & ~(gaps >= self.claim)]:
            gap, frame = gaps[rest == q][0], batch.middle[b[q]]
            pair = f"modules {i[q]} and {j[q]}"
            raise NotProved(f"{pair}: no gap above {gap:.9f} at frame {frame:.5f}")
        return rows[~(bound >= self.claim)]

    def _along(self, y, turn, axes, lost):
        """Return bounds along the axes with the largest gaps in mid-interval, and these gaps."""
        module, bound = self.module, np.full(len(y), -np.inf)
        along = np.einsum("qfa,qa->qf", axes, y[:, MID])
        axes = np.where(along[..., None] < 0.0, -axes, axes)
        gaps = np.abs(along) + module.least(-axes) + module.least(np.matmul(axes, turn[:, MID]))
        n, gaps = axes[np.arange(len(y)), gaps.argmax(1)], gaps.max(1)
        q = np.flatnonzero(gaps - lost >= self.claim)
        lines = np.concatenate([y[q, :, :, None], turn[q]], axis=3)  # centre and axes of j
        lines = np.matmul(self.B, np.einsum("qa,qpab->qpb", n[q], lines))  # Bernstein coefficients
        least = (lines[..., 0] + module.least(lines[..., 1:])).min(1)
        bound[q] = least + module.least(-n[q]) - lost[q]
        return bound, gaps


def stopped(module, told, middle, end, x, axes):
    """Require that two modules overlap as told, one before `middle`, one from there to `end`."""
    i, j = sorted(told["modules"])
    require(0 <= i < middle <= j < end and j - i >= module.apart, f"modules {i} and {j}")
    y, turn = axes[i] @ (x[j] - x[i]), axes[i] @ axes[j].T
    edges = np.cross(module.edges[:, None], module.edges @ turn.T).reshape(-1, 3)
    size = np.linalg.norm(edges, axis=1)
    edges = edges[size > 1e-6] / size[size > 1e-6, None]
    n = np.concatenate([module.faces, module.faces @ turn.T, edges])
    n = np.where((n @ y < 0.0)[:, None], -n, n)
    deep = -(n @ y + module.least(-n) + module.least(n @ turn)).max()
    require(deep >= DEEP and abs(deep - told["overlap"]) <= 1e-6,
            f"modules {i} and {j} overlap by {deep:.9f}, the plan says {told['overlap']:.9f}")


def blocks(plan, told, _):
    """Prove that modules stop each bent hinge, and the group that would move next (BLOCKS)."""
    module, motion, turns, moves = plan.module, plan.motion, told["turns"], told["moves"]
    hinges, q = len(module.names), motion.angles(motion.frames - 1, 0, motion.slots)
    pad, bend = module.rigid * hinges, told["bent_above_rad"]
    first = told["first_hinge"] + pad
    bent = first + np.flatnonzero(np.abs(q[first:]) > bend)
    require(plan.kind in MODULES, "modules whose separating axes are not known")
    require(turns + moves and 0.0 < bend <= math.pi / 3 and first >= pad and
            np.abs(q - motion.folded)[:first].max(initial=0.0) <= 1e-5 and
            [turn["hinge"] + pad for turn in turns] == bent.tolist(), "other bent hinges")
    for slot, turn in zip(bent, turns, strict=True):
        by = turn["turned_rad"]
        require(by * q[slot] < 0.0 and abs(by) <= math.radians(5.001), f"a turn by {by:.6f} rad")
        tried = np.where(np.arange(len(q)) == slot, q + by, q)
        stopped(module, turn, slot // hinges + 1, plan.count, *module.chain(tried))
    low, high = told["unit"] if moves else (0, 0)
    six = {(*way,) for way in [*np.eye(3), *-np.eye(3)]}
    require(not moves or 0 < low <= high == first // hinges and
            {(*move["direction"],) for move in moves} == six, "not all six directions")
    x, axes = module.chain(motion.folded)
    for move in moves:
        require(0.0 < move["moved"] <= 1.0, "a move of more than a pitch")
        way = np.outer(np.arange(plan.count) >= low, move["direction"]) * move["moved"]
        stopped(module, move, low, high + 1, x + way, axes)
    said = [f"none of the {len(turns)} hinges bent by more than {bend:g} rad from module "
            f"{first // hinges} on can straighten by itself"] * bool(turns)
    said += [f"modules {low} to {high} as one cannot move by a pitch along any axis"] * bool(moves)
    return "; ".join(said)


def crossings(p, b):
    """Return (over, under, off) of a closed polygon's crossings, seen along the third axis.

    Places are edges plus fractions. None if anything may change when vertices move by b.
    """
    e, found = np.roll(p, -1, axis=0) - p, [np.empty((0, 3))]
    low, high, size = np.minimum(p, p + e) - b, np.maximum(p, p + e) + b, np.linalg.norm(e, axis=1)
    for i in range(len(p) - 2):
        j = np.arange(i + 2, len(p) - (i == 0))
        j = j[((low[j] < high[i]) & (low[i] < high[j]))[:, :2].all(1)]
        gap = p[j] - p[i]
        sides = (e[i], gap), (e[i], gap + e[j]), (gap, e[j]), (gap - e[i], e[j])
        area = np.array([u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0] for u, v in sides])
        most = size[i] + size[j] + np.linalg.norm(gap, axis=1)
        side = np.where(np.abs(area) > 4 * b * most, np.sign(area), 0.0)
        ours, theirs = side[0] * side[1], side[2] * side[3]
        area, most, j = (v[..., (ours < 0.0) & (theirs < 0.0)] for v in (area, most, j))
        whole = area[2] - area[3]
        s, t = area[2] / whole, area[0] / (area[0] - area[1])
        above = p[i, 2] + s * e[i, 2] - p[j, 2] - t * e[j, 2]
        if (~((ours > 0.0) | (theirs > 0.0))).sum() > len(j) or not (
                np.abs(above * whole) > 4 * b * most**2).all():
            return None
        two = np.where(above > 0.0, (i + s, j + t), (j + t, i + s))
        found.append(np.column_stack([*two, 4 * b * most / np.abs(whole)]))
    found = np.concatenate(found)
    apart = np.diff(np.sort(found[:, :2], axis=None)).min(initial=1.0)
    return found if apart > 2 * found[:, 2].max(initial=0.0) else None


def determinant(polygon, b):
    """Return the determinant of a closed polygon's knot, modulo PRIME and up to sign (KNOT)."""
    turns = (np.linalg.qr(np.random.default_rng(k).normal(size=(3, 3)))[0] for k in range(VIEWS))
    clear = [view for turn in turns if (view := crossings(polygon @ turn, b)) is not None]
    require(clear, "no view of the line is clear")
    over, under, _ = min(clear, key=len).T
    require(len(over) <= CROSSINGS, f"a view of the line has {len(over)} crossings")
    ends, one, found = np.sort(under), np.eye(len(over), dtype="i8"), 1  # an arc ends below another
    arc, at = np.searchsorted(ends, under), np.searchsorted(ends, over) % len(over)
    rows = (2 * one[at] - one[arc] - one[(arc + 1) % len(over)])[1:, 1:] % PRIME
    while len(rows):
        top = rows[:, 0].argmax()
        first = int(rows[top, 0])
        by, found = rows[:, :1] * pow(first, PRIME - 2, PRIME) % PRIME, found * first % PRIME
        rows = np.delete((rows - by * rows[top]) % PRIME, top, 0)[:, 1:]
    return min(found, PRIME - found)


def away(points, a, b):
    """Return the least distance of points from the way from a to b."""
    share = ((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-300)).clip(0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * (b - a), axis=1).min()


def knot(plan, told, b):
    """Prove that the line through all centres is knotted, its ends led out and joined (KNOT)."""
    last, (root, place, (w, *v)), found = plan.motion.frames - 1, plan.pose, set()
    x, axes = plan.module.chain(plan.motion.angles(last, 0, plan.motion.slots))
    spin = np.cross(v, np.eye(3))
    turn = np.eye(3) + 2 * (w * spin + spin @ spin) / (w * w + np.dot(v, v))
    x = (x - x[root]) @ axes[root].T @ turn + place
    radius = np.linalg.norm(x - x.mean(0), axis=1).max()
    for corners in told["closings"]:
        c = np.array(corners, float).reshape(-1, 3)
        line = np.concatenate([x, c])
        require(len(c) in (0, 2, 3) and np.abs(line).max() < 1e5, "ends that are joined otherwise")
        free = np.linalg.norm(x[-1] - x[0]) <= 1.1  # no corners where the ends touch
        if len(c):
            free = min(away(x[:-1], x[-1], c[0]), away(x[1:], x[0], c[-1])) >= 0.5 and all(
                away(x.mean(0)[None], *two) >= radius for two in itertools.pairwise(c))
        e = np.roll(line, -1, axis=0) - line
        size, along = np.linalg.norm(e, axis=1), (e * np.roll(e, -1, axis=0)).sum(1)
        straight = (along > -0.999 * size * np.roll(size, -1)).all()
        require(free and straight, "an end without a free way out")
        found.add(determinant(line, b))
    require(len(found) == 1 and 1 not in found, f"no knot: determinant {found}")
    value = told["determinant"]
    require(value is None or min(value % PRIME, -value % PRIME) in found, f"determinant {found}")
    return (f"the line through all centres is knotted (determinant {value or found.pop()}), its "
            "ends being led out along free straight lines and joined outside")


REASONS = {"knot": knot, "blocks": blocks}


def check_end(plan, path):
    """Require that the plan ends on the cells, or with the angles, of a path's or chain's file."""
    with open(path, encoding="utf-8") as file:
        told = json.load(file)
    x, off = plan.module.chain(plan.motion.folded)[0], math.inf
    cells = np.array(told.get("cells", ()), float)
    for y in (cells, cells[::-1]) if cells.shape == x.shape else ():  # up to a rigid motion
        u, _, v = np.linalg.svd((x - x.mean(0)).T @ (y - y.mean(0)))
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
        off = min(off, np.abs((x - x.mean(0)) @ turn - (y - y.mean(0))).max())
    angles = np.radians(told.get("joint_angles_deg", ()))
    if len(angles) == len(plan.motion.folded):
        off = np.abs(plan.motion.folded - angles).max()
    require(off <= 1e-6, f"it does not end as {path} says: off by {off:.7f}")


def check(path, size=None, claim=None, end=None, record=None):
    """Return what was proved of a plan, or of a refusal, or why it was not, as plain values.

    Raises:
        ValueError: The file cannot be read.
    """
    began, found = time.perf_counter(), {}
    try:
        plan = Plan(path, size, claim, record)
        found |= {"modules": plan.count, "module": plan.kind, "size": plan.size,
                  "exempt": plan.exempt, "frames": plan.motion.frames, "clearance": plan.claim,
                  "angles_sha256": plan.digest}
        if end:
            check_end(plan, end)
        proof = Proof(plan)
        gap, frame, *pair = proof.tightest
        found |= {"verdict": "proved", "rounding": proof.rounding, "looks": proof.looks,
                  "tightest": {"gap": gap, "frame": frame, "modules": pair} if any(pair) else None}
        if told := plan.evidence:
            with reading(path):
                because = REASONS[told["kind"]](plan, told, proof.rounding + 1e-9)
            found |= {"verdict": "refusal confirmed", "because": because}
    except NotProved as error:
        verdict = "not checked" if isinstance(error, NotChecked) else "not proved"
        found |= {"verdict": verdict, "reason": str(error)}
    return found | {"seconds": round(time.perf_counter() - began, 3)}


SAYS = {
    "proved": "{modules} modules ({module}) of size {size:g}, {frames} frames.\n"
    "They begin as the plan says and end folded. All the way, each pair stays at least "
    "{clearance:.6f}\npitches apart, apart from {exempt} pairs that share a joint.\n"
    "Rounding {rounding:.1e} pitches, {seconds:.1f} s.\n"
    "SHA-256 of the angles: {angles_sha256}",
    "refusal confirmed": "{modules} modules ({module}) of size {size:g}, {frames} frames.\n"
    "They begin folded and never touch. At last, {because}.\n"
    "That no other motion unfolds them is not claimed. {seconds:.1f} s.",
}


def main(arguments=None):
    """Check a plan and print the result."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("plan", help="plan.npz of a fold")
    parser.add_argument("--end", help="file of the path or chain that the plan must end as")
    parser.add_argument("--size", type=float, help="module size instead of the plan's")
    parser.add_argument("--claim", type=float, help="clearance instead of the plan's, in pitches")
    parser.add_argument("--record", help="record.npz of a fold that failed, to check why")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    options = parser.parse_args(arguments)
    try:
        found = check(options.plan, options.size, options.claim, options.end, options.record)
    except ValueError as error:
        print(f"no plan: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(found))
    else:
        print(f"{found['verdict']}: " + SAYS.get(found["verdict"], "{reason}").format(**found))
    return {"proved": 0, "refusal confirmed": 3}.get(found["verdict"], 1)


if __name__ == "__main__":
    sys.exit(main())
