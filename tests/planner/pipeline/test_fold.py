from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.errors import InputError
from planner.explosion.simultaneous import explode
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.parameters.explosion import ExplosionParameters
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.fold import fold, refold, smooth_plan
from planner.pipeline.job import Result, Search
from planner.plan.plan import Plan
from tests.planner.chains import SQUARE, coil, line
from tests.planner.conftest import SHAPES
from tests.planner.peels import snake
from tests.planner.pipeline.test_parallel import timeless

Array = NDArray[np.float64]
PAPER = {
    *("box-4x4x4", "box-6x6x6"),
    *("mallet-24", "mallet-64", "mallet-80", "mallet-160", "mallet-192"),
    *("wrench-24", "wrench-80", "wrench-94", "wrench-160"),
}


def test_every_shape_of_the_paper_is_folded_here() -> None:
    # Those of the gallery carry tags. `make test-long` folds and replays all.
    untagged = {
        path.stem for path in SHAPES.glob("*.json") if "tags" not in json.loads(path.read_bytes())
    }
    assert untagged == PAPER


@pytest.mark.parametrize(
    "modules", [3, 7, *(pytest.param(n, marks=pytest.mark.long) for n in (4, 5))]
)
def test_the_smallest_chains_fold(modules: int) -> None:
    plan = fold(coil(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert plan.joint_angles_rad.shape[1] == 2 * (modules - 2)


@pytest.mark.parametrize("modules", [pytest.param(3, marks=pytest.mark.long), 10])
def test_a_line_has_nothing_to_fold(modules: int) -> None:
    plan = fold(line(modules))
    assert plan.certificate.verdict == "verified (simulated)"
    assert np.abs(plan.joint_angles_rad).max() < 1e-6


def test_a_directory_is_made_and_filled(tmp_path: FilePath) -> None:
    plan = fold(coil(8), directory=tmp_path / "a" / "b", seed=5, module_size=0.9)
    assert plan.seed == 5
    assert plan.certificate.module_size == 0.9
    assert Plan.load(tmp_path / "a" / "b" / "plan.json").summary() == plan.summary()


@pytest.mark.parametrize("with_files", [False, True])
def test_a_cancelled_fold_is_not_verified(tmp_path: FilePath, *, with_files: bool) -> None:
    plan = fold(coil(8), cancelled=lambda: True, directory=tmp_path if with_files else None)
    assert plan.certificate.verdict == "failed: it was cancelled"
    assert len(plan.attempts) == 1


def test_a_fold_takes_the_strategy_and_the_world_that_are_asked_for() -> None:
    plan = fold(coil(8), strategy="one-by-one")
    assert plan.explosion is not None
    assert plan.explosion["strategy"] == "one-by-one"
    with pytest.raises(InputError, match="cannot fold on a table"):
        fold(coil(8), world="table")


@pytest.mark.slow
def test_a_path_and_its_chain_fold_alike() -> None:
    path = Path.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)], name="same")
    one, other = fold(path), fold(Chain.from_path(path))
    np.testing.assert_allclose(one.joint_angles_rad, other.joint_angles_rad, atol=1e-9)


WRITES_NOTHING = """
import os, sys, tempfile
from planner import fold, refold, smooth_plan
from tests.planner.chains import coil

written, watched = [], False

def note(event, arguments):
    if not watched:
        return
    if event == "open":
        path, mode, flags = arguments
        if flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            written.append(str(path))
    elif event in ("os.mkdir", "os.rename", "os.remove"):
        written.append(str(arguments[0]))

plan = fold(coil(4))  # which compiles, and loads what is loaded late
refold(plan, coil(4)), smooth_plan(plan)
sys.addaudithook(note)
watched = True
refold(fold(coil(4)), coil(4)), smooth_plan(plan)
watched = False
print(written)
fold(coil(4), progress=lambda _: None, directory=sys.argv[1])
"""


@pytest.mark.slow
@pytest.mark.processes
def test_without_a_directory_no_file_is_written(tmp_path: FilePath) -> None:
    answer = subprocess.run(
        [sys.executable, "-c", WRITES_NOTHING, str(tmp_path / "fold")],
        env={**os.environ, "PYTHONPATH": str(FilePath(__file__).parents[3])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.returncode == 0, answer.stderr[-2000:]
    assert answer.stdout.strip() == "[]"
    assert (tmp_path / "fold" / "plan.npz").exists()


def same_plans(one: Plan, other: Plan) -> None:
    """Compare all but wall times."""
    for name, column in one.motion.columns().items():
        np.testing.assert_array_equal(column, other.motion.columns()[name])
    np.testing.assert_array_equal(one.max_error_rad, other.max_error_rad)
    values = [json.loads(json.dumps(plan.rest())) for plan in (one, other)]
    assert timeless(values[0]) == timeless(values[1])
    assert one.parameters == other.parameters


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["default", "direct"])
def test_a_plan_made_in_memory_is_that_of_a_directory(preset: str, tmp_path: FilePath) -> None:
    first = fold(coil(5), preset=preset)
    same_plans(first, fold(coil(5), preset=preset, directory=tmp_path / "fold"))
    if preset == "default":
        same_plans(refold(first, coil(5)), refold(first, coil(5), directory=tmp_path / "refold"))
        same_plans(smooth_plan(first), smooth_plan(first, directory=tmp_path / "smoothed"))


@pytest.mark.slow
def test_of_failures_in_memory_the_same_is_shown(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    def sticks(chain: Chain, parameters: Any, **more: Any) -> Record:
        hasty = ExplosionParameters(max_steps=40)
        return replace(explode(chain, hasty, **more), status="stalled", reason="it sticks")

    monkeypatch.setattr("planner.explosion.strategies.explode", sticks)
    monkeypatch.setattr(
        "planner.explosion.strategies.peel", lambda chain, _, **more: sticks(chain, _)
    )
    shape = snake((2, 2, 3))
    plan = fold(shape)
    assert len(plan.attempts) > 1 and not plan.verified
    same_plans(plan, fold(shape, directory=tmp_path))


@pytest.mark.slow
def test_in_memory_the_plan_is_the_same_for_any_number_of_workers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Modules as large as their cells always touch, so that others are tried.
    monkeypatch.setattr("planner.pipeline.search.MAX_REFUSED_EXPLOSIONS", 3)
    plans = [fold(SQUARE, module_size=1.0, workers=workers) for workers in (1, 2)]
    assert len(plans[0].attempts) > 1
    same_plans(*plans)


def test_the_best_of_unjudged_explosions_is_kept() -> None:
    chain = coil(8)
    folded = chain.folded_poses
    history = tuple(Attempt(trial=Trial(0, k, "peel"), status="stalled") for k in range(3))

    def stuck_at(share: float) -> Result:
        frames = Motion.from_frames(
            phase="explosion",
            time_s=np.zeros(1),
            joint_angles_rad=share * chain.folded_rad[None],
            root_position=folded.positions[chain.root][None],
            root_wxyz=folded.wxyzs[chain.root][None],
        )
        record = Record(status="stalled", reason="stuck", frames=frames, steps=1, seconds=0.1)
        return Result(chain=chain, record=record)

    for shares, best in (((0.5, 0.2, 0.9), 1), ((0.5, 0.5, 0.5), 2), ((0.1, 0.2, 0.3), 0)):
        results = {number: stuck_at(share) for number, share in enumerate(shares)}
        assert list(Search(history=history, results=results).pruned().results) == [best]
