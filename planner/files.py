"""Files that are either whole or not there, and zarr groups."""

from __future__ import annotations

import ctypes
import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    import zarr

_LOADING: Final = Lock()


def write_whole(path: FilePath, data: bytes) -> None:
    """Writes a file that is either whole or not there."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    aside.write_bytes(data)
    aside.replace(path)


def write_json(path: FilePath, values: object) -> None:
    """Writes plain values into a file that is either whole or not there."""
    write_whole(path, json.dumps(values).encode())


def json_of(path: FilePath) -> dict[str, Any]:
    """The JSON object in a file; an empty one when there is none that can be read."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def zarr_group(path: str | FilePath, mode: Literal["r", "r+", "w"] = "r") -> zarr.Group:
    """The zarr group at a path; a new one for ``w``.

    zarr takes a while to load, so that is left to whoever opens a group first. Its modules import
    each other in circles, which two threads that begin at once would break.
    """
    with _LOADING:
        import_module("zarr.codecs")
    import zarr

    return zarr.open_group(str(path), mode=mode, zarr_format=3 if mode == "w" else None)


@contextmanager
def directory_or_aside(directory: str | FilePath | None) -> Generator[FilePath]:
    """A directory, made if it is not there; for None one that goes away afterwards."""
    if directory is None:
        with TemporaryDirectory(prefix="foldback-") as aside:
            yield FilePath(aside)
        return
    folder = FilePath(directory)
    folder.mkdir(parents=True, exist_ok=True)
    yield folder


def settle(directory: FilePath) -> None:
    """Has all that was written lately reach the disk of a directory, to outlast a power cut.

    One call for the whole disk: to ask for each file of a timeline takes twenty times as long.

    Raises:
        OSError: When the disk can't take it.
    """
    syncfs = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
    if syncfs is None:  # elsewhere than on Linux
        os.sync()
        return
    handle = os.open(directory, os.O_RDONLY)
    try:
        if syncfs(handle):
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), str(directory))
    finally:
        os.close(handle)
