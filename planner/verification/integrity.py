"""Integrity: comparison of a finished fold's files with the files as they were written.

Each file is compared when it is first used, and again when it has changed on disk. Timelines and
figures carry checksums of their own (``planner.storage.array_files``); all other files are compared
with the manifest.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path as FilePath
from typing import Final
from zipfile import ZipFile

from foldback.planner.errors import UNREADABLE, DamagedError
from foldback.planner.pipeline.manifest import (
    FILE,
    Digests,
    digest_of_value,
    digests_of,
    read_manifest,
)
from foldback.planner.storage.array_files import check_folder
from foldback.planner.storage.file_names import ARRAY_FOLDERS, LATER_FILES

_RESULTS: Final[dict[FilePath, tuple[object, str | None]]] = {}
_LOCK: Final = threading.Lock()


def check(directory: FilePath, *names: str) -> None:
    """Compare files of a finished fold with the files as they were written.

    Args:
        directory: Directory of the fold.
        names: Names of the files; one that the fold never had, or that can be derived again, is
            not missed.

    Raises:
        DamagedError: A file is missing, or was changed.
    """
    for name in names:
        path = directory / name
        stamp = (_stamp(path), _stamp(directory / FILE))
        with _LOCK:
            cached = _RESULTS.get(path)
        if cached is None or cached[0] != stamp:
            cached = (stamp, _reason(directory, name))
            with _LOCK:
                if len(_RESULTS) >= 4096:
                    _RESULTS.clear()
                _RESULTS[path] = cached
        if cached[1] is not None:
            raise DamagedError(path, cached[1])


def damaged_among(directory: FilePath, names: Iterable[str]) -> list[str]:
    """Return the names of damaged files."""
    damaged: list[str] = []
    for name in names:
        try:
            check(directory, name)
        except DamagedError:
            damaged.append(name)
    return damaged


def _reason(directory: FilePath, name: str) -> str | None:
    """Return why a file is damaged, or None."""
    path = directory / name
    try:
        digests = read_manifest(directory)
        if digests is not None and name not in digests:
            return None
        if not path.exists():
            may_be_missing = digests is None or name in LATER_FILES
            return None if may_be_missing else "the file is missing"
        if name in ARRAY_FOLDERS:
            return _reason_of_folder(path, digests)
        if digests is not None:
            return _reason_by_digest(directory, name, digests[name])
        return _reason_by_itself(path)
    except DamagedError as error:
        return f"{FilePath(error.path).relative_to(directory)}: {error.reason}"
    except UNREADABLE as error:
        return f"{type(error).__name__}: {error}"


def _reason_of_folder(path: FilePath, digests: Digests | None) -> str | None:
    own_identity = digest_of_value(check_folder(path).get("id"))
    identity = None if digests is None else digests[path.name].get("head.id")
    if identity in (None, own_identity):
        return None
    return "the file belongs to another fold"


def _reason_by_digest(directory: FilePath, name: str, stated: dict[str, str]) -> str | None:
    digests = digests_of(directory, [name])[name]
    changed = [field for field in {**stated, **digests} if stated.get(field) != digests.get(field)]
    return f"these fields were changed: {', '.join(changed[:3])}" if changed else None


def _reason_by_itself(path: FilePath) -> str | None:
    """Return what can be seen of a file without a manifest."""
    if path.suffix == ".json":
        values = json.loads(path.read_bytes())
        return (
            None
            if isinstance(values, dict | list)
            else f"got {type(values).__name__}, expected an object or a list"
        )
    if path.suffix == ".npz":
        with ZipFile(path) as file:
            broken = file.testzip()
        return None if broken is None else f"the field {broken} was changed"
    return None


def _stamps_below(directory: str) -> Iterator[tuple[str, int, int, int]]:
    """Yield what changes whenever a file below a directory is written, without building paths."""
    with os.scandir(directory) as entries:
        for entry in sorted(entries, key=lambda item: item.name):
            if entry.is_dir():
                yield from _stamps_below(entry.path)
            else:
                stat = entry.stat()
                yield entry.path, stat.st_ino, stat.st_mtime_ns, stat.st_size


def _stamp(path: FilePath) -> object:
    """Return what changes whenever a file, or a file in a directory, is written."""
    try:
        stat = path.stat()
        if path.name not in ARRAY_FOLDERS:
            return (stat.st_ino, stat.st_mtime_ns, stat.st_size)
        return hash(tuple(_stamps_below(str(path))))
    except OSError:
        return None
