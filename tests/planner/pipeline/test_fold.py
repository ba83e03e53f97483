import json
import os
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.motion.record import Record
from foldback.planner.pipeline.attempt import Attempt, AttemptSpec
from foldback.planner.pipeline.fold import fold, refold, smooth_plan
from foldback.planner.pipeline.preference import PlanFigures, Preference
from foldback.planner.pipeline.search import Result, Search
from foldback.planner.plan.plan import Plan
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.verification.verify import verify
from tests.planner.chains import anchored, coil, line
from tests.planner.folds import compare_motions, untimed
from tests.planner.peels import snake
from tests.planner.silhouettes.pictures import as_picture, ring

CORNER = coil(3)
ONE_ROBOT = "robots=1"
"""Setting by which one robot is simulated instead of several."""


def test_smallest_chains_and_a_line_fold() -> None:
    for chain in (coil(3), line(5)):
        plan = fold(chain)
        assert plan.certificate.verdict == "verified (simulated)", chain
        assert plan.joint_angles_rad.shape[1] == 2 * (len(chain) - 2)
    assert np.abs(plan.joint_angles_rad).max() < 1e-6


def test_fold_takes_its_options_and_fills_a_new_directory(tmp_path: FilePath) -> None:
    place = tmp_path / "a" / "b"
    plan = fold(coil(8), directory=place, seed=5, module_size=0.9, strategy="one-by-one")
    assert plan.seed == 5
    assert plan.certificate.module_size == 0.9
    assert (plan.explosion or {})["strategy"] == "one-by-one"
    assert Plan.load(place / "plan.npz").summary() == plan.summary()
    with pytest.raises(InputError, match="cannot fold on a table"):
        fold(coil(8), world="table")


def test_word_or_file_of_any_shape_folds_in_memory_and_in_a_directory(
    tmp_path: FilePath,
) -> None:
    in_memory = fold("word:I", settings="robots=0")
    assert in_memory.certificate.verdict.startswith("verified")
    assert in_memory.chain.name == "I"
    assert len(in_memory.chain) == 13 * 8
    assert_same_plans(fold(b"word: i", directory=tmp_path, settings="robots=0"), in_memory)


def test_options_say_what_becomes_of_a_picture() -> None:
    picture, settings = as_picture(ring()), "robots=0"
    plan = fold(picture, modules=64, inside_out=True, thickness=2, settings=settings)
    sides = np.ptp(plan.chain.folded_poses.positions, axis=0) + 1.0
    assert sides.round().tolist() == [4.0, 4.0, 4.0]  # 2 × 2 cells in two layers
    with pytest.raises(InputError, match="thickness"):
        fold("word:I", thickness=0)


def test_angles_that_degrees_do_not_hold_exactly_are_taken_as_they_are(tmp_path: FilePath) -> None:
    angles = np.random.default_rng(1).uniform(-0.3, 0.3, 12)
    assert (np.deg2rad(np.rad2deg(angles)) != angles).any()
    chain = Chain.from_angles(CUBE, angles)
    plan = fold(chain, directory=tmp_path, settings="robots=0")
    assert (plan.chain.folded_rad == angles).all()
    assert verify(tmp_path).problems == ()


def assert_same_plans(first_plan: Plan, other_plan: Plan) -> None:
    """Compare two plans except for wall times."""
    compare_motions(first_plan.motion, other_plan.motion)
    np.testing.assert_array_equal(first_plan.max_error_rad, other_plan.max_error_rad)
    plan_values = [json.loads(json.dumps(plan.rest())) for plan in (first_plan, other_plan)]
    assert untimed(plan_values[0]) == untimed(plan_values[1])
    assert first_plan.parameters == other_plan.parameters


@pytest.fixture(scope="module")
def written_paths() -> Iterator[list[str]]:
    """List of the paths that this process writes from now on."""
    paths: list[str] = []
    watched = True

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        writes = event in ("os.mkdir", "os.rename", "os.remove") or (
            event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        )
        if watched and writes:
            paths.append(str(arguments[0]))

    sys.addaudithook(note)
    yield paths
    watched = False  # an audit hook cannot be removed


@pytest.mark.slow
def test_plan_made_in_memory_writes_no_file_and_equals_that_of_a_directory(
    tmp_path: FilePath, written_paths: list[str]
) -> None:
    folded = fold(CORNER, directory=tmp_path / "fold", settings=ONE_ROBOT)
    refolded = refold(folded, CORNER, directory=tmp_path / "refold", settings=ONE_ROBOT)
    smoothed = smooth_plan(folded, directory=tmp_path / "smoothed")
    assert written_paths
    written_paths.clear()
    assert_same_plans(folded, fold(CORNER, settings=ONE_ROBOT))
    assert_same_plans(refolded, refold(folded, CORNER, settings=ONE_ROBOT))
    assert_same_plans(smoothed, smooth_plan(folded))
    assert written_paths == []


@pytest.mark.slow
def test_plan_made_in_memory_is_the_same_for_any_number_of_workers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    # Modules as large as their cells always touch, which causes further attempts.
    monkeypatch.setattr("foldback.planner.pipeline.next_step.MAX_REFUSED_EXPLOSIONS", 2)
    too_large = partial(fold, CORNER, module_size=1.0, strategy="simultaneous", settings=ONE_ROBOT)
    plan = too_large()
    assert len(plan.attempts) > 1 and len(plan.motion) > 10
    assert "overlap" in plan.certificate.verdict
    assert_same_plans(plan, too_large(workers=2))
    assert_same_plans(plan, too_large(directory=tmp_path))


@pytest.mark.slow
def test_calm_preference_smooths_without_detours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foldback.planner.pipeline.improvements.SEEDS_PER_SMOOTHED_PLAN", 1)
    travels = []
    preferences: tuple[Preference, ...] = ("calm", "clearance")
    for prefer in preferences:
        plan = fold(snake((2, 2, 2)), prefer=prefer, strategy="simultaneous", settings="robots=0")
        first, smoothed = plan.attempts
        assert smoothed["smooths"] == 0
        travels.append([plan_facts["figures"]["travel_ratio"] for plan_facts in (first, smoothed)])
        scores = [PlanFigures(**figures["figures"]).score(prefer) for figures in (first, smoothed)]
        assert PlanFigures.of(plan.certificate.as_dict()).score(prefer) == max(scores)
    (first, calm), (repeated_travel, usual) = travels
    assert first == repeated_travel
    assert calm < usual - 0.02 < first


def test_best_of_unjudged_explosions_is_kept() -> None:
    chain = coil(8)
    history = tuple(Attempt(spec=AttemptSpec(0, k, "peel"), status="stalled") for k in range(3))

    def stuck_at(share: float) -> Result:
        frames = anchored("explosion", share * chain.folded_rad[None])
        record = Record(
            status="stalled",
            reason=Reason.of(ReasonCode.AT_REST, steps=1),
            frames=frames,
            steps=1,
            seconds=0.1,
        )
        return Result(chain=chain, record=record)

    for shares, best in (((0.5, 0.2, 0.9), 1), ((0.5, 0.5, 0.5), 2), ((0.1, 0.2, 0.3), 0)):
        results = {number: stuck_at(share) for number, share in enumerate(shares)}
        assert list(Search(history=history, results=results).pruned().results) == [best]
