"""Prove from a plan's file alone that a chain of modules folds without touching itself.

    python foldback_check.py plan.npz [--start shape.json] [--end shape.json] [--size S] [--claim C]
                                      [--json]

Needs NumPy, and nothing of foldback. docs/certificate.md states what is claimed: hinges turn evenly
from frame to frame, and every pair of modules keeps a clearance *all the time*, apart from pairs
that share a joint. Lengths are in pitches. Exits with 0: proved, 1: not proved, 2: no plan; with
3 to 5: proved, but within limits that the answer names (LIMITS). foldback_check_refusals.py,
another file, checks why a fold failed.

FILES come from strangers. Readers of zip, NumPy and JSON differ in what they make of doubled names,
gaps, odd types and the like, so a file with any of these is refused. Sizes are compared with
bounds before memory is used, and texts are printed as quoted ASCII.
POSES have four rows: the centre and three axes. A link is a matrix by which a pose is multiplied
from the left to get the next one; a hinge turns the first two axes about the third. Module i is the
piece, and its link to the next one the link, of place i of the pattern, which begins again and
again. A piece is made of convex parts, somewhere about its centre: two modules are as far apart as
the nearest two of their parts. r, L and l below are those of the largest piece and link.
MOTION. Seen from module i, a point v of module j is y(t) = sum_m P_m(t) e_m + P(t) v, with products
P_m of hinge rotations and constant links e_m. A derivative brings down one hinge's rate and a cross
product with a unit vector, so |y^(p)| <= S^p (L + |v|): S is the sum of the |rates| of the hinges
between i and j, L the length of the links between. Interpolating y at the p Chebyshev nodes of w
frames is off by at most rem = c (w S)^p (L + |v|), c = 2 / (4^p p!), along each direction. The
interpolating polynomial is nowhere outside the hull of its Bernstein coefficients.
AXIS. For a unit vector n fixed in i, the least coefficient of n.y over all corners of a part of j,
less the support of a part of i along n, less rem, bounds the distance of the parts from below.
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
entries are not 0, 1 or -1 adds 40 u. Let e be the sum of one link, l its length. Rotating keeps the
Frobenius norm of an error. So m links on, a rotation is off by m e. The error of one link turns
what is behind it, and so moves a point by e times its distance d from the link; adding up a
position that is at most x long adds 16 u x. So m links move a point by m (e d + 16 u x) at most.
Points of j seen from i are off by n (l n + 2 r) (2 e + 48 u) for n modules, as d and x <= l n.
BY PARTS. In windows that is less. Let c be the first module of the window, D be l plus the diagonal
of the box about the folded centres. Rotations of the folded modules are made orthonormal, to 32 u:
the modules in front are rigid bodies, off by n (D + 2 r) (2 e + 48 u) as seen from c, since d <= D
and x <= D for them. No distance is off by more because of that. From these bodies, as from others,
window and tail are seen with d <= l n and x <= D + l n, but only m links turn, m being the most of
a batch: hinges at 0 and poses in the straight chain are exact where all constant turns are, and
anchor and offset are halves of whole numbers. So points are off by m (l n + D + 2 r) (2 e + 48 u).
Where they are not exact, the tail is seen by way of its first module: not 2 e + 48 u but half more.
The sum of both is used if it is less. A batch has m <= 2 w + 1, w being the most of one interval.
Bernstein coefficients multiply that by |B|; B itself, axes and supports add 256 u |B| times the
length l n + 2 r, by parts with D. The sum is `rounding`, taken off every bound; 1e-8 for 160 cubes.
Sums of rates have `slack`, and factors near 1 are within 1e-7, which |B| (1 + 1e-6) covers.
"""

import argparse
import hashlib
import json
import math
import os
import re
import struct
import sys
import time
import zlib

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
WEDGE = [[x, y, z] for x, y in ((-1 / 3, -1 / 3), (2 / 3, -1 / 3), (-1 / 3, 2 / 3))
         for z in (-0.5, 0.5)]
TWISTS = {  # of each piece: corners, place and axis of the joint before it, and of that behind it
    "snake-prism": [[*WEDGE, [-1 / 3, 1 / 6, 0.0], ONE[0], [1 / 6, -1 / 3, 0.0], [0.0, -1.0, 0.0]]],
    "snake-cube": [[*CUBE["corners"], [-0.5, 0.0, 0.0], ONE[0], [0.5, 0.0, 0.0], ONE[0]],
                   [*CUBE["corners"], [-0.5, 0.0, 0.0], ONE[0], [0.0, 0.5, 0.0], ONE[1]]],
}
FORMATS = "foldback-claim/1", "foldback-claim/2"  # the first has one part and equal ranges
FREE = 2 * math.pi  # rad, by which a hinge without a range turns at most, either way
RULES = {1: "none", 2: "consecutive modules (i, i+1)"}  # of exempt pairs, by `apart`
SLIP = 1e-6  # rad by which a hinge may miss what is said of it; by more, it is bent
STEP = math.pi / 2 * 2.0**-23  # rad, unit of angles in planes
KINDS = {
    "plan": "U", "joint_names": "U", "time_s": "f8", "first": "i8", "offsets": "i8",
    "joint_angles_rad": "f8", "angles_rad": "f4", "angle_planes": "u1", "root_position": "f8",
    "root_wxyz": "f8", "base_position": "f8", "base_wxyz": "f8",
}
MAX_FILE, MAX_ARRAY, MAX_TEXT = 2**30, 2**28, 2**26  # bytes: of a file, an array, a text in it
NAME = re.compile(rb"\w{1,64}\.npy")
MAX_MODULES, MAX_FRAMES, MAX_HINGES, MAX_DEPTH = 2**18, 2**20, 4, 64
MAX_PIECES, MAX_CORNERS = 16, 96  # also of parts of a piece; also of faces and edges of a part
HEADER = re.compile(rb"\{'descr': '[<|](f8|f4|i8|u1|U\d{1,9})', 'fortran_order': (False|True), "
                    rb"'shape': \((|\d{1,9},|\d{1,9}, \d{1,9})\), \} *\n")
