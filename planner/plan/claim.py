"""Claim: what a plan states of its motion beside its figures, for independent checkers.

``docs/certificate.md`` says in words and as mathematics what is claimed. ``foldback_check.py``
proves it from the plan's file alone.
"""

from __future__ import annotations

import hashlib
from typing import Any, Final

import numpy as np

from planner.chain.module import Module
from planner.motion.motion import Motion

CLAIM_FORMAT: Final = "foldback-claim/1"
"""Format of a plan's claim; a change of its meaning gets a new number."""


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
    found = hashlib.sha256()
    for values, kind in parts:
        found.update(np.ascontiguousarray(values, dtype=kind).data)  # usually no copy
    return found.hexdigest()
