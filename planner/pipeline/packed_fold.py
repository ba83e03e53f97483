"""Packed fold: a fold's directory as one small file, without loss, for folds that are shipped.

Angles are whole steps (``planner.motion.angle_encoding``), of which differences over time are
stored; what other files repeat is stored once. Nothing here needs compiled kernels or the physics,
so that a service unpacks such a fold in a moment. ``examples/make_shipped_folds.py`` packs them.
"""

from __future__ import annotations

import io
import json
import lzma
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.certificate.figures_store import Curves, Figures, write
from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.errors import InputError
from foldback.planner.motion.angle_encoding import (
    PLAN_STEP_RAD,
    byte_planes,
    to_step_counts,
    whole_numbers,
)
from foldback.planner.motion.motion import FRAME_COLUMNS, Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pipeline.manifest import write_manifest
from foldback.planner.storage import file_names as names
from foldback.planner.storage.array_files import save_npz
from foldback.planner.storage.files import write_whole

Ints = NDArray[np.signedinteger[Any]]
Arrays = dict[str, NDArray[Any]]
PACKED_FORMAT: Final = "foldback-packed/1"
TEXT_FILES: Final = (
    *(names.INPUT, names.REQUEST, names.CHAIN, names.START_CHAIN, names.CANDIDATES, names.ATTEMPTS),
    *(names.CERTIFICATE, names.MODEL, names.MOMENTS),
)
"""Files that a packed fold (a whole fold directory in one small file) holds unchanged, if the fold
has them."""
ARRAY_FILES: Final = (names.RECORD, names.PLAYBACK, names.PLAN, names.START_PLAN)
"""Files whose arrays a packed fold (a whole fold directory in one small file) holds in compressed
form, each by its name."""
ROOT_STEPS: Final = {"root_position": 2.0**-20, "root_wxyz": 2.0**-30}
"""Quantisation of the position (pitches) and quaternion of a chain's root in a packed fold."""
ROOT_ARRAYS: Final = tuple(ROOT_STEPS)
CLEARANCE_STEP_PITCH: Final = 2.0**-10
"""Step, in pitches, to multiples of which the distances between modules for plots are rounded in a
packed fold (all files of a fold as one small file, as shipped with the program)."""
DIFFERENCE_ORDERS: Final = {"joint_angles_rad": 2, "reference_rad": 3}
"""A packed fold stores each array of joint angles as differences between frames, which are small
numbers. Order of the differences (1: from frame to frame; 2: differences of those) that makes the
smallest file. Measured."""


def pack(directory: FilePath, about: dict[str, Any]) -> bytes:
    """Return a fold's directory, and what else is to be known of it, as one file.

    Raises:
        InputError: ``not-packable`` for what is not in whole steps, such as a fold that
            ``examples/make_shipped_folds.py`` has not rounded.
    """
    packer = _Packer()
    texts = {
        name: (directory / name).read_text(encoding="utf-8")
        for name in TEXT_FILES
        if (directory / name).exists()
    }
    for file in ARRAY_FILES:
        if (directory / file).exists():
            with np.load(directory / file, allow_pickle=False) as opened:
                packer.add_npz(file, _frames_of(directory, file) | dict(opened))
    packer.add_figures(Figures.load(directory / names.FIGURES))
    header = {
        "format": PACKED_FORMAT,
        "about": about,
        "texts": texts,
        "timeline": Timeline.open(directory / names.TIMELINE).id,
        "coded": packer.coded,
    }
    file = io.BytesIO()
    np.savez(file, header=np.array(json.dumps(header)), **cast("dict[str, Any]", packer.arrays))
    return lzma.compress(file.getvalue(), preset=9 | lzma.PRESET_EXTREME)


