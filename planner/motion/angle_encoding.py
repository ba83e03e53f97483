"""Angle encoding: hinge angles as whole numbers of a small step, and their encoding in files.

A plan's angles are whole steps before they are verified, so that writing loses nothing.
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

from foldback.planner.arrays import Array

Ints = NDArray[np.signedinteger[Any]]
Planes = NDArray[np.uint8]
PLAN_STEP_RAD: Final = np.pi / 2 * 2.0**-23
"""Resolution of the hinge angles in a plan, 1.9e-7 rad: each angle is a whole multiple of it, so
that 90° is exact and files lose nothing. A finer one could not be told apart in single
precision."""
DIFFERENCE_ORDER: Final = 3
"""Number of times that angles are replaced by their differences from frame to frame before they are
stored: for a smooth motion third differences are small and compress well. Higher orders amplify
rounding."""
MAX_PLAIN_ANGLES: Final = 2**18
"""Maximum number of hinge angles that a plan file holds as plain numbers, five megabytes of JSON;
more are stored as compressed differences."""
MAX_ENCODED_ANGLES: Final = 2**16
"""Maximum number of hinge angles that are encoded for a file at once."""
PLANES_NAME: Final = "angle_planes"
"""Name of the array in an ``.npz`` file that holds the encoded hinge angles: four planes, one for
each byte of the 32-bit differences."""


NO_STOPS: Final = np.array([-np.inf, np.inf])


def quantised(angles_rad: NDArray[np.floating[Any]], stops_rad: Array = NO_STOPS) -> Array:
    """Return angles rounded to whole steps; NaN stays NaN, −0 becomes 0.

    Args:
        angles_rad: (…, J) angles.
        stops_rad: (J, 2) or (2,) smallest and largest angle of each hinge, or of all.
    """
    low, high = np.ceil(stops_rad.T[0] / PLAN_STEP_RAD), np.floor(stops_rad.T[1] / PLAN_STEP_RAD)
    scaled: Array = angles_rad.astype(np.float64)
    scaled /= PLAN_STEP_RAD  # in place: of 100 000 modules there are 30 million angles
    np.clip(np.rint(scaled, out=scaled), low, high, out=scaled)
    scaled *= PLAN_STEP_RAD
    scaled += 0.0  # planes hold no −0, and a plan's digest is that of the numbers in its file
    return scaled


def to_step_counts(angles_rad: NDArray[np.floating[Any]]) -> Ints | None:
    """Return angles as whole steps; None if some are no exact steps in their own precision."""
    flat = angles_rad.reshape(-1)
    steps = np.empty(len(flat), dtype=np.int32)
    for start in range(0, len(flat), MAX_ENCODED_ANGLES):
        block = flat[start : start + MAX_ENCODED_ANGLES]
        with np.errstate(invalid="ignore"):
            counts = np.rint(block.astype(np.float64) / PLAN_STEP_RAD)
            exact = np.array_equal((counts * PLAN_STEP_RAD).astype(flat.dtype), block)
        # Up to four right angles, third differences fit into 32 bits.
        if not exact or np.abs(counts).max(initial=0.0) >= 2**25:
            return None
        steps[start : start + MAX_ENCODED_ANGLES] = counts
    return steps.reshape(angles_rad.shape)


def encode_frames(angles_rad: Array) -> Planes | None:
    """Return (4, F·J) third differences over time of (F, J) angles; None if not whole steps."""
    steps = to_step_counts(angles_rad)
    if steps is None:
        return None
    for _ in range(DIFFERENCE_ORDER):
        steps = np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1]))
    return byte_planes(steps)


def decode_frames(planes: Planes, metadata: Mapping[str, Any]) -> Array:
    """Invert ``encode_frames``, by the values of ``plane_metadata``."""
    frames, hinges = metadata["shape"]
    steps = whole_numbers(planes).reshape(frames, hinges)
    for _ in range(metadata["differences"]):
        steps = steps.cumsum(axis=0)
    return steps.astype(np.float64) * float(metadata["step_rad"])


def encode_windows(
    first: Ints, offsets: Ints, angles_rad: NDArray[np.float32], folded_rad: Array
) -> Planes | None:
    """Return (4, V) ``window_differences`` of single precision angles; None if not whole steps."""
    steps = to_step_counts(angles_rad)
    if steps is None:
        return None
    return byte_planes(window_differences(first, offsets, steps, _nearest(folded_rad)))


def decode_windows(
    planes: Planes, metadata: Mapping[str, Any], first: Ints, offsets: Ints, folded_rad: Array
) -> NDArray[np.float32]:
    """Invert ``encode_windows``."""
    step = float(metadata["step_rad"])
    changes = whole_numbers(planes)
    if len(changes) != offsets[-1]:
        raise ValueError(f"got {len(changes)} angles, expected {offsets[-1]}")
    steps = window_totals(first, offsets, changes, _nearest(folded_rad))
    return (steps * step).astype(np.float32)


def window_differences(first: Ints, offsets: Ints, steps: Ints, folded: Ints) -> Ints:
    """Return each hinge's (V,) change since the snapshot before; those of the first are whole.

    A hinge counts as folded if the window before began later, as straight if it had ended.
    """
    changes = np.empty(offsets[-1], steps.dtype)
    before = np.zeros(0, np.int64)
    start = end = 0
    for k, low in enumerate(first.tolist()):
        now = steps[offsets[k] : offsets[k + 1]]
        high = low + len(now)
        expected = np.zeros(len(now), np.int64)
        if k:
            left, right = min(max(start, low), high), min(max(end, low), high)
            expected[: left - low] = folded[low:left]
            expected[left - low : right - low] = before[left - start : right - start]
        np.subtract(now, expected, out=changes[offsets[k] : offsets[k + 1]])
        before, start, end = now, low, high
    return changes


def window_totals(first: Ints, offsets: Ints, changes: Ints, folded: Ints) -> Ints:
    """Invert ``window_differences``."""
    steps = changes.astype(np.int64)
    full_counts = np.zeros(len(folded), np.int64)
    start = end = 0
    for k, low in enumerate(first.tolist()):
        now = steps[offsets[k] : offsets[k + 1]]
        high = low + len(now)
        if k:
            full_counts[low:start] = folded[low:start]
            full_counts[max(low, end) : high] = 0
            now += full_counts[low:high]
        full_counts[low:high] = now
        start, end = low, high
    return steps


def plane_metadata(shape: tuple[int, ...], *, windowed: bool) -> dict[str, Any]:
    """Return the description of a file's planes, as plain JSON values."""
    return {
        "encoding": "zigzag-planes",
        "shape": list(shape),
        "step_rad": PLAN_STEP_RAD,
        "differences": "window" if windowed else DIFFERENCE_ORDER,
    }


def packed_frames(name: str, angles_rad: Array) -> dict[str, Any]:
    """Return (F, J) angles as members of an ``.npz`` file, in planes if they are whole steps."""
    planes = encode_frames(angles_rad) if angles_rad.size > MAX_PLAIN_ANGLES else None
    if planes is None:
        return {name: angles_rad}
    metadata = plane_metadata(angles_rad.shape, windowed=False)
    return {f"{name}_planes": planes, f"{name}_told": np.array(json.dumps(metadata))}


def unpacked_frames(arrays: Mapping[str, Any], name: str) -> Array:
    """Invert ``packed_frames``."""
    if f"{name}_planes" not in arrays:
        return arrays[name]
    return decode_frames(arrays[f"{name}_planes"], json.loads(str(arrays[f"{name}_told"])))


def plan_columns(path: FilePath, folded_rad: Array) -> dict[str, Any]:
    """Read the angles of a plan's ``.npz`` file: arguments of ``Motion.from_angles``.

    Returns:
        ``angles_rad``, and of windows ``first`` and ``offsets``.

    Raises:
        KeyError, OSError, ValueError, BadZipFile: The file cannot be read, or does not have its
            angles once.
    """
    names = ("first", "offsets", "angles_rad", "joint_angles_rad", PLANES_NAME)
    with np.load(path, allow_pickle=False) as file:
        columns = {name: file[name] for name in names if name in file}
        metadata = json.loads(str(file["plan"]))["angles"] if PLANES_NAME in file else {}
    plain = with_plain_angles(columns, metadata, folded_rad, windowed="first" in columns)
    return {name.removeprefix("joint_"): values for name, values in plain.items()}


def with_plain_angles(
    columns: Mapping[str, Any], metadata: Mapping[str, Any], folded_rad: Array, *, windowed: bool
) -> dict[str, Any]:
    """Return columns of a plan, with angles that are stored in planes as plain numbers.

    Args:
        columns: Columns by name.
        metadata: Values of ``plane_metadata`` for the planes.
        folded_rad: (J,) folded angles of the chain.
        windowed: True if the plan's motion is windowed.

    Raises:
        ValueError: The angles are there twice, or not at all.
    """
    name, plain = "angles_rad" if windowed else "joint_angles_rad", dict(columns)
    if (count := (name in plain) + (PLANES_NAME in plain)) != 1:
        problem = "the angles twice" if count else "no angles"
        raise ValueError(f"got {problem}, expected either {name} or {PLANES_NAME}")
    if name in plain:
        return plain
    planes = plain.pop(PLANES_NAME)
    if not windowed:
        return plain | {name: decode_frames(planes, metadata)}
    first, offsets = (np.asarray(plain[column], np.int64) for column in ("first", "offsets"))
    return plain | {name: decode_windows(planes, metadata, first, offsets, folded_rad)}


def unpacked_bytes(path: FilePath) -> int:
    """Return the bytes of the arrays in a plan's ``.npz`` file with angles in double precision.

    Raises:
        OSError, BadZipFile: The file cannot be read.
    """
    with ZipFile(path) as file:
        return sum(
            info.file_size * (2 if info.filename == f"{PLANES_NAME}.npy" else 1)
            for info in file.infolist()
        )


def _nearest(angles_rad: Array) -> Ints:
    return np.rint(angles_rad / PLAN_STEP_RAD).astype(np.int64)


def byte_planes(changes: Ints) -> Planes:
    """Return the (4, n) bytes of n zigzag codes: 0, −1, 1, −2, … are 0, 1, 2, 3, …."""
    flat = changes.reshape(-1)
    planes = np.empty((4, len(flat)), dtype=np.uint8)
    for start in range(0, len(flat), MAX_ENCODED_ANGLES):
        block = flat[start : start + MAX_ENCODED_ANGLES].astype(np.int64)
        codes = ((block << 1) ^ (block >> 63)).astype("<u4")
        planes[:, start : start + MAX_ENCODED_ANGLES] = codes.view(np.uint8).reshape(-1, 4).T
    return planes


def whole_numbers(planes: Planes) -> Ints:
    """Return the (n,) numbers of ``byte_planes``."""
    if planes.ndim != 2 or len(planes) != 4 or planes.dtype != np.uint8:
        raise ValueError(
            f"got angle planes of the shape {planes.shape} and the type {planes.dtype}, expected "
            "the shape (4, n) and the type uint8"
        )
    codes = np.ascontiguousarray(planes.T).view("<u4").reshape(-1).astype(np.int64)
    return (codes >> 1) ^ -(codes & 1)
