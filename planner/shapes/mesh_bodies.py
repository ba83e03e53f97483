"""Mesh bodies: the closed surfaces of a mesh, each oriented by itself.

A body that lies inside another bounds a cavity, and one inside a cavity is solid again. So a body
inside an odd number of others faces inwards, and every other body faces outwards, however the file
has them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints

MIN_FILLED_SHARE: Final = 1e-9
"""Minimum enclosed volume of a mesh's body, as a fraction of its bounding box; a body with less is
a flat sheet that encloses nothing, up to rounding."""
MAX_PROBES: Final = 64
"""Maximum number of points of a body (connected part of a mesh) that are tested for lying inside
another one, to tell cavities from solids."""
PROBE_WEIGHTS: Final = np.array([0.4142, 0.3183, 0.2675])
"""Weights of a triangle's three corners in the point at which the triangle is tested for lying
inside another body: irregular, so that a ray from the point meets no edge of a regular mesh."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Oriented:
    """Consistently oriented triangles.

    Attributes:
        faces: (F, 3) triangles, counter-clockwise seen from outside.
        volume: Volume that the bodies enclose, cavities taken off.
        outer: Number of surfaces that face outwards; those around cavities do not.
        notes: Messages about corrected orientations.
    """

    faces: Ints
    volume: float
    outer: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bodies:
    """A mesh in bodies.

    Attributes:
        points: (V, 3) vertices.
        faces: (F, 3) triangles that agree within each body.
        order: (F,) triangles, one body after the other.
        begins: (B + 1,) index in ``order`` of the first triangle of each body.
        volumes: (B,) signed volumes.
        low, high: (B, 3) corners of the bodies' boxes.
        filled: (B,) True for bodies with an inside.
    """

    points: Array
    faces: Ints
    order: Ints
    begins: Ints
    volumes: Array
    low: Array
    high: Array
    filled: Flags

    @classmethod
    def from_surfaces(cls, points: Array, faces: Ints, body: Ints) -> _Bodies:
        order = np.argsort(body, kind="stable")
        begins = np.searchsorted(body[order], np.arange(int(body.max()) + 2))
        corners = points[faces[order]]
        low = np.minimum.reduceat(corners.min(axis=1), begins[:-1], axis=0)
        high = np.maximum.reduceat(corners.max(axis=1), begins[:-1], axis=0)
        a, b, c = (corners - points.mean(axis=0)).transpose(1, 0, 2)
        parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
        volumes = np.add.reduceat(parts, begins[:-1])
        return cls(
            points=points,
            faces=faces,
            order=order,
            begins=begins,
            volumes=volumes,
            low=low,
            high=high,
            filled=np.abs(volumes) > MIN_FILLED_SHARE * np.prod(high - low, axis=1),
        )

    def rows(self, body: int) -> Ints:
        """Return the triangles of a body."""
        return self.order[self.begins[body] : self.begins[body + 1]]


def orient_bodies(points: Array, faces: Ints) -> Oriented | None:
    """Turn each body of a closed mesh so that its triangles face out of the solid.

    Args:
        points: (V, 3) vertices.
        faces: (F, 3) triangles; an even number shares each edge.

    Returns:
        The triangles, or None for a surface that has no inside, such as a Klein bottle.
    """
    surfaces = _surfaces(points, faces)
    if surfaces is None:
        return None
    body, flips = surfaces
    mesh = _Bodies.from_surfaces(points, _turned(faces, flips), body)
    sizes = np.diff(mesh.begins)
    flipped = np.bincount(body, weights=flips, minlength=len(sizes))
    # A body faces as most of its triangles do in the file.
    orientations = np.sign(mesh.volumes) * np.where(2 * flipped > sizes, -1, 1)
    outward = np.where(_containers(mesh, orientations) % 2 == 1, -1, 1)
    wrong = mesh.filled & (np.sign(mesh.volumes) != outward)
    faces = _turned(mesh.faces, wrong[body])
    if wrong.any():
        faces = _once(faces, body)  # both sides of double-sided walls face outwards now
    return Oriented(
        faces=faces,
        volume=float((np.abs(mesh.volumes) * outward)[mesh.filled].sum()),
        outer=int((outward[mesh.filled] == 1).sum()),
        notes=tuple(
            _notes(
                outward[mesh.filled & (orientations != outward)],
                bodies=int(mesh.filled.sum()),
                triangles=int(np.minimum(flipped, sizes - flipped).sum()),
                sheets=_count_sheets(mesh, body),
            )
        ),
    )


def _once(faces: Ints, body: Ints) -> Ints:
    """Return triangles without repeated bodies: every triangle of these is in an earlier body."""
    turn = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (turn[:, None] + np.arange(3)) % 3, axis=1)
    _, first, kind = np.unique(turned, axis=0, return_index=True, return_inverse=True)
    is_repeat = first[kind.reshape(-1)] != np.arange(len(faces))
    repeated = np.bincount(body, weights=~is_repeat) == 0
    return faces[~repeated[body]] if repeated.any() else faces


