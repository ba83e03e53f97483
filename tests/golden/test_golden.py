"""Results of small folds: equal to the stored bits on the same machine, similar on others."""

import json
from functools import cache
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback.planner.pipeline.derived_files import complete
from tests.golden.cases import CASES
from tests.golden.digests import changed_parts, digests
from tests.golden.machine import machine, machine_key
from tests.golden.store import compute, load, summary_differences

pytestmark = pytest.mark.slow
REPEATED_CASE = "blocks"
"""Name of the fold that is computed twice: small, with an explosion and a simulated playback."""
compute_once = cache(compute)


@pytest.mark.parametrize("name", CASES)
def test_fold_gives_the_stored_results(name: str) -> None:
    own_values, everywhere = load(name)
    assert everywhere, f"nothing is stored; run `python -m tests.golden --store {name}`"
    result = compute_once(name)
    reference = everywhere[0] if own_values is None else own_values
    assert summary_differences(reference.summary, result.summary) == []
    if own_values is not None:
        assert changed_parts(own_values.digests, result.digests) == [], (
            f"if this is intended, run `python -m tests.golden --store {name}`"
        )


def test_fold_computed_twice_gives_the_same_bits() -> None:
    first, second = compute_once(REPEATED_CASE), compute(REPEATED_CASE)
    assert changed_parts(first.digests, second.digests) == []
    assert first.summary == second.summary


def test_digests_name_the_part_that_has_changed(tmp_path: FilePath) -> None:
    def write(angle: float, *, seconds: float, version: str, speed: float = 1.0) -> None:
        plan = {"versions": {"foldback": version}, "playback": {"steps": 3, "seconds": seconds}}
        plan["smoothing"] = {"seconds": speed}
        np.savez(tmp_path / "record.npz", angles_rad=[angle, 0.5], seconds=seconds)
        np.savez(tmp_path / "plan.npz", plan=json.dumps(plan))
        (tmp_path / "attempts.json").write_text(json.dumps([{"steps": 3, "seconds": seconds}]))

    write(1.0, seconds=0.1, version="1")
    before = digests(tmp_path)
    write(1.0, seconds=0.2, version="2")
    assert changed_parts(before, digests(tmp_path)) == []
    write(np.nextafter(1.0, 2.0), seconds=0.1, version="1")
    assert changed_parts(before, digests(tmp_path)) == ["record.npz: angles_rad"]
    # The duration of a motion is a result, although it has the name of a wall time.
    write(1.0, seconds=0.1, version="1", speed=2.0)
    assert changed_parts(before, digests(tmp_path)) == ["plan.npz: plan.smoothing"]
    (tmp_path / "attempts.json").unlink()
    assert "attempts.json: 0.steps" in changed_parts(before, digests(tmp_path))


def test_summary_of_another_machine_may_differ_a_little() -> None:
    stored = {"verdict": "verified (simulated)", "steps": 100, "min_clearance": None}
    assert summary_differences(stored, {**stored, "steps": 110}) == []
    assert len(summary_differences(stored, {**stored, "steps": 200})) == 1
    assert len(summary_differences(stored, {**stored, "verdict": "failed"})) == 1
    assert len(summary_differences(stored, {**stored, "min_clearance": 0.05})) == 1


def test_key_changes_with_every_property_of_the_machine() -> None:
    values = machine()
    keys = {machine_key({**values, name: "another"}) for name in values}
    assert len(keys) == len(values)
    assert machine_key(values) == machine_key(dict(reversed(values.items()))) not in keys


@pytest.mark.long
@pytest.mark.parametrize("name", ["prefer-time", "table-stuck"])
def test_number_of_workers_changes_no_bit(name: str, tmp_path: FilePath) -> None:
    CASES[name].fold(tmp_path, workers=2)
    complete(tmp_path)
    assert changed_parts(compute_once(name).digests, digests(tmp_path)) == []
