"""What people want to do with a fold, and the citation of a fold."""

import re
import tomllib
from pathlib import Path

import yaml

from foldback.words.citation import AUTHOR, PAPER_TITLE, bibtex
from foldback.words.fold import ShownFold
from foldback.words.purposes import FileName, purposes_of

ROOT = Path(__file__).parents[2]
FOLD = ShownFold(
    id="a1b2c3d4e5f6",
    name="50 % {odd}_name & #1 \\",
    status="verified",
    modules=24,
    preset="default",
    seed=0,
    renamed=True,
    created_at=1_700_000_000.0,
)


def test_each_purpose_has_one_file() -> None:
    files: dict[FileName, str] = {
        name: f"/{name}" for name in ("html", "mjcf", "trajectory", "leaflet", "stl", "npz")
    }
    answers = {purpose["name"]: purpose["href"] for purpose in purposes_of(FOLD, files)}
    assert answers == {
        "show": "/html",
        "simulate": "/mjcf",
        "drive": "/trajectory",
        "print": "/stl",
        "cite": None,
        "check": "/npz",
    }
    assert list(answers)[-2:] == ["cite", "check"]
    few = purposes_of(FOLD, {"html": "/html"})
    assert [purpose["name"] for purpose in few] == ["show", "cite"]
    assert purposes_of(FOLD, {}) == []


def test_bibtex_has_balanced_braces_and_no_sign_of_tex() -> None:
    text = bibtex(FOLD, address="https://example.org/folds/a1b2c3d4e5f6", version="0.1.0")
    fold, paper = text.split("\n\n")
    assert fold.startswith("@misc{foldback-a1b2c3d4,\n")
    assert r"title = {{50 \% \textbraceleft odd\textbraceright \_name \& \#1 " in fold
    assert "a folding motion of 24 cubes}}," in fold
    assert "year = {2023}," in fold
    assert r"howpublished = {\url{https://example.org/folds/a1b2c3d4e5f6}}," in fold
    assert "note = {Computed on 2023-11-14 with foldback 0.1.0}," in fold
    for entry in (fold, paper):
        assert entry.count("{") == entry.count("}")
        assert re.fullmatch(r"@misc\{[a-z0-9-]+,\n(  [a-z]+ = \{.*\},\n)+\}\n?", entry)
    assert PAPER_TITLE in paper


def test_citation_file_states_the_version_and_the_authors() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    values = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert values["cff-version"] == "1.2.0"
    assert (values["title"], values["version"]) == (project["name"], project["version"])
    assert values["license"] == project["license"]
    assert values["authors"] == project["authors"] == [{"name": AUTHOR}]
    assert {"message", "type"} <= values.keys()
    assert PAPER_TITLE in values["abstract"]
