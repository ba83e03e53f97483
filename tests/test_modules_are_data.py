"""Modules are data: no place outside of a module's own data asks which module a chain has.

What differs between modules is asked of the module: its words, pieces, joints and filling, and
whether it ``follows_paths``. A place counts if

* it compares something with the name or the plural of a shipped module, ``name == "cube"``;
* it has a table or a type by such names, ``{"cube": …}`` or ``Literal["cube", …]``;
* it uses a shipped module by name, ``CUBE``, except to build a chain of it;
* it concludes the kind of module from something else, ``hinges_per_joint == 1``;
* a page's script or template says what modules are called.

The two fillings of space, cells and rings, are told apart by ``filling``: methods that find chains
through cells are in one table, ``FILLING_METHODS``.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from foldback.planner.chain.built_in_modules import MODULE_NAMES, module_named
from foldback.planner.pathfinding import FILLINGS
from foldback.planner.pathfinding.filling_methods import FILLING_METHODS
from tests.case import case

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDERS: Final = ("planner", "server", "words", "cli", "client", "web")
NAMES: Final = frozenset(
    word
    for module in map(module_named, MODULE_NAMES)
    for word in (module.name, module.words.singular, module.words.plural)
)
"""Names of shipped modules, and what one and several of them are called."""
CONSTANTS: Final = frozenset(name.upper().replace("-", "_") for name in MODULE_NAMES)
PROXIES: Final = frozenset({"hinges_per_joint", "rigid_links", "hinge_names"})
"""Attributes of a module that, compared with a constant, tell kinds of modules apart."""
BUILDERS: Final = {
    "client/options.py": "is written by docs/make_options.py from the choices of modules",
    "planner/chain/built_in_modules.py": "loads the shipped modules",
    "planner/chain/chain.py": "builds a chain of cubes along a path, and of tetrahedra on a trail",
    "planner/chain/module.py": "derives what a module can do from its data",
    "planner/exports/code_text.py": "writes codes of snakes, with the number of prisms",
    "planner/readers/angle_strings.py": "reads a notation for chains of tetrahedra",
    "planner/readers/twist_codes.py": "reads notations for snakes, one of which is called cube",
    "planner/twist_chains/cube_sequence.py": "writes these notations",
    "planner/twist_chains/figures.py": "reads the published figures of snakes",
}
"""Python files that build chains of a certain module, and why."""
CHECKER: Final = "web/static/js/check/module.js"
"""The browser's independent checker knows the modules of early plans itself, which do not describe
them, as ``foldback_check.py`` does."""
SCRIPT_PLACE: Final = re.compile(
    r"""["'`](?:cube|tetrahedron)["'`]|\b(?:cube|tetrahedron):|tetrahedra?\b|(?<!-)\bcubes\b"""
    r"""|\.hinges\s*[!=]==\s*\d""",
    re.IGNORECASE,
)
"""Matches a script's or a template's use of a shipped module."""
TEXT_PAGES: Final = {
    "benchmarks.html": "reports measurements of certain shapes",
    "landing.html": "introduces foldback with one fold, and a notation for one kind of chain",
    "paper.html": "compares with the published paper",
    "site.html": "introduces a site of finished folds of cubes",
}
"""Templates that describe certain folds instead of any."""


def _constants(node: ast.AST) -> Iterator[str]:
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and isinstance(inner.value, str):
            yield inner.value


def _is_named(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and node.value in NAMES


def _asks(node: ast.AST) -> bool:
    """Return True if an expression asks for the kind of module."""
    match node:
        case ast.Compare(left=left, comparators=others):
            sides = (left, *others)
            if any(_is_named(word) for side in sides for word in ast.walk(side)):
                return True
            constant = any(isinstance(side, ast.Constant) for side in sides)
            return constant and any(
                isinstance(side, ast.Attribute) and side.attr in PROXIES for side in sides
            )
        case ast.Dict(keys=keys):
            return any(key is not None and _is_named(key) for key in keys)
        case ast.Subscript(value=ast.Name(id="Literal"), slice=values):
            return any(word in NAMES for word in _constants(values))
        case ast.MatchValue(value=value):
            return _is_named(value)
        case ast.Name(id=name):
            return name in CONSTANTS
        case ast.ImportFrom(names=aliases):
            return any(alias.name in CONSTANTS for alias in aliases)
        case _:
            return False


def places_in(source: str) -> list[int]:
    """Return the lines of Python code that ask for the kind of module."""
    return sorted({node.lineno for node in ast.walk(ast.parse(source)) if _asks(node)})  # type: ignore[attr-defined]


def script_places_in(text: str) -> list[int]:
    """Return the lines of a script or template, without comments, that name a kind of module."""
    without = re.sub(r"/\*.*?\*/|\{#.*?#\}|(?<!:)//[^\n]*", _blank, text, flags=re.DOTALL)
    lines = without.splitlines()
    return [number for number, line in enumerate(lines, 1) if SCRIPT_PLACE.search(line)]


def _blank(match: re.Match[str]) -> str:
    return "\n" * match.group().count("\n")


def _places() -> Iterator[str]:
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            name = path.relative_to(ROOT).as_posix()
            if path.suffix == ".py" and name not in BUILDERS:
                lines = places_in(path.read_text(encoding="utf-8"))
            elif name != CHECKER and name.startswith("web/") and path.suffix in (".js", ".ts"):
                lines = script_places_in(path.read_text(encoding="utf-8"))
            elif name.startswith("web/templates/") and path.suffix == ".html":
                text = path.read_text(encoding="utf-8")
                lines = [] if path.name in TEXT_PAGES else script_places_in(text)
            else:
                continue
            yield from (f"{name}:{line}" for line in lines)


def test_no_place_asks_for_the_kind_of_module() -> None:
    assert list(_places()) == [], "ask the module for what differs instead"


def test_exempt_files_exist() -> None:
    for name in (*BUILDERS, CHECKER):
        with case(name):
            assert (ROOT / name).is_file()
    for name in TEXT_PAGES:
        with case(name):
            assert (ROOT / "web" / "templates" / name).is_file()


def test_each_filling_has_a_method() -> None:
    assert set(FILLING_METHODS) == set(FILLINGS)


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("chain.module is CUBE", 1),
        ("name == 'tetrahedron'", 1),
        ("name in ('cube', 'tetrahedron')", 1),
        ("PLURALS = {'cube': 'cubes'}", 1),
        ("kind: Literal['cube']", 1),
        ("module.hinges_per_joint != 2", 1),
        ("match name:\n    case 'cube':\n        pass", 1),
        ("module.words.plural", 0),
        ("module.filling == 'rings'", 0),
        ("module.module_count(3) == 4", 0),
    ],
)
def test_places_are_found(source: str, count: int) -> None:
    assert len(places_in(source)) == count


def test_places_in_scripts_are_found() -> None:
    script = "// cubes\nif (answer.module !== 'cube') x();\nconst p = { cube: 1 };\nm.hinges === 1;"
    assert script_places_in(script) == [2, 3, 4]
