"""Sweeps: rows of all folds, once each; later runs compute only what is missing."""

import json
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.run import run_cases
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.sweep import SweepState
from foldback.sweeps import Sweep
from tests.refusal import refused

BAR = b"[[0,0,0],[1,0,0],[1,1,0],[0,1,0]]"


def _sweep(**values: Any) -> Sweep:
    return Sweep([("bar.json", BAR), ("none.json", b"[]")], **values)


def test_sweep_has_a_row_for_each_fold(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        sweep = _sweep(seeds=range(2), keep={"plans": "all"})
        table = sweep.run(tmp_path, executor=pool)
        assert table.num_rows == 4
        rows = {(row["shape"], row["seed"]): row for row in table.to_pylist()}
        assert rows["bar", 1]["verified"]
        assert rows["bar", 1]["modules"] == 4
        assert rows["bar", 1]["clearance_bound_pitch"] > 0.0
        assert rows["none", 0]["verdict"].startswith("refused")
        assert (tmp_path / "plans" / rows["bar", 0]["key"] / "plan.npz").exists()
        assert len((tmp_path / "results.csv").read_text().splitlines()) == 5
        assert (
            list(_sweep(seeds=range(2), keep={"plans": "all"}).rows(tmp_path, executor=pool)) == []
        )
        metadata = pq.read_schema(tmp_path / "results.parquet").metadata
        assert metadata[b"format"] == b"foldback-sweep/1"
        assert json.loads(metadata[b"spec"])["seeds"] == "0-1"


def test_missing_rows_and_repeated_verdicts_are_computed(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        first = next(iter(_sweep(seeds=1).rows(tmp_path, executor=pool)))
        rest = list(_sweep(seeds=1).rows(tmp_path, executor=pool))
        assert sorted(row["shape"] for row in (first, *rest)) == ["bar", "none"]
        again = list(_sweep(seeds=1).rows(tmp_path, executor=pool, again=["refused"]))
    assert [row["shape"] for row in again] == ["none"]
    assert len(Rows(tmp_path).read()) == 2


def test_directory_of_another_sweep_is_refused(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        list(_sweep(seeds=1).rows(tmp_path, executor=pool))
        with refused("another-sweep", match="seeds is 1 there and 2 here"):
            list(_sweep(seeds=2).rows(tmp_path, executor=pool))


def test_table_has_only_the_folds_of_the_present_spec(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        for wall_s in (50, 60):
            (tmp_path / "sweep.toml").unlink(missing_ok=True)
            sweep = Sweep([("none.json", b"[]")], budget={"wall_s": wall_s})
            assert sweep.run(tmp_path, executor=pool).num_rows == 1
    assert len(Rows(tmp_path).read()) == 2


def test_sweep_of_another_planner_is_refused(tmp_path: Path) -> None:
    """A worker of a cluster may have another version of foldback."""
    spec = SweepSpec.of({"shapes": [("none.json", b"[]")]}, tmp_path)
    with ThreadPoolExecutor(1) as pool, SweepState.opened(spec, tmp_path) as state:
        (fold,) = state.missing()
        other = replace(fold, planner_digest="other")
        with pytest.raises(BrokenExecutor, match="the same version of foldback"):
            list(run_cases([other], state.add, pool, at_once=1))
    assert Rows(tmp_path).read() == {}


def test_page_that_plays_an_earlier_plan_goes(tmp_path: Path) -> None:
    spec = SweepSpec.of({"shapes": [("none.json", b"[]")]}, tmp_path)
    with SweepState.opened(spec, tmp_path) as state:
        (fold,) = state.missing()
        page = tmp_path / "players" / "folds" / f"{fold.key}.html"
        page.parent.mkdir(parents=True)
        page.touch()
        state.add({"key": fold.key, **fold.columns, "verdict": "failed"})
    assert not page.exists()


def test_one_verdict_may_be_repeated_by_its_name(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        sweep = Sweep([("none.json", b"[]")])
        list(sweep.rows(tmp_path, executor=pool))
        assert list(sweep.rows(tmp_path, executor=pool, again="error")) == []


def test_later_seeds_wait_for_a_verified_plan(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        rows = list(_sweep(seeds="0-2", until="verified").rows(tmp_path, executor=pool))
    assert sorted((row["shape"], row["seed"]) for row in rows) == [
        *[("bar", 0)],
        *[("none", 0), ("none", 1), ("none", 2)],
    ]


def test_second_command_on_a_directory_is_refused(tmp_path: Path) -> None:
    with Rows(tmp_path).writing() as add:
        add({"key": "a", "verdict": "verified"})
        with refused("in-use", match="another foldback sweep"), Rows(tmp_path).writing():
            pass


def test_torn_line_is_ignored_and_a_damaged_one_named(tmp_path: Path) -> None:
    rows = Rows(tmp_path)
    with rows.writing() as add:
        add({"key": "a", "verdict": "failed"})
    with rows.files()[0].open("ab") as file:
        file.write(b'{"key":"b","ver')
    with rows.writing() as add:
        add({"key": "a", "verdict": "verified"})
    assert rows.read() == {"a": {"key": "a", "verdict": "verified"}}
    with rows.files()[0].open("ab") as file:
        file.write(b"\n")
    with refused("damaged-rows", match="line 2"):
        rows.read()