NOTHING = "nothing folds"
OTHER_MODULE = "only for modules as the plan describes them, not foldback's"
OTHER_START = "only from another shape, without being straight"
LIMITS = {NOTHING: 5, OTHER_MODULE: 3, OTHER_START: 4}  # of a proof, with exit statuses


class NotProved(Exception):
    """Something that could not be proved, with the place."""


class Unreadable(ValueError):
    """Something that is no plan."""


def require(condition, message, error=NotProved):
    """Raise an error unless the condition holds."""
    if not condition:
        raise error(message)


def readable(condition, message):
    """Raise Unreadable unless the condition holds."""
    require(condition, message, Unreadable)


def quoted(text, limit=60):
    """Return a stranger's text in quotes: printable ASCII, everything else escaped, shortened."""
    text = str(text)
    return json.dumps(text if len(text) <= limit else text[: limit - 3] + "...")


def fields(value):
    """Return a JSON object."""
    if type(value) is not dict:
        raise Unreadable(f"got {quoted(value)}, expected a JSON object")
    return value


def numbers(value, *shape):
    """Return a finite number, or an array of them; -n stands for a length from 1 to n."""
    if not shape:
        if type(value) not in (int, float) or not math.isfinite(value):
            raise Unreadable(f"got {quoted(value)}, expected a number")
        return float(value)
    length = len(value) if type(value) is list else math.nan
    if length != shape[0] and not 0 < length <= -shape[0]:
        raise Unreadable(f"got {quoted(value)}, expected a list of {abs(shape[0])} parts" +
                         " at most" * (shape[0] < 0))
    return np.array([numbers(part, *shape[1:]) for part in value], float) + 0.0  # no -0.0


def whole(value, low, high):
    """Return a whole number of a range."""
    readable(numbers(value) in range(low, high + 1),
             f"got {quoted(value)}, expected a whole number from {low} to {high}")
    return int(value)


def pair(i, j):
    """Name two modules for people, who count from 1."""
    return f"modules {i + 1} and {j + 1}"


def parsed(text, integers=float):
    """Return a JSON text's object. Integers become what JavaScript reads, unless told otherwise."""

    def once(pairs):
        readable(len(dict(pairs)) == len(pairs), "a name occurs twice in the text of the plan")
        return dict(pairs)

    root = json.loads(text, object_pairs_hook=once, parse_int=integers, parse_constant=numbers)
    level, depth = [root], 0
    while level:
        depth += 1
        readable(depth <= MAX_DEPTH, "the text of the plan is nested too deeply")
        level = [part for value in level if type(value) in (dict, list)
                 for part in (value.values() if type(value) is dict else value)]
    return fields(root)


class File:
    """The arrays of an .npz file: a zip archive of .npy files, read when they are asked for."""

    def __init__(self, path):
        with open(path, "rb") as file:
            readable(22 <= file.seek(0, 2) <= MAX_FILE, "this is no zip archive, or a huge one")
            file.seek(0)
            data = memoryview(file.read())
        mark, *disks, entries, count, _, at, note = struct.unpack("<4s4H2IH", data[-22:])
        readable(mark == b"PK\5\6" and not any(disks) and entries == count and not note,
                 "this is no zip archive, or something follows it")
        self.members, place, end = {}, 0, at
        for _ in range(count):
            mark, _, *facts, packed, size, letters, extra, note, _, _, _, head = struct.unpack_from(
                "<4sH3HI3I5H2I", data, at)
            name, at = bytes(data[at + 46 : at + 46 + letters]), at + 46 + letters + extra + note
            head_mark, *also, head_packed, head_size, long, extra = struct.unpack_from(
                "<4s3HI3I2H", data, head)
            start = head + 30 + long
            _, flags, method, _, crc = facts
            in_extra = data[start : start + 20] == struct.pack("<2H2Q", 1, 16, size, packed)
            sizes = (head_packed, head_size) == (packed, size) or (
                head_packed == head_size == 2**32 - 1 and in_extra)
            agree = sizes and facts == also and name == data[head + 30 : start] and head == place
            usual = NAME.fullmatch(name) and not flags & ~0x806 and method in (0, 8)
            readable(mark == b"PK\1\2" and head_mark == b"PK\3\4" and agree and usual and
                     name not in self.members, f"the member {quoted(name.decode('latin-1'))} of "
                     "the archive is not as usual, or its headers differ")
            place = start + extra + packed
            self.members[name] = method, crc, size, data[start + extra : place]
        readable(place == end and at == len(data) - 22, "the archive has gaps")

    def __contains__(self, name):
        """Return True if there is an array of this name."""
        return b"%s.npy" % name.encode() in self.members

    def _unpacked(self, name, limit):
        """Return a member's first bytes, its size, and whether they are all of it."""
        readable(name in self, f"the array {name} is missing")
        method, crc, size, packed = self.members[b"%s.npy" % name.encode()]
        unpack = zlib.decompressobj(-15)
        data = unpack.decompress(packed, limit) if method else packed[:limit]
        ends = unpack.eof and not unpack.unused_data if method else len(packed) <= limit
        return data, size, ends and len(data) == size and zlib.crc32(data) == crc

    def header(self, name):
        """Return type, memory order and shape of an array, and where its values begin."""
        head, size, _ = self._unpacked(name, 4096)
        start = 10 + int.from_bytes(head[8:10], "little")
        match = head[:8] == b"\x93NUMPY\1\0" and HEADER.fullmatch(head[10:start])
        readable(match and match[1].decode().startswith(KINDS[name]),
                 f"the array {name} has an unexpected type or header")
        kind, shape = match[1].decode(), tuple(map(int, re.findall(rb"\d+", match[3])))
        width = int(kind[1:]) * (4 if KINDS[name] == "U" else 1)
        readable(size == start + math.prod(shape) * width and
                 size <= (MAX_TEXT if KINDS[name] == "U" else MAX_ARRAY),
                 f"the array {name} does not have the size that its header states, or a huge one")
        return kind, "F" if match[2] == b"True" else "C", shape, start

    def shape(self, name, dimensions):
        """Return the shape of an array."""
        shape = self.header(name)[2]
        readable(len(shape) == dimensions, f"the array {name} has the shape {shape}")
        return shape

    def read(self, name, *shape):
        """Return an array of this shape; of texts as a list."""
        kind, order, actual, start = self.header(name)
        readable(actual == shape, f"the array {name} has the shape {actual}, expected {shape}")
        data, _, intact = self._unpacked(name, self.members[b"%s.npy" % name.encode()][2] + 1)
        readable(intact, f"the array {name} is damaged")
        if KINDS[name] != "U":
            return np.frombuffer(data, f"<{kind}", offset=start).reshape(shape, order=order)
        text, width = str(data[start:], "utf-32-le"), int(kind[1:])
        return [text[k * width : (k + 1) * width].rstrip("\0") for k in range(math.prod(shape))]


