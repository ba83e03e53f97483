"""Separate bodies of a solid: what does not touch, with the share of the volume of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.shapes.mesh_bodies import patches
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.solid_sampling import Sampling

MIN_BODY_SHARE: Final = 0.01
"""Minimum volume of a separate body, as a fraction of the solid's, for cells to be fitted to the
largest body alone; smaller ones are specks, and remain beside it."""
MAX_CROSSED_SHARE: Final = 0.001
"""Maximum share of a solid's inside samples that its surface encloses more than once for volumes to
be computed from the surface, and for the surface not to count as crossing itself."""
MAX_BODY_POINTS: Final = 256
"""Maximum number of points by which a body is found among the cells."""
MAX_LISTED_SHARES: Final = 6
"""Maximum number of bodies whose shares a note lists; it sums up the shares of the rest."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeparateBody:
    """One body of a solid.

    Attributes:
        share: Its share of the solid's volume, 0…1.
        points: (n, 3) some points on or in it, in the solid's frame.
        faces: Rows of its triangles in the solid's ``faces``; None if it was only sampled.
    """

    share: float
    points: Array
    faces: Ints | None


def separate_bodies(
    solid: Solid, sampling: Sampling, numbers: NDArray[np.int32], sizes: Ints
) -> tuple[SeparateBody, ...]:
    """Return the bodies of a solid: that with the most samples, then the others by their volume.

    The volumes are computed from the triangles; only where the surface is open, crosses itself or
    is finer than the samples, they are counted in samples.

    Args:
        solid: The solid.
        sampling: Its samples.
        numbers: (X, Y, Z) the connected part of each sample, from 1; 0 outside.
        sizes: (P,) samples of each part, at least one.
    """
    min_samples = MIN_BODY_SHARE * float(sizes.sum())
    main = int(np.argmax(sizes)) + 1
    bodies: dict[int, SeparateBody] = {}
    if solid.oriented and sampling.crossed <= MAX_CROSSED_SHARE:
        bodies = _from_surface(solid, sampling, numbers, sizes)
    if not {int(p) + 1 for p in np.flatnonzero(sizes >= min_samples)} <= set(bodies):
        bodies = _from_samples(sampling, numbers, np.where(sizes >= min_samples, sizes, 0))
    first = bodies.pop(main)
    return first, *sorted(bodies.values(), key=lambda body: -body.share)


def _from_surface(
    solid: Solid, sampling: Sampling, numbers: NDArray[np.int32], sizes: Ints
) -> dict[int, SeparateBody]:
    patch = patches(solid.faces)
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    centre = solid.vertices.mean(axis=0)
    parts = np.einsum("ij,ij->i", a - centre, np.cross(b - centre, c - centre)) / 6.0
    volumes = np.bincount(patch, weights=parts)
    lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    depth = 0.75 * sampling.pitch / sampling.size
    body = _majority(patch, numbers[_at(sampling, (a + b + c) / 3.0 - depth * normals / lengths)])
    # What is finer than the samples is a body of its own; small cavities are of the largest body.
    lost = np.flatnonzero(body == 0)
    filled = lost[volumes[lost] > 0.0]
    body[lost] = int(np.argmax(sizes)) + 1
    body[filled] = len(sizes) + 1 + np.arange(len(filled))
    sums = np.bincount(body, weights=volumes)
    total = float(sums[sums > 0.0].sum())
    of_triangle = body[patch]
    order = np.argsort(of_triangle, kind="stable")
    bodies: dict[int, SeparateBody] = {}
    for number in np.flatnonzero(sums > 0.0).tolist():
        first, last = np.searchsorted(of_triangle[order], [number, number + 1])
        rows = order[first:last]
        sample_rows = rows[:: max(1, len(rows) // MAX_BODY_POINTS)]
        bodies[number] = SeparateBody(
            share=float(sums[number] / total),
            points=solid.vertices[solid.faces[sample_rows]].mean(axis=1),
            faces=rows,
        )
    return bodies


def _majority(patch: Ints, part: NDArray[np.int32]) -> Ints:
    """Return the part that most of each patch's triangles lie in; 0 if none lies in one."""
    counts = int(part.max()) + 1
    keys, votes = np.unique(patch * counts + part, return_counts=True)
    keys, votes = keys[keys % counts > 0], votes[keys % counts > 0]
    order = np.argsort(votes, kind="stable")
    body = np.zeros(int(patch.max()) + 1, dtype=np.int64)
    body[keys[order] // counts] = keys[order] % counts  # the last one of a patch has most votes
    return body


def _at(sampling: Sampling, points: Array) -> tuple[Ints, Ints, Ints]:
    """Return the samples that points of the solid lie in."""
    turned = points @ sampling.rotation.T * (sampling.size / sampling.pitch) + sampling.offset
    x, y, z = np.clip(np.floor(turned).astype(np.int64), 0, np.array(sampling.inside.shape) - 1).T
    return x, y, z


def _from_samples(
    sampling: Sampling, numbers: NDArray[np.int32], sizes: Ints
) -> dict[int, SeparateBody]:
    total = float(np.count_nonzero(numbers))
    bodies: dict[int, SeparateBody] = {}
    for part in np.flatnonzero(sizes).tolist():
        places = np.argwhere(numbers == part + 1)[:: max(1, int(sizes[part]) // MAX_BODY_POINTS)]
        turned = (places + 0.5 - sampling.offset) * (sampling.pitch / sampling.size)
        bodies[part + 1] = SeparateBody(
            share=float(sizes[part]) / total, points=turned @ sampling.rotation, faces=None
        )
    return bodies


def bodies_note(shares: list[float], unused: list[float]) -> str:
    """Return the note about separate bodies that are left out.

    Args:
        shares: Shares of the volume of all bodies, the largest first.
        unused: Shares of those that are left out, at least one.
    """
    listed = [percent(share) for share in unused[:MAX_LISTED_SHARES]]
    if unlisted := unused[MAX_LISTED_SHARES:]:
        listed.append(f"{len(unlisted)} more with {percent(sum(unlisted))} together")
    body_list = listed[0] if len(listed) == 1 else f"{', '.join(listed[:-1])} and {listed[-1]}"
    if len(unused) == len(shares) - 1:
        word = "the largest" if shares[0] >= max(shares) - 1e-6 else "one"
        return (
            f"the mesh has {len(shares)} separate bodies; only {word}, with "
            f"{percent(shares[0])} of the volume, is used; {body_list} "
            f"{'is' if len(unused) == 1 else 'are'} left out. Join the bodies, or fold them one "
            "by one."
        )
    is_one = len(unused) == 1
    return (
        f"{len(unused)} of the mesh's {len(shares)} separate bodies, with {body_list} of the "
        f"volume, {'is' if is_one else 'are'} left out. Join the bodies, or fold them one by one."
    )


def joined_note(bodies: int) -> str:
    """Return the note about separate bodies that are joined by modules in the air."""
    return f"the mesh has {bodies} separate bodies; modules in the air between them join them."


def percent(share: float) -> str:
    """Return a share from 0 to 1 in percent, with a decimal where it would round to 0 or 100."""
    value = 100.0 * share
    if 0.0 < value < 0.05:
        return "less than 0.1 %"
    decimals = 1 if value < 1.0 or 99.0 < value < 99.95 else 0
    return f"{value:.{decimals}f} %"
