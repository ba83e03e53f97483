"""The rooms of the code: each of a size to live in, each importing from lower floors only."""

from __future__ import annotations

import re

import pytest

from docs.make_house import (
    COLUMNS,
    ELSEWHERE,
    FLOOR_OF,
    PAGE,
    PICTURE,
    ROOT,
    about,
    drawn,
    imports,
    modules,
    room_of,
    with_table,
)
from tests.case import case

FEWEST, MOST = 5, 25
ROOMS = [room for room in FLOOR_OF if room not in COLUMNS and modules()[room].name == "__init__.py"]


def test_imports_point_to_lower_floors() -> None:
    up = [
        f"{each.module} imports {each.imported}"
        for each in imports()
        if (room := room_of(each.module)) is not None
        and (other := room_of(each.imported)) not in (None, room)
        and FLOOR_OF[str(other)] >= FLOOR_OF[room]
        and each.module != "planner"  # hands on the names of all rooms, each when it is asked for
    ]
    assert up == []


def test_packages_have_a_purpose_and_5_to_25_files() -> None:
    for room in ROOMS:
        with case(room):
            files = [path for path in modules()[room].parent.iterdir() if path.is_file()]
            assert FEWEST <= len(files) <= MOST
            assert about(room).endswith(".")


def test_all_packages_have_a_floor() -> None:
    folders = {".".join(p.parent.relative_to(ROOT).parts) for p in modules().values()}
    named = {f for f in folders if not f.startswith(ELSEWHERE) and f not in COLUMNS}
    assert named == set(ROOMS)


@pytest.mark.parametrize("folder", ["tests", "bench", "examples", "docs", "web/static/js"])
def test_other_folders_have_at_most_25_files(folder: str) -> None:
    for path in (ROOT / folder, *(ROOT / folder).rglob("*")):
        if path.is_dir() and path.name not in ("__pycache__", "shapes", "snapshots"):
            assert len([p for p in path.iterdir() if p.is_file()]) <= MOST, path


def test_house_page_and_picture_are_current() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert with_table(page) == page, "run `python -m docs.make_house`"
    assert drawn() == PICTURE.read_text(encoding="utf-8"), "run `python -m docs.make_house`"


def test_paths_on_the_house_page_exist() -> None:
    page, _, _ = PAGE.read_text(encoding="utf-8").partition("<!-- rooms -->")
    named = [name for name in re.findall(r"`([\w./]+)`", page) if "/" in name]
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []
