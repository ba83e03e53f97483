import json
import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.path import Path
from foldback.planner.plan.shape_writers import write_shape
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from tests.case import case
from tests.planner.lattice import Ints
from tests.planner.reading import refusal_of, shape_in
from tests.planner.solids_made import (
    VOXEL_WRITERS,
    as_binvox,
    as_vox,
    chunk,
    npy,
    vox_file,
    vox_model,
    vox_shape,
    vox_transform,
)
from tests.planner.solids_made import words as pairs

L_SHAPE = np.array([[0, 0, 0], [0, 1, 0], [0, 2, 0], [1, 0, 0], [1, 0, 1]])


def sets(maximum: int) -> st.SearchStrategy[Ints]:
    """Return a strategy for sets of cells whose smallest coordinates are zero."""
    number = st.integers(0, maximum)
    cells = st.lists(st.tuples(number, number, number), min_size=1, max_size=30)
    return cells.map(lambda c: np.unique(np.array(c) - np.min(c, axis=0), axis=0))


@pytest.mark.parametrize("writer", VOXEL_WRITERS)
@given(cells=sets(20))
def test_written_voxels_are_read_back(writer: Callable[[Ints], bytes], cells: Ints) -> None:
    np.testing.assert_array_equal(shape_in(writer(cells)).cells, cells)


@given(sets(900), st.floats(1e-6, 1e3))
def test_written_shape_is_read_back(cells: Ints, pitch_m: float) -> None:
    shape = Shape.from_cells(cells - 400, name="some shape", pitch_m=pitch_m)
    restored_shape = shape_in(write_shape(shape))
    np.testing.assert_array_equal(restored_shape.cells, shape.cells)
    assert (restored_shape.name, restored_shape.pitch_m) == ("some shape", pitch_m)


def test_lists_of_cells_are_read_as_voxels_on_request() -> None:
    for data in (
        json.dumps(L_SHAPE.tolist()[::-1]).encode(),
        b"x,y,z\n" + b"".join(b"%d,%d,%d\n" % tuple(c) for c in L_SHAPE[::-1]),
        b"".join(b"%d %d %d\n" % tuple(c) for c in L_SHAPE[::-1]),
    ):
        with case(data):
            np.testing.assert_array_equal(shape_in(data, as_voxels=True).cells, L_SHAPE)
            refusal = refusal_of(data)
            assert refusal.code == "not-adjacent"
            assert "read the cells as a shape" in refusal.detail


def test_paths_grids_and_axes_of_voxels() -> None:
    data = b"0 0 0\n1 0 0\n1 1 0\n"
    assert isinstance(read(data), Path)
    assert len(shape_in(data, as_voxels=True)) == 3
    assert len(shape_in(b"0 0 0\n0 0 0\n", as_voxels=True)) == 1
    grid = np.minimum(np.arange(8, dtype=np.uint8), 1).reshape(2, 2, 2)
    assert len(shape_in(npy(np.asfortranarray(grid)))) == 7
    # The fastest axis of binvox is y.
    data = b"#binvox 1\ndim 1 2 3\ndata\n\x00\x01\x01\x01\x00\x04"
    assert shape_in(data).cells.tolist() == [[0, 1, 0]]
    cells = [[0, 0, 0], [0, 1, 0]]
    assert shape_in(as_binvox(np.array(cells))).cells.tolist() == cells


def test_models_of_a_vox_scene_are_placed_by_its_nodes() -> None:
    bar = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
    # Node 0 moves a group of two moved shapes; the second is rotated by a quarter turn about z.
    turned = str(1 | (0 << 2) | (1 << 4))

    group = chunk(b"nGRP", struct.pack("<I", 1) + pairs() + struct.pack("<III", 2, 2, 4))
    data = vox_file(
        vox_model(bar),
        vox_model(bar[:1]),
        vox_transform(0, 1),
        group,
        vox_transform(2, 3, _t="10 0 0", _r=turned),
        vox_shape(3, 0),
        vox_transform(4, 5, _t="10 0 2"),
        vox_shape(5, 1),
    )
    # The bar rotates about a corner of its middle cell, as in MagicaVoxel.
    assert shape_in(data).cells.tolist() == [[0, 0, 0], [0, 1, 0], [0, 2, 0], [1, 1, 2]]


def test_more_cells_than_the_limit_are_refused() -> None:
    cells = np.argwhere(np.ones((5, 5, 5)))
    for writer in (*VOXEL_WRITERS, lambda c: write_shape(Shape.from_cells(c))):
        assert len(shape_in(writer(cells), max_cells=125)) == 125
        assert refusal_of(writer(cells), max_cells=124).code == "too-many-cells"


def test_binvox_of_too_many_cells_is_refused_before_it_is_unpacked() -> None:
    head = b"#binvox 1\ndim 4096 4096 4096\ndata\n"
    assert refusal_of(head + b"\x01\xff" * 20_000).code == "truncated"
    head = b"#binvox 1\ndim 100 300 170\ndata\n"
    assert refusal_of(head + b"\x01\xff" * 20_000).code == "too-many-cells"
    assert len(shape_in(head + b"\x00\xff" * 19_999 + b"\x01\xff")) == 255


def test_invalid_voxel_files_are_refused() -> None:
    vox = as_vox(L_SHAPE)
    for data, code in (
        (b"#binvox 1\ndata\n", "damaged"),
        (b"#binvox 1\ndim 99999999999999 1 1\ndata\n\x01\x08", "damaged"),
        (b"#binvox 1\ndim 2 2 2\ndata\n\x01\x07\x01", "truncated"),
        (b"#binvox 1\ndim 2 2 2\ndata\n\x01\x08\x01", "damaged"),
        (b"#binvox 1\ndim 2 2 2\ndata\n\x01\x09", "damaged"),
        (b"#binvox 1\ndim 2 2 2\ndata\n\x07\x08", "damaged"),
        (vox[:-9], "truncated"),
        (vox[:14], "damaged"),
        (vox_file(), "empty"),
        (vox_file(chunk(b"XYZI", struct.pack("<I", 0))), "damaged"),
        (vox_file(chunk(b"SIZE", struct.pack("<3I", 1, 1, 1))), "damaged"),
        (vox.replace(b"\x05\0\0\0\0\0\0\x01", b"\xff\xff\xff\x7f\0\0\0\x01"), "damaged"),
        (vox.replace(b"SIZE\x0c\0\0\0", b"SIZE\xff\xff\xff\xff"), "truncated"),
        (vox.replace(struct.pack("<3I", 2, 3, 2), struct.pack("<3I", 1, 3, 2)), "damaged"),
        (b'{"format": "foldback-voxels/1", "cells": []}', "empty"),
        (b'{"format": "foldback-voxels/1"}', "wrong-type"),
        (b'{"format": "foldback-voxels/1", "cells": [[0, 0, 0.5]]}', "not-whole"),
    ):
        with case((data, code)):
            assert refusal_of(data).code == code
