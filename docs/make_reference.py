"""Make the reference of the Python library: pages in out/reference, from docstrings, with pdoc.

Run it by ``make docs``.
"""

from __future__ import annotations

import ast
import inspect
import warnings
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

import pdoc.doc
import pdoc.render

ROOT: Final = Path(__file__).parents[1]
OUT: Final = ROOT / "out" / "reference"
MODULES: Final = ("foldback", "foldback.viewer")
HEADING: Final = "## Ten lines of Python\n"
PUBLIC_MARK: Final = "\n\n@public"
"""Makes pdoc include a name that begins with underscores."""
INDEX: Final = '<!doctype html><meta http-equiv="refresh" content="0; url=foldback.html">'
"""Page that forwards to the reference of ``foldback``."""
BEGIN, END = "```python\n", "```\n"


def example() -> str:
    """Return the ten lines of Python in the README."""
    _, _, section = (ROOT / "README.md").read_text(encoding="utf-8").partition(HEADING)
    _, _, code = section.partition(BEGIN)
    return code.partition(END)[0]


def value_docstring(module: ModuleType, name: str) -> str:
    """Return the docstring below the assignment of a name, which Python itself discards."""
    tree = ast.parse(inspect.getsource(module))
    for node, following in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(node, ast.ImportFrom) and name in [alias.name for alias in node.names]:
            return value_docstring(import_module(str(node.module)), name)
        if (
            isinstance(node, ast.AnnAssign)
            and isinstance(node.target, ast.Name)
            and node.target.id == name
            and isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
        ):
            return str(following.value.value)
    for node in tree.body:
        if isinstance(node, ast.If):  # imports for type checkers only
            for statement in node.body:
                if isinstance(statement, ast.ImportFrom) and name in [
                    a.name for a in statement.names
                ]:
                    return value_docstring(import_module(str(statement.module)), name)
    return ""


def documented(name: str) -> pdoc.doc.Module:
    """Return the pdoc module for a module, with the docstrings of its values."""
    module = import_module(name)
    for public in module.__all__:  # loads names that are imported on first use
        setattr(module, public, getattr(module, public))
    doc_module = pdoc.doc.Module(module)
    for member in doc_module.members.values():
        if isinstance(member, pdoc.doc.Variable):
            member.docstring = value_docstring(module, member.name)
        if isinstance(member, pdoc.doc.Class) and "__call__" in member.members:
            member.members["__call__"].docstring += PUBLIC_MARK
    if name == MODULES[0]:
        doc_module.docstring += f"\n\n{HEADING}\n{BEGIN}{example()}{END}"
    return doc_module


def make(out: Path) -> None:
    """Write the pages into a folder."""
    pdoc.render.configure(docformat="google", show_source=False, footer_text="foldback")
    modules = {name: documented(name) for name in MODULES}
    pages = {
        f"{name.replace('.', '/')}.html": pdoc.render.html_module(module, modules)
        for name, module in modules.items()
    }
    pages["index.html"] = INDEX
    pages["search.js"] = pdoc.render.search_index(modules)
    for name, text in pages.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text, encoding="utf-8")


def main() -> None:
    """Write the pages; a warning about a docstring is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make(OUT)
    print(OUT.relative_to(ROOT) / "index.html")


if __name__ == "__main__":
    main()
