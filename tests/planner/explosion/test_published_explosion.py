from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from foldback.planner.explosion import published_explosion
from foldback.planner.explosion.published_explosion import explode_as_published
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import coil
from tests.planner.folds import intercept

PAPER = PaperExplosionParameters()


def test_cancelled_or_too_long_explosion_keeps_its_frames() -> None:
    chain = coil(12)
    for maximum in (0, 1, 250):
        record = explode_as_published(chain, replace(PAPER, max_steps=maximum))
        assert (record.status, record.steps) == ("timeout", maximum)
        np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)
    record = explode_as_published(chain, PAPER, cancelled=lambda: True)
    assert (record.status, record.steps) == ("cancelled", 0)
    assert len(record.frames) >= 1


def test_accelerations_that_are_not_finite_end_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(number: int, original: Any, segments: Any, state: Any, forces: Any) -> Any:
        return original(segments, state, forces * np.nan if number > 150 else forces)

    intercept(monkeypatch, Segments, "free_accelerations", broken)
    record = explode_as_published(coil(12), PAPER)
    assert record.status == "diverged"
    assert len(record.frames) >= 2
    assert np.isfinite(record.frames.joint_angles_rad).all()


def test_explosion_without_forces_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(published_explosion, "REST_CHECK_STEPS", 100)
    still = replace(PAPER, radial_gain=0.0, repulsion_gain=0.0, spring=0.0)
    record = explode_as_published(coil(6), still)
    assert (record.status, record.steps) == ("stalled", 100)
    assert "nothing moved" in str(record.reason)


def test_snapshots_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(published_explosion, "MAX_SNAPSHOT_ANGLES", 1000)
    record = explode_as_published(coil(12), replace(PAPER, snapshot_interval=1))
    assert record.status == "timeout"
    assert record.steps < 60
    assert "set a longer snapshot_interval" in str(record.reason)
