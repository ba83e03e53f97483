"""The stored chain files of robots, and the script that makes them."""

from collections import Counter

from examples.make_robots import HERE, chains
from foldback.planner.plan.shape_writers import write_chain


def test_stored_files_are_those_of_the_script() -> None:
    labelled = chains()
    for chain, title, tags in labelled:
        stored = (HERE / "shapes" / f"{chain.name}.json").read_bytes()
        assert write_chain(chain, title=title, tags=tags) == stored
        assert len(chain) >= 8
        assert chain.module.document["source"]
    robots = Counter(chain.module.name for chain, _, _ in labelled)
    assert robots == dict.fromkeys(("sea-snake", "yamor", "molecube", "polybot-g2", "rofi"), 3)
