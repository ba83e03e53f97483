"""The stored chain files of robots, and the script that makes them."""

from pathlib import Path

import pytest

from examples import make_robots
from foldback.planner.chain.chain import Chain
from foldback.planner.readers.formats import read


def test_stored_files_are_those_of_the_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = make_robots.ROBOTS
    monkeypatch.setattr(make_robots, "ROBOTS", tmp_path / "robots")
    make_robots.main()
    names = sorted(path.name for path in (tmp_path / "robots").iterdir())
    assert names == sorted(path.name for path in stored.iterdir())
    robots: dict[str, int] = {}
    for name in names:
        data = (tmp_path / "robots" / name).read_bytes()
        assert data == (stored / name).read_bytes()
        chain = read(data)
        assert isinstance(chain, Chain) and len(chain) >= 8
        assert chain.module.document["source"]
        robots[chain.module.name] = robots.get(chain.module.name, 0) + 1
    assert robots == dict.fromkeys(("sea-snake", "yamor", "molecube", "polybot-g2", "rofi"), 3)
