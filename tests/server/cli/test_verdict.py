"""``foldback verdict``: codes, names and files of figures, and files of proofs."""

from pathlib import Path

from foldback import foldback_check_exhaustion
from tests.server.cli.test_command_line import foldback, foldback_json


def test_a_figure_by_name_with_the_file_of_its_proof(tmp_path: Path) -> None:
    file = tmp_path / "proof.json"
    answer = foldback_json("verdict", "lightsabre", "--file", str(file))
    assert answer["verdict"] == "smaller-modules"
    assert answer["text"][0].startswith("One joint at a time leads there with smaller prisms")
    assert answer["no_single_turns"] == {"first_module": 4, "modules": 5, "states": 1}
    assert foldback_check_exhaustion.check(str(file))["verdict"] == "proved"


def test_a_figure_by_its_code_from_another_one() -> None:
    printed = foldback("verdict", "digits: 00210", "--from", "digits: 12000").stdout
    assert printed == "One joint at a time leads there: 6 quarter turns.\n"


def test_refusals_name_modules_and_counts(tmp_path: Path) -> None:
    path = tmp_path / "cells.json"
    path.write_text('{"format": "foldback-path/1", "cells": [[0,0,0],[1,0,0],[2,0,0]]}')
    for arguments, words in (
        (("digits: 02220",), "prisms 1 and 5"),
        (("digits: 0021", "--from", "digits: 00210"), "got figures of 6 prisms and 5 prisms"),
        ((str(path),), "expected a chain"),
    ):
        answer = foldback("verdict", *arguments)
        assert answer.returncode == 2
        assert words in " ".join(answer.stderr.split())
