"""Pages of the documentation: their links, files and programs exist, and their words are known."""

import re
from pathlib import Path

from tests.case import case
from tests.run_python import ROOT

PAGES = {
    page: page.read_text(encoding="utf-8")
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"))
    if page.name != "CHANGELOG.md"
}
HAND_OVER = PAGES[ROOT / "docs" / "hand-over.md"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")
FOLDERS = (
    *("planner", "web", "words", "cli", "server", "client", "foldback"),
    *("tests", "bench", "docs", "examples", "deploy"),
)
ROOTS = "|".join(FOLDERS)
NAMED_FILE = re.compile(rf"`((?:{ROOTS})/[\w./-]+)`")
SCRIPT = re.compile(r"`([\w-]+\.(?:py|js))`")
PROGRAM = re.compile(rf"python -m ((?:{ROOTS})\.[\w.]+)")
TARGET = re.compile(r"`make ([a-z-]+)")
NOT_THERE = {"planner/x.py", "foldback/planner/x.py", "deploy/.env"}
"""Files that a page gives as examples, or asks its reader to make."""


def anchors(text: str) -> set[str]:
    """Return the anchors of a page's headings."""
    plain = re.sub(r"\[([^]]*)\]\([^)]*\)|[`*]", r"\1", text)
    headings = re.findall(r"^#+ (.*)$", plain, re.MULTILINE)
    return {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}


def exists(name: str) -> bool:
    """Return True if a file, a folder, or a component without its ending exists."""
    return (ROOT / name).exists() or (ROOT / f"{name}.py").exists() or name in NOT_THERE


def test_links_lead_to_pages_and_headings() -> None:
    links = 0
    for page, text in PAGES.items():
        for name, anchor in LINK.findall(text):
            links += 1
            target = (page.parent / name).resolve() if name else page
            with case(f"{page.name}: {name}#{anchor}"):
                assert target.exists()
                assert not anchor or anchor in anchors(target.read_text(encoding="utf-8"))
    assert links > 100


def test_files_programs_and_targets_exist() -> None:
    scripts = {p.name for f in FOLDERS for p in (ROOT / f).rglob("*.*")}
    scripts |= {path.name for path in ROOT.glob("*.py")}
    for page, text in PAGES.items():
        files, programs = NAMED_FILE.findall(text), PROGRAM.findall(text)
        wrong = [name for name in files if not exists(name)]
        wrong += [name for name in SCRIPT.findall(text) if name not in scripts]
        wrong += [name for name in programs if not exists(name.replace(".", "/"))]
        wrong += [name for name in TARGET.findall(text) if f"\n{name}:" not in MAKEFILE]
        with case(page.name):
            assert wrong == []
    assert len(NAMED_FILE.findall(HAND_OVER)) > 40


def test_words_stand_in_the_files_that_explain_them() -> None:
    rows = re.findall(r"^\| (\*\*.*\*\*.*) \| `([\w./]+)` \|$", HAND_OVER, re.MULTILINE)
    assert len(rows) > 20
    for row, file in rows:
        text = Path(ROOT / file).read_text(encoding="utf-8").lower()
        for word in re.findall(r"\*\*(.+?)\*\*", row):
            with case(f"{word} in {file}"):
                assert word in text or word.replace(" ", "_") in text