def _count_sheets(mesh: _Bodies, body: Ints) -> int:
    """Return the number of bodies without an inside that are not walls between other bodies."""
    if mesh.filled.all():
        return 0
    used = np.zeros(len(mesh.points), dtype=np.bool_)
    used[mesh.faces[mesh.filled[body]]] = True
    outside = body[~used[mesh.faces].all(axis=1)]
    return len(np.unique(outside[~mesh.filled[outside]]))


def _turned(faces: Ints, flipped: Flags) -> Ints:
    if not flipped.any():
        return faces
    return np.where(flipped[:, None], faces[:, ::-1], faces)


def _notes(changed: Ints, *, bodies: int, triangles: int, sheets: int) -> list[str]:
    """Return what was turned: bodies to 1 (outwards) or −1 (inwards), and single triangles."""
    notes: list[str] = []
    if sheets:
        noun = "part that encloses" if sheets == 1 else "parts that enclose"
        notes.append(f"{sheets} {noun} no volume {'was' if sheets == 1 else 'were'} ignored.")
    if triangles:
        word = "triangle was" if triangles == 1 else "triangles were"
        notes.append(f"{triangles} {word} flipped to match neighbouring triangles.")
    outwards, inwards = (int((changed == sign).sum()) for sign in (1, -1))
    if outwards and outwards + inwards == bodies:
        notes.append("the mesh was inside out and was corrected.")
        return notes
    if outwards:
        was = "was" if outwards == 1 else "were"
        notes.append(f"{outwards} of {bodies} bodies {was} inside out and {was} corrected.")
    if inwards:
        word = "body inside another body was" if inwards == 1 else "bodies inside other bodies were"
        notes.append(f"{inwards} {word} read as {'a cavity' if inwards == 1 else 'cavities'}.")
    return notes


