"""Solid sampling: the inside of a solid as a fine grid of samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.core import fill_by_winding, mark_crossings, vote_by_parity
from foldback.planner.errors import InputError
from foldback.planner.shapes.solid import Solid, signed_volume


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampling:
    """Samples of a turned solid.

    A point x of the solid lies in sample ``floor(R x · size / pitch + offset)``.

    Attributes:
        inside: (X, Y, Z) True for samples inside, with a rim of at least ``size`` empty ones.
        size: Samples along the edge of a cell.
        pitch: Edge of a cell, in the solid's units.
        rotation: (3, 3) rotation of the solid.
        offset: (3,) position of its origin, in samples.
        crossed: Share of the inside samples that the surface encloses more than once, 0…1.
    """

    inside: Flags
    size: int
    pitch: float
    rotation: Array
    offset: Array
    crossed: float

    @property
    def count(self) -> int:
        """Number of samples inside."""
        return int(np.count_nonzero(self.inside))

    @property
    def volume(self) -> float:
        """Volume of the samples inside, in the solid's units."""
        return self.count * (self.pitch / self.size) ** 3


def grid_of(extents: Array, pitch: float, size: int) -> Ints:
    """Return the (3,) grid size of a box whose middle is a corner of samples."""
    half = size * np.ceil(extents / (2.0 * pitch) - 1e-9) + size
    return 2 * half.astype(np.int64)


def too_fine(pitch: float, extents: Array) -> InputError:
    """Return the error for cells that are too small for a box."""
    box = " × ".join(f"{extent:.4g}" for extent in extents)
    return InputError(
        "too-fine",
        f"cells with an edge of {pitch:.4g} are too small for a solid that measures {box} and has "
        "little volume; use fewer modules.",
    )


def sample(
    solid: Solid,
    *,
    pitch: float,
    size: int,
    rotation: Array,
    turned: Array | None = None,
    bounds: tuple[Array, Array] | None = None,
) -> Sampling:
    """Sample the inside of a solid.

    What the surface goes around is inside: by winding where neighbouring triangles agree on the
    outside, else by the parity of crossings along three axes, of which two must agree.

    Args:
        solid: Solid to sample.
        pitch: Edge of a cell, in the solid's units.
        size: Samples along it, an even number.
        rotation: (3, 3) rotation that is applied first.
        turned: (V, 3) turned vertices, if they are known.
        bounds: Two (3,) corners of the sampled box around all of ``turned``; by default the
            bounding box.

    Raises:
        InputError: ``too-fine`` when there would be too many samples.
    """
    if turned is None:
        turned = solid.vertices @ rotation.T
    low, high = (turned.min(axis=0), turned.max(axis=0)) if bounds is None else bounds
    middle = (low + high) / 2.0
    shape = grid_of(high - low, pitch, size)
    if float(np.prod(shape.astype(np.float64))) > 48_000_000:
        raise too_fine(pitch, high - low)
    scale = size / pitch
    # What is equal but for rounding shall fall on the same side of every sample.
    points = np.round((turned - middle) * scale, 9) + shape / 2.0
    x, y, z = (np.ascontiguousarray(column) for column in points.T)
    inside = np.zeros(tuple(shape), dtype=np.bool_)
    crossed = 0.0
    marks = np.zeros(tuple(shape), dtype=np.int16)
    mark_crossings(x, y, z, solid.faces, marks)
    if solid.oriented:
        twice = fill_by_winding(marks, inside)
        crossed = twice / max(1, int(np.count_nonzero(inside)))
    else:
        votes = np.zeros(tuple(shape), dtype=np.int8)
        vote_by_parity(marks, votes)
        for u, v, w, order in ((y, z, x, (1, 2, 0)), (z, x, y, (2, 0, 1))):
            marks = np.zeros(tuple(shape[list(order)]), dtype=np.int16)
            mark_crossings(u, v, w, solid.faces, marks)
            axis_votes = np.zeros(marks.shape, dtype=np.int8)
            vote_by_parity(marks, axis_votes)
            votes += axis_votes.transpose(np.argsort(order))
        inside = votes >= 2  # the majority of three axes tolerates small holes
    return Sampling(
        inside=inside,
        size=size,
        pitch=pitch,
        rotation=rotation,
        offset=shape / 2.0 - middle * scale,
        crossed=crossed,
    )


def enclosed_volume(solid: Solid) -> float:
    """Return the volume that a solid encloses, in its units; an estimate unless it is oriented.

    Raises:
        InputError: ``no-volume`` if it encloses none.
    """
    if solid.oriented:
        volume = abs(signed_volume(solid.vertices, solid.faces))
        if volume > 0.0:
            return volume
    pitch = float(solid.extents.max()) / 64.0
    for finer in (1.0, 3.0):
        volume = sample(solid, pitch=pitch / finer, size=2, rotation=np.eye(3)).volume
        if volume > 0.0:
            return volume
    raise InputError(
        "no-volume",
        "got a mesh that encloses no volume, expected a closed surface; close its holes, or give "
        "its walls some thickness.",
    )
