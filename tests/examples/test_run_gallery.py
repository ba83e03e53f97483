import pytest

from examples.run_gallery import SHAPES, digest, known, suited

pytestmark = pytest.mark.slow

FILES = sorted(SHAPES.glob("*.json"))


def test_stored_results_belong_to_the_shape_files() -> None:
    assert {file.stem: digest(file) for file in FILES} == {
        name: result["digest"] for name, result in known().items()
    }


def test_stored_results_are_verified_mostly_at_the_first_attempt() -> None:
    results = known()
    assert all(result["verified"] for result in results.values())
    at_once = sum(result["attempts"] == 1 for result in results.values())
    assert at_once >= 0.98 * len(results)
    assert all(result["clearance"] >= 0.0 for result in results.values())


def test_stored_results_on_tables_belong_to_the_shape_files() -> None:
    results = known("table")
    assert set(results) <= {file.stem for file in FILES if suited(file, "table")}
    for name, result in results.items():
        assert result["digest"] == digest(SHAPES / f"{name}.json")
        if result["verified"]:
            assert 0.0 <= result["torque_wp"] <= 8.0
            assert result["friction"] == 0.0
