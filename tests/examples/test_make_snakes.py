from examples.make_snakes import CUBES, FIGURES, HERE, chains
from foldback.planner.plan.shape_writers import write_chain
from tests.case import case


def test_files_of_snakes_are_up_to_date() -> None:
    labelled = chains()
    assert len(labelled) == len(FIGURES) + len(CUBES)
    for chain, title, tags in labelled:
        with case(title):
            stored = (HERE / "shapes" / f"{chain.name}.json").read_bytes()
            assert write_chain(chain, title=title, tags=tags) == stored
