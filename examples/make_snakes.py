"""Make the gallery's snakes and snake cubes: `python examples/make_snakes.py`.

`planner/twist_chains/figures.json` states their codes, and the collections in which they stand. The
same script makes the same files. `bench/sweeps/gallery.toml` folds them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from foldback.planner.chain.chain import Chain
from foldback.planner.pathfinding.snake_cubes import box_chains
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.twist_chains.figures import known_snake_cube, snake_figure
from foldback.planner.twist_chains.folded_chains import snake_chain

HERE = Path(__file__).parent
FIGURES: Final = (
    *("Ball", "Beetle1", "Candle Stick", "Dog1", "Face", "Flying Boat", "giraffe", "half balls"),
    *("Heart", "Just Squares", "Pyramid", "snowflake", "Swan2", "tie fighter", "triangle"),
    *("turtle", "duck", "cat"),
)
"""Names of the figures in the gallery."""
CUBES: Final = (("wooden, common type A", "Wooden snake cube"), ("Cubra Green", "Green snake cube"))
"""Snake cubes in the gallery: a name each, and the title."""


def chains() -> list[tuple[Chain, str, tuple[str, ...]]]:
    """Return the chains with their titles and tags."""
    labelled: list[tuple[Chain, str, tuple[str, ...]]] = []
    for name in FIGURES:
        figure = snake_figure(name)
        assert figure is not None, f"{name} is a known figure"
        title = name.rstrip("0123456789").capitalize()
        slug = f"snake-{title.lower().replace(' ', '-')}"
        labelled.append((snake_chain(figure.code, name=slug), title, ("snake",)))
    for name, title in CUBES:
        puzzle = known_snake_cube(name)
        assert puzzle is not None, f"{name} is a known snake cube"
        slug = title.lower().replace(" ", "-")
        labelled.append((replace(box_chains(puzzle.sequence)[0], name=slug), title, ("puzzle",)))
    return labelled


def main() -> None:
    """Write the files."""
    for chain, title, tags in chains():
        data = write_chain(chain, title=title, tags=tags)
        (HERE / "shapes" / f"{chain.name}.json").write_bytes(data)


if __name__ == "__main__":
    main()