def _surfaces(points: Array, faces: Ints) -> tuple[Ints, Flags] | None:
    """Return (F,) the body of each triangle, and whether it must be turned to agree with it.

    Triangles are connected if two of them share an edge. Where more do, bodies touch: what is
    not closed without such an edge goes on there with the next triangle around the edge.
    """
    count = len(faces)
    runs, order, shared, pairs = _shared_edges(faces)
    forward = runs[:, 0] < runs[:, 1]
    surfaces = _consistent(count, pairs, forward)
    crowded = np.repeat(shared > 2, shared)
    if surfaces is None or not crowded.any():
        return surfaces
    body, flips = surfaces
    half = order[crowded]
    edge = np.repeat(np.arange(len(shared)), shared)[crowded]
    run = np.where(forward[half] ^ flips[half // 3], 1.0, -1.0)
    _, kind = np.unique(edge * count + body[half // 3], return_inverse=True)
    loose = np.bincount(kind, weights=run) != 0.0
    is_rest = np.zeros(int(body.max()) + 1, dtype=np.bool_)
    is_rest[body[half // 3][loose[kind]]] = True
    of_rest = is_rest[body[half // 3]]
    if not of_rest.any():
        return surfaces
    half, edge = half[of_rest], edge[of_rest]
    angles = _angles(points, faces, half, forward[half])
    around = np.lexsort((angles, edge))
    around = _apart(around, angles[around], edge[around])
    half, angles, edge = half[around], angles[around], edge[around]
    # Of walls that lie on each other, the one that agrees with the triangle before comes first.
    odd = np.arange(1, len(half) - 1, 2)
    swapped = odd[
        (edge[odd] == edge[odd + 1])
        & (angles[odd] == angles[odd + 1])
        & (forward[half[odd]] == forward[half[odd - 1]])
        & (forward[half[odd + 1]] != forward[half[odd - 1]])
    ]
    half[swapped], half[swapped + 1] = half[swapped + 1], half[swapped]
    return _consistent(count, np.concatenate([pairs, half.reshape(-1, 2)]), forward)


def patches(faces: Ints) -> Ints:
    """Return (F,) the patch of each triangle: patches only touch at edges of more than two."""
    _, _, _, pairs = _shared_edges(faces)
    first, second = pairs.T // 3
    return _components(len(faces), first, second)


def _shared_edges(faces: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Find the triangles at each edge.

    Returns:
        (3 F, 2) vertices of the triangles' edges, (3 F,) their order in which equal edges follow
        one another, (E,) number of triangles at each edge, (P, 2) edges with two triangles, as
        rows of the first array.
    """
    runs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = runs.min(axis=1) * (int(faces.max()) + 1) + runs.max(axis=1)
    order = np.argsort(keys, kind="stable")
    begins = np.flatnonzero(np.concatenate([[True], np.diff(keys[order]) != 0]))
    shared = np.diff(np.append(begins, len(keys)))
    return runs, order, shared, order[begins[shared == 2][:, None] + np.arange(2)]


def _apart(order: Ints, angles: Array, edge: Ints) -> Ints:
    """Return triangles around edges in an order in which no coinciding walls form a pair.

    The first and second triangle of an edge form a pair, the third and fourth, and so on. A pair
    of equal angles encloses nothing, and a body that occurs twice would vanish. So if all pairs of
    an edge are such pairs, its order begins one triangle later.

    Args:
        order: (H,) triangles, in the order of their edges and angles.
        angles, edge: (H,) their angles and edges.
    """
    begins = np.flatnonzero(np.concatenate([[True], np.diff(edge) != 0]))
    sizes = np.diff(np.append(begins, len(edge)))
    after = np.arange(1, len(edge) + 1)
    after[begins + sizes - 1] = begins
    equal = angles == angles[after]
    odd = (np.arange(len(edge)) - np.repeat(begins, sizes)) % 2 == 1
    even_ties = np.add.reduceat(equal & ~odd, begins)
    odd_ties = np.add.reduceat(equal & odd, begins)
    moved = np.repeat((2 * even_ties == sizes) & (odd_ties < even_ties), sizes)
    return order[np.where(moved, after, np.arange(len(edge)))]


def _angles(points: Array, faces: Ints, half: Ints, forward: Flags) -> Array:
    """Return the angles of triangles around one of their edges, rad.

    Args:
        points, faces: The mesh.
        half: (H,) edges: three times the triangle, and 0 to 2 for the corner that it begins at.
        forward: (H,) True if the edge runs to the vertex of the larger number.
    """
    row, corner = half // 3, half % 3
    start, end, third = (points[faces[row, (corner + k) % 3]] for k in range(3))
    along = np.where(forward[:, None], end - start, start - end)
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), np.finfo(float).tiny)
    up = np.cross(along, side)
    up /= np.maximum(np.linalg.norm(up, axis=1, keepdims=True), np.finfo(float).tiny)
    apart = third - start
    angles = np.arctan2(np.einsum("ij,ij->i", apart, up), np.einsum("ij,ij->i", apart, side))
    # −π and π are the same direction.
    angles[angles < -np.pi + 1e-9] = np.pi
    return np.round(angles, 9)


def _consistent(count: int, pairs: Ints, forward: Flags) -> tuple[Ints, Flags] | None:
    """Return the body of each triangle and which to turn; None where a body has no two sides.

    Args:
        count: Number of triangles.
        pairs: (P, 2) edges at which two triangles are connected.
        forward: (3 F,) True if an edge runs to the vertex of the larger number.
    """
    first, second = pairs.T // 3
    against = forward[pairs[:, 0]] == forward[pairs[:, 1]]
    if not against.any():
        return _components(count, first, second), np.zeros(count, dtype=np.bool_)
    # Each triangle stands there twice, as it is and turned over: a body with two sides falls into
    # two parts that mirror each other.
    same_side = np.where(against, second + count, second)
    opposite_side = np.where(against, second, second + count)
    part = _components(
        2 * count,
        np.concatenate([first, first + count]),
        np.concatenate([same_side, opposite_side]),
    )
    if (part[:count] == part[count:]).any():
        return None
    smaller_half = np.minimum(part[:count], part[count:])
    return np.unique(smaller_half, return_inverse=True)[1].reshape(-1), part[:count] != smaller_half


def _components(count: int, first: Ints, second: Ints) -> Ints:
    """Return (count,) the part of a graph that each of its nodes belongs to."""
    from scipy import sparse  # not before a mesh is read: importing it takes a while

    ones = np.ones(len(first), dtype=np.bool_)
    links: Any = sparse.coo_matrix((ones, (first, second)), shape=(count, count))
    connected: Any = sparse.csgraph.connected_components
    return connected(links, directed=False)[1].astype(np.int64)


def _containers(mesh: _Bodies, orientations: Array) -> Ints:
    """Return (B,) the number of bodies that each body lies inside of.

    Args:
        mesh: The bodies.
        orientations: (B,) 1 or −1 from the file, which count where comparing takes too long.
    """
    inside = np.zeros(len(mesh.volumes), dtype=np.int64)
    sizes = np.abs(mesh.volumes)
    tests = 10_000_000  # about two seconds
    for outer in np.argsort(-sizes, kind="stable")[:1000].tolist():
        within = (mesh.low >= mesh.low[outer]).all(axis=1)
        within &= (mesh.high <= mesh.high[outer]).all(axis=1)
        within &= mesh.filled & (sizes < sizes[outer])
        if not mesh.filled[outer] or not within.any():
            continue
        bodies = np.flatnonzero(within)
        triangles = mesh.points[mesh.faces[mesh.rows(outer)]]
        # The probes and the triangles are gone through once, whatever they are tested against.
        tests -= len(triangles) + int(np.minimum(np.diff(mesh.begins)[bodies], MAX_PROBES).sum())
        owners, probes = _probes(mesh, bodies if tests > 0 else bodies[:0])
        crossings = _crossings(triangles, probes, tests) if len(probes) else None
        if crossings is None:
            tests = 0
            inside[bodies] += orientations[bodies] != orientations[outer]
            continue
        odd, spent = crossings
        tests -= spent
        outside = np.bincount(owners[~odd], minlength=len(sizes))
        inside[bodies] += outside[bodies] == 0
    return inside


def _probes(mesh: _Bodies, bodies: Ints) -> tuple[Ints, Array]:
    """Return (P,) bodies and (P, 3) points of theirs, a little below the surface."""
    counts = mesh.begins[bodies + 1] - mesh.begins[bodies]
    probe_counts = np.minimum(counts, MAX_PROBES)
    owners = np.repeat(bodies, probe_counts)
    number = np.arange(len(owners)) - np.repeat(
        np.cumsum(probe_counts) - probe_counts, probe_counts
    )
    steps = (number * np.repeat(counts, probe_counts)) // np.repeat(probe_counts, probe_counts)
    corners = mesh.points[mesh.faces[mesh.order[mesh.begins[owners] + steps]]]
    a, b, c = corners.transpose(1, 0, 2)
    normals = np.cross(b - a, c - a) * np.sign(mesh.volumes[owners])[:, None]
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    depth = 1e-7 * float(np.ptp(mesh.points, axis=0).max())  # tells touching walls apart
    return owners, np.einsum("k,pki->pi", PROBE_WEIGHTS, corners) - depth * normals / lengths[
        :, None
    ]


def _crossings(triangles: Array, probes: Array, max_tests: int) -> tuple[Flags, int] | None:
    """Count the triangles above each probe.

    Args:
        triangles: (F, 3, 3) corners of a closed surface.
        probes: (P, 3) points.
        max_tests: Tests of a probe against a triangle, at most.

    Returns:
        (P,) True for an odd number, and the tests done; None where they would be too many.
    """
    flat = triangles[:, :, :2]
    low, high = flat.min(axis=1), flat.max(axis=1)
    corner = low.min(axis=0)
    extent = np.maximum(high.max(axis=0) - corner, np.finfo(float).tiny)
    side = int(np.clip(np.sqrt(len(flat)), 1, 512))
    while True:
        first, last = (
            np.clip(((places - corner) / extent * side).astype(np.int64), 0, side - 1)
            for places in (low, high)
        )
        wide = last - first + 1
        covered = wide.prod(axis=1)
        if side == 1 or covered.sum() <= 4 * len(flat) + 4096:
            break
        side //= 2
    face = np.repeat(np.arange(len(flat)), covered)
    number = np.arange(len(face)) - np.repeat(np.cumsum(covered) - covered, covered)
    column, row = np.divmod(number, wide[face, 1])
    cell = (first[face, 0] + column) * side + first[face, 1] + row
    face = face[np.argsort(cell, kind="stable")]
    begins = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=side * side))])
    at = np.clip(((probes[:, :2] - corner) / extent * side).astype(np.int64), 0, side - 1)
    key = at[:, 0] * side + at[:, 1]
    counts = begins[key + 1] - begins[key]
    ends = np.cumsum(counts)
    if int(ends[-1]) > max_tests:
        return None
    odd = np.zeros(len(probes), dtype=np.bool_)
    start = 0
    while start < len(probes):
        done = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + (1 << 20))))
        chunk_counts = counts[start:stop]
        probe = np.repeat(np.arange(start, stop), chunk_counts)
        step = np.arange(len(probe)) - np.repeat(
            np.cumsum(chunk_counts) - chunk_counts, chunk_counts
        )
        above = _is_above(triangles[face[begins[key[probe]] + step]], probes[probe])
        odd[start:stop] = np.bincount(probe[above] - start, minlength=stop - start) % 2 == 1
        start = stop
    return odd, int(ends[-1])


def _is_above(triangles: Array, points: Array) -> Flags:
    """Return (N,) True where a ray upwards from a point goes through its triangle."""
    a, b, c = (triangles[:, i] - points for i in range(3))
    ab, bc, ca = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] for u, v in ((a, b), (b, c), (c, a)))
    through = ((ab > 0) & (bc > 0) & (ca > 0)) | ((ab < 0) & (bc < 0) & (ca < 0))
    total = ab + bc + ca
    height = (bc * a[:, 2] + ca * b[:, 2] + ab * c[:, 2]) * np.sign(total)
    return through & (height > 0)
