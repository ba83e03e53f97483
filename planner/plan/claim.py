"""Claim: what a plan states of its motion beside its figures, for independent checkers.

``docs/certificate.md`` says in words and as mathematics what is claimed. ``foldback_check.py``
proves it from the plan's file alone.
"""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.module import Link, Module
from foldback.planner.chain.polyhedron import Polyhedron
from foldback.planner.motion.angle_encoding import (
    PLANES_NAME,
    encode_frames,
    encode_windows,
    plane_metadata,
)
from foldback.planner.motion.motion import Motion

CLAIM_FORMATS: Final = ("foldback-claim/1", "foldback-claim/2")
"""Formats of a plan's claim: of one convex part whose hinges turn as far either way, and of any
other module. A change of their meaning gets a new number."""
MAX_CLAIMED_TURN_RAD: Final = 2.0 * np.pi
"""Angle up to which checkers let a hinge turn, either way, whatever its range."""
CLAIMED_VALUES: Final = ("chain", "start", "certificate", "claim", "angles")
"""Values of a plan's file that its claim is about."""
CLAIMED_ARRAYS: Final = (
    *("joint_names", "time_s", "first", "offsets"),
    *("joint_angles_rad", "angles_rad", PLANES_NAME),
)
"""Arrays of a plan's ``.npz`` file that its claim is about."""


def claim_of(module: Module, motion: Motion) -> dict[str, Any]:
    """Return the claim of a plan, as plain JSON values.

    Args:
        module: The module that the chain is made of.
        motion: The plan's motion.
    """
    return {
        "format": CLAIM_FORMATS[_limit_of_one_part(module) is None],
        "module": geometry_of(module),
        "angles_sha256": angles_digest(motion),
    }


def geometry_of(module: Module) -> dict[str, Any]:
    """Return modules at full size, and how each is attached to the next, as plain JSON values.

    Module i is the piece, and its link to the next one the link, of place i of ``pattern``, which
    repeats. A claim of the first format has the values of the only part and link instead.
    """
    of_joints = {
        "hinges": [f"_{name}" if name else "" for name in module.hinge_names],
        "rigid_links": module.rigid_links,
        "apart": module.apart,
    }
    if (limit_rad := _limit_of_one_part(module)) is not None:
        part, link = module.piece(0).parts[0], _link_values(module.link(0))
        return {**_part_values(part), **link, **of_joints, "limit_rad": limit_rad}
    pieces = [
        [{**_part_values(part), "faces": _unit(part.face_normals).tolist()} for part in piece.parts]
        for piece in module.pieces
    ]
    kinds: dict[_LinkKind, int] = {}
    pattern = [
        [piece, kinds.setdefault(_link_kind(module, k), len(kinds))]
        for k, piece in enumerate(module.pattern)
    ]
    places = {link: place for place, (_, link) in enumerate(pattern)}
    links = [
        {**_link_values(module.link(place)), "ranges_rad": _ranges(module.ranges_rad[place])}
        for _, place in sorted(places.items())
    ]
    return {"pieces": pieces, "links": links, "pattern": pattern, **of_joints}


_LinkKind = tuple[int, int, float]


def _link_kind(module: Module, place: int) -> _LinkKind:
    """Return what a link depends on: the pieces that it joins, and the angle at rest."""
    rest = 0.0 if module.rest_rad is None else float(module.rest_rad[place])
    return module.pattern[place], module.pattern[(place + 1) % len(module.pattern)], rest


def _limit_of_one_part(module: Module) -> float | None:
    """Return the limit of all angles of a module of one part and one link; None of others."""
    limit = float(module.ranges_rad[0, 0, 1])
    is_one = len({_link_kind(module, place) for place in range(len(module.pattern))}) == 1
    is_plain = is_one and len(module.piece(0).parts) == 1 and limit <= MAX_CLAIMED_TURN_RAD
    return limit if is_plain and bool((module.ranges_rad == (-limit, limit)).all()) else None


