"""Estimated remaining time of folds: one source for previews, comparisons and the folds."""

import time
from pathlib import Path
from typing import Any

import pytest

from planner.pipeline.request import FoldRequest
from planner.progress import COMPILING
from server.api.schemas import ExpectedTimes, progress_of
from server.jobs.eta import EtaEstimator, left_s
from server.settings import Settings
from server.store.durations import MIN_SIMILAR_FOLDS, Duration, typical_s
from server.store.estimates import Estimates, expected_of_cost, plain_fold
from server.store.folds import Store
from server.store.leases import Leases, Preparing
from server.store.worker_identity import WorkerIdentities
from tests.server.rows import SOMEBODY, a_fold
from tests.server.store.test_leases import Clock

USUAL = {"read": 0.5, "explode": 8.0, "play_back": 4.0, "certify": 2.0, "export": 0.5}
NOW = 1_000_000.0


@pytest.fixture
def clock() -> Clock:
    return Clock(NOW)


@pytest.fixture
def remaining(tmp_path: Path, store: Store, clock: Clock) -> EtaEstimator:
    leases = Leases(store, WorkerIdentities(Settings(data_dir=tmp_path)), 1000.0)
    leases.heartbeat("one", host="here", pid=1, folds_at_once=1)
    return EtaEstimator(store, leases, clock=clock)


def add(store: Store, name: str, *, modules: int = 160, times: float = 1.0, **how: Any) -> None:
    stage_s = {stage: times * seconds for stage, seconds in USUAL.items()}
    took = {"started_at": NOW - 100.0, "ended_at": NOW - 100.0 + sum(stage_s.values())}
    for k in range(MIN_SIMILAR_FOLDS):
        row = a_fold(f"{name} {k}", modules=modules, progress={"stage_s": stage_s}, **took, **how)
        store.add(row, SOMEBODY)


def add_running(store: Store, stage: str, fraction: float, *, began_at: float, **how: Any) -> str:
    before = list(USUAL)[: list(USUAL).index(stage)]
    values = {
        "stage": stage,
        "fraction": fraction,
        "stage_s": {name: USUAL[name] for name in before},
        "began_at": began_at,
    }
    row = a_fold("now", status="running", stage=stage, modules=160, progress=values, **how)
    store.add(row, SOMEBODY)
    return row.id


def test_remaining_uses_only_similar_folds(
    store: Store, remaining: EtaEstimator, clock: Clock
) -> None:
    fold = add_running(store, "explode", 0.0, began_at=NOW)
    expected = remaining.of(store.fold(fold)).remaining_s
    assert expected is not None and expected < sum(USUAL.values())
    add(store, "much longer", modules=1600)
    add(store, "another preset", preset="paper")
    add(store, "one that failed", status="failed")
    clock.now += 10.0
    fresh = EtaEstimator(store, remaining._leases, clock=lambda: NOW)
    assert fresh.of(store.fold(fold)).remaining_s == expected
    add(store, "one like it")
    fresh = EtaEstimator(store, remaining._leases, clock=lambda: NOW)
    assert (fresh.of(store.fold(fold)).remaining_s or 0) > expected


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
    both = [*several, *known(9.0, 9.0, 9.0, 9.0, modules=500)]
    assert typical_s(both, row) == {"explode": 2.0}
    assert typical_s(several, a_fold("now", modules=0)) is None


def test_remaining_is_the_rest_of_the_stage_and_those_after_it(
    store: Store, remaining: EtaEstimator
) -> None:
    for name in ("first", "second", "third"):
        add(store, name)
    fold = add_running(store, "explode", 0.5, began_at=NOW - 4.0)
    assert remaining.of(store.fold(fold)).remaining_s == round(4.0 + 4.0 + 2.0 + 0.5)


def test_remaining_runs_down_and_follows_reports_gradually(
    store: Store, remaining: EtaEstimator, clock: Clock
) -> None:
    add(store, "another")
    fold = add_running(store, "play_back", 0.0, began_at=NOW)
    estimates: list[int | None] = []
    for _ in range(12):
        estimates.append(remaining.of(store.fold(fold)).remaining_s)
        clock.now += 0.25
    assert estimates[0] == round(4.0 + 2.0 + 0.5)
    assert estimates == sorted(estimates, key=lambda s: -(s or 0)), "it does not rise"
    assert estimates[-1] == 4
    # A report of less progress raises the estimate, but gradually.
    progress = store.fold(fold).progress | {"fraction": 0.3, "began_at": NOW - 7.0}
    store.report(fold, 0, progress)
    after = [remaining.of(store.fold(fold)).remaining_s or 0]
    for _ in range(8):
        clock.now += 1.0
        after.append(remaining.of(store.fold(fold)).remaining_s or 0)
    assert after[0] - (estimates[-1] or 0) <= 2
    assert max(after) > after[0]


def test_clock_that_is_set_back_changes_little(
    store: Store, remaining: EtaEstimator, clock: Clock
) -> None:
    add(store, "another")
    fold = add_running(store, "explode", 0.5, began_at=NOW - 4.0)
    before = remaining.of(store.fold(fold)).remaining_s
    clock.now -= 5 * 3600.0
    after = remaining.of(store.fold(fold)).remaining_s
    assert before is not None and after is not None
    assert abs(after - before) <= 1


def test_remaining_of_an_overdue_fold_ends_at_zero(
    store: Store, remaining: EtaEstimator, clock: Clock
) -> None:
    add(store, "another")
    fold = add_running(store, "certify", 0.4, began_at=NOW)
    for _ in range(7):
        assert (remaining.of(store.fold(fold)).remaining_s or 0) >= 1
        clock.now += 1.0
    clock.now += 1.0
    assert remaining.of(store.fold(fold)).remaining_s == 0


