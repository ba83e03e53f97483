"""Array files: named NumPy arrays in ``.npz`` files that are whole, and checked when they are read.

A ``.npz`` file is a zip archive: it holds the CRC-32 of each array. Its *checksum* covers these, so
that one array can be read and checked without the others. Whoever knows the checksum notices a
change as well as a file in the wrong place.

An *array folder* holds a head, and files whose checksums the head states in ``files``. The head is
written after them. It carries a digest of its own.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Collection, Mapping
from math import prod
from pathlib import Path as FilePath
from typing import Any, Final
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from foldback.planner.errors import UNREADABLE, DamagedError
from foldback.planner.storage.files import unsealed_json, write_sealed_json, written_aside
from foldback.planner.storage.plain_values import from_plain

Arrays = dict[str, NDArray[Any]]
HEAD: Final = "head.json"
"""Name of the file in an array folder that states the checksums of the other files."""
PROBE_HALF_WIDTH_BYTES: Final = 8192
"""Number of bytes on either side of an array's middle that are compressed as a test of whether the
whole array is worth compressing. For the files of a wrench of 160, eight times as many decide the
same."""
MAX_ARRAY_BYTES: Final = 2**28
"""Maximum size, in bytes, of an array that ``read_arrays`` unpacks: 256 MiB."""


def save_npz(
    path: FilePath, arrays: Mapping[str, Any], *, level: int = 1, durable: bool = False
) -> int:
    """Write arrays to a temporary file and rename it: the file is either complete or absent.

    Args:
        path: Path of the file.
        arrays: Arrays by name.
        level: Level of zlib, 1 to 9, for arrays that compression makes smaller.
        durable: Flush the file to the disk, so that it survives a power cut.

    Returns:
        The file's checksum.
    """
    with (
        written_aside(path, durable=durable) as temporary_path,
        ZipFile(temporary_path, "w", compresslevel=level) as file,
    ):
        for name, value in arrays.items():
            array = np.asanyarray(value)
            file.compression = ZIP_DEFLATED if _shrinks(array) else ZIP_STORED
            with file.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, array, allow_pickle=False)
    return _checksum(file)


def read_arrays(path: FilePath, checksum: int, names: Collection[str] | None = None) -> Arrays:
    """Read arrays of a file, those in ``names`` only, all if None; they are read-only.

    The file cannot make its reader allocate more memory than the arrays in it take, nor more than
    ``MAX_ARRAY_BYTES`` for one of them.

    Raises:
        DamagedError: The file is missing, or is not the one with this checksum.
    """
    try:
        with ZipFile(path) as file:
            if _checksum(file) != checksum:
                raise DamagedError(path, "the file's contents do not match their checksum")
            return {
                name: _array(file, member)
                for member in file.infolist()
                if (name := member.filename.removesuffix(".npy")) in (names or (name,))
            }
    except FileNotFoundError as error:
        raise DamagedError(path, "the file is missing") from error
    except UNREADABLE as error:
        raise DamagedError(path, f"{type(error).__name__}: {error}") from error


def write_head(folder: FilePath, values: Mapping[str, Any]) -> None:
    """Write the head of an array folder, after the files that it lists."""
    write_sealed_json(folder / HEAD, values)


def read_head(folder: FilePath) -> dict[str, Any]:
    """Read the head of an array folder.

    Raises:
        FileNotFoundError: There is none.
        DamagedError: It is not what was written.
    """
    path = folder / HEAD
    try:
        return unsealed_json(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FileNotFoundError(f"no {HEAD} in {folder}") from error
    except UNREADABLE as error:
        raise DamagedError(path, str(error)) from error


def check_folder(folder: FilePath) -> dict[str, Any]:
    """Read all files of an array folder; return its head.

    Raises:
        FileNotFoundError: There is none.
        DamagedError: A file is missing, or is not what was written.
    """
    head = read_head(folder)
    for name, checksum in from_plain(head.get("files"), dict[str, int]).items():
        read_arrays(folder / name, checksum)
    return head


def _checksum(file: ZipFile) -> int:
    members = [(member.filename, member.CRC, member.file_size) for member in file.infolist()]
    return zlib.crc32(json.dumps(members).encode())


def _array(file: ZipFile, member: ZipInfo) -> NDArray[Any]:
    """Read an array without believing the size that its header states.

    Raises:
        ValueError: It is too large, or its header is not one of an array of numbers.
    """
    if member.file_size > MAX_ARRAY_BYTES:
        raise ValueError(
            f"{member.filename} has {member.file_size} bytes, expected at most {MAX_ARRAY_BYTES}"
        )
    data = file.read(member)
    stream = io.BytesIO(data)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{member.filename} is not in version 1.0 of NumPy's format")
    shape, column_major, dtype = np.lib.format.read_array_header_1_0(stream)
    size = dtype.itemsize * prod(shape)
    if dtype.hasobject or size != len(data) - stream.tell():
        raise ValueError(f"{member.filename} does not hold the values that its header describes")
    order = "F" if column_major else "C"
    return np.ndarray(shape, dtype, data, stream.tell(), order=order)


def _shrinks(array: NDArray[Any]) -> bool:
    """Return True if zlib makes an array much smaller, tested on values from its middle."""
    flat = array.reshape(-1)
    middle, half = len(flat) // 2, max(1, PROBE_HALF_WIDTH_BYTES // max(1, array.itemsize))
    sample = flat[max(0, middle - half) : middle + half].tobytes()
    # angles of an unfolding do not get below 0.9
    return len(zlib.compress(sample, 1)) < 0.7 * len(sample)
