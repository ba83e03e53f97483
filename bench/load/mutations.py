"""Mutations: valid files of every format, and random changes of them."""

from __future__ import annotations

import io
import json
import random
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.readers.formats import READABLE_SUFFIXES
from tests.planner.readers.test_fuzz import FILES, SPICE, WALK, mutate
from tests.planner.solids_made import zipped

NAMES: Final = (
    *(f"a{suffix}" for suffix in ("", *READABLE_SUFFIXES)),
    "",
    *("../../etc/passwd", "a\x00.stl", "a.stl\r\nX: y", "é" * 300, "CON", ".", "a.png", "a.zip"),
)
"""File names that an upload may have instead of its own."""
TYPES: Final = (
    *("application/json", "text/html", "image/svg+xml", "model/stl", "application/zip"),
    *("multipart/form-data", "x" * 300, "text/plain; charset=utf-16", ""),
)
"""Media types that an upload may have instead of the plain one."""
NUMBERS: Final = (b"1e308", b"-1e308", b"9" * 400, b"1e-320", b"0x10", b"NaN", b"-0", b"2147483648")
"""Numbers at the limits of parsers, put in place of a digit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Upload:
    """One file with the name and media type that are sent."""

    data: bytes
    filename: str
    media_type: str


def valid() -> dict[str, bytes]:
    """Return one small valid file of every format, by name."""
    return {
        **FILES,
        "cells.npy": _saved(np.array(WALK)),
        "cells.json": json.dumps(WALK).encode(),
    }


def _saved(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def made(seed: int, files: dict[str, bytes]) -> Upload:
    """Return the upload of a seed, the same in each run."""
    rng = random.Random(seed)
    name = rng.choice(list(files))
    data = rng.choices(CHANGES, CHANGE_WEIGHTS)[0](files[name], rng)
    return Upload(
        data=data,
        filename=rng.choice(NAMES) if rng.random() < 0.2 else name,
        media_type=rng.choice(TYPES) if rng.random() < 0.2 else "application/octet-stream",
    )


def _bits(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 12)):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data))]


def _doubled(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data))
    part = data[start : start + rng.randint(1, len(data))]
    return data[:start] + part * rng.choice([2, 3, 50, 1000 if len(data) < 2000 else 2]) + data


def _swapped(data: bytes, rng: random.Random) -> bytes:
    a, b, c = sorted(rng.randrange(len(data) + 1) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def _huge(data: bytes, rng: random.Random) -> bytes:
    """Replace a digit by an extreme number or by special text."""
    digits = [k for k, byte in enumerate(data) if 48 <= byte < 58] or [rng.randrange(len(data))]
    at = rng.choice(digits)
    return data[:at] + rng.choice((*NUMBERS, *SPICE)) + data[at + 1 :]


def _nested(data: bytes, rng: random.Random) -> bytes:
    depth = rng.choice([50, 1000, 100_000])
    opening, closing = rng.choice([(b"[", b"]"), (b'{"a":', b"}"), (b'{"cells":[', b"]}")])
    inner = data if data[:1] in b"[{" else b"1"
    return opening * depth + inner + (closing * depth if rng.random() < 0.7 else b"")


def _bomb(data: bytes, rng: random.Random) -> bytes:
    """Return a small archive that unpacks to 1 to 256 MiB."""
    size = rng.choice([2**20, 2**26, 2**28])
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        name = rng.choice(["3D/3dmodel.model", "a.stl", "../../a", "[Content_Types].xml"])
        with archive.open(name, "w", force_zip64=True) as file:
            file.write(rng.choice([b"", b"<model>", b"solid a\n"]))
            for _ in range(size // 2**20):
                file.write(bytes(2**20))
    del data
    return stream.getvalue()


def _entities(data: bytes, rng: random.Random) -> bytes:
    """Return XML with entities that expand repeatedly or refer to another file."""
    del data
    grow = b"".join(
        b'<!ENTITY e%d "%s">' % (k + 1, b"&e%d;" % k * 10) for k in range(rng.randint(2, 9))
    )
    outside = b'<!ENTITY e0 SYSTEM "file:///etc/passwd">'
    xml = b'<?xml version="1.0"?><!DOCTYPE model [%s%s]><model>&e2;</model>' % (outside, grow)
    return zipped(**{"3D__3dmodel_model": xml})


def _polluted(data: bytes, rng: random.Random) -> bytes:
    """Put a value of the wrong type into JSON; in other files, put noise after the signature."""
    try:
        value = json.loads(data)
    except ValueError:
        return data[: rng.randint(1, 16)] + rng.randbytes(rng.randint(1, 400))
    wrong = rng.choice(
        [None, True, -1, 1e300, "x" * 1000, [], {}, [[]], {"__proto__": 1}, "\ud800"]
    )
    if isinstance(value, dict):
        value[rng.choice([*value, "modules", "name", "format"])] = wrong
    else:
        value[rng.randrange(len(value))] = wrong
    return json.dumps(value).encode()


def _spiced(data: bytes, rng: random.Random) -> bytes:
    return mutate(data, rng, SPICE)


Change = Callable[[bytes, random.Random], bytes]
CHANGES: Final[tuple[Change, ...]] = (
    *(_bits, _cut, _doubled, _swapped, _huge, _nested, _bomb, _entities, _polluted, _spiced),
)
CHANGE_WEIGHTS: Final = (4, 3, 2, 3, 5, 1, 0.03, 0.3, 3, 6)
"""Relative frequencies of ``CHANGES``. Bombs take long to make and to refuse: a few dozen in ten
thousand."""