def relative(origin, poses):
    """Return poses (..., 4, 3) of some modules as seen from others."""
    apart = poses.copy()
    apart[..., 0, :] -= origin[..., 0, :]
    return apart @ origin[..., 1:, :].swapaxes(-1, -2)


def listed(value, most):
    """Return a list that is neither empty nor longer than told."""
    readable(type(value) is list and 0 < len(value) <= most,
             f"got {quoted(value)}, expected a list of {most} parts at most")
    return value


def geometry(values, form):
    """Return a module's description with arrays; lists and texts have a bounded length."""
    names = values["hinges"]
    readable(type(names) is list and 0 < len(names) <= MAX_HINGES and
             all(type(name) is str and len(name) <= 16 for name in names),
             "names of hinges that cannot be")
    if form == FORMATS[0]:
        limit = numbers(values["limit_rad"])
        link = values | {"ranges_rad": [[-limit, limit]] * len(names)}
        values = values | {"pieces": [[values]], "links": [link], "pattern": [[0, 0]]}
    links = [fields(link) for link in listed(values["links"], MAX_MODULES)]
    for link in links:
        free = listed(link["ranges_rad"], MAX_HINGES)
        link |= {"ranges_rad": [[-FREE, FREE] if turns is None else turns for turns in free]}
    pieces = [[{part: numbers(fields(body)[part], -MAX_CORNERS, 3)
                for part in ("corners", "faces", "edges")} for body in listed(piece, MAX_PIECES)]
              for piece in listed(values["pieces"], MAX_PIECES)]
    for body in (body for piece in pieces for body in piece if form != FORMATS[0]):
        high = body["corners"] @ body["faces"].T
        on = np.maximum(*((side > side.max(0) - 1e-9).sum(0) for side in (high, -high)))
        require(on.min() > 2, "a part with corners outside its faces")
    return {part: np.array([numbers(link[part], *shape) for link in links]) for part, shape in {
        "anchor": (3,), "offset": (3,), "turns": (len(names) + 1, 3, 3),
        "ranges_rad": (len(names), 2),
    }.items()} | {
        "pieces": pieces, "hinges": names, "rigid_links": whole(values["rigid_links"], 0, 1),
        "apart": whole(values["apart"], 1, 2), "pattern": [
            (whole(piece, 0, len(pieces) - 1), whole(link, 0, len(links) - 1))
            for piece, link in numbers(values["pattern"], -MAX_MODULES, 2).tolist()]}


def is_usual(kind, description):
    """Return True if a description (`geometry`) is that of foldback's module of this name."""
    if kind in MODULES:
        both = description, geometry(MODULES[kind], FORMATS[0])
        return len({json.dumps(one, default=np.ndarray.tolist) for one in both}) == 1
    # Twist modules may be in any order and shape at rest, and their frames turned in any way.
    anchor, offset, turns, ranges = (
        description[part] for part in ("anchor", "offset", "turns", "ranges_rad"))
    free = np.abs(ranges).min() == FREE and len(description["hinges"]) == description["apart"] == 1
    known, pattern = [np.matmul(rows, np.transpose(rows)) for rows in TWISTS[kind]], [
        *description["pattern"]]
    for (_, before), (piece, link) in {*zip(pattern[-1:] + pattern[:-1], pattern, strict=True)}:
        rows = np.array([*description["pieces"][piece][0]["corners"], -offset[before],
                         turns[before, -1, 2], anchor[link], turns[link, 0, :, 2]])
        free &= len(description["pieces"][piece]) == 1 and any(
            len(rows) == len(other) and np.abs(rows @ rows.T - other).max() < 1e-9
            for other in known)
    return free and not description["rigid_links"]