def unpack(data: bytes, directory: FilePath) -> dict[str, Any]:
    """Write the files of a packed fold into a directory that is there; return what is about it."""
    with np.load(io.BytesIO(lzma.decompress(data)), allow_pickle=False) as file:
        arrays: Arrays = dict(file)
    header = json.loads(str(arrays.pop("header")))
    if header["format"] != PACKED_FORMAT:
        raise InputError(
            "not-packed", f"got the format {header['format']!r}, expected {PACKED_FORMAT!r}."
        )
    files_found = _unpacked(arrays, header["coded"])
    for name, text in header["texts"].items():
        write_whole(directory / name, text.encode())
    refold = (directory / names.START_CHAIN).exists()
    shown = (names.PLAYBACK,) if refold else (names.RECORD, names.PLAYBACK)
    for file in ARRAY_FILES:
        stored = _of_file(files_found, file)
        for name in (*FRAME_COLUMNS, "reference_rad") if file in shown else ():
            stored.pop(name, None)
        if stored:
            save_npz(directory / file, stored)
    _write_timeline(directory, files_found, shown, header["timeline"])
    write([Figures(**_of_file(files_found, "figures"))], directory / names.FIGURES)
    write_manifest(directory)
    return header["about"]


class _Packer:
    """Collects arrays, as they are or coded."""

    def __init__(self) -> None:
        self.arrays: Arrays = {}
        self.coded: dict[str, dict[str, Any]] = {}

    def add_npz(self, file: str, arrays: Arrays) -> None:
        reference = arrays.get("reference_rad")
        for name, array in arrays.items():
            key = f"{file}/{name}"
            if self._repeats(file, name, array):
                continue
            if name.endswith("_rad") and array.ndim > 1:
                self._add_angles(key, name, array, reference)
            elif name in ROOT_ARRAYS and file != names.START_PLAN:
                step = ROOT_STEPS[name]
                self._code(key, _whole(key, array / step), step, 2, array.dtype)
            else:
                self.arrays[key] = array

    def _repeats(self, file: str, name: str, array: NDArray[Any]) -> bool:
        """Return True if ``_unpacked`` finds an array in another one."""
        if name == "joint_error_rad":
            return True  # of a record it is NaN, of a playback the distance from the reference
        if file != names.PLAN or name not in ("joint_angles_rad", *ROOT_ARRAYS):
            return False
        column = "reference_rad" if name == "joint_angles_rad" else name
        recorded = _unpacked(dict(self.arrays), self.coded).get(f"playback.npz/{column}")
        if recorded is None or not np.array_equal(recorded, array):
            raise InputError(
                "not-packable", f"{file}: {name} differs from the array in playback.npz."
            )
        return True

    def _add_angles(self, key: str, name: str, array: Array, reference: Array | None) -> None:
        steps = _steps(key, array)
        if reference is None or name == "reference_rad":
            order = DIFFERENCE_ORDERS["reference_rad" if "start" in key else name]
            self._code(key, steps, PLAN_STEP_RAD, order, array.dtype)
            return
        errors = steps - _steps(key, reference)
        self._code(key, errors, PLAN_STEP_RAD, 1, array.dtype)
        self.coded[key]["from"] = "playback.npz/reference_rad"

    def add_figures(self, figures: Figures) -> None:
        for name in Curves.__dataclass_fields__:
            self.arrays[f"figures/{name}"] = getattr(figures, name)
        self._code("figures/nearest", figures.nearest, 1, 1, np.dtype(np.int32))
        clearance = _whole("clearance", figures.clearance.astype(float) / CLEARANCE_STEP_PITCH)
        self._code("figures/clearance", clearance, CLEARANCE_STEP_PITCH, 1, np.dtype(np.float32))
        torque = figures.torque_nm.astype(float)
        first = int(np.isnan(torque).all(axis=1).sum())  # the explosion's frames have none
        step = torque_step(torque)
        rounded = _whole("torque_nm", np.nan_to_num(torque[first:]) / step)
        self._code("figures/torque_nm", rounded, step, 1, np.dtype(np.float32))
        self.coded["figures/torque_nm"]["missing"] = first

    def _code(self, key: str, values: Ints, step: float, order: int, dtype: Any) -> None:
        """Store whole numbers as byte planes of their differences, column by column."""
        shape = values.shape
        scale = int(np.gcd.reduce(values, axis=None)) or 1
        remainder = values.astype(np.int64).reshape(-1, *shape[-2:]) // scale
        for _ in range(order):
            remainder = np.diff(remainder, axis=1, prepend=np.zeros_like(remainder[:, :1]))
        self.arrays[key] = byte_planes(remainder.swapaxes(1, 2))
        self.coded[key] = {
            "shape": list(shape),
            "step": step,
            "scale": scale,
            "order": order,
            "dtype": np.dtype(dtype).str,
        }


