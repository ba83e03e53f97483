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

from foldback.planner.chain.module import Module
from foldback.planner.motion.angle_encoding import (
    PLANES_NAME,
    encode_frames,
    encode_windows,
    plane_metadata,
)
from foldback.planner.motion.motion import Motion

CLAIM_FORMAT: Final = "foldback-claim/1"
"""Format of a plan's claim; a change of its meaning gets a new number."""
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
        "format": CLAIM_FORMAT,
        "module": geometry_of(module),
        "angles_sha256": angles_digest(motion),
    }


def geometry_of(module: Module) -> dict[str, Any]:
    """Return a module at full size, and how the next one is attached, as plain JSON values.

    From one module to the next: go along ``anchor``, turn by the first of ``turns``; for each hinge
    turn about the third axis by its angle, then by the next of ``turns``; go along ``offset``.
    """
    frames = [np.eye(3)]
    for axis in module.axes:
        first = np.roll(np.eye(3), -1, axis=0)[int(np.abs(axis).argmax())]
        first = first - (first @ axis) * axis
        first = first / np.linalg.norm(first)
        frames.append(np.stack([first, np.cross(axis, first), axis], axis=1))
    turns = [a.T @ b for a, b in zip(frames, frames[1:], strict=False)]
    return {
        "corners": module.vertices.tolist(),
        "faces": module.face_normals.tolist(),
        "edges": module.edge_directions.tolist(),
        "anchor": module.anchor.tolist(),
        "offset": module.offset.tolist(),
        "turns": [turn.tolist() for turn in (*turns, frames[-1].T @ module.turn)],
        "hinges": [f"_{name}" if name else "" for name in module.hinge_names],
        "rigid_links": module.rigid_links,
        "apart": module.apart,
        "limit_rad": module.angle_limit_rad,
    }


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