class Part:
    """A convex body at its size: corners, and directions of its faces and edges."""

    def __init__(self, values, size):
        self.corners, self.faces, self.edges = size * values["corners"], values["faces"], values[
            "edges"]
        self.solid = np.insert(self.corners, 0, 1.0, axis=1)  # for products with whole poses

    def gaps(self, other, pose, by_edges):
        """Return axes (Q, A, 3), and how far they separate the part from another at (Q, 4, 3).

        Axes are the line of centres and all normals of faces, or cross products of two edges.
        """
        y = (other.solid.mean(0) @ pose - self.corners.mean(0))[:, None]
        normals, others = (self.edges, other.edges) if by_edges else (self.faces, other.faces)
        turned = others @ pose[:, 1:]
        axes = (np.cross(normals[:, None], turned[:, None]).reshape(
            len(pose), len(normals) * len(others), 3) if by_edges else np.hstack(
                [y, np.broadcast_to(normals, (len(pose), *normals.shape)), turned]))
        size = np.linalg.norm(axes, axis=2, keepdims=True)
        axes = np.where(axes @ y.swapaxes(1, 2) < 0.0, -axes, axes) / size.clip(1e-6)
        gaps = (axes @ pose.swapaxes(1, 2) @ other.solid.T).min(2) - (
            axes @ self.corners.T).max(2)
        return axes, np.where(size[..., 0] > 1e-6, gaps, -math.inf)


class Module:
    """Modules at their size: pieces, and links from hinge to hinge, by place in the pattern."""

    def __init__(self, description, size):
        self.description = description
        anchor, offset, turns, ranges = (
            description[part] for part in ("anchor", "offset", "turns", "ranges_rad"))
        self.names, self.rigid, self.apart = [*description["hinges"]], *(
            description[name] for name in ("rigid_links", "apart"))
        self.pieces = [[Part(part, size) for part in piece] for piece in description["pieces"]]
        self.piece, self.link = np.array(description["pattern"]).T
        parts = [part for piece in self.pieces for part in piece]
        corners, faces, edges = (max(len(getattr(part, name)) for part in parts)
                                 for name in ("corners", "faces", "edges"))
        self.work = max(256, corners * max(2 * faces + 1, edges**2))  # numbers for a pair of parts
        self.radius = max(np.linalg.norm(part.corners, axis=1).max() for part in parts) * (
            1 + 1e-12)
        self.length = (np.linalg.norm(anchor, axis=1) + np.linalg.norm(offset, axis=1)).max() * (
            1 + 1e-12)
        self.exact = np.isin(turns, (-1.0, 0.0, 1.0)).all()
        self.is_straight_exact = self.exact and not (2 * np.append(anchor, offset) % 1).any()
        self.ranges, self.links = ranges, np.tile(np.eye(4), (*turns.shape[:2], 1, 1))
        self.links[..., 1:, 1:] = turns.swapaxes(2, 3)
        self.links[:, 0, 0, 1:] = anchor
        self.links[:, -1, 0, 1:] = np.einsum("tab,tb->ta", turns[:, -1], offset)
        faces = np.concatenate([part.faces for part in parts])
        lengths = np.concatenate([anchor, offset, *(
            part[name] for piece in description["pieces"] for part in piece
            for name in ("corners", "edges"))])
        require(np.abs(turns @ turns.swapaxes(2, 3) - ONE).max() < 1e-15 and
                (np.linalg.det(turns) > 0).all() and np.abs(lengths).max() < 1e6 and
                np.abs((faces**2).sum(1) - 1).max() < 1e-15 and self.length > 1e-6 and
                (ranges[..., 0] < ranges[..., 1]).all() and (ranges[..., 0] <= 0.0).all() and
                (ranges[..., 1] >= 0.0).all() and np.abs(ranges).max() <= FREE,
                "a module that cannot be")

    def poses(self, q, pose, first=0):
        """Return poses (m+1, M, 4, 3) of module `first` and m after it.

        Args:
            q: (m, K, M) angles.
            pose: (4, 3, M) pose of module `first`.
        """
        poses, cos, sin = [pose], np.cos(q), np.sin(q)
        for m in range(len(q)):
            for k, link in enumerate(self.links[self.link[(first + m) % len(self.link)]]):
                pose = (link @ pose.reshape(4, -1)).reshape(pose.shape)
                if k < len(self.names):
                    c, s = cos[m, k], sin[m, k]
                    pose[1], pose[2] = c * pose[1] + s * pose[2], c * pose[2] - s * pose[1]
            poses.append(pose)
        return np.stack(poses).transpose(0, 3, 1, 2)

    def chain(self, angles):
        """Return poses (n, 4, 3) of a chain with these angles, a slot each."""
        start = np.eye(4, 3, -1)[:, :, None]
        return self.poses(angles.reshape(-1, len(self.names), 1), start)[:, 0]