def test_remaining_in_the_queue_includes_the_wait(store: Store, remaining: EtaEstimator) -> None:
    add(store, "another")
    first = a_fold("first", status="queued", modules=160)
    second = a_fold("second", status="queued", modules=160)
    for row in (first, second):
        store.add(row, SOMEBODY)
    one, two = remaining.of(store.fold("first")), remaining.of(store.fold("second"))
    assert (one.place, two.place) == (1, 2)
    assert one.remaining_s == sum(USUAL.values())
    assert two.remaining_s == 2 * sum(USUAL.values())


def test_fraction_of_an_earlier_stage_is_not_used(store: Store, remaining: EtaEstimator) -> None:
    add(store, "another")
    fold = add_running(store, "explode", 1.0, began_at=NOW - 8.0)
    progress = store.fold(fold).progress
    store.report(fold, 0, progress | {"stage_s": {"read": 0.5, "explode": 8.0}})
    store.begin(fold, "play_back", "one")
    row = store.fold(fold)
    assert progress_of(row, remaining)["fraction"] == 0.0
    assert 6 <= (remaining.of(row).remaining_s or 0) <= 7


def test_slow_stages_raise_the_estimate_of_later_ones() -> None:
    spent = {"read": 0.5, "explode": 24.0}
    rest_s = left_s(USUAL, stage="play_back", fraction=0.0, spent_s=spent, elapsed_s=0.0)
    assert rest_s == pytest.approx(6.5 * (3.0 + 24.0) / (3.0 + 8.0))
    # A start that includes compiling says nothing about the others.
    late = {"read": 90.0, "explode": 8.0}
    rest_s = left_s(USUAL, stage="play_back", fraction=0.0, spent_s=late, elapsed_s=0.0)
    assert rest_s == pytest.approx(6.5)


def test_estimate_with_a_preference_repeats_stages() -> None:
    spent = {"explode": 3.0, "play_back": 4.0}
    once = left_s(USUAL, stage="certify", fraction=0.0, spent_s=spent, elapsed_s=0.0)
    again = left_s(USUAL, stage="certify", fraction=0.0, spent_s=spent, elapsed_s=0.0, chooses=True)
    assert once == pytest.approx(2.5 * (3.0 + 7.0) / (3.0 + 12.0)), "it was quicker so far"
    assert again == pytest.approx(2.5 + 5.0)


def test_wait_of_queued_fold_includes_the_rest_of_preparing(
    store: Store, remaining: EtaEstimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    add(store, "another")
    queued = a_fold("waiting", status="queued", modules=160)
    store.add(queued, SOMEBODY)
    now = add_running(store, "read", 0.0, began_at=NOW)
    ready = {key: remaining.of(store.fold(key)) for key in (queued.id, now)}
    preparing = Preparing(fraction=0.5, remaining_s=30.0)
    monkeypatch.setattr(Leases, "preparing", lambda self: preparing)
    fresh = EtaEstimator(store, remaining._leases, clock=lambda: NOW)
    later = {key: fresh.of(store.fold(key)) for key in (queued.id, now)}
    assert {outlook.preparing for outlook in later.values()} == {preparing}
    assert (later[queued.id].wait_s or 0) - (ready[queued.id].wait_s or 0) == 30.0
    for key, outlook in later.items():
        assert (outlook.remaining_s or 0) - (ready[key].remaining_s or 0) == 30


def test_queued_and_running_folds_report_compiling(store: Store, remaining: EtaEstimator) -> None:
    queued = a_fold("waiting", status="queued", modules=160)
    store.add(queued, SOMEBODY)
    assert progress_of(store.fold(queued.id), remaining)["running_before"] == 0
    now = add_running(store, "read", 0.25, began_at=NOW)
    progress = progress_of(store.fold(queued.id), remaining)
    assert (progress["running_before"], progress["preparing"]) == (1, None)
    store.report(now, 0, store.fold(now).progress | {"message": COMPILING})
    for fold in (queued.id, now):
        progress = progress_of(store.fold(fold), remaining)
        assert progress["preparing"] == {"fraction": 0.25, "remaining_s": None}
        # Nobody knows how long that takes.
        assert (progress["wait_s"], progress["remaining_s"]) == (None, None)


def test_smoothing_before_its_first_report_is_not_an_explosion(
    store: Store, remaining: EtaEstimator
) -> None:
    fold = add_running(store, "explode", 0.0, began_at=NOW, smooths="another")
    assert progress_of(store.fold(fold), remaining)["message"] == "smoothing"


@pytest.mark.parametrize("measured", [False, True])
def test_estimates_of_preview_and_fold_agree(
    store: Store, remaining: EtaEstimator, measured: bool
) -> None:
    for k in range(MIN_SIMILAR_FOLDS - (not measured)):
        store.add(a_fold(f"ended {k}", modules=160, progress={"stage_s": USUAL}), SOMEBODY)
    shape, estimates = {"modules": 160, "module": "cube"}, Estimates(store)
    preview = ExpectedTimes.of(shape, "floating", estimates.total_s)
    store.add(a_fold("asked", status="queued", modules=160, created_at=time.time()), SOMEBODY)
    outlook = EtaEstimator(store, remaining._leases, estimates).of(store.fold("asked"))
    assert outlook.remaining_s == round(preview.expected_s)

    def expected(**options: str) -> object:
        return pytest.approx(expected_of_cost(plain_fold(160, FoldRequest(**options))))

    usual = pytest.approx(sum(USUAL.values()))
    assert preview.expected_s == (usual if measured else expected())
    # Other options have samples of their own.
    assert preview.expected_as_published_s == expected(preset="paper")
    assert preview.expected_preferred_s == expected(prefer="time")
    assert estimates.stages_s(plain_fold(0, FoldRequest())) is None
