"""Kernel cache: where machine code is stored, and its use only while all sources are the same.

numba compares the source of the file that a kernel stands in. Machine code of a kernel holds that
of the kernels it calls, too, most of which stand in other files: after a change there, the old code
would still be run.

numba refuses to define a cached kernel if it can write neither beside the source, nor below the
user's home, nor into ``NUMBA_CACHE_DIR``: a program of root, run by a user without a home. Then
machine code is stored in a private temporary directory, or not at all.
"""
# numba has no types; what is changed here is private to it.
# pyright: reportUnknownMemberType=false, reportPrivateUsage=false

from __future__ import annotations

import hashlib
import os
import re
import stat
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from numba import config
from numba.core.caching import CacheImpl, IndexDataCacheFile, _SourceFileBackedLocatorMixin

KERNELS: Final = Path(__file__).parents[1] / "kernels"
KERNEL_IMPORT: Final = re.compile(rb"(?m)^from foldback\.planner\.kernels\.(\w+) import ")
"""Matches the line by which a file of kernels imports another one, so that a change of the imported
file invalidates the importing file's cached machine code."""


def compare_all_sources() -> None:
    """Have numba compare all sources of a kernel with those that its machine code was made of."""
    locator: Any = _SourceFileBackedLocatorMixin
    index: Any = IndexDataCacheFile
    own_stamp, initialise = locator.get_source_stamp, index.__init__
    if own_stamp.__module__ == __name__:
        return

    def get_source_stamp(self: Any) -> object:
        path = Path(self._py_file)
        return sources_digest(path) if path.parent == KERNELS else own_stamp(self)

    def __init__(self: Any, cache_path: str, filename_base: str, source_stamp: object) -> None:
        initialise(self, cache_path, filename_base, source_stamp)
        # An index of other sources may name types that are gone; an index of another version is
        # not read.
        self._version = f"{self._version} {source_stamp!r}"

    locator.get_source_stamp = get_source_stamp
    index.__init__ = __init__


@cache
def find_cache() -> bool:
    """Return True if compiled kernels can be stored; choose a temporary directory if need be."""
    if _has_directory():
        return True
    with suppress(OSError):
        # Also read by the processes that this one starts, and by the sandbox that confines them.
        os.environ["NUMBA_CACHE_DIR"] = str(_private_temporary_directory())
        config.reload_config()
    return _has_directory()


def _has_directory() -> bool:
    locators: Any = CacheImpl._locator_classes
    file = str(KERNELS / "__init__.py")
    return any(locator.from_function(_has_directory, file) is not None for locator in locators)


def _private_temporary_directory() -> Path:
    """Return this user's directory for kernels among the temporary files.

    Machine code is run, so a directory that others made or can write is refused.

    Raises:
        OSError: If it cannot be created, or is not this user's alone.
    """
    path = Path(tempfile.gettempdir()) / f"foldback-kernels-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    status = path.lstat()
    mode = stat.S_IMODE(status.st_mode)
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or mode & 0o077:
        raise PermissionError(f"{path} is not a private directory of this user.")
    return path


def sources(path: Path) -> tuple[Path, ...]:
    """Return a file of kernels and all files of kernels that it imports, directly or not."""
    files: dict[Path, None] = {}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        if file not in files:
            files[file] = None
            names = KERNEL_IMPORT.findall(file.read_bytes())
            waiting += [path.parent / f"{name.decode()}.py" for name in names]
    return tuple(sorted(files))


@cache
def sources_digest(path: Path) -> str:
    """Return the SHA-256 digest of all ``sources`` of a file, as they are at its first call."""
    digest = hashlib.sha256()
    for source in sources(path):
        digest.update(source.read_bytes())
    return digest.hexdigest()
