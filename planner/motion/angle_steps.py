"""Angle steps: hinge angles as whole numbers of a small step, and what of them is written to files.

A plan's angles are whole steps before they are verified, so that what is written loses nothing.
The step is a right angle divided by a power of two: straight and folded are exact. It needs NumPy
alone, so that a file's angles can be read without the physics.

Files hold zigzag codes of differences, taken apart into four planes of bytes: neighbouring bytes
are then alike and deflate well.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, Final
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.signedinteger[Any]]
Planes = NDArray[np.uint8]
STEP_RAD: Final = np.pi / 2 * 2.0**-23
"""A step, 1.9e-7 rad; single precision still tells two neighbours apart."""
DIFFERENCES: Final = 3
"""Order of the differences of frames that are stored; third ones of a smooth motion are small."""
MOST_STEPS: Final = 2**25
"""Steps of an angle, at most: four right angles, whose third differences fit into 32 bits."""
MOST_PLAIN: Final = 2**18
"""Angles up to which a file holds plain numbers: five megabytes of JSON."""
BLOCK: Final = 2**16
"""Angles that are worked on at once, so that what is in between stays small."""
PLANES: Final = "angle_planes"
"""Name of the planes in an ``.npz`` file."""


def snapped(angles_rad: NDArray[np.floating[Any]], limit_rad: float = np.inf) -> Array:
    """Angles rounded to whole steps, at most ``limit_rad`` either way; what is none stays none."""
    most = np.floor(limit_rad / STEP_RAD)
    found: Array = angles_rad.astype(np.float64)
    found /= STEP_RAD  # in place: of 100 000 modules there are 30 million angles
    np.clip(np.rint(found, out=found), -most, most, out=found)
    found *= STEP_RAD
    return found


def whole_steps(angles_rad: NDArray[np.floating[Any]]) -> Ints | None:
    """Angles as whole steps; None when some are not exactly that in their own precision."""
    flat = angles_rad.reshape(-1)
    steps = np.empty(len(flat), dtype=np.int32)
    for begin in range(0, len(flat), BLOCK):
        block = flat[begin : begin + BLOCK]
        with np.errstate(invalid="ignore"):
            found = np.rint(block.astype(np.float64) / STEP_RAD)
            exact = np.array_equal((found * STEP_RAD).astype(flat.dtype), block)
        if not exact or np.abs(found).max(initial=0.0) >= MOST_STEPS:
            return None
        steps[begin : begin + BLOCK] = found
    return steps.reshape(angles_rad.shape)


def frame_planes(angles_rad: Array) -> Planes | None:
    """(4, F·J) third differences over time of (F, J) angles; None for those not in whole steps."""
    steps = whole_steps(angles_rad)
    if steps is None:
        return None
    for _ in range(DIFFERENCES):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    return byte_planes(steps)


def frame_angles(planes: Planes, told: Mapping[str, Any]) -> Array:
    """The inverse of ``frame_planes``, from what ``told_of`` says."""
    frames, hinges = told["shape"]
    steps = whole_numbers(planes).reshape(frames, hinges)
    for _ in range(told["differences"]):
        steps = steps.cumsum(axis=0)
    return steps.astype(np.float64) * float(told["step_rad"])


def window_planes(
    first: Ints, offsets: Ints, angles_rad: NDArray[np.float32], folded_rad: Array
) -> Planes | None:
    """(4, V) ``window_differences`` of single precision angles; None as for ``frame_planes``."""
    steps = whole_steps(angles_rad)
    if steps is None:
        return None
    return byte_planes(window_differences(first, offsets, steps, _nearest(folded_rad)))


def window_angles(
    planes: Planes, told: Mapping[str, Any], first: Ints, offsets: Ints, folded_rad: Array
) -> NDArray[np.float32]:
    """The inverse of ``window_planes``."""
    step = float(told["step_rad"])
    changes = whole_numbers(planes)
    if len(changes) != offsets[-1]:
        raise ValueError(f"got {len(changes)} angles, expected {offsets[-1]}")
    steps = window_totals(first, offsets, changes, _nearest(folded_rad))
    return (steps * step).astype(np.float32)


def window_differences(first: Ints, offsets: Ints, steps: Ints, folded: Ints) -> Ints:
    """(V,) each hinge's change since the snapshot before; those of the first one are whole.

    A hinge counts as folded where the window before began later, as straight where it had ended.
    """
    changes = np.empty(offsets[-1], steps.dtype)
    before = np.zeros(0, np.int64)
    begin = end = 0
    for k, low in enumerate(first.tolist()):
        now = steps[offsets[k] : offsets[k + 1]]
        high = low + len(now)
        expected = np.zeros(len(now), np.int64)
        if k:
            left, right = min(max(begin, low), high), min(max(end, low), high)
            expected[: left - low] = folded[low:left]
            expected[left - low : right - low] = before[left - begin : right - begin]
        np.subtract(now, expected, out=changes[offsets[k] : offsets[k + 1]])
        before, begin, end = now, low, high
    return changes


def window_totals(first: Ints, offsets: Ints, changes: Ints, folded: Ints) -> Ints:
    """The inverse of ``window_differences``."""
    steps = changes.astype(np.int64)
    whole = np.zeros(len(folded), np.int64)
    begin = end = 0
    for k, low in enumerate(first.tolist()):
        now = steps[offsets[k] : offsets[k + 1]]
        high = low + len(now)
        if k:
            whole[low:begin] = folded[low:begin]
            whole[max(low, end) : high] = 0
            now += whole[low:high]
        whole[low:high] = now
        begin, end = low, high
    return steps


def told_of(shape: tuple[int, ...], *, windowed: bool) -> dict[str, Any]:
    """What a file says of its planes, as plain JSON values."""
    return {
        "encoding": "zigzag-planes",
        "shape": list(shape),
        "step_rad": STEP_RAD,
        "differences": "window" if windowed else DIFFERENCES,
    }


def packed_frames(name: str, angles_rad: Array) -> dict[str, Any]:
    """(F, J) angles as members of an ``.npz`` file, in planes where they are in whole steps."""
    planes = frame_planes(angles_rad) if angles_rad.size > MOST_PLAIN else None
    if planes is None:
        return {name: angles_rad}
    told = told_of(angles_rad.shape, windowed=False)
    return {f"{name}_planes": planes, f"{name}_told": np.array(json.dumps(told))}


def unpacked_frames(arrays: Mapping[str, Any], name: str) -> Array:
    """What ``packed_frames`` packed."""
    if f"{name}_planes" not in arrays:
        return arrays[name]
    return frame_angles(arrays[f"{name}_planes"], json.loads(str(arrays[f"{name}_told"])))


def plan_angles(path: FilePath) -> Array:
    """(F, J) angles of the frames in a plan's ``.npz`` file.

    Raises:
        KeyError: For a plan of windows.
        OSError, ValueError, BadZipFile: When the file cannot be read, or has its angles twice.
    """
    with np.load(path, allow_pickle=False) as file:
        if "joint_angles_rad" in file and PLANES in file:
            raise ValueError(f"got both joint_angles_rad and {PLANES}, expected one of them")
        if "joint_angles_rad" in file or "first" in file:
            return file["joint_angles_rad"]
        return frame_angles(file[PLANES], json.loads(str(file["plan"]))["angles"])


def plan_window_angles(path: FilePath, folded_rad: Array) -> tuple[Ints, Ints, NDArray[np.float32]]:
    """Where the windows in a plan's ``.npz`` file begin, their offsets and their angles.

    Raises:
        KeyError: For a plan of frames.
        OSError, ValueError, BadZipFile: As for ``plan_angles``.
    """
    with np.load(path, allow_pickle=False) as file:
        if "angles_rad" in file and PLANES in file:
            raise ValueError(f"got both angles_rad and {PLANES}, expected one of them")
        first, offsets = file["first"], file["offsets"]
        if "angles_rad" in file:
            return first, offsets, file["angles_rad"]
        told = json.loads(str(file["plan"]))["angles"]
        return first, offsets, window_angles(file[PLANES], told, first, offsets, folded_rad)


def unpacked_bytes(path: FilePath) -> int:
    """Bytes of the arrays in a plan's ``.npz`` file with its angles in double precision.

    Raises:
        OSError, BadZipFile: When the file cannot be read.
    """
    with ZipFile(path) as file:
        return sum(
            info.file_size * (2 if info.filename == f"{PLANES}.npy" else 1)
            for info in file.infolist()
        )


def _nearest(angles_rad: Array) -> Ints:
    return np.rint(angles_rad / STEP_RAD).astype(np.int64)


def byte_planes(changes: Ints) -> Planes:
    """Return the (4, n) bytes of n zigzag codes: 0, −1, 1, −2, … are 0, 1, 2, 3, …."""
    flat = changes.reshape(-1)
    planes = np.empty((4, len(flat)), dtype=np.uint8)
    for begin in range(0, len(flat), BLOCK):
        block = flat[begin : begin + BLOCK].astype(np.int64)
        codes = ((block << 1) ^ (block >> 63)).astype("<u4")
        planes[:, begin : begin + BLOCK] = codes.view(np.uint8).reshape(-1, 4).T
    return planes


def whole_numbers(planes: Planes) -> Ints:
    """Return the (n,) numbers of ``byte_planes``."""
    if planes.ndim != 2 or len(planes) != 4 or planes.dtype != np.uint8:
        raise ValueError(f"got planes of the shape {planes.shape}, expected four of bytes")
    codes = np.ascontiguousarray(planes.T).view("<u4").reshape(-1).astype(np.int64)
    return (codes >> 1) ^ -(codes & 1)
