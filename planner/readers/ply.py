"""PLY: elements that a header describes, binary or as text."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import MAX_TRIANGLES, Source, check_lines, parse_float, quote
from foldback.planner.readers.text import BYTE_LINE, numbered_lines
from foldback.planner.shapes.polygons import MIN_CORNERS, fans, skipped_note
from foldback.planner.shapes.solid import Solid, check_triangles

MAX_PLY_HEADER_BYTES: Final = 65_536
"""Maximum size of the header of a PLY file, in bytes; a file whose header does not end within it is
refused."""
END_HEADER: Final = re.compile(rb"(?<=[\r\n])end_header[ \t]*(?:\r\n|\n|\r)")
TYPES: Final = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"},
    **{"uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
BYTE_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Prefix of NumPy types (byte order) for each format that a PLY header may state; empty for
text."""
CORNER_LISTS: Final = ("vertex_indices", "vertex_index")
"""Names that PLY files use for the list property with the vertex numbers of a face."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Property:
    """A property: its type, and for lists the type of their length."""

    name: str
    kind: str
    length: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Element:
    """Name, count and properties of an element of the header."""

    name: str
    count: int
    properties: list[_Property] = field(default_factory=list[_Property])

    def column(self, names: tuple[str, ...]) -> int:
        """Return the index of the first property with one of these names; −1 if there is none."""
        return next((i for i, p in enumerate(self.properties) if p.name in names), -1)


def is_ply(data: bytes) -> bool:
    """Return True if the first line is the signature of PLY."""
    return data[:4] in (b"ply\n", b"ply\r", b"ply ")


def read_ply(data: bytes, source: Source) -> Solid:
    """Return the solid in a PLY file.

    Raises:
        InputError: The header is wrong, data is missing, or the mesh is no solid.
    """
    order, elements, start = _header(data)
    body = (
        _Text(data[start:], elements, source.max_triangles)
        if order == ""
        else _Binary(data[start:], order)
    )
    points: Array | None = None
    parts: list[Ints] = []
    skipped = 0
    for element in elements:
        if not element.properties:
            raise _damaged(f"the element {quote(element.name)!r} has no properties")
        if element.count > body.most(element):
            raise _truncated(element)
        if element.name == "face":
            check_triangles(element.count, source.max_triangles)
        columns = body.read(element)
        if element.name == "vertex":
            places = [element.column((axis,)) for axis in "xyz"]
            if -1 in places or any(element.properties[p].length for p in places):
                raise _damaged("the vertices have no x, y and z")
            with np.errstate(invalid="ignore"):
                points = np.column_stack([columns[p][0].astype(np.float64) for p in places])
        elif element.name in ("face", "tristrips"):
            place = element.column(CORNER_LISTS)
            if place == -1 or not element.properties[place].length:
                raise _damaged("the faces have no list of vertices")
            corners, counts = columns[place]
            with np.errstate(invalid="ignore"):
                rows = corners.astype(np.int64)
            if corners.dtype.kind == "f" and not np.array_equal(rows, corners):
                raise _damaged("a face has a vertex number that is not a whole number")
            parts.append(fans(rows, counts) if element.name == "face" else _strips(rows, counts))
            skipped += int((counts < MIN_CORNERS).sum())
    list_elements = [e.name for e in elements if e.count and any(p.length for p in e.properties)]
    lists = [name for name in list_elements if name not in ("face", "tristrips")]
    if points is None or not sum(map(len, parts)):
        problem = (
            f"the element {quote(lists[0])!r} is not supported"
            if lists
            else "the file has only points"
        )
        raise InputError(
            "no-triangles",
            f"got a PLY file without faces ({problem}), expected a closed surface of polygons.",
        )
    triangles = np.concatenate(parts)
    notes = list(skipped_note(skipped))
    notes += [f"the element {quote(name)!r} was ignored." for name in lists]
    if body.has_more():
        notes.append("data after the last element was ignored.")
    return Solid.from_triangles(
        points,
        triangles,
        name=source.name or "solid",
        notes=notes,
        max_triangles=source.max_triangles,
    )


def _strips(corners: Ints, counts: Ints) -> Ints:
    """Return (T, 3) triangles of strips; −1 ends a strip, every other triangle is turned."""
    ends = np.cumsum(counts)
    place = np.arange(len(corners))
    breaks = np.zeros(len(corners) + 1, dtype=np.bool_)
    breaks[ends] = True
    breaks[1:] |= corners < 0
    breaks[:-1] |= corners < 0
    begins = np.maximum.accumulate(np.where(breaks[:-1], place, 0))
    number = place - begins
    third = np.flatnonzero((number >= 2) & (corners >= 0))
    rows = np.column_stack([corners[third - 2], corners[third - 1], corners[third]])
    odd = number[third] % 2 == 1
    return np.where(odd[:, None], rows[:, [1, 0, 2]], rows)


def _damaged(problem: str) -> InputError:
    return InputError("damaged", f"{problem}; save the mesh again as PLY.")


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    last = END_HEADER.search(data, 0, MAX_PLY_HEADER_BYTES)
    if last is None and len(data) > MAX_PLY_HEADER_BYTES:
        raise _damaged(f"the header does not end within {MAX_PLY_HEADER_BYTES} bytes")
    if last is None:
        raise InputError("truncated", "the file ends within its header; save or send it again.")
    order: str | None = None
    elements: list[_Element] = []
    header = data[: last.start()].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    for number, line in numbered_lines(header.decode("latin-1")):
        words = line.split()
        match words:
            case ["format", name, _] if name in BYTE_ORDERS:
                order = BYTE_ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit():
                elements.append(_Element(name=name, count=int(count[:15])))
            case ["property", "list", length, kind, name] if (
                elements and length in TYPES and kind in TYPES
            ):
                if TYPES[length][0] == "f":
                    raise _damaged(
                        f"line {number} declares the type {length} for the length of a list, "
                        "expected an integer type"
                    )
                elements[-1].properties.append(
                    _Property(name=name, kind=TYPES[kind], length=TYPES[length])
                )
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(_Property(name=name, kind=TYPES[kind]))
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise _damaged(f"line {number} of the header is not valid: {quote(line.strip())!r}")
    if order is None:
        raise _damaged("the header names no format")
    return order, elements, last.end()


Columns = list[tuple[NDArray[Any], Ints]]


class _Rows:
    """Words of rows, one list per property, and the number of words of each row."""

    def __init__(self, element: _Element) -> None:
        self._lists = [bool(p.length) for p in element.properties]
        self.values: list[list[bytes]] = [[] for _ in element.properties]
        self.counts: list[list[int]] = [[] for _ in element.properties]

    def add(self, words: list[bytes], at: int) -> int | None:
        """Add the row that begins at an index; return its end, or None if it is incomplete."""
        for i, is_list in enumerate(self._lists):
            length = 1
            if is_list:
                if at >= len(words) or not words[at].isdigit():
                    return None
                length = int(words[at][:15])
                at += 1
            if at + length > len(words):
                return None
            self.values[i] += words[at : at + length]
            self.counts[i].append(length)
            at += length
        return at


class _Text:
    """The data of a PLY file written as text.

    Rows follow one another wherever the lines end. Where they don't fit so, each has a line of its
    own, and what that holds beyond what the header says of a row is left alone.
    """

    def __init__(self, data: bytes, elements: list[_Element], max_triangles: int) -> None:
        check_lines(data, max_triangles)
        self._lines = [line[0].split() for line in BYTE_LINE.finditer(data)]
        rows = sum(element.count for element in elements)
        self._line_a_row = len(self._lines) >= rows and not _fits(self._lines, elements)
        self._at = 0

    def read(self, element: _Element) -> Columns:
        """Read the columns of an element: all values in a row, and the number in each row."""
        lines = self._lines[self._at : self._at + element.count]
        columns = self._by_line(element, lines) if self._line_a_row else None
        if columns is not None:
            self._at += element.count
            return columns
        words = list(chain.from_iterable(self._lines[self._at :]))
        rows = _Rows(element)
        at = 0
        for _ in range(element.count):
            end = rows.add(words, at)
            if end is None:
                raise _damaged(f"an entry of the element {quote(element.name)!r} is broken")
            at = end
        self._lines, self._at, self._line_a_row = [words[at:]], 0, False
        return self._columns(rows)

    def most(self, element: _Element) -> int:
        """Return an upper bound of the number of rows of an element that are left."""
        words = sum(len(words) for words in islice(self._lines, self._at, None))
        return words // len(element.properties)

    def has_more(self) -> bool:
        """Return True if words follow the last row that was read."""
        return any(self._lines[self._at :])

    def _by_line(self, element: _Element, lines: list[list[bytes]]) -> Columns | None:
        """Read one row per line; None if a line has too few words."""
        wide = len(element.properties)
        if not any(p.length for p in element.properties):
            if any(len(line) < wide for line in lines):
                return None
            values = self._numbers([word for line in lines for word in line[:wide]])
            row_counts = np.ones(element.count, dtype=np.int64)
            return [(values[i::wide], row_counts) for i in range(wide)]
        rows = _Rows(element)
        if any(rows.add(line, 0) is None for line in lines):
            return None
        return self._columns(rows)

    def _columns(self, rows: _Rows) -> Columns:
        return [
            (self._numbers(values), np.array(counts, dtype=np.int64))
            for values, counts in zip(rows.values, rows.counts, strict=True)
        ]

    def _numbers(self, words: list[bytes]) -> Array:
        try:
            if b"_" not in b"".join(words):  # Python accepts it within numbers
                return np.array([float(word) for word in words])
        except ValueError:
            pass
        try:
            return np.array([parse_float(word) for word in words])
        except ValueError as error:
            raise _damaged(f"got {error}") from error


def _fits(lines: list[list[bytes]], elements: list[_Element]) -> bool:
    """Return True if the rows of all elements take exactly all words."""
    words = list(chain.from_iterable(lines))
    at = 0
    for element in elements:
        lists = [bool(p.length) for p in element.properties]
        if not any(lists):
            at += element.count * len(lists)
            continue
        for _ in range(element.count):
            for is_list in lists:
                if at >= len(words) or (is_list and not words[at].isdigit()):
                    return False
                at += 1 + (int(words[at][:15]) if is_list else 0)
    return at == len(words)


class _Binary:
    """The data of a binary PLY file."""

    def __init__(self, data: bytes, order: str) -> None:
        self._data = data
        self._order = order
        self._at = 0

    def read(self, element: _Element) -> Columns:
        """Read the columns of an element: all values in a row, and the number in each row."""
        lists = [p for p in element.properties if p.length]
        if element.count == 0:
            none = np.zeros(0, dtype=np.int64)
            return [(none, none) for _ in element.properties]
        lengths = self._lengths_of_first_row(element)
        rows = self._rows(element, lengths)
        if rows is not None and all(
            (rows[f"n{i}"] == lengths[i]).all()
            for i, p in enumerate(element.properties)
            if p.length
        ):
            self._at += rows.nbytes
            return [
                (rows[f"v{i}"].reshape(-1), np.full(element.count, lengths[i]))
                for i in range(len(element.properties))
            ]
        if not lists:
            raise _truncated(element)
        return self._row_by_row(element)

    def most(self, element: _Element) -> int:
        """Return an upper bound of the number of rows of an element that are left."""
        min_row_bytes = sum(np.dtype(p.length or p.kind).itemsize for p in element.properties)
        return (len(self._data) - self._at) // min_row_bytes

    def has_more(self) -> bool:
        """Return True if bytes follow the last row that was read."""
        return bool(self._data[self._at :].strip(b"\0 \t\r\n"))

    def _length(self, column: _Property, at: int) -> int:
        if not column.length:
            return 1
        kind = np.dtype(self._order + column.length)
        if at + kind.itemsize > len(self._data):
            raise _damaged("the file ends within a list")
        return int(np.frombuffer(self._data, kind, 1, at)[0])

    def _lengths_of_first_row(self, element: _Element) -> list[int]:
        at, lengths = self._at, list[int]()
        for column in element.properties:
            length = self._length(column, at)
            if column.length:
                at += np.dtype(column.length).itemsize
            at += length * np.dtype(column.kind).itemsize
            if length < 0 or at > len(self._data):
                raise _truncated(element)
            lengths.append(length)
        return lengths

    def _rows(self, element: _Element, lengths: list[int]) -> NDArray[Any] | None:
        """Return all rows with the lengths of the first; None if the data is too short."""
        fields: list[Any] = []
        for i, (column, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if column.length:
                fields.append((f"n{i}", self._order + column.length))
            fields.append((f"v{i}", self._order + column.kind, (length,)))
        row = np.dtype(fields)
        if element.count * row.itemsize > len(self._data) - self._at:
            return None
        return np.frombuffer(self._data, row, element.count, self._at)

    def _row_by_row(self, element: _Element) -> Columns:
        if element.count > MAX_TRIANGLES:
            raise InputError(
                "too-large",
                f"got {element.count} entries of the element {quote(element.name)!r}, expected at "
                f"most {MAX_TRIANGLES}; simplify the mesh.",
            )
        values: list[list[bytes]] = [[] for _ in element.properties]
        counts: list[list[int]] = [[] for _ in element.properties]
        little = "little" if self._order == "<" else "big"
        sizes = [
            (
                np.dtype(p.length).itemsize if p.length else 0,
                p.length[:1] == "i",
                np.dtype(p.kind).itemsize,
            )
            for p in element.properties
        ]
        at, data = self._at, self._data
        for _ in range(element.count):
            for i, (prefix, signed, size) in enumerate(sizes):
                length = 1
                if prefix:
                    length = int.from_bytes(data[at : at + prefix], little, signed=signed)
                    at += prefix
                end = at + length * size
                if length < 0 or end > len(data):
                    raise _truncated(element)
                values[i].append(data[at:end])
                counts[i].append(length)
                at = end
        self._at = at
        return [
            (np.frombuffer(b"".join(v), self._order + p.kind), np.array(c, dtype=np.int64))
            for v, c, p in zip(values, counts, element.properties, strict=True)
        ]


def _truncated(element: _Element) -> InputError:
    return InputError(
        "truncated",
        f"the header declares {element.count} entries of the element {quote(element.name)!r}, but "
        "the file has fewer; save or send it again.",
    )
