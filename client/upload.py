"""Upload: conversion of a source to a file and of options to a form."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import IO, Any, Literal, Protocol, TypedDict

from foldback.client.options import PlanOptions, PreviewOptions


class Array(Protocol):
    """Array such as NumPy's; NumPy itself is optional."""

    @property
    def ndim(self) -> int:
        """Number of dimensions."""
        ...

    def tolist(self) -> Any:
        """Return the elements as nested lists."""
        ...


Source = str | os.PathLike[str] | bytes | IO[bytes] | Sequence[Sequence[int]] | Array
"""Path of a file, its bytes, an open file, (n, 3) cells, or a solid as a 3D array."""


class ShapeOptions(PreviewOptions, total=False):
    """Options that turn a shape into a chain, or the id of a preview or fold with the shape."""

    preview: str
    fold: str


class FoldOptions(ShapeOptions, PlanOptions, total=False):
    """Options of a fold and of its shape, and ids of the folds that it is based on."""

    refold: str
    smooth: str


class MovieOptions(TypedDict, total=False):
    """Options of a movie."""

    format: Literal["mp4", "gif"]
    width: int
    height: int
    fps: int
    seconds: float
    azimuth_deg: float
    elevation_deg: float
    turn_deg: float
    theme: Literal["light", "dark"]
    first_frame: int
    last_frame: int
    tour: bool


def form_of(options: Any, option_types: type[Any], shape: str | None) -> dict[str, str]:
    """Return the form fields of the options.

    Raises:
        TypeError: If an option is unknown; the service would ignore it.
    """
    if unknown := set(options) - set(option_types.__annotations__):
        allowed = sorted(option_types.__annotations__)
        raise TypeError(f"got the unknown options {sorted(unknown)}, expected any of {allowed}.")
    form = {**options, "shape": shape}
    return {name: _text(value) for name, value in form.items() if value is not None}


def file_of(source: Source, filename: str | None) -> tuple[str, bytes]:
    """Return the file name and the bytes of a source.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If an array contains neither cells nor a solid.
    """
    content: Any = source
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        return filename or path.name, path.read_bytes()
    if isinstance(source, bytes):
        return filename or "upload", source
    if hasattr(content, "read"):
        return filename or Path(str(getattr(content, "name", "upload"))).name, content.read()
    dimensions = getattr(content, "ndim", 2)
    if dimensions == 3:
        import numpy as np

        file = BytesIO()
        np.save(file, content, allow_pickle=False)
        return filename or "solid.npy", file.getvalue()
    if dimensions != 2:
        raise ValueError(
            f"got an array with {dimensions} dimensions, expected cells of the shape (n, 3) or a "
            "solid of the shape (x, y, z)."
        )
    cells = content.tolist() if hasattr(content, "tolist") else [list(cell) for cell in content]
    return filename or "cells.json", json.dumps(cells).encode()


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, tuple | list):
        return ",".join(str(int(number)) for number in value)
    return str(value)
