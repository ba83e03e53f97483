"""Page for new maintainers: its words stand in the code, its files and commands exist."""

import re
from importlib.util import find_spec

from tests.case import case
from tests.run_python import ROOT

PAGE = (ROOT / "docs" / "hand-over.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def test_words_stand_in_the_files_that_explain_them() -> None:
    rows = re.findall(r"^\| (\*\*.*\*\*.*) \| `([\w./]+)` \|$", PAGE, re.MULTILINE)
    assert len(rows) > 20
    for row, file in rows:
        text = (ROOT / file).read_text(encoding="utf-8").lower()
        for word in re.findall(r"\*\*(.+?)\*\*", row):
            with case(f"{word} in {file}"):
                assert word in text or word.replace(" ", "_") in text


def test_files_and_folders_exist() -> None:
    for name in re.findall(r"`([\w./-]+/[\w./-]*)`", PAGE):
        with case(name):
            assert (ROOT / name).exists()


def test_commands_exist() -> None:
    modules = re.findall(r"`python -m ([\w.]+)", PAGE)
    targets = re.findall(r"`make ([a-z-]+)`", PAGE)
    assert len(modules) > 10
    assert len(targets) >= 3
    for module in modules:
        with case(module):
            assert find_spec(module) is not None
    for target in targets:
        with case(target):
            assert f"\n{target}:" in MAKEFILE
