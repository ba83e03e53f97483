"""Estimated remaining time of folds: one source for previews, comparisons and the folds."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from foldback.planner.pipeline.request import FoldRequest
from foldback.server.jobs.eta import EtaEstimator, left_s
from foldback.server.schemas import expected_times, progress_of
from foldback.server.settings import Settings
from foldback.server.store.estimates import (
    MIN_SIMILAR_FOLDS,
    Duration,
    Estimates,
    expected_of_cost,
    plain_fold,
    typical_s,
)
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from tests.server.rows import SOMEBODY, a_fold, live_worker

USUAL = {"read": 0.5, "explode": 8.0, "play_back": 4.0, "certify": 2.0, "export": 0.5}
NOW = 1_000_000.0


class Clock:
    """Clock that advances only on request."""

    def __init__(self, now: float) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


class Folds:
    """Folds of a store whose remaining time is estimated, with a clock that tests advance."""

    def __init__(self, store: Store, leases: Leases) -> None:
        self.store = store
        self.clock = Clock(NOW)
        self._leases = leases
        self.remaining = self.new_estimator()

    def new_estimator(self, estimates: Estimates | None = None) -> EtaEstimator:
        """Return an estimator without history, whose clock starts anew."""
        clock = Clock(NOW)
        self.clock = clock
        return EtaEstimator(self.store, self._leases, estimates, clock=clock)

    def left(self, fold_id: str) -> int | None:
        return self.remaining.of(self.store.fold(fold_id)).remaining_s

    def progress(self, fold_id: str) -> dict[str, Any]:
        return progress_of(self.store.fold(fold_id), self.remaining)

    def add(self, name: str, *, modules: int = 160, **row_values: Any) -> None:
        """Add enough finished folds for an estimate."""
        took = {"started_at": NOW - 100.0, "ended_at": NOW - 100.0 + sum(USUAL.values())}
        summary_values = {"modules": modules, "progress": {"stage_s": USUAL}, **took, **row_values}
        for k in range(MIN_SIMILAR_FOLDS):
            self.store.add(a_fold(f"{name} {k}", **summary_values), SOMEBODY)

    def add_queued(self, name: str, **row_values: Any) -> str:
        self.store.add(a_fold(name, status="queued", modules=160, **row_values), SOMEBODY)
        return name

    def add_running(
        self, stage: str, fraction: float, *, began_at: float, **row_values: Any
    ) -> str:
        before = list(USUAL)[: list(USUAL).index(stage)]
        values = {"stage": stage, "fraction": fraction, "began_at": began_at}
        values |= {"stage_s": {name: USUAL[name] for name in before}}
        row = a_fold(
            "now", status="running", stage=stage, modules=160, progress=values, **row_values
        )
        self.store.add(row, SOMEBODY)
        return row.id


@pytest.fixture
def folds(tmp_path: Path, store: Store) -> Iterator[Folds]:
    leases = Leases(Settings(data_dir=tmp_path), store)
    with live_worker(leases, "one"):
        yield Folds(store, leases)


def test_remaining_uses_only_similar_folds(folds: Folds) -> None:
    fold = folds.add_running("explode", 0.0, began_at=NOW)
    expected = folds.left(fold)
    assert expected is not None and expected < sum(USUAL.values())
    folds.add("much longer", modules=1600)
    folds.add("another preset", preset="paper")
    folds.add("one that failed", status="failed")
    folds.remaining = folds.new_estimator()
    assert folds.left(fold) == expected
    folds.add("one like it")
    folds.remaining = folds.new_estimator()
    assert (folds.left(fold) or 0) > expected


def test_typical_duration_is_the_median_of_folds_of_its_size() -> None:
    def known(*seconds: float, modules: int = 160) -> list[Duration]:
        return [Duration(modules=modules, stage_s={"explode": s}) for s in seconds]

    row = a_fold("now", modules=160)
    assert typical_s(known(360.0), row) is None
    assert typical_s(known(360.0, 3.0, 3.0), row) == {"explode": 3.0}
    several = known(1.0, 2.0, 30.0)
    assert typical_s(several, row) == {"explode": 2.0}
    # Twice as many modules take longer, and a fold of the same size has the largest weight.
    larger = typical_s(several, a_fold("now", modules=320))
    assert larger is not None and larger["explode"] > 4.0
    known_stages = [*several, *known(9.0, 9.0, 9.0, 9.0, modules=500)]
    assert typical_s(known_stages, row) == {"explode": 2.0}
    assert typical_s(several, a_fold("now", modules=0)) is None


def test_remaining_is_the_rest_of_the_stage_and_those_after_it(folds: Folds) -> None:
    folds.add("another")
    fold = folds.add_running("explode", 0.5, began_at=NOW - 4.0)
    assert folds.left(fold) == round(4.0 + 4.0 + 2.0 + 0.5)
    folds.clock.now -= 5 * 3600.0
    assert abs((folds.left(fold) or 0) - round(10.5)) <= 1, "the clock was set back"


def test_remaining_runs_down_and_follows_reports_gradually(folds: Folds) -> None:
    folds.add("another")
    fold = folds.add_running("play_back", 0.0, began_at=NOW)
    estimates: list[int | None] = []
    for _ in range(12):
        estimates.append(folds.left(fold))
        folds.clock.now += 0.25
    assert estimates[0] == round(4.0 + 2.0 + 0.5)
    assert estimates == sorted(estimates, key=lambda s: -(s or 0)), "it does not rise"
    assert estimates[-1] == 4
    # A report of less progress raises the estimate, but gradually.
    progress = folds.store.fold(fold).progress | {"fraction": 0.3, "began_at": NOW - 7.0}
    folds.store.report(fold, 0, progress)
    after = [folds.left(fold) or 0]
    for _ in range(8):
        folds.clock.now += 1.0
        after.append(folds.left(fold) or 0)
    assert after[0] - (estimates[-1] or 0) <= 2
    assert max(after) > after[0]


def test_remaining_of_an_overdue_fold_ends_at_zero(folds: Folds) -> None:
    folds.add("another")
    fold = folds.add_running("certify", 0.4, began_at=NOW)
    for _ in range(7):
        assert (folds.left(fold) or 0) >= 1
        folds.clock.now += 1.0
    folds.clock.now += 1.0
    assert folds.left(fold) == 0


def test_remaining_in_the_queue_includes_the_wait(folds: Folds) -> None:
    folds.add("another")
    places = [folds.remaining.of(folds.store.fold(folds.add_queued(k))) for k in ("a", "b")]
    assert [queue_place.place for queue_place in places] == [1, 2]
    assert [queue_place.remaining_s for queue_place in places] == [
        sum(USUAL.values()),
        2 * sum(USUAL.values()),
    ]


def test_fraction_of_an_earlier_stage_is_not_used(folds: Folds) -> None:
    folds.add("another")
    fold = folds.add_running("explode", 1.0, began_at=NOW - 8.0)
    progress = folds.store.fold(fold).progress
    folds.store.report(fold, 0, progress | {"stage_s": {"read": 0.5, "explode": 8.0}})
    folds.store.begin(fold, "play_back", "one")
    assert folds.progress(fold)["fraction"] == 0.0
    assert 6 <= (folds.left(fold) or 0) <= 7


def test_slow_stages_raise_the_estimate_of_later_ones() -> None:
    spent = {"read": 0.5, "explode": 24.0}
    rest_s = left_s(USUAL, stage="play_back", fraction=0.0, spent_s=spent, elapsed_s=0.0)
    assert rest_s == pytest.approx(6.5 * (3.0 + 24.0) / (3.0 + 8.0))
    # A first stage that waited for its process does not affect the estimate for the others.
    late = {"read": 90.0, "explode": 8.0}
    rest_s = left_s(USUAL, stage="play_back", fraction=0.0, spent_s=late, elapsed_s=0.0)
    assert rest_s == pytest.approx(6.5)


def test_estimate_with_a_preference_repeats_stages() -> None:
    spent = {"explode": 3.0, "play_back": 4.0}
    once = left_s(USUAL, stage="certify", fraction=0.0, spent_s=spent, elapsed_s=0.0)
    second_left_s = left_s(
        USUAL, stage="certify", fraction=0.0, spent_s=spent, elapsed_s=0.0, chooses=True
    )
    assert once == pytest.approx(2.5 * (3.0 + 7.0) / (3.0 + 12.0)), "it was quicker so far"
    assert second_left_s == pytest.approx(2.5 + 5.0)


def test_queued_folds_count_those_that_run(folds: Folds) -> None:
    queued = folds.add_queued("waiting")
    assert folds.progress(queued)["running_before"] == 0
    folds.add_running("read", 0.25, began_at=NOW)
    assert folds.progress(queued)["running_before"] == 1


def test_smoothing_before_its_first_report_is_not_an_explosion(folds: Folds) -> None:
    fold = folds.add_running("explode", 0.0, began_at=NOW, smooths="another")
    assert folds.progress(fold)["message"] == "smoothing"


@pytest.mark.parametrize("measured", [False, True])
def test_estimates_of_preview_and_fold_agree(folds: Folds, measured: bool) -> None:
    for k in range(MIN_SIMILAR_FOLDS - (not measured)):
        folds.store.add(a_fold(f"ended {k}", modules=160, progress={"stage_s": USUAL}), SOMEBODY)
    shape, estimates = {"modules": 160, "module": "cube"}, Estimates(folds.store)
    preview = expected_times(shape, "floating", estimates.total_s)
    fold = folds.store.fold(folds.add_queued("asked", created_at=time.time()))
    assert folds.new_estimator(estimates).of(fold).remaining_s == round(preview["expected_s"])

    def expected(**options: str) -> object:
        return pytest.approx(expected_of_cost(plain_fold(160, FoldRequest(**options))))

    usual = pytest.approx(sum(USUAL.values()))
    assert preview["expected_s"] == (usual if measured else expected())
    # Other options have samples of their own.
    assert preview["expected_as_published_s"] == expected(preset="paper")
    assert preview["expected_preferred_s"] == expected(prefer="time")
    assert estimates.stages_s(plain_fold(0, FoldRequest())) is None
