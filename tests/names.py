"""``python -m tests.names [FOLDER …]``: list names of values that fit every value, with places.

Counted are local names, parameters and attributes, each once in its function or class, without
``self``, ``cls`` and ``_``.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
FOLDERS: Final = (
    *("planner", "foldback", "web", "words", "cli", "server", "client"),
    *("bench", "docs", "examples", "tests"),
)
VAGUE_WORDS: Final = """
    again aside asked away back begin begun both chosen each few found given gone got held here how
    it kept known least left made many met mine more most one ones other others ours own rest said
    same seen shown some taken that theirs there these this those told tried wanted what when where
    which who whole why
"""
"""Pronouns, adverbs and participles that do not say what a value is."""
VAGUE: Final = frozenset(VAGUE_WORDS.split())
CONVENTIONAL: Final = frozenset({"self", "cls", "_"})


@dataclass(frozen=True, slots=True, order=True)
class Binding:
    """A name in the scope that binds it, at its first line."""

    path: Path
    line: int
    name: str

    @property
    def is_vague(self) -> bool:
        """Return True if the name would fit every value."""
        return self.name.strip("_") in VAGUE


class _Scopes(ast.NodeVisitor):
    """Collects the bindings of one file."""

    def __init__(self, path: Path) -> None:
        self.bindings: list[Binding] = []
        self._path = path
        self._locals: dict[str, int] | None = None
        self._attributes: dict[str, int] | None = None

    def _visit_scope(self, node: ast.AST) -> None:
        enclosing, self._locals = self._locals, {}
        self.generic_visit(node)
        self._collect(self._locals)
        self._locals = enclosing

    def _collect(self, lines: dict[str, int]) -> None:
        self.bindings += [
            Binding(self._path, line, name)
            for name, line in lines.items()
            if name not in CONVENTIONAL
        ]

    visit_FunctionDef = visit_AsyncFunctionDef = visit_Lambda = _visit_scope
    visit_ListComp = visit_SetComp = visit_DictComp = visit_GeneratorExp = _visit_scope

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Collect the attributes of a class."""
        enclosing, self._attributes = self._attributes, {}
        for statement in node.body:
            if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
                self._attributes.setdefault(statement.target.id, statement.lineno)
        outside, self._locals = self._locals, None
        self.generic_visit(node)
        self._collect(self._attributes)
        self._attributes, self._locals = enclosing, outside

    def visit_arg(self, node: ast.arg) -> None:
        """Collect a parameter."""
        self._bind(node.arg, node.lineno)

    def visit_Name(self, node: ast.Name) -> None:
        """Collect a local name where it gets a value."""
        if isinstance(node.ctx, ast.Store):
            self._bind(node.id, node.lineno)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> None:
        """Collect the name of a caught exception."""
        if node.name is not None:
            self._bind(node.name, node.lineno)
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Collect an attribute that a method sets."""
        of_self = isinstance(node.value, ast.Name) and node.value.id == "self"
        if of_self and isinstance(node.ctx, ast.Store) and self._attributes is not None:
            self._attributes.setdefault(node.attr, node.lineno)
        self.generic_visit(node)

    def _bind(self, name: str, line: int) -> None:
        if self._locals is not None:
            self._locals.setdefault(name, line)


def bindings_of(source: str, path: Path) -> list[Binding]:
    """Return the local names, parameters and attributes of a file's source."""
    scopes = _Scopes(path)
    scopes.visit(ast.parse(source))
    return scopes.bindings


def bindings(folders: tuple[str, ...] = FOLDERS) -> Iterator[Binding]:
    """Yield the local names, parameters and attributes of all Python files in folders."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield from bindings_of(path.read_text(encoding="utf-8"), path.relative_to(ROOT))


def vague_share(folders: tuple[str, ...] = FOLDERS) -> float:
    """Return the fraction of bindings whose names are vague."""
    counted = Counter(binding.is_vague for binding in bindings(folders))
    return counted[True] / max(1, counted.total())


def main(folders: tuple[str, ...]) -> None:
    """Print the vague names with their places, and the share of each folder."""
    for binding in sorted(bindings(folders)):
        if binding.is_vague:
            print(f"{binding.path}:{binding.line}: {binding.name}")
    for folder in folders:
        print(f"{folder}: {vague_share((folder,)):.2%}")
    print(f"all: {vague_share(folders):.2%}")


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or FOLDERS)
