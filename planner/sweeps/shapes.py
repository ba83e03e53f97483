"""Shapes of a sweep: examples, files and bytes in memory."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from glob import glob, has_magic
from pathlib import Path
from typing import Final

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.errors import InputError
from foldback.planner.parameters.option import OPTIONS_KEY_CHARS
from foldback.planner.readers import read
from foldback.planner.readers.gallery import Gallery
from foldback.planner.storage.files import MAX_FILE_BYTES
from foldback.planner.sweeps.spec import Pattern

GALLERY: Final = "gallery:"
"""Prefix of the names of examples in a sweep's list of shapes."""
CHAIN_SUFFIXES: Final = (".json", ".csv", ".txt", ".xyz")
"""Suffixes of the names of files that may hold a path or chain, whose number of modules is known
before it is folded. Others are read by the folds alone, because that takes time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeSource:
    """A shape that is folded.

    Attributes:
        name: Name in the table.
        filename: Name of its file.
        source: Its file, or its bytes.
    """

    name: str
    filename: str
    source: Path | bytes = field(repr=False)

    def data(self) -> bytes:
        """Return the bytes.

        Raises:
            InputError: ``too-large``.
        """
        if isinstance(self.source, bytes):
            return self.source
        if (size := self.source.stat().st_size) > MAX_FILE_BYTES:
            raise InputError(
                "too-large",
                f"got {size} bytes, expected at most {MAX_FILE_BYTES}.",
                where=str(self.source),
            )
        return self.source.read_bytes()

    def digest_and_modules(self) -> tuple[str, int | None]:
        """Return a digest of the bytes, and the number of modules where the file states it."""
        data = self.data()
        modules = None
        if self.filename.lower().endswith(CHAIN_SUFFIXES):
            try:
                shape = read(data, filename=self.filename)
                modules = len(shape) if isinstance(shape, CellPath | Chain) else None
            except InputError:  # the fold is refused, which is its row
                pass
        return hashlib.sha256(data).hexdigest()[:OPTIONS_KEY_CHARS], modules


def find_shapes(patterns: Sequence[Pattern], base: Path) -> tuple[ShapeSource, ...]:
    """Return the shapes that match, each once, in the order of the patterns.

    Args:
        patterns: ``gallery:`` with the name of an example or a glob, names of examples, files or
            globs of files, or names with bytes.
        base: Directory to which files are relative.

    Raises:
        InputError: ``no-shape``, if a pattern matches nothing.
    """
    shapes = dict.fromkeys(shape for pattern in patterns for shape in _matches(pattern, base))
    names = Counter(shape.name for shape in shapes)
    return tuple(
        replace(shape, name=shape.name + Path(shape.filename).suffix)
        if names[shape.name] > 1
        else shape
        for shape in shapes
    )


def _matches(pattern: Pattern, base: Path) -> Iterator[ShapeSource]:
    if not isinstance(pattern, str):
        name, data = pattern
        yield ShapeSource(name=Path(name).stem, filename=Path(name).name, source=data)
        return
    files = [
        file for file in glob(pattern, root_dir=base, recursive=True) if (base / file).is_file()
    ]
    # Links to directories may lead to a file in many ways; the shortest one counts.
    places = {
        (os.path.realpath(base / Path(file).parent), Path(file).name): file
        for file in sorted(files, key=len, reverse=True)
    }
    files = sorted(places.values())
    for file in files:
        name = os.fsencode(os.path.splitext(file)[0]).decode(errors="replace")
        yield ShapeSource(name=name, filename=Path(file).name, source=base / file)
    example = pattern.removeprefix(GALLERY)
    examples = [
        shape
        for shape in Gallery().shapes()
        if not files
        and (pattern.startswith(GALLERY) or not has_magic(pattern))
        and fnmatchcase(shape.name, example)
    ]
    for shape in examples:
        yield ShapeSource(name=shape.name, filename=shape.filename, source=shape.data)
    if not files and not examples:
        raise InputError(
            "no-shape",
            f"got {pattern!r}, which no shape matches, expected files, or examples as in "
            f"'gallery:*', of which there are {Gallery().nearest(example)}; files are relative to "
            f"{base}.",
        )
