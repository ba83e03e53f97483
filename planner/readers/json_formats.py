"""JSON formats: strict parsing, then the reader that the format asks for."""

from __future__ import annotations

from typing import Any, Final, cast

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module_file import MODULE_FORMAT
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.readers.chain_json import CHAIN_FORMAT, read_chain
from foldback.planner.readers.gltf import is_gltf, read_gltf
from foldback.planner.readers.limits import Source, quote
from foldback.planner.readers.own_module import refuse_alone
from foldback.planner.readers.path_json import path_from_rows, read_path, read_voxels
from foldback.planner.readers.strict_json import parse
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid

PATH_FORMAT: Final = "foldback-path/1"
VOXELS_FORMAT: Final = "foldback-voxels/1"
JSON_FORMATS: Final = (PATH_FORMAT, CHAIN_FORMAT, VOXELS_FORMAT, MODULE_FORMAT)


def is_json(text: str) -> bool:
    """Return True if the first character begins a JSON object or list."""
    return text.lstrip()[:1] in ("{", "[")


def read_json(text: str, source: Source) -> Path | Chain | Shape | Solid:
    """Read a path, a chain, voxels or a glTF scene from JSON.

    Raises:
        InputError: The JSON cannot be read; names the line, the key or the cell.
    """
    value = parse(text, source.max_cells)
    if isinstance(value, list):
        return path_from_rows(cast("list[Any]", value), source, name="", field="the list")
    document = cast("dict[str, Any]", value)
    format_name = document.get("format")
    if format_name == PATH_FORMAT:
        return read_path(document, source)
    if format_name == CHAIN_FORMAT:
        return read_chain(document, source)
    if format_name == VOXELS_FORMAT:
        return read_voxels(document, source)
    if format_name == MODULE_FORMAT:
        refuse_alone(document)
    if is_gltf(document):
        return read_gltf(document, source)
    raise _wrong_format(document, format_name)


def _wrong_format(document: dict[str, Any], value: object) -> InputError:
    expected = f'expected "{PATH_FORMAT}", "{CHAIN_FORMAT}" or "{VOXELS_FORMAT}"'
    if value is None:
        keys = quote(", ".join(list(document)[:8])) or "none"
        return InputError(
            "no-format",
            f'got a JSON object without "format" (keys: {keys}), {expected} as its "format".',
        )
    family, slash, version = value.partition("/") if isinstance(value, str) else ("", "", "")
    if slash and family in {f.partition("/")[0] for f in JSON_FORMATS}:
        return InputError(
            "wrong-version",
            f"got version {quote(version)!r} of {family}, {expected}.",
            where="format",
        )
    return InputError(
        "wrong-format", f"got the format {quote(value)!r}, {expected}.", where="format"
    )
