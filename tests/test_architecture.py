"""Architecture: components with one purpose, which import from lower layers, without circles."""

import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from docs import make_architecture as made
from tests import names
from tests.case import case

FOLDERS = [
    c for c in made.LAYER_OF if c not in made.COLUMNS and made.modules()[c].name == "__init__.py"
]

MAX_VAGUE_SHARES = {names.FOLDERS[:2]: 0.01, names.FOLDERS[2:]: 0.01} | {
    (folder,): 0.01 for folder in ("words", "cli", "server", "client", "tests")
}
"""Largest fractions of local names, parameters and attributes that fit every value."""


def test_imports_point_to_lower_layers() -> None:
    up = [
        f"{file_import.module} imports {file_import.imported}"
        for file_import in made.imports()
        if (component := made.component_of(file_import.module)) is not None
        and (imported_component := made.component_of(file_import.imported)) not in (None, component)
        and made.LAYER_OF[str(imported_component)] >= made.LAYER_OF[component]
    ]
    assert up == [], "move what is shared to a lower layer, or change LAYERS of make_architecture"


def test_no_files_import_each_other() -> None:
    # Also not for their types alone: a file states as a protocol what it needs of its caller.
    below = {module: set[str]() for module in made.modules()}
    for file_import in made.imports():
        below[file_import.module].add(file_import.imported)
    try:
        TopologicalSorter(below).prepare()
    except CycleError as error:
        circle = " → ".join(error.args[1])
        raise AssertionError(
            f"files import each other in a circle: {circle}; put what both need into a file below, "
            "or state as a protocol what one needs of the other"
        ) from None


def test_packages_have_a_purpose() -> None:
    for component in FOLDERS:
        with case(component):
            assert made.summary_of(component).endswith("."), "its __init__.py starts with a purpose"


def test_all_packages_have_a_layer() -> None:
    folders = {".".join(p.parent.relative_to(made.ROOT).parts) for p in made.modules().values()}
    named = {f for f in folders if not f.startswith(made.ELSEWHERE) and f not in made.COLUMNS}
    assert named == set(FOLDERS), "add the folder to LAYERS of docs/make_architecture.py"


def test_page_and_picture_are_current() -> None:
    page = made.PAGE.read_text(encoding="utf-8")
    assert made.with_rows(page) == page, "run `python -m docs.make_architecture`"
    assert made.draw() == made.PICTURE.read_text(encoding="utf-8"), (
        "run `python -m docs.make_architecture`"
    )


def test_no_constant_is_only_said_to_be_chosen() -> None:
    folders = (made.ROOT / name for name in ("bench", "docs", "examples", "tests"))
    sources = (path for folder in folders for path in folder.rglob("*.py"))
    scripts = (made.ROOT / "web" / "static").rglob("*.js")
    for path in (*made.modules().values(), *sources, *scripts):
        with case(str(path)):
            match = re.search(r"\bChosen\b[.:;]", path.read_text(encoding="utf-8"))
            assert match is None, "say what the number is and its unit: CONTRIBUTING.md, Style"


def test_names_say_what_they_hold() -> None:
    for folders, limit in MAX_VAGUE_SHARES.items():
        with case(", ".join(folders)):
            assert names.vague_share(folders) < limit, "run `python -m tests.names`"


def test_vague_names_are_counted_once_per_scope() -> None:
    source = (
        "class A:\n  found: int\n  def f(self, told):\n    told = [one for one in told]\n"
        "    self.kept = told\n"
    )
    bindings = sorted((b.line, b.name) for b in names.bindings_of(source, Path("a.py")))
    assert bindings == [(1, "found"), (1, "kept"), (3, "told"), (4, "one")]


def test_sentences_are_not_parsed() -> None:
    """Verdicts, reasons and errors are values, see docs/decisions/0046-reasons.md."""
    scripts = (made.ROOT / "web" / "static").rglob("*.js")
    for path in (*made.modules().values(), *scripts):
        with case(str(path)):
            text = path.read_text(encoding="utf-8")
            sentence = re.search(r"starts?_?[wW]ith\(\s*[\"'](verified|failed)", text)
            assert sentence is None, "compare a code or a boolean: docs/decisions/0046-reasons.md"
    for path in (made.ROOT / "words").rglob("*.py"):
        if path.name != "fold.py":  # parses names of example shapes
            with case(str(path)):
                patterns = re.search(r"^(?:import|from) re\b", path.read_text("utf-8"), re.M)
                assert patterns is None, "take values from a code's values, not from a sentence"
