"""Repair of meshes: shared edges, merging of vertices, closing of holes."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """Statistics of the edges of a mesh.

    Attributes:
        open: Number of edges that an odd number of triangles share.
        scattered: True if most edges belong to one triangle alone.
        loose: (E, 2) edges of a single triangle, in its direction.
    """

    open: int
    scattered: bool
    loose: Ints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closed:
    """A mesh after its holes were closed.

    Attributes:
        vertices: (V, 3) vertices, with a new one in the middle of each hole.
        faces: (F, 3) triangles, with a fan for each hole.
        holes: Number of closed holes.
        share: Area of the fans over the whole area, 0…1.
    """

    vertices: Array
    faces: Ints
    holes: int
    share: float


def edges_of(faces: Ints) -> Edges:
    """Count how triangles share edges; there must be some.

    Two triangles at an edge close a mesh. Four are as good: solids that touch along an edge are
    closed.
    """
    runs = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    first, kind = _kinds(np.sort(runs, axis=1))
    counts = np.bincount(kind)
    open_ = int((counts % 2).sum())
    loose = runs[first[counts == 1]]
    return Edges(
        open=open_,
        scattered=2 * open_ > len(runs),
        loose=loose[np.lexsort((loose.max(axis=1), loose.min(axis=1)))],
    )


def is_surface(points: Array, faces: Ints) -> bool:
    """Return True if triangles share edges like a surface, by a sample of the edges.

    Sewing millions of triangles takes seconds. Here vertices at one place are told by a hash, and
    only the edges with some of the hashes are counted.
    """
    mixed = _mixed(points + 0.0)
    modulus = np.uint64(max(1, 3 * len(faces) // 20_000))
    sampled_keys: list[NDArray[np.uint64]] = []
    with np.errstate(over="ignore"):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            keys = mixed[faces[:, a]] + mixed[faces[:, b]]
            keys ^= keys >> np.uint64(31)
            sampled_keys.append(keys[keys % modulus == 0])
    _, counts = np.unique(np.concatenate(sampled_keys), return_counts=True)
    if not len(counts):
        return True
    # A closed surface has no odd edges, and two triangles at each.
    return bool((counts % 2).mean() <= 2 / 3 and counts.mean() <= 3.0)


def welded(
    points: Array, faces: Ints, *, tolerance: float, once: bool = True
) -> tuple[Array, Ints]:
    """Merge vertices that are equal, or equal after rounding to ``tolerance``.

    Triangles that collapse are left out, and with ``once`` those that come again with the same
    corners in the same order. Without it a closed mesh stays closed.
    """
    rows = points + 0.0
    if tolerance > 0:
        rows = np.round((points - points.min(axis=0)) / tolerance)
    first, inverse = _kinds(rows.astype(np.int64) if tolerance > 0 else _bits(rows).view(np.int64))
    # The order of kinds means nothing, but rims that touch are closed by it.
    order = np.argsort(_mixed(rows[first]))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    first, inverse = first[order], place[inverse]
    joined = inverse[faces]
    a, b, c = joined.T
    proper = (a != b) & (b != c) & (c != a)
    joined = joined[proper]
    if not len(joined) or not once:
        return points[first], joined
    turn = np.argmin(joined, axis=1)
    turned = np.take_along_axis(joined, (turn[:, None] + np.arange(3)) % 3, axis=1)
    first_faces, _ = _kinds(turned)
    return points[first], turned[np.sort(first_faces)] if len(first_faces) < len(turned) else turned


def _kinds(rows: Ints) -> tuple[Ints, Ints]:
    """Return the first index of each kind of equal (n, k) rows, and the (n,) kinds of all rows.

    Rows of small numbers are numbered, since numbers are sorted faster than rows.
    """
    low, high = rows.min(axis=0), rows.max(axis=0)
    sides = [int(last) - int(first) + 1 for first, last in zip(low, high, strict=True)]
    if prod(sides) < 2**63:
        keys = np.zeros(len(rows), dtype=np.int64)
        for side, column in zip(sides, (rows - low).T, strict=True):
            keys = keys * side + column
    else:
        row = np.dtype((np.void, rows.itemsize * rows.shape[1]))
        keys = np.ascontiguousarray(rows).view(row).reshape(-1)
    _, first, kind = np.unique(keys, return_index=True, return_inverse=True)
    return first, kind


def closed_holes(points: Array, faces: Ints, edges: Edges) -> Closed:
    """Close holes with fans around the middle of the rim; skip meshes with too many."""
    loops = _loops(edges.loose)
    new_points, new_faces = [points], [faces]
    next_row = len(points)
    for loop in loops:
        rim = points[loop]
        ahead = np.roll(loop, -1)
        # The fan runs against the triangles at the rim, so that both agree on what is outside.
        if len(loop) == 3:
            new_faces.append(loop[::-1].reshape(1, 3))
            continue
        new_points.append(rim.mean(axis=0, keepdims=True))
        new_faces.append(np.column_stack([ahead, loop, np.full(len(loop), next_row)]))
        next_row += 1
    all_points, all_faces = np.concatenate(new_points), np.concatenate(new_faces)
    areas = _areas(all_points, all_faces)
    share = float(areas[len(faces) :].sum() / max(areas.sum(), np.finfo(float).tiny))
    return Closed(vertices=all_points, faces=all_faces, holes=len(loops), share=share)


def _loops(loose: Ints) -> list[Ints]:
    """Return the rims of holes, split so that each passes its vertices once."""
    if len(loose) > 100_000:
        return []
    ahead: dict[int, list[int]] = {}
    for start, end in loose.tolist():
        ahead.setdefault(start, []).append(end)
    loops: list[Ints] = []
    for start in list(ahead):
        rim, place = [start], {start: 0}
        while ahead.get(rim[-1]):
            vertex = ahead[rim[-1]].pop()
            if vertex not in place:
                place[vertex] = len(rim)
                rim.append(vertex)
                continue
            loop = rim[place[vertex] :]
            for passed in loop[1:]:
                del place[passed]
            del rim[place[vertex] + 1 :]
            if len(loop) >= 3:
                loops.append(np.array(loop, dtype=np.int64))
    return loops


def _areas(points: Array, faces: Ints) -> Array:
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _bits(rows: Array) -> NDArray[np.uint64]:
    return np.ascontiguousarray(rows).view(np.uint64).reshape(rows.shape)


def _mixed(rows: Array) -> NDArray[np.uint64]:
    """Return (N,) a hash of each row."""
    bits = _bits(rows)
    mixed = np.zeros(len(rows), dtype=np.uint64)
    with np.errstate(over="ignore"):
        for column in range(rows.shape[1]):
            mixed = (mixed ^ bits[:, column]) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
    return mixed
