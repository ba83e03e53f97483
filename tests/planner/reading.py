"""Helpers that read a file as a kind of shape, or expect its refusal."""

from typing import Any

import pytest

from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid


def refusal_of(data: bytes, **options: Any) -> InputError:
    """Return the error of a file that is refused, in words that can be printed."""
    with pytest.raises(InputError) as refusal:
        read(data, **options)
    assert str(refusal.value).isprintable()
    assert refusal.value.detail.endswith(".")
    return refusal.value


def solid_in(data: bytes, filename: str | None = None) -> Solid:
    """Return the solid in a file."""
    read_shape = read(data, filename=filename)
    assert isinstance(read_shape, Solid)
    return read_shape


def shape_in(data: bytes, **options: Any) -> Shape:
    """Return the voxels in a file."""
    read_shape = read(data, **options)
    assert isinstance(read_shape, Shape)
    return read_shape


def cells_of(data: bytes, filename: str | None = None) -> list[list[int]]:
    """Return the cells of the path in a file, in its order."""
    read_shape = read(data, filename=filename)
    assert isinstance(read_shape, Path)
    return read_shape.cells.tolist()
