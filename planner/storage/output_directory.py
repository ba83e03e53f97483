"""Output directory: the files of a run replace those of an earlier run as a whole, or not at all.

A run writes into a hidden folder of the directory. A complete folder is renamed, and from then on
its files count: if the run is ended before they are all in place, the next command that uses the
directory moves the rest. Files that foldback did not write stay where they are.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.storage.files import json_of, write_json

if sys.platform != "win32":
    from fcntl import LOCK_EX, LOCK_NB, flock

_GROWING: Final = ".foldback-new"
"""Name of the folder in which a run writes its files."""
_COMPLETE: Final = ".foldback-complete"
"""Name of that folder once all files are written, and those of the earlier run are removed."""
_MOVING: Final = ".foldback-moving"
"""Name of that folder once the earlier run's files are removed, and its own are moved out of it."""
_REPLACED: Final = ".replaced.json"
"""Name of the file, in a complete folder, that lists the earlier run's files."""
FILE_LIST: Final = ".foldback-files.json"
"""Name of the file that lists what a command wrote into a directory, so that a later run knows
which files it may replace."""
LIST_FORMAT: Final = "foldback-files/1"


@contextmanager
def replacing(
    directory: FilePath, earlier: Callable[[FilePath], Iterable[str]]
) -> Generator[FilePath]:
    """Yield an empty folder; when the context ends without an error, its files are the directory's.

    After an error, the directory is as it was before.

    Args:
        directory: Directory for the files; it is created if it is missing.
        earlier: Returns the relative paths of an earlier run's files in the directory, which are
            removed. It is called before and after the context, and raises InputError if the
            directory cannot be used.

    Raises:
        InputError: ``no-directory`` if the directory cannot be created or written, ``in-use`` if
            another run writes into it, ``foreign-file`` if it has a file of the same name that is
            not an earlier run's.
    """
    is_new = not directory.exists()
    growing = directory / _GROWING
    _create(directory)
    with _locked(directory, wait=False):
        finish_replacement(directory, locked=True)
        try:
            earlier(directory)
            rmtree(growing, ignore_errors=True)  # of a run that was killed
            _create(growing)
            yield growing
            replaced = [*earlier(directory)]
            _check_names(growing, directory, set(replaced))
            write_json(growing / _REPLACED, replaced)
            growing.rename(directory / _COMPLETE)
            finish_replacement(directory, locked=True)
        finally:
            rmtree(growing, ignore_errors=True)
            if is_new:
                with suppress(OSError):  # it is not empty
                    directory.rmdir()


@contextmanager
def replacing_listed(directory: FilePath, source: str | None) -> Generator[FilePath]:
    """Yield a folder as ``replacing`` does, for files whose names are known only at the end.

    Args:
        directory: Directory for the files.
        source: Digest of what the files are made of. Files of the same source that are in the
            directory already stay there; None if no earlier files stay.

    Raises:
        InputError: Same as ``replacing``.
    """
    before = listed_files(directory)
    has_same_source = source is not None and json_of(directory / FILE_LIST).get("source") == source
    names: set[str] = set()

    def earlier(_: FilePath) -> list[str]:
        return [
            name for name in before if not has_same_source or name in names or name == FILE_LIST
        ]

    with replacing(directory, earlier) as growing:
        yield growing
        names.update(path.relative_to(growing).as_posix() for path in _files_in(growing))
        retained = {*before} - {FILE_LIST} if has_same_source else set[str]()
        values = {"format": LIST_FORMAT, "source": source, "files": sorted(names | retained)}
        write_json(growing / FILE_LIST, values)


def listed_files(directory: FilePath) -> list[str]:
    """Return the files that ``replacing_listed`` wrote into a directory, with the list itself."""
    values = json_of(directory / FILE_LIST)
    if values.get("format") != LIST_FORMAT or not isinstance(values.get("files"), list):
        return []
    return [FILE_LIST, *(name for name in values["files"] if isinstance(name, str))]