def torque_step(torque_nm: Array) -> float:
    """Return the step of the torques that plots show: between 1/64 and 1/128 of the largest one."""
    return float(2.0 ** (np.floor(np.log2(np.nanmax(np.abs(torque_nm)) or 1.0)) - 6))


def _steps(key: str, angles_rad: Array) -> Ints:
    steps = to_step_counts(angles_rad)
    if steps is None or np.signbit(angles_rad[steps == 0]).any():  # −0 would come back as 0
        raise InputError(
            "not-packable", f"{key}: got angles that are not multiples of the angle step."
        )
    return steps


def _whole(key: str, values: Array) -> Ints:
    rounded = np.rint(values)
    if not np.array_equal(rounded, values):
        raise InputError("not-packable", f"{key}: got values that are not multiples of their step.")
    return rounded.astype(np.int64)


def _decoded(planes: NDArray[np.uint8], coding: dict[str, Any]) -> Ints:
    *_, rows, columns = shape = coding["shape"]
    values = whole_numbers(planes).reshape(-1, columns, rows)
    for _ in range(coding["order"]):
        values = values.cumsum(axis=2)
    return (values.swapaxes(1, 2) * coding["scale"]).reshape(shape)


def _unpacked(arrays: Arrays, coded: dict[str, dict[str, Any]]) -> Arrays:
    """Return all arrays by file and name, those that are coded or repeat others as well."""
    rounded = {key: _decoded(arrays[key], values) for key, values in coded.items()}
    decoded = dict(arrays)
    for key, coding in coded.items():
        values = rounded[key] + (rounded[coding["from"]] if "from" in coding else 0)
        array = (values * coding["step"]).astype(coding["dtype"])
        if missing := coding.get("missing", 0):
            array = np.concatenate([np.full((missing, array.shape[1]), np.nan, array.dtype), array])
        decoded[key] = array
    if (record := decoded.get("record.npz/joint_angles_rad")) is not None:
        decoded["record.npz/joint_error_rad"] = np.full_like(record, np.nan)
    played, reference = (
        decoded.get(f"playback.npz/{name}") for name in ("joint_angles_rad", "reference_rad")
    )
    if played is not None and reference is not None:
        decoded["playback.npz/joint_error_rad"] = np.abs(played - reference)
        decoded["plan.npz/joint_angles_rad"] = reference
        for name in ROOT_ARRAYS:
            decoded[f"plan.npz/{name}"] = decoded[f"playback.npz/{name}"]
    return decoded


def _of_file(arrays: Arrays, file: str) -> dict[str, Any]:
    prefix = f"{file}/"
    return {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}


def _frames_of(directory: FilePath, file: str) -> Arrays:
    """Return the arrays that the file of a record or playback leaves out."""
    from foldback.planner.playback.playback import Playback  # loads the physics

    if file == names.RECORD:
        return Record.load(directory / file).frames.columns()
    if file == names.PLAYBACK:
        playback = Playback.load(directory / file)
        return playback.frames.columns() | {"reference_rad": np.asarray(playback.reference_rad)}
    return {}


def _write_timeline(
    directory: FilePath, arrays: Arrays, shown: Sequence[str], timeline_id: str
) -> None:
    """Write the timeline: the explosion, unless the fold is a refold, and the playback."""
    path = directory / names.TIMELINE
    chain = chain_from_attributes(json.loads((directory / names.CHAIN).read_bytes()))
    with TimelineWriter.create(path, chain, timeline_id=timeline_id) as writer:
        for file in shown:
            writer.append(Motion.from_columns(_of_file(arrays, file)))
