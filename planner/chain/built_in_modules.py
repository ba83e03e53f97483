"""Modules that foldback ships, by name."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib.resources import files
from typing import Any, Final

from foldback.planner.chain.module import Filling, Module, ModuleWords
from foldback.planner.chain.module_file import read_module
from foldback.planner.errors import InputError

MODULE_NAMES: Final = (
    *("cube", "tetrahedron", "snake-prism", "snake-cube"),
    *("sea-snake", "yamor", "polybot-g2", "molecube", "rofi"),
)
"""Names of the modules, the default one first; published robots last."""
DEFAULT_MODULE: Final = MODULE_NAMES[0]
"""Name of the module of a chain that states none."""


@lru_cache(maxsize=len(MODULE_NAMES))
def _document(name: str) -> dict[str, Any]:
    text = files("foldback.planner.modules").joinpath(f"{name}.json").read_text(encoding="utf-8")
    return json.loads(text)


@lru_cache(maxsize=len(MODULE_NAMES))
def _module(name: str) -> Module:
    return read_module(_document(name))


def module_named(name: str) -> Module:
    """Return the module of that name.

    Raises:
        InputError: ``unknown-module`` when there is none.
    """
    if name not in MODULE_NAMES:
        known_names = ", ".join(sorted(MODULE_NAMES))
        raise InputError(
            "unknown-module", f"got the module type {name!r}, expected one of: {known_names}."
        )
    return _module(name)


def filling_named(name: str) -> Filling | None:
    """Return how the module of that name, which foldback ships, fills space; builds no geometry."""
    return _document(name).get("filling")


def described_words(module: Module) -> dict[str, str] | None:
    """Return the words to store beside a module's name; None for one that foldback ships."""
    return None if module.name in MODULE_NAMES else asdict(module.words)


def words_named(name: str, words: Mapping[str, str] | None) -> ModuleWords:
    """Return what a module is called of which only the name and ``described_words`` are stored.

    Builds no geometry.
    """
    if words is None and name not in MODULE_NAMES:
        # One that an older or newer version shipped.
        return ModuleWords("module", "modules")
    return ModuleWords(**(_document(name)["words"] if words is None else words))


def module_value(module: Module) -> str | dict[str, Any]:
    """Return what files hold for a module: its name if foldback ships it, or its description."""
    is_built_in = module.name in MODULE_NAMES and module is _module(module.name)
    return module.name if is_built_in else module.document


def document_of(value: str | dict[str, Any]) -> dict[str, Any]:
    """Return the description that ``module_value`` stands for, unchecked; builds no geometry."""
    return _document(value) if isinstance(value, str) else value


def module_of(value: str | dict[str, Any]) -> Module:
    """Return the module that ``module_value`` stands for; equal descriptions give the same one.

    Raises:
        InputError: ``unknown-module`` or ``bad-module``; or ``name-taken`` where a description has
            the name of a module that foldback ships, and differs in more than its pattern and rest
            shape.
    """
    if isinstance(value, str):
        return module_named(value)
    return _described(json.dumps(value, sort_keys=True))


@lru_cache(maxsize=64)
def _described(text: str) -> Module:
    module = read_module(json.loads(text))
    if module.name in MODULE_NAMES and _lasting(module) != _lasting(_module(module.name)):
        raise InputError(
            "name-taken",
            f"got a module with the name {module.name!r}, which another module has; give it "
            "another name.",
            where="name",
        )
    return module


def _lasting(module: Module) -> dict[str, Any]:
    """Return the description of a module without what differs from chain to chain."""
    changing = ("pattern", "rest_deg")
    return {key: value for key, value in module.document.items() if key not in changing}


CUBE: Final = module_named("cube")
"""Cubic module: a universal joint (hinge about z, then about y) at each cube's centre, and links of
one pitch to the next cube."""
TETRAHEDRON: Final = module_named("tetrahedron")
"""Tetrahedral module (right-angle tetrahedron, or tetragonal disphenoid), hinged to its neighbours
along its two long edges of two pitches; the other edges have √3 pitches. The middles of its hinges
are one pitch apart. Neighbours lie face to face at ±90°, so a hinge turns hardly farther."""
