"""One source of estimates: previews, comparisons and the folds themselves."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from planner.pipeline.request import FoldRequest
from server.api.schemas import ExpectedTimes
from server.jobs.remaining import EtaEstimator
from server.settings import Settings
from server.store.durations import MIN_SIMILAR_FOLDS
from server.store.estimates import Estimates, expected_of_cost, plain_fold
from server.store.folds import Store
from server.store.leases import Leases
from server.store.worker_identity import WorkerIdentities
from tests.server.rows import SOMEBODY, a_fold

STAGE_S = {"read": 0.5, "explode": 8.0, "play_back": 4.0, "certify": 2.0, "export": 0.5}
REPORT = {"modules": 160, "module": "cube"}


def add_ended(store: Store, count: int) -> None:
    for k in range(count):
        store.add(a_fold(f"ended {k}", modules=160, progress={"stage_s": STAGE_S}), SOMEBODY)


def told_everywhere(store: Store, tmp_path: Path) -> tuple[float, float]:
    """What a preview tells of a shape of 160, and what the page of its fold tells then."""
    estimates = Estimates(store)
    preview = ExpectedTimes.of(REPORT, "floating", estimates.total_s)
    leases = Leases(store, WorkerIdentities(Settings(data_dir=tmp_path)), 1000.0)
    leases.heartbeat("one", host="here", pid=1, folds_at_once=1)
    store.add(a_fold("asked", status="queued", modules=160, created_at=time.time()), SOMEBODY)
    outlook = EtaEstimator(store, leases, estimates).of(store.fold("asked"))
    assert outlook.remaining_s is not None
    return preview.expected_s, outlook.remaining_s


@pytest.mark.parametrize("measured", [False, True])
def test_estimates_of_preview_and_fold_agree(store: Store, tmp_path: Path, measured: bool) -> None:
    add_ended(store, MIN_SIMILAR_FOLDS - (not measured))
    preview_s, fold_s = told_everywhere(store, tmp_path)
    expected = expected_of_cost(plain_fold(160, FoldRequest()))
    assert preview_s == pytest.approx(sum(STAGE_S.values()) if measured else expected)
    assert fold_s == round(preview_s)


def test_estimate_of_other_options_uses_their_own_samples(store: Store) -> None:
    add_ended(store, MIN_SIMILAR_FOLDS)
    times = ExpectedTimes.of(REPORT, "floating", Estimates(store).total_s)
    assert times.expected_as_published_s == pytest.approx(
        expected_of_cost(plain_fold(160, FoldRequest(preset="paper")))
    )
    assert times.expected_preferred_s == pytest.approx(
        expected_of_cost(plain_fold(160, FoldRequest(prefer="time")))
    )
    assert Estimates(store).stages_s(plain_fold(0, FoldRequest())) is None