def finish_replacement(directory: FilePath, *, locked: bool = False) -> None:
    """Move the files of a complete run into place, if the run was ended before it had done so.

    Args:
        directory: Directory of results.
        locked: True if this process holds the directory's lock.

    Raises:
        InputError: ``unfinished`` if they cannot be moved.
    """
    complete, moving = directory / _COMPLETE, directory / _MOVING
    if not (complete.is_dir() or moving.is_dir()):
        return
    if not locked:
        with _locked(directory, wait=True):
            finish_replacement(directory, locked=True)
        return
    try:
        if complete.is_dir():
            for name in json.loads((complete / _REPLACED).read_bytes()):
                _remove(_inside(directory, name), directory)
            complete.rename(moving)
        if moving.is_dir():
            _move(moving, directory)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            "unfinished",
            f"new results replace older ones here, and the rest cannot be moved ({error}). Make "
            "the folder writable, or write the results into another folder.",
            where=str(directory),
        ) from error


def _create(directory: FilePath) -> None:
    """Create a directory if it is missing.

    Raises:
        InputError: ``no-directory``.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            "no-directory",
            f"the directory cannot be created ({error.strerror}).",
            where=str(directory),
        ) from error


@contextmanager
def _locked(directory: FilePath, *, wait: bool) -> Generator[None]:
    """Hold the lock of a directory; where there are no such locks, do nothing."""
    if sys.platform == "win32":
        yield
        return
    handle = os.open(directory, os.O_RDONLY)
    try:
        try:
            flock(handle, LOCK_EX if wait else LOCK_EX | LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                "in-use",
                "another program writes results into this folder. Wait until it has ended, or "
                "choose another folder.",
                where=str(directory),
            ) from error
        except OSError:  # a disk without locks
            pass
        yield
    finally:
        os.close(handle)


def _check_names(growing: FilePath, directory: FilePath, replaced: set[str]) -> None:
    """Refuse to replace files that are not an earlier run's.

    Raises:
        InputError: ``foreign-file``.
    """
    for path in sorted(growing.iterdir()):
        _check_name(path, directory / path.name, path.name, replaced)


def _check_name(path: FilePath, target: FilePath, name: str, replaced: set[str]) -> None:
    if name in replaced or not os.path.lexists(target):
        return
    if path.is_dir() and target.is_dir() and not target.is_symlink():
        for entry in sorted(path.iterdir()):
            _check_name(entry, target / entry.name, f"{name}/{entry.name}", replaced)
        return
    raise foreign_file(target)


def foreign_file(path: FilePath) -> InputError:
    """Return the error for a file that a run would replace, although foldback did not write it."""
    return InputError(
        "foreign-file",
        f"got a folder with the file {path.name!r}, which no earlier run of this command wrote. "
        "Choose another folder, or move the file away.",
        where=str(path.parent),
    )


def _inside(directory: FilePath, name: str) -> FilePath:
    """Return the path of an entry in a directory, which links do not lead out of.

    Raises:
        ValueError: It is not in the directory.
    """
    path = directory / name
    if path.name in ("", "..") or not path.parent.resolve().is_relative_to(directory.resolve()):
        raise ValueError(f"{name!r} is not in the folder")
    return path


def _remove(path: FilePath, directory: FilePath) -> None:
    """Remove a file or folder within a directory, and the folders that are empty then."""
    if path.is_dir() and not path.is_symlink():
        rmtree(path)
    else:
        path.unlink(missing_ok=True)
    with suppress(OSError):  # a folder that is not empty
        for folder in path.parents:
            if folder == directory:
                break
            folder.rmdir()


def _move(source: FilePath, target: FilePath) -> None:
    """Move what is in a directory into another one, and remove it."""
    for path in sorted(source.iterdir()):
        place = target / path.name
        if path.name == _REPLACED:
            path.unlink()
        elif path.is_dir() and place.is_dir() and not place.is_symlink():
            _move(path, place)
        else:
            path.replace(place)
    source.rmdir()


def _files_in(directory: FilePath) -> Iterator[FilePath]:
    """Yield all files in a directory and its folders."""
    return (path for path in directory.rglob("*") if path.is_file())
