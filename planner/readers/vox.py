"""MagicaVoxel's .vox: chunks with models of voxels, and a scene that places them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, parse_int, quote, too_many
from foldback.planner.readers.text import PADDING
from foldback.planner.shapes.shape import Shape

VOX_MAGIC: Final = b"VOX "
MAX_CHUNKS: Final = 100_000
"""Maximum number of chunks (typed blocks of data) of a MagicaVoxel file; a file with more is
refused."""
MAX_SCENE_NODES: Final = 10_000
"""Maximum number of nodes of a MagicaVoxel file's scene graph that are visited; a file with more is
refused."""
FILE_HEADER_BYTES: Final = 8
"""Size of the signature and version of a MagicaVoxel file, before the first chunk (typed block of
data), in bytes."""
COLOURLESS: Final = "voxels of colour 0, which means empty, were ignored."
HIDDEN: Final = "hidden objects were ignored."
CHUNK_HEADER_BYTES: Final = 12
"""Size of the header of a chunk (typed block of data) in a MagicaVoxel file, in bytes: its type,
and the sizes of its content and of its children."""
MAX_PADDING_BYTES: Final = 4096
"""Maximum number of bytes without a meaning after the last chunk."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Placed:
    """A rotation (3, 3) and a shift (3,) of whole numbers."""

    turn: Ints = field(default_factory=lambda: np.eye(3, dtype=np.int64))
    shift: Ints = field(default_factory=lambda: np.zeros(3, dtype=np.int64))


@dataclass(slots=True, kw_only=True)
class _File:
    """Content of the chunks: models as (size, voxels), and the scene's nodes, some hidden."""

    sizes: list[Ints] = field(default_factory=list[Ints])
    models: list[Ints] = field(default_factory=list[Ints])
    moves: dict[int, tuple[int, _Placed]] = field(default_factory=dict[int, tuple[int, _Placed]])
    groups: dict[int, list[int]] = field(default_factory=dict[int, list[int]])
    shapes: dict[int, list[int]] = field(default_factory=dict[int, list[int]])
    layers: dict[int, int] = field(default_factory=dict[int, int])
    hidden: set[int] = field(default_factory=set[int])
    hidden_layers: set[int] = field(default_factory=set[int])
    named: set[int] = field(default_factory=set[int])
    notes: list[str] = field(default_factory=list[str])


def is_vox(data: bytes) -> bool:
    """Return True if the bytes begin with the signature of .vox."""
    return data.startswith(VOX_MAGIC)


