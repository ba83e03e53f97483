"""Numeric constants: ``python -m bench.constants.counting`` counts them, folder by folder.

A numeric constant is a name in capitals that a module assigns outside of functions and classes and
whose value is a number, a computation with numbers and such names, or a tuple, list or dictionary
of them. Other names for a constant, and tuples of names alone, do not count.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("planner", "server", "web", "words", "cli", "client")


def numeric_constants(source: str) -> Iterator[str]:
    """Yield the names of a module's numeric constants."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.AnnAssign):
            target, value = node.target, node.value
        elif isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        else:
            continue
        if not (isinstance(target, ast.Name) and target.id.isupper() and value):
            continue
        if _is_numeric(value) and any(map(_is_number, ast.walk(value))):
            yield target.id


def _is_number(value: ast.AST) -> bool:
    return isinstance(value, ast.Constant) and type(value.value) in {int, float}


def _is_numeric(value: ast.expr) -> bool:
    match value:
        case ast.Constant():
            return _is_number(value)
        case ast.Name(id=name):
            return name.isupper()
        case ast.Attribute(attr=name):
            return name in {"pi", "inf"}
        case ast.UnaryOp(operand=operand):
            return _is_numeric(operand)
        case ast.BinOp(left=left, right=right):
            return _is_numeric(left) and _is_numeric(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Dict(values=parts):
            return bool(parts) and all(map(_is_numeric, parts))
        case ast.Call(func=ast.Name() | ast.Attribute(value=ast.Name()), args=parts):
            return bool(parts) and all(map(_is_numeric, parts))
        case _:
            return False


def main() -> None:
    """Print the number of numeric constants of each folder, and of all."""
    counts = Counter(
        str(path.parent)
        for package in PACKAGES
        for path in Path(package).rglob("*.py")
        for _ in numeric_constants(path.read_text(encoding="utf-8"))
    )
    for folder, count in counts.most_common():
        print(f"{count:5} {folder}")
    print(f"{counts.total():5} in all")


if __name__ == "__main__":
    main()
