"""NumPy's .npy: (N, 3) whole numbers or a grid of voxels.

Its header is checked before its data is touched.
"""

from __future__ import annotations

import io
import math
import warnings
from typing import Any, Final

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, quote, too_many
from foldback.planner.readers.text import path_or_shape
from foldback.planner.shapes.shape import Shape

NPY_MAGIC: Final = b"\x93NUMPY"
LINE_ENDS: Final = b"\r\n"
"""Bytes that a program for text may have written after the data."""


def is_npy(data: bytes) -> bool:
    """Return True if the bytes begin with the signature of .npy."""
    return data.startswith(NPY_MAGIC)


def read_npy(data: bytes, source: Source) -> Path | Shape:
    """Return a path from an (N, 3) array or a shape from a grid; pickles are refused.

    Raises:
        InputError: The array has another shape or type, or the file is damaged.
    """
    shape, fortran, dtype, start = _header(data)
    if dtype.hasobject:
        raise InputError(
            "wrong-type",
            "got an array of Python objects, expected whole numbers of the shape (N, 3).",
        )
    _refuse_batch_axis(shape)
    is_grid = len(shape) == 3 and dtype.kind in "iubf"
    if not is_grid and (dtype.kind not in "iuf" or dtype.itemsize > 8):
        raise InputError(
            "wrong-type",
            f"got an array of {dtype}, expected whole numbers of the shape (N, 3), or a grid of "
            "voxels of the shape (X, Y, Z) with True in filled cells.",
        )
    if not is_grid and (len(shape) != 2 or shape[1] != 3):
        raise InputError(
            "wrong-shape",
            f"got an array of shape {shape}, expected the shape (N, 3) with one cell per row, or "
            "a grid of voxels of the shape (X, Y, Z) with True in filled cells.",
        )
    if 0 in shape:
        raise InputError("empty", f"got an array of shape {shape}, which has no entries.")
    expected = math.prod(shape) * dtype.itemsize
    if data[start + expected :].strip(LINE_ENDS) == b"":
        data = data[: start + expected]
    data_size = len(data) - start
    if data_size != expected:
        raise InputError(
            "truncated" if data_size < expected else "damaged",
            f"the header declares an array of shape {quote(shape)}, which takes {expected} bytes, "
            f"but the file has {data_size} bytes of data; the header is wrong, or the file is cut "
            "off.",
        )
    if not is_grid and shape[0] > source.max_cells:
        raise too_many(shape[0], source.max_cells)
    flat = np.frombuffer(data, dtype=dtype, offset=start)
    if is_grid:
        return _voxels(flat.reshape(shape, order="F" if fortran else "C"), source)
    with np.errstate(all="ignore"):
        cells = flat.reshape(shape, order="F" if fortran else "C").astype(
            np.float64 if dtype.kind == "f" else dtype.newbyteorder("=")
        )
    return path_or_shape(cells, source)


def _refuse_batch_axis(shape: tuple[int, ...]) -> None:
    """Refuse grids with further axes of length 1, as machine learning has them.

    Raises:
        InputError: ``wrong-shape``; says how to remove the axes.
    """
    inner = tuple(length for length in shape if length != 1)
    if len(shape) > 3 and len(inner) <= 3 and len(shape) <= 6:
        raise InputError(
            "wrong-shape",
            f"got an array of shape {shape}, which has a batch or channel axis of length 1, "
            "expected a grid of voxels of the shape (X, Y, Z); remove the axis, for example with "
            f"{'array[0]' if shape[0] == 1 else 'array[..., 0]'}.",
        )
    if len(shape) > 3:
        raise InputError(
            "wrong-shape",
            f"got an array with {len(shape)} axes, expected a grid of voxels of the shape "
            "(X, Y, Z); save one grid alone.",
        )


def _voxels(grid: NDArray[Any], source: Source) -> Shape:
    stray_values = grid[(grid != 0) & (grid != 1)]
    if len(stray_values):
        raise InputError(
            "not-voxels",
            f"got a grid with the value {stray_values[0]:g}, expected only 0 and 1; compare the "
            "grid with a threshold, for example grid > 0.5.",
        )
    filled = int(np.count_nonzero(grid))
    if filled > source.max_cells:
        raise too_many(filled, source.max_cells)
    return Shape.from_cells(np.argwhere(grid), name=source.name or "shape")


def _header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    stream = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            version = npy_format.read_magic(stream)
            read_header = {
                (1, 0): npy_format.read_array_header_1_0,
                (2, 0): npy_format.read_array_header_2_0,
            }[version]
            # usual headers take 128 bytes
            shape, fortran, dtype = read_header(stream, max_header_size=4096)
    except Exception as error:
        # NumPy evaluates the header as a Python literal, which fails in many ways when damaged.
        raise InputError(
            "damaged",
            "the header of this .npy file cannot be read; save the array again with numpy.save.",
            where="header",
        ) from error
    if any(type(n) is not int or n < 0 for n in shape):
        raise InputError("damaged", f"got the shape {shape}, expected (N, 3).", where="header")
    return shape, bool(fortran), dtype, stream.tell()