class Plan:
    """A plan's file, checked against what it says of itself.

    A slot is a hinge of the chain, or one that a rigid link would have. In a frame, angles of slots
    `first` to `last` are `values` from `offsets` on, those before as `folded`, those behind 0. From
    a frame to the next, links `low` to `high` turn, at most `widest` of them.

    Raises:
        NotProved: It contradicts itself, or claims nothing. Any other error: it cannot be read.
    """

    def __init__(self, path, size=None, claim=None):
        file = File(path)
        text = parsed(*file.read("plan"))
        certificate = fields(text["certificate"])
        require(certificate.get("verified") is True, "the plan says that it is not verified: "
                f"{quoted(certificate.get('verdict'), 200)} (foldback_check_refusals.py can check "
                "some reasons)")
        self.read(file, text, size, claim)

    def read(self, file, text, size, claim, ends=True):
        """Take up what a plan says; without `ends`, it neither ends folded nor has a digest."""
        chain, certificate = fields(text["chain"]), fields(text["certificate"])
        stated = fields(text["claim"])
        form, step = stated.get("format"), certificate.get("max_joint_step_rad")
        require(form in FORMATS, f"its claim has the format {quoted(form)}, expected "
                f"{' or '.join(FORMATS)}; another version of this checker may know it")
        kind, self.count = chain["module"], whole(chain["modules"], 2, MAX_MODULES)
        self.kind = kind.get("name") if type(kind) is dict else kind
        readable(type(self.kind) is str, f"got {quoted(kind)}, expected a kind of module")
        self.rest = ("straight", "at rest (all hinges at 0)")[FORMATS.index(form)]
        self.size = float(numbers(certificate["module_size"] if size is None else size))
        bound = certificate.get("clearance_bound") if claim is None else claim
        self.claim = 0.0 if bound is None else float(numbers(bound))
        self.step = math.inf if step is None else numbers(step) or math.inf
        self.module = Module(geometry(fields(stated.get("module")), form), self.size)
        self.is_usual = self.kind in MODULES or self.kind in TWISTS
        require(not self.is_usual or is_usual(self.kind, self.module.description),
                f"modules with the name {self.kind}, but of another kind")
        hinges = (self.count - 1 - self.module.rigid) * len(self.module.names)
        self.pad = self.module.rigid * len(self.module.names)
        self.ranges = self.module.ranges[np.resize(self.module.link, self.count - 1)].reshape(-1, 2)
        self.folded = np.append(np.zeros(self.pad), numbers(chain["folded_rad"], hinges))
        start = text.get("start")
        self.start = np.zeros(hinges) if start is None else numbers(
            fields(start)["folded_rad"], hinges)
        self._arrays(file, text, hinges)
        for fact, holds in self._facts(certificate, ends):
            require(holds, f"the plan contradicts itself or claims nothing: {fact}")
        digest = stated.get("angles_sha256")
        require(digest in (None, self.digest) or not ends,
                "the plan contradicts itself: the checksum of the angles")

    def _arrays(self, file, text, hinges):
        """Read names, times and angles of a file, sizes first."""
        module, self.windowed = self.module, "first" in file
        frames, = file.shape("first" if self.windowed else "time_s", 1)
        readable(0 < frames <= MAX_FRAMES, f"got {frames} frames, expected 1 to {MAX_FRAMES}")
        self.frames, plain = frames, "angles_rad" if self.windowed else "joint_angles_rad"
        stored = [name for name in KINDS if "angle" in name and name in file]
        readable(stored in ([plain], ["angle_planes"]),
                 "the angles are missing, or stored more than once")
        planes, dense = stored != [plain], (frames, hinges)
        count = file.shape(*stored, 2)[1] if planes else math.prod(
            file.shape(plain, 1 if self.windowed else 2))
        readable(count <= frames * hinges and (self.windowed or count == frames * hinges),
                 "the number of angles does not match the hinges and frames")
        names = [f"joint_{k}{name}" for k in range(module.rigid, self.count - 1)
                 for name in module.names]
        require(file.read("joint_names", hinges) == names,
                "the names of the hinges do not match the chain")
        self.times = file.read("time_s", frames)
        first, offsets = np.zeros(frames, "i8"), np.arange(frames + 1) * hinges
        if self.windowed:
            first, offsets = file.read("first", frames), file.read("offsets", frames + 1)
            require(offsets[0] == 0 and offsets[-1] == count and offsets.min() == 0 and
                    offsets.max() == count and first.min() >= 0 and first.max() <= hinges,
                    "the windows do not match the angles")
        last = first + np.diff(offsets)
        require((first <= last).all() and last.max() <= hinges,
                "the windows do not match the chain")
        if planes:
            coded = fields(text["angles"])
            readable(coded["encoding"] == "zigzag-planes" and coded["step_rad"] == STEP and
                     coded["differences"] == ("window" if self.windowed else 3) and
                     tuple(numbers(coded["shape"], -2)) == ((count,) if self.windowed else dense),
                     "angles in planes of another kind")
            values = self._decoded(file.read("angle_planes", 4, count), first, last, offsets)
        else:
            values = file.read(plain, *((count,) if self.windowed else dense))
        hashed = hashlib.sha256()
        for array in (first, offsets, values) if self.windowed else (values,):
            hashed.update(np.ascontiguousarray(array))
        self.digest, self.values = hashed.hexdigest(), values.ravel().astype(float)
        self.first, self.last, self.offsets = first + self.pad, last + self.pad, offsets
        two = [np.minimum(np.arange(frames) + k, frames - 1) for k in range(2)]
        self.low = self.first[two].min(0) // len(module.names)
        self.high = -(-self.last[two].max(0) // len(module.names))
        self.widest = (self.high - self.low).max()
        self.largest = np.abs(np.append(self.values, self.folded)).max()

    def _decoded(self, planes, first, last, offsets):
        """Return angles in planes: (F, J), or those of windows one after another."""
        codes = np.ascontiguousarray(planes.T).view("<u4").astype("i8").ravel()
        codes = (codes >> 1) ^ -(codes & 1)
        if not self.windowed:
            codes = codes.reshape(self.frames, -1)
            for _ in range(3):
                codes = codes.cumsum(axis=0)
                readable(np.abs(codes).max(initial=0) < 2**40, "angles in planes are too large")
            return codes * STEP
        folded, windows = np.rint(self.folded[self.pad :] / STEP).astype("i8"), []
        now = np.zeros(len(folded), "i8")
        for a, b, changes in zip(first, last, np.split(codes, offsets[1:-1]), strict=True):
            now[a:b] += changes
            windows.append((now[a:b] * STEP).astype("f4"))
            now[:a], now[b:] = folded[:a], 0  # a hinge enters as folded in front, straight behind
        return np.concatenate(windows)

    def _facts(self, certificate, ends):
        """Yield what holds of a plan that does not contradict itself."""
        apart, times, frames = self.module.apart, self.times, certificate.get("frames")
        self.exempt, pairs = (apart - 1) * (self.count - 1), certificate.get("exempt_pairs")
        same_pairs = pairs is None or (
            numbers(fields(pairs).get("apart")) == apart and numbers(pairs.get("count")) ==
            self.exempt and pairs.get("rule") in (None, RULES[apart]))
        same_frames = frames is None or numbers(frames) == self.frames
        yield "angles within the ranges of the hinges", self._within(
            self.folded, 0) and all(self._within(self.values[o : o + b - a], a) for a, b, o in zip(
                self.first, self.last, self.offsets[:-1], strict=True))
        yield "module size and clearance", 0.0 < self.size <= 1.0 and 0.0 < self.claim < math.inf
        yield "exempt pairs", same_pairs
        yield "frames", same_frames
        yield "increasing times", np.isfinite(times).all() and (np.diff(times) >= 0.0).all()
        for words, frame, angles in ("start", 0, self.start), (
                "end", self.frames - 1, self.folded[self.pad :]):
            q = self.angles(frame, self.pad, len(self.folded))
            off = np.abs(q - angles).max(initial=0.0)
            near = off <= SLIP or (words == "end" and not ends)
            yield f"{words} of the motion; a hinge is off by {off:.7f} rad", near

    def _within(self, angles, slot):
        """Return True if angles of slots from one on are within their ranges."""
        low, high = self.ranges[slot : slot + len(angles)].T
        return ((angles >= low - SLIP) & (angles <= high + SLIP)).all()

    @property
    def module_words(self):
        """What the modules are."""
        return self.kind if self.is_usual else (
            f"{quoted(self.kind)} as the plan describes it, not one of foldback's: its corners are "
            f"up to {100 * self.module.radius:.1f} % of the spacing from its centre")

    def bent(self):
        """Return how many hinges are bent in each frame."""
        within, before = (np.insert(np.cumsum(np.abs(angles) > SLIP), 0, 0)
                          for angles in (self.values, self.folded))
        return np.diff(within[self.offsets]) + before[self.first]

    def shape_words(self, frame, bent):
        """Say how the chain is folded in a frame."""
        largest = math.degrees(np.abs(self.angles(frame, 0, len(self.folded))).max())
        return (f"{bent} of {len(self.folded) - self.pad} hinges are bent, by up to "
                f"{largest:.1f} degrees")

    def angles(self, frame, low, high):
        """Return the angles of slots low to high in a frame."""
        a, b = np.clip((self.first[frame], self.last[frame]), low, high)
        shift = self.offsets[frame] - self.first[frame]
        values = self.values[shift + a : shift + b]
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
        self.c = c = min(plan.low[self.k].min(), n - 2)
        self.m = m = max(plan.high[self.k].max() - c, 1)
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
        poses = module.poses(q.transpose(1, 2, 0), start, c)
        bodies = np.insert(poses, 0, np.eye(4, 3, -1), axis=0)
        self.bodies = bodies.reshape(m + 2, *t.shape, 4, 3)

    def poses(self, i, b):
        """Return poses (Q, ORDER, 4, 3) of modules i in intervals b."""
        poses, last = self.bodies[self.at[i], b], self.c + self.m
        front, behind = np.flatnonzero(i < self.c), np.flatnonzero(i > last)
        poses[front] = self.proof.folded[i[front]][:, None] @ poses[front]
        poses[behind] = self.proof.tail(last, i[behind])[:, None] @ poses[behind]
        return poses

    def boxes(self):
        """Return corners (n, B, 3) of boxes in which centres stay (CANDIDATES)."""
        c, n = self.c, len(self.at)
        root = c if self.proof.plan.windowed else n // 2
        hull = relative(self.bodies[self.at[root]], self.bodies)
        hull = np.tensordot(BERNSTEIN, hull, (1, 2)).swapaxes(0, 1)
        front = np.tensordot(self.proof.folded[:c, 0], hull[0], (1, 2))
        tail = self.proof.tail(c + self.m, np.arange(c + self.m + 1, n), 1)
        behind = np.tensordot(tail[:, 0], hull[-1], (1, 2))
        hull = np.concatenate([front, hull[1:, ..., 0, :], behind])
        turn = np.abs(self.S - self.S[:, [root]]).T + self.slack
        links = np.abs(np.arange(n) - root)[:, None] * self.proof.plan.module.length
        lost = (REMAINDER * turn**ORDER * links + self.proof.rounding)[..., None]
        return hull.min(1) - lost, hull.max(1) + lost

    def pairs(self, b):
        """Return rows (b, i, j) of pairs that may come too near, and intervals with too many."""
        levels, n, crowded = [self.boxes()], len(self.at), np.zeros(len(self.k), bool)
        crowd = CROWD * (np.where(self.k == 0, n, self.m) + 10)
        while len(levels[-1][0]) > 1:
            two = np.arange(0, len(levels[-1][0]), 2)
            low, high = levels[-1]
            levels.append((np.minimum.reduceat(low, two), np.maximum.reduceat(high, two)))
        i = j = np.zeros(len(b), int)
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
        module, n = plan.module, plan.count
        self.plan, self.tightest, self.looks, self.step = plan, (math.inf, 0.0, 0, 0), 0, 0.0
        self.folded = np.insert(module.chain(plan.folded), 0, [1, 0, 0, 0], axis=2)
        self.straight = module.chain(0.0 * plan.folded)
        turns = self.folded[:, 1:, 1:]
        turns[:] = 1.5 * turns - 0.5 * turns @ turns.swapaxes(1, 2) @ turns  # orthonormal
        self.chain_rounding, by_parts = self._roundings()
        self.rounding = min(self.chain_rounding, by_parts)
        self.reach = 2 * module.radius + plan.claim + self.rounding
        todo = [(k, 0.0, 1.0, None) for k in reversed(range(max(1, plan.frames - 1)))]
        while todo:
            items = todo[-max(1, MODULES_AT_ONCE // n) :]
            k = [item[0] for item in reversed(items)]
            links = np.maximum.accumulate(plan.high[k]) - np.minimum.accumulate(plan.low[k])
            items = items[-np.count_nonzero(links <= 2 * plan.widest) :]
            todo[-len(items) :] = self._halves(items)
        require(self.step <= plan.step + 1e-9, f"a hinge turns by {self.step:.6f} rad "
                "between two frames, more than the plan states")

    def tail(self, last, i, rows=4):
        """Return the first rows of links (Q, 4, 4) from a module to others behind it at rest."""
        poses = relative(self.straight[last], self.straight[i, :rows])
        return np.insert(poses, 0, np.eye(4)[0, :rows], axis=2)

    def _roundings(self):
        """Return the bounds of ROUNDING: of any chain; by parts, or infinite without them."""
        plan, module, n, hinges = (self.plan, self.plan.module, self.plan.count,
                                   len(self.plan.module.names))
        a = (4 * 2 + 2) * plan.largest * U + 8 * U
        e = hinges * math.sqrt(2) * (2 * a + 3 * U) + (not module.exact) * (hinges + 1) * 40 * U
        scale = np.abs(BERNSTEIN).sum(1).max() * (1 + 1e-6)
        link = (2 + (plan.windowed and not module.is_straight_exact)) * (e + 24 * U)
        D = module.length + np.linalg.norm(np.ptp(self.folded[:, 0, 1:], axis=0))
        size = module.length * n + 2 * module.radius
        moved = n * (D + 2 * module.radius) + (2 * plan.widest + 1) * (size + D)
        by_parts = moved * link + (size + D) * 256 * U
        return (float(scale * size * (n * link + 256 * U)),
                float(scale * by_parts) if module.is_straight_exact else math.inf)

    def _halves(self, items):
        """Return the halves of the intervals in which something is not proved."""
        batch, halves = Batch(self, items), []
        rows, crowded = batch.pairs(np.flatnonzero([item[3] is None for item in items]))
        rows = np.concatenate([rows, *(np.insert(item[3], 0, b, axis=1)
                                       for b, item in enumerate(items) if item[3] is not None)])
        self.looks += len(rows)
        parts = np.array_split(rows, len(rows) * self.plan.module.work // (256 * PAIRS_AT_ONCE) + 1)
        open_rows = np.concatenate([self._left(batch, part) for part in parts])
        for b in np.union1d(crowded, open_rows[:, 0]):
            k, t, w, _ = items[b]
            pairs = None if b in crowded else open_rows[open_rows[:, 0] == b, 1:]
            between = "" if pairs is None else f" between {pair(*pairs[0])}"
            require(w > 2.0**-DEPTH, f"no bound{between} at frame {k + t + 1:.5f}")
            halves += [(k, t + w / 2, w / 2, pairs), (k, t, w / 2, pairs)]
        return halves

    def _left(self, batch, rows):
        """Return the rows (b, i, j) whose modules are not proved clear."""
        module, claim, (b, i, j) = self.plan.module, self.plan.claim, rows.T
        pose = relative(batch.poses(i, b), batch.poses(j, b))
        turn = batch.S[b, j] - batch.S[b, i] + batch.slack[b]
        lost = REMAINDER * turn**ORDER * ((j - i) * module.length + module.radius) + self.rounding
        bound, gap = np.full((2, len(rows)), math.inf)
        first, second = module.piece[np.stack([i, j]) % len(module.piece)]
        for code in np.unique(first * MAX_PIECES + second):
            q = np.flatnonzero(first * MAX_PIECES + second == code)
            for one in module.pieces[code // MAX_PIECES]:
                for other in module.pieces[code % MAX_PIECES]:
                    apart = self._apart(one, other, pose[q], lost[q])
                    bound[q], gap[q] = np.minimum((bound[q], gap[q]), apart)
        if gap.min(initial=math.inf) < self.tightest[0]:
            q = gap.argmin()
            self.tightest = float(gap[q]), float(batch.middle[b[q]]), int(i[q]), int(j[q])
        smallest, frame, *modules = self.tightest
        require(smallest >= claim,
                f"{pair(*modules)}: no gap above {smallest:.9f} at frame {frame + 1:.5f}")
        return rows[~(bound >= claim)]

    def _apart(self, one, other, pose, lost):
        """Return bounds (Q,) of the distance of two parts, and gaps at the middle of intervals."""
        bound, gap = np.full((2, len(pose)), -math.inf)
        for by_edges in (False, True):
            q = np.flatnonzero(~(bound >= self.plan.claim))
            axes, gaps = one.gaps(other, pose[q, MID], by_edges)
            n = np.take_along_axis(axes, gaps.argmax(1)[:, None, None], axis=1)[:, 0]
            line = BERNSTEIN @ np.einsum("qkax,qx->qka", pose[q], n)
            low = (line @ other.solid.T).min((1, 2)) - (n @ one.corners.T).max(1) - lost[q]
            bound[q], gap[q] = np.maximum((bound[q], gap[q]), (low, gaps.max(1)))
        return bound, gap


def check_shape(plan, frame, path):
    """Require that in a frame, the chain has the cells or angles of a path's or chain's file."""
    with open(path, encoding="utf-8") as file:
        shape = parsed(file.read(MAX_TEXT))
    q, off = plan.angles(frame, 0, len(plan.folded)), math.inf
    x, cells = plan.module.chain(q)[:, 0], shape.get("cells")
    if type(cells) is list and len(cells) == len(x):
        cells = numbers(cells, len(x), 3)
        for y in cells, cells[::-1]:  # up to a rigid motion
            u, _, v = np.linalg.svd((x - x.mean(0)).T @ (y - y.mean(0)))
            turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
            off = min(off, np.abs((x - x.mean(0)) @ turn - (y - y.mean(0))).max())
    for name, unit in ("joint_angles_deg", math.pi / 180), ("folded_rad", 1.0):
        angles = shape.get(name)
        if type(angles) is list and len(angles) == len(q) - plan.pad:
            off = np.abs(q[plan.pad :] - unit * numbers(angles, len(angles))).max(initial=0.0)
    require(off <= SLIP, f"in frame {frame + 1}, the chain is not as {quoted(path, 999)} "
            f"says: off by {off:.7f}")


def prove(plan, result, start=None, end=None):
    """Return the proof of what a plan claims; tell what it is about, and what came out."""
    bent, last = plan.bent(), plan.frames - 1
    straight = np.flatnonzero(bent == 0)
    result |= {"modules": plan.count, "module": plan.module_words, "size": plan.size,
               "exempt": plan.exempt, "frames": plan.frames, "clearance": plan.claim,
               "angles_sha256": plan.digest}
    result["start"] = plan.rest if not bent[0] else (
        f"in another shape: {plan.shape_words(0, bent[0])}; the chain is " +
        (f"{plan.rest} after {straight[0]} of {last} steps" if straight.size else
         f"never {plan.rest}"))
    result["end"] = f"folded: {plan.shape_words(last, bent[-1])}" if bent[-1] else plan.rest
    for frame, path in (0, start), (last, end):
        if path:
            check_shape(plan, frame, path)
    proof = Proof(plan)
    gap, frame, *two = proof.tightest
    holds = proof.step == 0.0 or not bent[-1], not plan.is_usual, not straight.size
    result["limits"] = [limit for limit, true in zip(LIMITS, holds, strict=True) if true]
    result["reason"] = " and ".join(result["limits"])
    result |= {"verdict": "proved" + f", but {result['reason']}" * any(holds),
               "rounding": proof.rounding, "looks": proof.looks,
               "tightest": {"gap": gap, "frame": frame, "modules": two} if any(two) else None}
    return proof


def answer(path, work):
    """Return what some work finds out about a file, or why nothing is proved, as plain values.

    Raises:
        ValueError: The file cannot be read.
    """
    began, result = time.perf_counter(), {}
    try:
        work(result)
    except NotProved as error:
        result |= {"verdict": "not proved", "reason": str(error), "limits": []}
    except Unreadable as error:
        raise ValueError(f"{quoted(path, 999)}: {error}") from error
    except Exception as error:  # the file holds something else than was expected
        raise ValueError(f"{quoted(path, 999)}: {type(error).__name__}: {quoted(error)}") from error
    return result | {"seconds": round(time.perf_counter() - began, 3)}


def check(path, size=None, claim=None, end=None, start=None):
    """Return what was proved of a plan, or why it was not, as plain values (`answer`).

    Args:
        path: plan.npz.
        size: Module size instead of the plan's, in pitches.
        claim: Clearance instead of the plan's, in pitches.
        end: File of the path or chain that the plan must end as.
        start: File of the path or chain that the plan must begin as.

    Returns:
        `verdict`: "proved"; "proved, but " and one or more of LIMITS; or "not proved". `limits`:
        those of LIMITS that hold. `reason`: the same as a text, or what is not proved. If proved,
        also what was proved: `modules`, `module`, `size`, `frames`, `start`, `end`, `clearance`,
        `exempt`.

    Raises:
        ValueError: The file cannot be read.
    """
    return answer(path, lambda result: prove(Plan(path, size, claim), result, start, end))


SAYS = """{verdict}: {modules} modules of size {size:g} ({module}), {frames} frames.
The motion begins {start}.
It ends {end}.
All the way, each pair stays at least {clearance:.6f} pitches apart, except for {exempt} pairs of
neighbours that share a joint.
Rounding {rounding:.1e} pitches, {seconds:.1f} s.
SHA-256 of the angles: {angles_sha256}"""


def show(result, as_json, says=SAYS):
    """Print an answer. A closed pipe is no error; a full disk ends the program with status 2."""
    says = "{verdict}: {reason}" if result["verdict"].startswith("not ") else says
    try:
        print(json.dumps(result) if as_json else says.format(**result), flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python tries again
        if not isinstance(error, BrokenPipeError):
            print(f"the answer cannot be written: {error.strerror}", file=sys.stderr)
            sys.exit(2)


def status(result):
    """Return the exit status of an answer."""
    limits = [LIMITS[limit] for limit in result["limits"]]
    return 1 if result["verdict"].startswith("not ") else (limits or [0])[0]


def main(arguments=None):
    """Check a plan and print the result."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("plan", help="plan.npz of a fold")
    parser.add_argument("--start", help="file of the path or chain that the plan must begin as")
    parser.add_argument("--end", help="file of the path or chain that the plan must end as")
    parser.add_argument("--size", type=float, help="module size instead of the plan's")
    parser.add_argument("--claim", type=float, help="clearance instead of the plan's, in pitches")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    options = parser.parse_args(arguments)
    try:
        result = check(options.plan, options.size, options.claim, options.end, options.start)
        show(result, options.json)
        return status(result)
    except ValueError as error:
        if options.json:
            show({"verdict": "no plan", "reason": str(error)}, options.json)
        print(f"no plan: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
