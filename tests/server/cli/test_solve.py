"""``foldback solve`` and codes as inputs of ``foldback fold``."""

from pathlib import Path

import pytest

from foldback.cli.inputs import read_input
from foldback.planner.chain.chain import Chain
from foldback.planner.readers import read
from foldback.planner.twist_chains.folded_chains import cube_sequence_of
from tests.refusal import refused
from tests.server.cli.test_command_line import foldback, foldback_json

WOODEN = "001010101111010111011011100"


def test_solve_a_known_cube_and_write_its_chain(tmp_path: Path) -> None:
    out = tmp_path / "solved.json"
    answer = foldback_json("solve", "cubra blue", "--all", "--out", str(out))
    assert (answer["status"], answer["is_complete"]) == ("solved", True)
    (solution,) = answer["solutions"]
    assert solution["sequence"] == WOODEN
    assert len(solution["cells"][0]) == 27
    chain = read(out.read_bytes())
    assert isinstance(chain, Chain)
    sequence = cube_sequence_of(chain)
    assert sequence is not None
    assert sequence.text() == WOODEN
    printed = foldback("solve", "--into", "3x3x3", "--into", "1x3x9", "--corners", "16").stdout
    assert "27, of which 16 corners" in printed
    assert printed.count("Solution ") == 2


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("--into", "2x3x3", "--corners", "5"), 3, "all ways were tried"),
        (("--into", "5x5x5", "--corners", "123", "--max-steps", "1000"), 3, "--max-steps"),
        (("3,3,3",), 2, "runs:, legs:, run-and-legs:"),
        ((WOODEN, "--into", "2x2x2"), 2, "27 pieces and a solid of 8 cells"),
        ((WOODEN, "--corners", "3"), 2, "16"),
        (("kevs",), 2, "Kev's Kubes"),
        ((), 2, "0 solids"),
        (("--into", "99x99x99"), 2, "1000 cells"),
        (("--into", "no-such-file"), 2, "name of one of"),
    ],
)
def test_without_a_solution(arguments: tuple[str, ...], status: int, words: str) -> None:
    answer = foldback("solve", *arguments)
    assert answer.returncode == status
    assert words in " ".join((answer.stdout + answer.stderr).split())


def test_codes_and_names_as_inputs() -> None:
    data, filename = read_input(None, snake="candle_stick")
    assert (data, filename) == (b"24 prisms digits: 32301230121232301230121", "Candle Stick.txt")
    data, filename = read_input(None, snake="DLURD")
    assert (data, filename) == (b"6 prisms digits: 01230", "snake.txt")
    assert read_input(None, snake_cube="3 2 2 3 2 3 2 2 3 3 2 2 2 3 3 3 3")[0] == (
        f"cube: {WOODEN[::-1]}".encode()
    )
    assert read_input("Half balls")[1] == "half balls.txt"
    assert read_input("kev's kubes")[0].startswith(b"cube: 0011")
    assert read_input("digits: 0132")[0] == b"digits: 0132"
    with refused("no-file"):
        read_input("no such figure")
    for arguments in ({}, {"snake": "0", "snake_cube": "0"}, {"angles": "0", "snake": "0"}):
        with refused("no-input"):
            read_input(None, **arguments)
    with refused("bad-code", match="half balls"):
        read_input(None, snake="Balll")
    with refused("overlap"):
        read_input(None, snake="2222")
    with refused("bad-code", match="expected one of: digits"):
        read_input(None, snake="cube: 010")
