"""Module files, alone and together with the joint angles of a chain."""

from __future__ import annotations

import json
import re
from typing import Any, Final, NoReturn, cast

from foldback.planner.chain.built_in_modules import MODULE_NAMES, module_named, module_value
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_checks import check_module, module_notes
from foldback.planner.chain.module_file import MODULE_FORMAT, read_module
from foldback.planner.errors import InputError
from foldback.planner.readers.chain_json import CHAIN_FORMAT
from foldback.planner.readers.limits import MAX_CELLS, check_size, described, quote
from foldback.planner.readers.strict_json import parse
from foldback.planner.readers.text import decode

SEPARATORS: Final = re.compile(r"[\s,;]+")
"""Matches what may stand between typed angles."""


def read_module_file(data: bytes) -> Module:
    """Return the module in a ``foldback-module/1`` file.

    Raises:
        InputError: The file is no module file, or the module has a fault.
    """
    document = _object(data, MODULE_FORMAT)
    module = read_module(document)
    check_module(module)
    return module


def refuse_alone(document: dict[str, Any]) -> NoReturn:
    """Check a module that is given without the angles of a chain, and say what is missing.

    Raises:
        InputError: ``module-alone``, or the fault of the module.
    """
    module = read_module(document)
    check_module(module)
    notes = "".join(f" {note}" for note in module_notes(module))
    raise InputError(
        "module-alone",
        "this module has no faults, but a fold also needs the joint angles of the folded chain; "
        f"add a chain file, or use --angles on the command line.{notes}",
    )


def with_module(data: bytes, module: Module) -> bytes:
    """Return a chain file that holds a module of its own.

    Args:
        data: A chain file without a module, or with one of the same name.
        module: The module of the chain.

    Raises:
        InputError: The file is no chain file, or has another module.
    """
    document = _object(data, CHAIN_FORMAT)
    if document.get("module", module.name) != module.name:
        raise InputError(
            "two-modules",
            f"got a chain file with the module {described(document['module'])} and a module file "
            f"of {module.name!r}; leave one of them out.",
            where="module",
        )
    return _chain(module, document)


def chain_of_angles(angles: str, module: Module) -> bytes:
    """Return the chain file of typed angles in degrees, one for each hinge in their order.

    Raises:
        InputError: A word is no number, or the number of angles is wrong.
    """
    values: list[float] = []
    for word in filter(None, SEPARATORS.split(angles.replace("\u2212", "-"))):
        try:
            values.append(float(word))
        except ValueError as error:
            raise InputError(
                "not-a-number",
                f"got {quote(word)!r} after {len(values)} angles, expected an angle in degrees for "
                "each hinge, such as 0, 90 or -45.5.",
                where="angles",
            ) from error
    hinges = module.hinges_per_joint
    if len(values) % hinges:
        raise InputError(
            "wrong-count",
            f"got {len(values)} angles, expected a multiple of {hinges}, because each joint has "
            f"{hinges} hinges.",
            where="angles",
        )
    rows: list[Any] = [values[k : k + hinges] for k in range(0, len(values), hinges)]
    joints = rows if hinges > 1 else values
    return _chain(module, {"name": module.name, "joint_angles_deg": joints})


def built_in_or_file(name: str, data: bytes | None) -> Module:
    """Return the module of a name, or in the bytes of a file where there is one.

    Raises:
        InputError: There is neither, or the file cannot be used.
    """
    if data is not None:
        return read_module_file(data)
    if name in MODULE_NAMES:
        return module_named(name)
    raise InputError(
        "unknown-module",
        f"got the module {quote(name)!r}, expected a module file, or one of: "
        f"{', '.join(MODULE_NAMES)}.",
        where="module",
    )


def _chain(module: Module, document: dict[str, Any]) -> bytes:
    pitch = {} if module.pitch_m is None else {"pitch_m": module.pitch_m}
    values = {"format": CHAIN_FORMAT, **pitch, **document, "module": module_value(module)}
    return json.dumps(values).encode()


def _object(data: bytes, format_name: str) -> dict[str, Any]:
    """Return the JSON object of a file of one format."""
    expected = f'a JSON object with "format": "{format_name}"'
    check_size(data, MAX_CELLS)
    text = decode(data, expected)
    value = parse(text) if text.lstrip()[:1] == "{" else None
    document = cast("dict[str, Any]", value) if isinstance(value, dict) else {}
    if document.get("format") != format_name:
        got = f'"format": {described(document["format"])}' if "format" in document else "none"
        raise InputError("wrong-format", f"got {got}, expected {expected}.", where="format")
    return document
