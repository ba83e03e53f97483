"""Files that are either whole or not there."""

from __future__ import annotations

import ctypes
import errno
import hashlib
import json
import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath
from shutil import rmtree
from tempfile import TemporaryFile
from typing import Any, Final

READ_ONLY_ERRORS: Final = frozenset({errno.EROFS, errno.EACCES, errno.EPERM})
"""Error numbers (errno) that mean, when a file is written, that the disk is read-only or permission
is missing."""
SEAL_BYTES: Final = 72
"""Size of the line before sealed JSON, in bytes: the name of the digest, its 64 digits, and the
separators."""
MAX_FILE_BYTES: Final = 64 << 20
"""Maximum size of an input file, in bytes."""
TEMPORARY_SUFFIX: Final = ".partial"
"""Suffix of the name of a file or directory while it is written; it is renamed when complete."""


def temporary_path(path: FilePath) -> FilePath:
    """Return the path of a new temporary file beside a path."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}{TEMPORARY_SUFFIX}")


def remove_temporary(directory: FilePath, *, before: float) -> None:
    """Remove temporary files of killed processes from a directory and its folders.

    Args:
        directory: Directory that is searched, with its folders, but not deeper.
        before: Seconds since 1970; what was written later may still be in the making.
    """
    for pattern in (f".*{TEMPORARY_SUFFIX}", f"*/.*{TEMPORARY_SUFFIX}"):
        for path in directory.glob(pattern):
            with suppress(OSError):  # another process removes it
                if path.lstat().st_mtime >= before:
                    continue
                if path.is_dir() and not path.is_symlink():
                    rmtree(path)
                else:
                    path.unlink()


def refuses_writing(place: FilePath) -> bool:
    """Return True if a file, or a directory, is there and cannot be written."""
    try:
        if place.is_dir():
            TemporaryFile(dir=place).close()
        else:
            place.open("r+b").close()
    except FileNotFoundError:
        return False
    except OSError as error:
        return error.errno in READ_ONLY_ERRORS
    return False


@contextmanager
def written_aside(path: FilePath, *, durable: bool = False) -> Generator[FilePath]:
    """Yield the path of a temporary file, which replaces a file if the context ends without error.

    The file is thus either whole or not there.

    Args:
        path: Path of the file.
        durable: Flush the file and its new name to the disk. Without it, a power cut can leave an
            empty file.
    """
    temporary = temporary_path(path)
    try:
        yield temporary
        if durable:
            sync(temporary)
        temporary.replace(path)
        if durable:
            sync(path.parent)
    finally:
        with suppress(OSError):  # an error of the write itself must not be replaced
            temporary.unlink(missing_ok=True)


def write_whole(path: FilePath, data: bytes) -> None:
    """Write a file that is either whole or not there."""
    with written_aside(path) as temporary:
        temporary.write_bytes(data)


def write_json(path: FilePath, values: object) -> None:
    """Write plain values into a JSON file that is either whole or not there."""
    write_whole(path, json.dumps(values).encode())


def json_of(path: FilePath) -> dict[str, Any]:
    """Return the JSON object in a file; an empty one if it is missing or unreadable."""
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def write_sealed_json(path: FilePath, values: object) -> None:
    """Write plain values with a digest by which ``sealed_json_of`` recognises damage."""
    text = json.dumps(values).encode()
    write_whole(path, _seal_of(text) + text)


def unsealed_json(data: bytes) -> dict[str, Any]:
    """Return the object in a file from ``write_sealed_json``.

    Raises:
        ValueError, RecursionError: It is damaged.
    """
    seal, text = data[:SEAL_BYTES], data[SEAL_BYTES:]
    if seal != _seal_of(text):
        raise ValueError("the file's contents do not match their digest")
    return dict(json.loads(text))


def sealed_json_of(path: FilePath) -> dict[str, Any]:
    """Return an object from ``write_sealed_json``; an empty one if it is missing or damaged."""
    try:
        return unsealed_json(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}


def _seal_of(text: bytes) -> bytes:
    """Return the line before sealed JSON."""
    return f"sha256 {hashlib.sha256(text).hexdigest()}\n".encode()


def sync(path: FilePath) -> None:
    """Flush a directory, or a file, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def settle(directory: FilePath) -> None:
    """Write the caches of a directory's disk, so that recent files survive a power cut.

    One call writes the whole disk; one call for each file of a timeline takes twenty times as long.

    Raises:
        OSError: If the disk cannot be written.
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
