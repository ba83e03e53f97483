"""Map of a sweep: shares of verified folds, and a page that shows names of strangers as text."""

import json
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from foldback.planner.sweeps.case import Row
from foldback.planner.sweeps.map import SweepMap, write_map
from foldback.planner.sweeps.spec import SweepSpec
from tests.refusal import refused

HOSTILE = """\x1b[31m</script><script>alert(1)</script>"'&<img src=x onerror=alert(2)>"""


def _spec(**axes: str) -> SweepSpec:
    values = {"shapes": {"x": "a", "y": "b"}, "methods": {"a": {}, "b": {}}, "map": axes}
    return SweepSpec.of(values, Path())


def _row(number: int, **values: Any) -> Row:
    plain = {"key": f"{number:024x}", "modules": 8, "planner_digest": "new", "verdict": "failed"}
    return {**plain, "verified": False, "simulated": None, **values}


def _rows(*rows: Row) -> dict[str, Row]:
    return {str(row["key"]): row for row in rows}


def test_picture_shows_shares_of_verified_folds() -> None:
    simulated = {"verified": True, "simulated": True}
    by_kinematics = {"verified": True, "simulated": False}
    rows = [
        *(_row(k, method="a", group="x", **simulated) for k in range(2)),
        *(_row(k, method="a", group="y") for k in range(2)),
        _row(0, method="b", group="x", **simulated),
        _row(0, method="b", group="x"),
        *(_row(k, method="b", group="y", **by_kinematics) for k in range(2)),
        _row(0, method="b", group="y", verdict="refused: strategy-differs"),
    ]
    drawn = ElementTree.fromstring(SweepMap.of(_spec(), rows).picture())
    cells = {
        parts[0].text: [(part.get("class"), part.get("height")) for part in parts[1:]]
        for parts in (list(cell) for cell in drawn.iter() if cell.tag.endswith("}g"))
    }
    assert cells == {
        "2 of 2 verified (simulated)": [("cell", "21"), ("good", "21.0")],
        "1 of 2 verified (simulated)": [("cell", "21"), ("good", "10.5")],
        "2 of 2 verified (kinematics only)": [("cell", "21"), ("kinematics", "21.0")],
        "0 of 2 verified": [("cell", "21"), ("cross", None)],
    }


def test_columns_of_numbers_are_in_order_and_cells_lead_to_their_rows(tmp_path: Path) -> None:
    sizes = (512, 32, 144)
    rows = [_row(k, method="a", group="x", modules=size) for k, size in enumerate(sizes)]
    write_map(tmp_path, _spec(), _rows(*rows), 7, is_running=True)
    page = (tmp_path / "index.html").read_text()
    labels = re.findall(r'class="size"[^>]*>([^<]*)<', page)
    assert labels[:3] == ["32", "144", "512"]
    assert "3 folds computed, 0 verified, 7 left." in page
    assert 'http-equiv="refresh"' in page
    data = _data(page)
    assert [(data["cells"][row[1]], row[0]) for row in data["rows"]] == [
        (f"a, x, {size}", rows[k]["key"]) for k, size in enumerate(sizes)
    ]
    assert len(re.findall(r'href="#cell-\d+"', page)) == 3


def test_newest_planner_alone_is_shown(tmp_path: Path) -> None:
    old = _row(1, method="a", group="x", planner_digest="old", verified=True)
    write_map(tmp_path, _spec(), _rows(old, _row(2, method="a", group="x")), 0, is_running=False)
    page = (tmp_path / "index.html").read_text()
    assert "1 folds computed, 0 verified." in page
    assert "refresh" not in page


def test_names_of_strangers_are_text(tmp_path: Path) -> None:
    spec = SweepSpec.of(
        {"shapes": ["a"], "methods": {HOSTILE: {}}, "map": {"columns": "seed"}}, tmp_path
    )
    row = _row(1, shape=HOSTILE, method=HOSTILE, seed=0, host=HOSTILE, verdict=HOSTILE)
    outside = _row(2, shape="b", method=HOSTILE, seed=1) | {"key": "../../outside"}
    directory = tmp_path / "sweep<b>"
    directory.mkdir()
    (tmp_path / "outside").mkdir()
    write_map(directory, spec, _rows(row, outside), 0, is_running=False)
    page = (directory / "index.html").read_text()
    tags: list[str] = []

    class Tags(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            tags.append(tag)
            assert not [name for name, _ in attrs if name.startswith("on")]

    Tags().feed(page)
    assert tags.count("script") == 2
    assert "img" not in tags and "b" not in tags
    assert _data(page)["rows"][0][2] is False
    assert HOSTILE in _data(page)["rows"][0]
    assert _data(page)["plans"] == {}
    ElementTree.parse(directory / "map.svg")


def test_unknown_column_names_the_nearest() -> None:
    with refused("unknown-column", match="'modul' for the map, expected module"):
        SweepMap.of(_spec(rows="modul"), [_row(1, method="a", group="x")])


def _data(page: str) -> dict[str, Any]:
    match = re.search(r'id="data">(.*?)</script>', page)
    assert match is not None
    return json.loads(match[1])
