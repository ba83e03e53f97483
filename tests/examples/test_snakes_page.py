"""docs/snakes.md: its examples can be read, and it names all notations."""

import re
from pathlib import Path

from foldback.cli.inputs import read_input
from foldback.planner.readers.twist_codes import EXAMPLES, read_twist_code
from tests.case import case

PAGE = (Path(__file__).parents[2] / "docs" / "snakes.md").read_text(encoding="utf-8")
ROWS = dict(re.findall(r"^\| `([a-z-]+)` \| `([^`]+)` \|", PAGE, re.MULTILINE))


def test_all_notations_are_described_with_an_example() -> None:
    assert ROWS.keys() == EXAMPLES.keys()
    for name, example in ROWS.items():
        with case(name):
            assert read_twist_code(f"{name}: {example}") == read_twist_code(EXAMPLES[name])


def test_inputs_of_the_commands_are_readable() -> None:
    for option, value in re.findall(r"fold --(snake|snake-cube) (\S+)", PAGE):
        with case(value):
            read_input(None, **{option.replace("-", "_"): value})
