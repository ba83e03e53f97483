"""Solids: surface meshes that bound a volume, cleaned of what is safe to clean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.path import check_coordinates
from foldback.planner.errors import InputError
from foldback.planner.shapes.mesh_bodies import MIN_FILLED_SHARE, orient_bodies
from foldback.planner.shapes.mesh_repair import closed_holes, edges_of, is_surface, welded

MAX_VERTEX_COORDINATE: Final = 1e9
"""Maximum magnitude of a vertex's coordinate in an input mesh, in the file's unit; a mesh with a
larger one is refused as damaged."""
MIN_THICKNESS_SHARE: Final = 1e-6
"""Minimum ratio of a mesh's smallest to its largest extent; a mesh below it is refused as flat."""
MAX_LOOSE_TRIANGLES: Final = 200_000
"""Maximum number of triangles of a mesh whose vertices are joined without a test."""
MIN_BOX_SHARE: Final = 0.97
"""Minimum share of its bounding box that a solid fills to count as a box."""
TRIANGLE_CHUNK: Final = 1 << 17
"""Number of triangles whose areas are computed in one NumPy call."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """A surface mesh that bounds a volume.

    Attributes:
        name: Name of the solid.
        vertices: (V, 3) float64, read-only, in the units of the file.
        faces: (F, 3) int64, read-only: triangles as rows of ``vertices``.
        closed: True if every edge is shared by an even number of triangles.
        oriented: True if neighbours agree on the outside and triangles face it.
        surfaces: Number of surfaces that face outwards, if ``oriented``; else 1.
        notes: Messages about repairs.
    """

    name: str
    vertices: Array
    faces: Ints
    closed: bool = True
    oriented: bool = True
    surfaces: int = 1
    notes: tuple[str, ...] = ()

    @classmethod
    def from_triangles(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        name: str = "solid",
        notes: Sequence[str] = (),
        max_triangles: int | None = None,
    ) -> Solid:
        """Check triangles, clean them, close holes and make a solid of them.

        Args:
            vertices: (V, 3) lengths in any unit.
            faces: (F, 3) rows of ``vertices``, counter-clockwise seen from outside.
            name: Name of the solid.
            notes: Messages of the reader about the file.
            max_triangles: Maximum number of triangles; None for any number.

        Raises:
            InputError: A coordinate is invalid, or the mesh has no triangles, is flat or has no
                volume.
        """
        points = np.asarray(vertices, dtype=np.float64).reshape(-1, 3)
        corners = np.asarray(faces, dtype=np.int64).reshape(-1, 3)
        remarks = list(notes)
        check_triangles(len(corners), max_triangles)
        _check_corners(corners, len(points))
        points, corners = _used(points, corners)
        _check_lengths(points)
        corners = _without_slivers(points, corners, remarks)
        points, corners = _used(points, corners)
        _check_extents(points, len(corners))
        solid = _sewn(cls(name=name, vertices=points, faces=corners), remarks)
        solid = _outside_out(solid, remarks)
        for array in (solid.vertices, solid.faces):
            array.setflags(write=False)
        return replace(solid, notes=tuple(remarks))

    @property
    def extents(self) -> Array:
        """(3,) size of the bounding box."""
        return np.ptp(self.vertices, axis=0)

    @property
    def fills_its_box(self) -> bool:
        """True if the solid is a box along the axes, up to ``MIN_BOX_SHARE``."""
        volume = abs(signed_volume(self.vertices, self.faces)) if self.oriented else 0.0
        return volume >= MIN_BOX_SHARE * float(np.prod(self.extents))

    def __len__(self) -> int:
        return len(self.faces)


def check_triangles(count: int, limit: int | None) -> None:
    """Refuse meshes without triangles, and with more than ``limit``; None is no limit.

    Raises:
        InputError: ``no-triangles`` or ``too-many-triangles``.
    """
    if count == 0:
        raise InputError(
            "no-triangles", "this mesh has no triangles; save it again as a closed surface."
        )
    if limit is not None and count > limit:
        raise InputError(
            "too-many-triangles",
            f"got {count} triangles, expected at most {limit}; simplify the mesh.",
        )


def signed_volume(vertices: Array, faces: Ints) -> float:
    """Return the volume of a closed mesh; negative if it is inside out."""
    a, b, c = (vertices[faces[:, i]] - vertices.mean(axis=0) for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _check_corners(corners: Ints, points: int) -> None:
    bad = (corners < 0) | (corners >= points)
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            "bad-index",
            "got vertex {vertex}, but the file has {points} vertices, counted from 0; every corner "
            "of a triangle must be a vertex of the file.",
            where="triangle {triangle}",
            vertex=int(corners[row, column]),
            points=points,
            triangle=row,
        )


def _check_lengths(points: Array) -> None:
    check_coordinates(
        points,
        (
            (~np.isfinite(points), "not-finite", "a number"),
            (
                np.abs(points) > MAX_VERTEX_COORDINATE,
                "too-far",
                f"−{MAX_VERTEX_COORDINATE:g} to {MAX_VERTEX_COORDINATE:g}; scale the mesh down, or "
                "move it closer to the origin",
            ),
        ),
        row="vertex",
    )


def _used(points: Array, corners: Ints) -> tuple[Array, Ints]:
    """Remove the vertices that belong to no triangle."""
    used = np.zeros(len(points), dtype=bool)
    used[corners.ravel()] = True
    if used.all():
        return points, corners
    return points[used], (np.cumsum(used) - 1)[corners]


def _without_slivers(points: Array, corners: Ints, remarks: list[str]) -> Ints:
    longest = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    good = np.empty(len(corners), dtype=bool)
    for start in range(0, len(corners), TRIANGLE_CHUNK):
        chunk = slice(start, start + TRIANGLE_CHUNK)
        a, b, c = (points[corners[chunk, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        good[chunk] = np.linalg.norm(normals, axis=1) > 1e-14 * longest * longest
    dropped = len(corners) - int(good.sum())
    if dropped == len(corners):
        raise InputError(
            "degenerate", "got only triangles of zero area, expected a closed surface."
        )
    if dropped:
        were = "triangle without area was" if dropped == 1 else "triangles without area were"
        remarks.append(f"{dropped} {were} left out.")
    return corners[good] if dropped else corners


def _check_extents(points: Array, triangles: int) -> None:
    extents = np.ptp(points, axis=0)
    centred = points - points.mean(axis=0)
    # Squares of the spread along three directions, the smallest first.
    spread = np.linalg.eigvalsh(centred.T @ centred)
    if (
        extents.min() <= MIN_THICKNESS_SHARE * extents.max()
        or spread[0] <= MIN_THICKNESS_SHARE**2 * spread[-1]
    ):
        size = " × ".join(f"{e:g}" for e in extents)
        noun = "one triangle" if triangles == 1 else f"{triangles} triangles"
        raise InputError(
            "flat",
            f"got a flat mesh of {noun}, which measures {size}, expected a closed surface; give "
            "the mesh some thickness.",
        )


def _sewn(solid: Solid, remarks: list[str]) -> Solid:
    """Return the solid with equal vertices merged and holes closed."""
    if len(solid.faces) > MAX_LOOSE_TRIANGLES and not is_surface(solid.vertices, solid.faces):
        raise _no_surface(len(solid.faces))
    points, corners = welded(solid.vertices, solid.faces, tolerance=0.0)
    if not len(corners):
        raise InputError(
            "degenerate",
            "got only triangles with two corners at the same point, expected a closed surface.",
        )
    edges = edges_of(corners)
    if edges.open:
        # Walls of two bodies may lie on each other; without one of them the mesh would be open.
        every_point, every_corner = welded(solid.vertices, solid.faces, tolerance=0.0, once=False)
        if len(every_corner) > len(corners):
            every = edges_of(every_corner)
            if every.open < edges.open:
                points, corners, edges = every_point, every_corner, every
    if edges.open and (len(corners) <= MAX_LOOSE_TRIANGLES or not edges.scattered):
        loose_points, loose_corners = welded(
            points, corners, tolerance=1e-5 * float(solid.extents.max())
        )
        loose = edges_of(loose_corners) if len(loose_corners) else edges
        if loose.open < edges.open:
            remarks.append("vertices that almost coincide were merged.")
            points, corners, edges = loose_points, loose_corners, loose
    if edges.scattered:
        raise _no_surface(len(corners))
    if edges.open:
        closed = closed_holes(points, corners, edges)
        # A triangle without area that was left out leaves a hole without area.
        # smaller ones are lines, which triangles without area leave behind
        if closed.holes and closed.share > 1e-12:
            word, its = ("hole was", "its") if closed.holes == 1 else ("holes were", "their")
            share = (
                f"; {its} area is {100 * closed.share:.0f} % of the surface of the closed mesh"
                if closed.share > 0.05
                else ""
            )
            remarks.append(f"the mesh is open: {closed.holes} {word} closed{share}.")
        if closed.holes:
            points, corners = closed.vertices, closed.faces
            edges = edges_of(corners)
    if edges.open:
        remarks.append(f"the mesh is open along {edges.open} edges, so its inside was estimated.")
    return replace(
        solid,
        vertices=points,
        faces=corners,
        closed=edges.open == 0,
        oriented=False,
    )


def _no_surface(triangles: int) -> InputError:
    return InputError(
        "not-a-surface",
        f"got {triangles} triangles that share almost no edges, expected a closed surface.",
    )


def _outside_out(solid: Solid, remarks: list[str]) -> Solid:
    """Return the solid with each of its bodies turned outside out, cavities inside out."""
    if not solid.closed:
        return solid
    oriented = orient_bodies(solid.vertices, solid.faces)
    if oriented is None:
        remarks.append(
            "the triangles have inconsistent orientations, so the inside of the mesh was estimated."
        )
        return replace(solid, oriented=False)
    if oriented.volume <= MIN_FILLED_SHARE * float(np.prod(solid.extents)):
        raise InputError(
            "no-volume",
            "got a closed mesh without volume, expected a solid; its walls coincide, or its "
            "parts cancel each other out.",
        )
    remarks += oriented.notes
    return replace(solid, faces=oriented.faces, oriented=True, surfaces=oriented.outer)
