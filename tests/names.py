"""``python -m tests.names [FOLDER …]``: list names of values that fit every value, with places.

Counted are local names, parameters and attributes, each once in its function or class, without
``self``, ``cls`` and ``_``.
"""

import re
import symtable
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
CONVENTIONAL: Final = frozenset({"self", "cls", "_", ".0"})
"""Names that are not counted; ``.0`` is the argument of a comprehension."""
OF_SELF: Final = re.compile(r"^ +self\.(\w+)(?:: [^=]+)? = ", re.MULTILINE)


@dataclass(frozen=True, slots=True, order=True)
class Binding:
    """A name in the scope that binds it.

    Attributes:
        path: File, relative to the root of the checkout.
        line: First line of the function, comprehension or class; 1 for attributes that methods set.
        name: The name.
    """

    path: Path
    line: int
    name: str

    @property
    def is_vague(self) -> bool:
        """Return True if the name would fit every value."""
        return self.name.strip("_") in VAGUE


def _names(table: symtable.SymbolTable) -> Iterator[tuple[int, str]]:
    """Yield the names that functions and classes bind, each with the first line of its scope."""
    for scope in table.get_children():
        for symbol in scope.get_symbols():
            bound = symbol.is_parameter() or symbol.is_assigned() or symbol.is_annotated()
            if bound and symbol.is_local() and not symbol.is_namespace():
                yield scope.get_lineno(), symbol.get_name()
        yield from _names(scope)


def bindings_of(source: str, path: Path) -> list[Binding]:
    """Return the local names, parameters and attributes of a file's source."""
    names = [*_names(symtable.symtable(source, str(path), "exec"))]
    names += dict.fromkeys((1, match[1]) for match in OF_SELF.finditer(source))
    return [Binding(path, line, name) for line, name in names if name not in CONVENTIONAL]


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
    """Print the vague names with the lines of their scopes, and the share of each folder."""
    for binding in sorted(bindings(folders)):
        if binding.is_vague:
            print(f"{binding.path}:{binding.line}: {binding.name}")
    for folder in folders:
        print(f"{folder}: {vague_share((folder,)):.2%}")
    print(f"all: {vague_share(folders):.2%}")


if __name__ == "__main__":
    main(tuple(sys.argv[1:]) or FOLDERS)
