"""Choice of the reader of a file, and the formats that can be read.

The content decides which reader takes a file; its name only names the shape, and hints where a
damaged file could be of several kinds. Nothing outside of the bytes is ever read or fetched.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final, TypeAlias

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.display_names import clean_name
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.readers.angle_strings import is_angle_string, read_angle_string, refuse_digits
from foldback.planner.readers.binvox import is_binvox, read_binvox
from foldback.planner.readers.csv_cells import is_csv, read_csv
from foldback.planner.readers.gltf import is_glb, read_glb
from foldback.planner.readers.json_formats import is_json, read_json
from foldback.planner.readers.limits import (
    MAX_CELLS,
    MAX_TRIANGLES,
    Source,
    check_bytes,
    check_size,
)
from foldback.planner.readers.npy import is_npy, read_npy
from foldback.planner.readers.obj import is_obj, read_obj
from foldback.planner.readers.off import is_off, read_off
from foldback.planner.readers.pixel_pictures import is_pixel_picture, read_pixel_picture
from foldback.planner.readers.ply import is_ply, read_ply
from foldback.planner.readers.refused_formats import refuse_other_kinds, unknown_kind
from foldback.planner.readers.stl import is_binary, is_stl, read_stl
from foldback.planner.readers.svg import is_svg, read_svg
from foldback.planner.readers.text import decode, refuse_binary, refuse_prose, to_utf8
from foldback.planner.readers.threemf import is_zip, read_threemf
from foldback.planner.readers.twist_codes import is_twist_code, read_twist_code
from foldback.planner.readers.vox import is_vox, read_vox
from foldback.planner.readers.word_text import is_word, read_word
from foldback.planner.readers.xyz import is_xyz, read_xyz
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.silhouettes.picture import Picture
from foldback.planner.silhouettes.word import Word
from foldback.planner.storage.files import MAX_FILE_BYTES
from foldback.planner.twist_chains.cube_sequence import CubeSequence
from foldback.planner.twist_chains.figures import names_of
from foldback.planner.twist_chains.folded_chains import snake_chain

READABLE_FORMATS: Final = (
    "a mesh (STL, OBJ, PLY, OFF, GLB, glTF, 3MF), voxels (.vox, .binvox, .npy, JSON), a picture "
    "(PNG, JPEG, SVG), a word (word:Anna), or the cells or angles of a chain (foldback-path/1 or "
    "foldback-chain/1 JSON, CSV, XYZ, .npy, a snake's code)"
)

MESH_SUFFIXES: Final = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf", ".3mf")
"""Suffixes of the names of triangle meshes, in lower case."""
PICTURE_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".svg")
"""Suffixes of the names of pictures, in lower case."""
READABLE_SUFFIXES: Final = (
    *MESH_SUFFIXES,
    *PICTURE_SUFFIXES,
    *(".vox", ".binvox", ".npy", ".json", ".csv", ".txt", ".xyz"),
)
"""Suffixes of the names of files that can be read, which dialogs for opening a file offer."""

LOGGER: Final = logging.getLogger(__name__)
UNREADABLE: Final = (
    "the file cannot be read: it is damaged, or unusual in a way that foldback does not know; save "
    "it again with another program, or in another format."
)
"""Message for a file at which a reader failed in an unforeseen way."""
Content: TypeAlias = Path | Chain | Shape | Solid | CubeSequence | Word | Picture
"""What is in a file, and is folded."""
Kind = tuple[Callable[[bytes], bool], Callable[[bytes, Source], Content]]
BINARY_KINDS: Final[tuple[Kind, ...]] = (
    (is_npy, read_npy),
    (is_vox, read_vox),
    (is_binvox, read_binvox),
    (is_glb, read_glb),
    (is_ply, read_ply),
    (is_zip, read_threemf),
    (is_off, read_off),
    (is_pixel_picture, read_pixel_picture),
)


def read(
    data: bytes,
    *,
    filename: str | None = None,
    as_voxels: bool = False,
    max_cells: int = MAX_CELLS,
    max_triangles: int = MAX_TRIANGLES,
    max_bytes: int = MAX_FILE_BYTES,
) -> Content:
    """Read a path, chain, shape or solid from a file.

    Args:
        data: The whole file.
        filename: Name of the file; it names the shape where the content does not.
        as_voxels: True to read lists of cells as voxels in no order, not as a path.
        max_cells: Maximum number of cells; larger files are refused before they take much memory.
        max_triangles: Maximum number of triangles of a mesh.
        max_bytes: Maximum file size, bytes.

    Returns:
        A ``Path`` for lists of cells, a ``Chain`` for ``foldback-chain/1`` and codes of Rubik's
        snakes, a ``Shape`` for voxels, a ``Solid`` for meshes, a ``CubeSequence`` for the pieces of
        a snake cube, a ``Word`` for letters after ``word:``, a ``Picture`` for pictures.

    Raises:
        InputError: The content cannot be read; says what was found and expected, and what to do.
    """
    try:
        return _read(data, filename, as_voxels, max_cells, max_triangles, max_bytes)
    except (InputError, MemoryError):
        raise
    except Exception as error:
        # A fault of a reader or of a library that it uses. Its words mean nothing to people.
        LOGGER.debug("reading a file failed", exc_info=error)
        raise InputError("unreadable", UNREADABLE) from error


def _read(
    data: bytes,
    filename: str | None,
    as_voxels: bool,
    max_cells: int,
    max_triangles: int,
    max_bytes: int,
) -> Content:
    source = Source(
        name=clean_name(_stem(filename)),
        max_cells=max_cells,
        max_triangles=max_triangles,
        as_voxels=as_voxels,
    )
    check_bytes(data, max_bytes)
    if not is_binary(data, hinted=False):
        data = to_utf8(data)
    for belongs, reader in BINARY_KINDS:
        if belongs(data):
            return reader(data, source)
    if is_stl(data, hinted=False):
        return read_stl(data, source, hinted=False)
    if is_svg(data):
        return read_svg(data, source)
    refuse_other_kinds(data, READABLE_FORMATS)
    called_stl = (filename or "").lower().endswith(".stl")
    if called_stl and is_stl(data, hinted=True):
        return read_stl(data, source, hinted=True)
    if is_obj(data):
        return read_obj(data, source)
    refuse_binary(data, READABLE_FORMATS)
    if not _looks_like_gltf(data):
        check_size(data, max_cells)
    text = decode(data, READABLE_FORMATS)
    if not text.strip():
        raise InputError(
            "empty", f"this looks like a file with only white space, expected {READABLE_FORMATS}."
        )
    if is_word(text):
        return read_word(text)
    if is_json(text):
        return read_json(text, source)
    if is_angle_string(text):
        return read_angle_string(text, name=source.name or "chain", most_modules=max_cells)
    if is_twist_code(text):
        return _read_twist_code(text, source)
    refuse_digits(text)
    refuse_prose(text, READABLE_FORMATS)
    if is_csv(text):
        return read_csv(text, source)
    if is_xyz(text):
        return read_xyz(text, source)
    raise unknown_kind(text, READABLE_FORMATS)


def _read_twist_code(text: str, source: Source) -> Chain | CubeSequence:
    code = read_twist_code(text, max_modules=source.max_cells)
    if isinstance(code, CubeSequence):
        return code
    name = next(iter(names_of(code)), source.name or "snake")
    return snake_chain(code, name=name)


def _looks_like_gltf(data: bytes) -> bool:
    return data[:64].lstrip()[:1] == b"{" and b'"accessors"' in data


def _stem(filename: str | None) -> str:
    base = (filename or "").replace("\\", "/").rpartition("/")[2]
    stem, dot, _ = base.rpartition(".")
    return stem if dot and stem else base