def read_vox(data: bytes, source: Source) -> Shape:
    """Return the shape of the visible models of a .vox file in its scene; z is up.

    Raises:
        InputError: Chunks and their headers disagree.
    """
    if len(data) < FILE_HEADER_BYTES + CHUNK_HEADER_BYTES or data[8:12] != b"MAIN":
        raise _damaged("the first chunk of the file is not MAIN")
    content = _chunks(data)
    if not content.models:
        raise InputError("empty", "got a .vox file without voxels.")
    cells: list[Ints] = []
    total = 0
    placements = _placements(content)
    for model, placed in placements:
        if not 0 <= model < len(content.models):
            raise _damaged(
                f"the scene refers to model {model}, but the last model of the file is "
                f"{len(content.models) - 1}"
            )
        total += len(content.models[model])
        if total > source.max_cells:
            raise too_many(total, source.max_cells)
        # A model turns about its middle, and the middle of an even side is a corner: so in halves.
        doubled = 2 * content.models[model] + 1 - 2 * (content.sizes[model] // 2)
        cells.append((doubled @ placed.turn.T - 1) // 2 + placed.shift)
    if total == 0:
        sight = (
            " that are visible; show its objects and save it again"
            if HIDDEN in content.notes
            else ""
        )
        sight = sight or (
            " that have a colour (0 means empty)" if COLOURLESS in content.notes else ""
        )
        raise InputError("empty", f"got a .vox file without voxels{sight}.")
    joined = np.concatenate(cells)
    shape = Shape.from_cells(joined - joined.min(axis=0), name=source.name or "shape")
    return replace(shape, notes=tuple(content.notes))


def _damaged(problem: str) -> InputError:
    return InputError("damaged", f"{problem}; save the model again.")


def _chunks(data: bytes) -> _File:
    content = _File()
    at = FILE_HEADER_BYTES + CHUNK_HEADER_BYTES + int.from_bytes(data[12:16], "little")
    for _ in range(MAX_CHUNKS):
        if at == len(data):
            break
        if not data[at : at + MAX_PADDING_BYTES].strip(PADDING) and (
            len(data) - at <= MAX_PADDING_BYTES
        ):
            break
        if at + CHUNK_HEADER_BYTES > len(data):
            raise InputError("truncated", "the file ends within a chunk; save or send it again.")
        kind = data[at : at + 4]
        size = int.from_bytes(data[at + 4 : at + 8], "little")
        start = at + CHUNK_HEADER_BYTES
        if start + size > len(data):
            raise InputError(
                "truncated",
                f"the chunk {quote(kind.decode('latin-1'))!r} declares {size} bytes, but the file "
                f"ends after {len(data) - start} of them; save or send it again.",
            )
        _take(kind, _Reader(data[start : start + size]), content)
        at = start + size
    else:
        raise InputError(
            "too-large",
            f"the file has more than {MAX_CHUNKS} chunks, which is too many; simplify the model.",
        )
    if len(content.sizes) != len(content.models):
        raise _damaged(f"the file has {len(content.models)} models but {len(content.sizes)} sizes")
    return content


def _take(kind: bytes, reader: _Reader, content: _File) -> None:
    match kind:
        case b"SIZE":
            content.sizes.append(np.array([reader.number() for _ in range(3)]))
        case b"XYZI":
            count = reader.number()
            if count < 0 or 4 * count != reader.left:
                raise _damaged(f"a model declares {count} voxels but has {reader.left // 4}")
            cells, colours = reader.voxels(count)
            content.models.append(cells[colours > 0])
            if len(content.sizes) < len(content.models):
                raise _damaged("a model has no size")
            if count and (cells >= content.sizes[len(content.models) - 1]).any():
                raise _damaged("a voxel lies outside of its model")
            if not colours.all():
                _note(content, COLOURLESS)
        case b"nTRN":
            node = reader.number()
            _hide(node, reader.words(), content.hidden)
            child = reader.number()
            reader.skip(4)
            content.layers[node] = reader.number()
            frames = [reader.words() for _ in range(reader.counted(4))]
            content.moves[node] = child, _placed(min(frames, key=_frame, default={}))
            if len(frames) > 1:
                _note(content, "the file is animated; its first frame was read.")
        case b"nGRP":
            node = reader.number()
            _hide(node, reader.words(), content.hidden)
            content.groups[node] = reader.numbers()
        case b"nSHP":
            node = reader.number()
            _hide(node, reader.words(), content.hidden)
            models = [(reader.number(), reader.words()) for _ in range(reader.counted(8))]
            content.shapes[node] = [model for model, _ in sorted(models, key=_frame_of_model)[:1]]
            content.named.update(model for model, _ in models)
            if len(models) > 1:
                _note(content, "an object has several frames; the first one was read.")
        case b"LAYR":
            _hide(reader.number(), reader.words(), content.hidden_layers)
        case _:
            pass


def _hide(number: int, words: dict[bytes, bytes], hidden: set[int]) -> None:
    if words.get(b"_hidden", b"0") == b"1":
        hidden.add(number)


def _frame(words: dict[bytes, bytes]) -> int:
    """Return the number of the frame that an object's state belongs to; 0 if it is not stated."""
    word = words.get(b"_f", b"0")
    if not word.isdigit():
        raise _damaged("a frame has no valid frame number")
    return int(word[:9])  # hostile numbers take no time


def _frame_of_model(model: tuple[int, dict[bytes, bytes]]) -> int:
    return _frame(model[1])


def _note(content: _File, note: str) -> None:
    if note not in content.notes:
        content.notes.append(note)


class _Reader:
    """Sequential reader of the numbers and words of a chunk."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        """Number of unread bytes."""
        return len(self._data) - self._at

    def skip(self, size: int) -> bytes:
        """Read the next bytes."""
        if not 0 <= size <= self.left:
            raise _damaged("a chunk ends too early")
        self._at += size
        return self._data[self._at - size : self._at]

    def number(self) -> int:
        """Read a signed 32-bit integer."""
        return int.from_bytes(self.skip(4), "little", signed=True)

    def counted(self, min_bytes: int) -> int:
        """Read a number of items of at least ``min_bytes`` bytes each."""
        count = self.number()
        if count < 0 or count * min_bytes > self.left:
            raise _damaged(f"a chunk declares {count} items but has fewer")
        return count

    def numbers(self) -> list[int]:
        """Read a list of numbers with its length."""
        return [self.number() for _ in range(self.counted(4))]

    def words(self) -> dict[bytes, bytes]:
        """Read a dictionary of byte strings."""
        return {self.skip(self.number()): self.skip(self.number()) for _ in range(self.counted(8))}

    def voxels(self, count: int) -> tuple[Ints, Ints]:
        """Read (count, 3) cells and their (count,) colours."""
        rows = np.frombuffer(self.skip(4 * count), dtype=np.uint8).reshape(-1, 4).astype(np.int64)
        return rows[:, :3], rows[:, 3]


def _placed(words: dict[bytes, bytes]) -> _Placed:
    turn, shift = np.eye(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    try:
        if b"_t" in words:
            shift = np.array([parse_int(word) for word in words[b"_t"].split()], dtype=np.int64)
        code = parse_int(words.get(b"_r", b"4"))
    except (ValueError, OverflowError) as error:
        raise _damaged("a node has no valid position") from error
    first, second = code & 3, (code >> 2) & 3
    if shift.shape != (3,) or np.abs(shift).max() > 1 << 20 or {first, second} - {0, 1, 2}:
        raise _damaged("a node has an invalid position")
    if first == second:
        raise _damaged("a node has an invalid rotation")
    if b"_r" in words:
        turn = np.zeros((3, 3), dtype=np.int64)
        for row, column in enumerate((first, second, 3 - first - second)):
            turn[row, column] = -1 if code >> (4 + row) & 1 else 1
    return _Placed(turn=turn, shift=shift)


def _placements(content: _File) -> list[tuple[int, _Placed]]:
    """Return the visible models and their transforms; without a scene, the first one."""
    nodes = len(content.moves) + len(content.groups) + len(content.shapes)
    if not nodes or not content.moves:
        if len(content.models) > 1:
            _note(content, f"the file has {len(content.models)} frames; the first one was read.")
        return [(0, _Placed())]
    placements: list[tuple[int, _Placed]] = []
    waiting = [(0, _Placed(), 0)]
    visits = 0
    while waiting:
        node, above, depth = waiting.pop()
        visits += 1
        if depth > nodes:
            raise _damaged(f"node {node} of the scene contains itself")
        if visits > MAX_SCENE_NODES:
            raise InputError(
                "too-large",
                f"the scene places more than {MAX_SCENE_NODES} objects and groups, those in shared "
                "groups counted each time; simplify the scene.",
            )
        if node in content.hidden or content.layers.get(node) in content.hidden_layers:
            _note(content, HIDDEN)
            continue
        if node in content.moves:
            child, placement = content.moves[node]
            shift = above.turn @ placement.shift + above.shift
            if np.abs(shift).max() > 1 << 30:
                raise _damaged("an object lies too far from the origin")
            waiting.append(
                (child, _Placed(turn=above.turn @ placement.turn, shift=shift), depth + 1)
            )
        elif node in content.groups:
            waiting += [(child, above, depth + 1) for child in content.groups[node]]
        elif node in content.shapes:
            placements += [(model, above) for model in content.shapes[node]]
        else:
            raise _damaged(f"the scene refers to node {node}, which does not exist")
    if any(len(cells) for model, cells in enumerate(content.models) if model not in content.named):
        _note(content, "models outside of the scene were ignored.")
    return placements