def _part_values(part: Polyhedron) -> dict[str, Any]:
    return {
        "corners": part.corners.tolist(),
        "faces": part.face_normals.tolist(),
        "edges": part.edge_directions.tolist(),
    }


def _link_values(link: Link) -> dict[str, Any]:
    """Return a link: the way from a module to the next one.

    Go along ``anchor``, turn by the first of ``turns``; for each hinge turn about the third axis by
    its angle, then by the next of ``turns``; go along ``offset``.
    """
    frames: list[Array] = [np.eye(3)]
    for axis in link.axes:
        first = np.roll(np.eye(3), -1, axis=0)[int(np.abs(axis).argmax())]
        first = _unit(first - (first @ axis) * axis)
        frames.append(np.array([first, np.cross(axis, first), axis], dtype=np.float64).T)
    turns = [a.T @ b for a, b in zip(frames, frames[1:], strict=False)]
    return {
        "anchor": link.anchor.tolist(),
        "offset": link.offset.tolist(),
        "turns": [_orthonormal(turn).tolist() for turn in (*turns, frames[-1].T @ link.turn)],
    }


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _orthonormal(rotation: Array) -> Array:
    """Return a rotation without its rounding errors, by a step of Newton's method."""
    return 1.5 * rotation - 0.5 * rotation @ rotation.T @ rotation


def _ranges(ranges_rad: Array) -> list[list[float] | None]:
    """Return the ranges of a joint's hinges; None of one that turns freely."""
    clipped = np.clip(ranges_rad, -MAX_CLAIMED_TURN_RAD, MAX_CLAIMED_TURN_RAD)
    return [
        None if np.isinf(given).all() else kept.tolist()
        for given, kept in zip(ranges_rad, clipped, strict=True)
    ]


def angles_digest(motion: Motion) -> str:
    """Return the SHA-256 of a motion's hinge angles, as hexadecimal digits.

    Of a dense motion it is that of its (F, J) angles in double precision, frame by frame; of a
    windowed motion that of ``first`` and ``offsets`` as 64-bit integers, then of the angles of all
    windows in single precision. All numbers are little-endian.
    """
    if motion.is_windowed:
        parts = (motion.first, "<i8"), (motion.offsets, "<i8"), (motion.angles_rad, "<f4")
    else:
        parts = ((motion.joint_angles_rad, "<f8"),)
    digest = hashlib.sha256()
    for values, kind in parts:
        digest.update(np.ascontiguousarray(values, dtype=kind).data)  # usually no copy
    return digest.hexdigest()


def claimed_part(path: FilePath) -> bytes:
    """Return a smaller ``.npz`` file with the part of a plan that its claim is about.

    A checker proves it like the whole file. The angles are stored in planes where they can be.

    Args:
        path: A plan's ``.npz`` file.

    Raises:
        KeyError, OSError, ValueError, BadZipFile: The file cannot be read.
    """
    with np.load(path, allow_pickle=False) as file:
        arrays: dict[str, Any] = {name: file[name] for name in CLAIMED_ARRAYS if name in file}
        metadata = json.loads(str(file["plan"]))
    metadata = {name: metadata[name] for name in CLAIMED_VALUES if name in metadata}
    if (windowed := "angles_rad" in arrays) or "joint_angles_rad" in arrays:
        name = "angles_rad" if windowed else "joint_angles_rad"
        angles, folded = arrays[name], np.array(metadata["chain"]["folded_rad"])
        planes = (
            encode_windows(arrays["first"], arrays["offsets"], angles, folded)
            if windowed
            else encode_frames(angles)
        )
        if planes is not None:
            metadata["angles"] = plane_metadata(angles.shape, windowed=windowed)
            arrays = {**arrays, PLANES_NAME: planes}
            del arrays[name]
    written = io.BytesIO()
    np.savez_compressed(written, plan=np.array(json.dumps(metadata)), **arrays)
    return written.getvalue()
