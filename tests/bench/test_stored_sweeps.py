"""Stored sweeps: results of the gallery and rows of the success map, current and complete."""

import hashlib
import json
from typing import Any

import pytest

from bench.shape_files import SHAPES
from bench.stored_sweeps import FOLD, MAP_ROWS, PICTURE, RESULTS, map_of, results_of

pytestmark = pytest.mark.slow


def stored_results(name: str) -> dict[str, dict[str, Any]]:
    """Return the stored results by shape, which belong to the files of the shapes."""
    results = json.loads(RESULTS[name].read_bytes())["shapes"]
    for shape, result in results.items():
        data = (SHAPES / f"{shape}.json").read_bytes()
        assert hashlib.sha256(data).hexdigest().startswith(result["digest"]), shape
    return results


def test_stored_results_are_verified_mostly_at_the_first_attempt() -> None:
    results = stored_results("gallery")
    assert set(results) == {file.stem for file in SHAPES.glob("*.json")}
    assert all(result["verified"] for result in results.values())
    at_once = sum(result["attempts"] == 1 for result in results.values())
    assert at_once >= 0.98 * len(results)
    assert all(result["clearance"] >= 0.0 for result in results.values())


def test_stored_results_on_tables_rest_within_the_torque() -> None:
    results = stored_results("table")
    cubes = {shape: len(path_cells(shape)) for shape in results}
    assert all(1 <= count <= 64 for count in cubes.values())
    torques = [result["torque_wp"] for result in results.values() if result["verified"]]
    assert torques and all(0.0 <= torque <= 8.0 for torque in torques)


def test_attempts_of_all_seeds_are_counted() -> None:
    about = {"shape": "a", "modules": 8, "verdict": "", "cpu_s": 1.0, "shape_digest": "0"}
    rows = [
        {**about, "seed": 1, "verified": True, "attempts": 2},
        {**about, "seed": 0, "verified": False, "attempts": 6},
    ]
    (result,) = results_of(rows).values()
    assert (result["seed"], result["verified"], result["attempts"]) == (1, True, 8)


def test_success_map_is_drawn_from_its_stored_rows() -> None:
    rows = [json.loads(line) for line in MAP_ROWS.read_text(encoding="utf-8").splitlines()]
    assert len({tuple(row[column] for column in FOLD) for row in rows}) == len(rows) == 757
    assert map_of(rows) == PICTURE.read_text(encoding="utf-8")


def path_cells(shape: str) -> list[Any]:
    return json.loads((SHAPES / f"{shape}.json").read_bytes())["cells"]
