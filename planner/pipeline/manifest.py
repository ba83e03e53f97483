"""Manifest: SHA-256 of everything that a fold's directory holds, file by file and field by field.

It is written last. A digest tells damage and slips by name, also in what nobody can work out anew:
seeds, versions, wall times. It does not hold against somebody who writes it anew; what can be
worked out anew ``planner.verification.verify`` works out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.errors import UNREADABLE, DamagedError
from foldback.planner.storage.array_files import HEAD, read_head
from foldback.planner.storage.file_names import ARRAY_FOLDERS, DESCRIBED, LATER_FILES
from foldback.planner.storage.file_names import MANIFEST as FILE
from foldback.planner.storage.files import write_json
from foldback.planner.storage.plain_values import from_plain

MANIFEST_FORMAT: Final = "foldback-manifest/1"
FILE_CONTENT: Final = "content"
"""Key under which a fold's manifest lists the digest of a whole file, where a file (unlike an
archive of arrays) has no parts with digests of their own."""
MISSING: Final = "the file is missing"
"""Difference from the manifest that is reported for a file which the manifest lists, but the folder
lacks."""
Digests = dict[str, dict[str, str]]


@dataclass(frozen=True, slots=True)
class _Manifest:
    """Content of a manifest: its format, and the digests of fields by names of files."""

    format: str
    sha256: Digests


def digests_of(
    directory: FilePath, names: Sequence[str] = DESCRIBED, *, arrays: bool = True
) -> Digests:
    """Return digests of each file's fields; of an unreadable file, the digest of its bytes.

    Fields of JSON files are their keys, of ``.npz`` files their arrays; ``plan.…`` are the keys of
    the text in a plan's ``.npz`` file. Of an array folder they are its files, and as ``head.…`` the
    keys of its head.

    Args:
        directory: Directory of the fold.
        names: Names of the files.
        arrays: False to leave out arrays.
    """

    def digests(name: str) -> dict[str, str]:
        path = directory / name
        try:
            return dict(_fields(path, arrays=arrays))
        except (*UNREADABLE, DamagedError):
            return {FILE_CONTENT: _of_bytes(path)}

    # One after the other: two at once are no sooner done, and hold an array more.
    return {name: digests(name) for name in names if (directory / name).exists()}


def digest_of_value(value: Any) -> str:
    """Return the digest of the value of a key in a JSON file."""
    return _of_text(json.dumps(value, sort_keys=True, separators=(",", ":")))


def write_manifest(directory: FilePath, earlier: Digests | None = None) -> None:
    """Write the manifest of a directory.

    Args:
        directory: Directory of the fold.
        earlier: Digests of files that have not changed since, which need no second look.
    """
    digests = earlier or {}
    missing = digests_of(directory, [name for name in DESCRIBED if name not in digests])
    _write(directory, digests | missing)


def add_to_manifest(directory: FilePath, names: Sequence[str]) -> None:
    """Add the digests of files that were made after the fold; nothing if it has no manifest."""
    if (digests := read_manifest(directory)) is not None:
        _write(directory, digests | digests_of(directory, names))


def read_manifest(directory: FilePath) -> Digests | None:
    """Return the digests that a directory's manifest states; None if it has no manifest.

    Raises:
        DamagedError: The manifest cannot be read.
    """
    path = directory / FILE
    try:
        manifest = from_plain(json.loads(path.read_bytes()), _Manifest)
    except FileNotFoundError:
        return None
    except UNREADABLE as error:
        raise DamagedError(path, f"{FILE} cannot be read") from error
    if manifest.format != MANIFEST_FORMAT:
        raise DamagedError(
            path, f"got the format {manifest.format!r}, expected {MANIFEST_FORMAT!r}"
        )
    return manifest.sha256


def changed_fields(
    directory: FilePath, names: Sequence[str] = DESCRIBED, *, arrays: bool = True
) -> list[str] | None:
    """Return what differs from the manifest, ``file: field``; None when there is no manifest.

    Args:
        directory: Directory of the fold.
        names: Names of the files that are compared.
        arrays: False to leave out arrays, which take time.
    """
    try:
        stated = read_manifest(directory)
    except DamagedError:
        return [f"{FILE}: {FILE_CONTENT}"]
    if stated is None:
        return None
    # Derived files that are missing, or not listed, are computed again before they are used.
    names = [
        name
        for name in names
        if name not in LATER_FILES or (name in stated and (directory / name).exists())
    ]
    current = digests_of(directory, names, arrays=arrays)
    changed: list[str] = []
    for name in dict.fromkeys((*(name for name in stated if name in names), *current)):
        if name not in current:
            changed.append(f"{name}: {MISSING}")
            continue
        current_fields, stated_fields = current[name], stated.get(name, {})
        if not arrays:
            stated_fields = {field: stated_fields.get(field, "") for field in current_fields}
        changed += [
            f"{name}: {field}"
            for field in dict.fromkeys((*stated_fields, *current_fields))
            if current_fields.get(field) != stated_fields.get(field)
        ]
    return changed


def _write(directory: FilePath, digests: Digests) -> None:
    in_order = {name: digests[name] for name in DESCRIBED if name in digests}
    write_json(directory / FILE, {"format": MANIFEST_FORMAT, "sha256": in_order})


def _fields(path: FilePath, *, arrays: bool) -> Iterator[tuple[str, str]]:
    if path.suffix == ".json":
        yield from _of_values(json.loads(path.read_bytes()))
    elif path.suffix == ".npz":
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            for name in file.files:
                if name == "plan":
                    for key, digest in _of_values(json.loads(str(file[name]))):
                        yield f"plan.{key}", digest
                elif arrays:
                    yield name, _of_array(file[name])
    elif path.name in ARRAY_FOLDERS:
        for key, digest in _of_values(read_head(path)):
            yield f"head.{key}", digest
        for file in sorted(path.iterdir()) if arrays else ():
            if file.name != HEAD:
                yield file.name, _of_bytes(file)
    else:
        yield FILE_CONTENT, _of_bytes(path)


def _of_values(values: Any) -> Iterator[tuple[str, str]]:
    if not isinstance(values, dict):
        values = {FILE_CONTENT: values}
    for key, value in cast("dict[str, Any]", values).items():
        yield key, digest_of_value(value)


def _of_text(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def _of_array(array: NDArray[Any]) -> str:
    digest = sha256(f"{array.dtype.str} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).data if array.size else b"")
    return digest.hexdigest()


def _of_bytes(path: FilePath) -> str:
    if path.is_dir():
        return "unreadable"
    return sha256(path.read_bytes()).hexdigest()
