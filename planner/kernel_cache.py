"""Kernel cache: the use of machine code on disk only while all of its sources are the same.

numba compares the source of the file that a kernel stands in. Machine code of a kernel holds that
of the kernels it calls, too, most of which stand in other files: after a change there, the old code
would still be run.
"""
# numba has no types; what is changed here is private to it.
# pyright: reportUnknownMemberType=false, reportPrivateUsage=false

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any, Final

from numba.core.caching import IndexDataCacheFile, _SourceFileBackedLocatorMixin

KERNELS: Final = Path(__file__).parent / "kernels"
KERNEL_IMPORT: Final = re.compile(rb"(?m)^from planner\.kernels\.(\w+) import ")
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


def sources(path: Path) -> tuple[Path, ...]:
    """Return a file of kernels and all files of kernels that it imports, directly or not."""
    found: dict[Path, None] = {}
    waiting = [path]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found[one] = None
            names = KERNEL_IMPORT.findall(one.read_bytes())
            waiting += [path.parent / f"{name.decode()}.py" for name in names]
    return tuple(sorted(found))


@cache
def sources_digest(path: Path) -> str:
    """Return the SHA-256 digest of all ``sources`` of a file, as they are at its first call."""
    digest = hashlib.sha256()
    for source in sources(path):
        digest.update(source.read_bytes())
    return digest.hexdigest()
