from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import SimulationError
from foldback.planner.explosion.loop.whole_chain import WholeChain
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pipeline import exploding
from foldback.planner.pipeline.attempt import AttemptSpec
from foldback.planner.pipeline.search import Watch
from foldback.planner.simulation.reduced_state import Acceleration
from tests.planner.chains import Array, coil, knotted, line
from tests.planner.folds import intercept

DEFAULT = ExplosionParameters()


def test_linked_modules_are_pulled_apart_by_the_tension_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen_frames: list[Array] = []

    def replace_forces(call: int, chain: WholeChain, forces: Array) -> Array:
        seen_frames.append(forces.copy())
        raise SimulationError("seen")

    watch_accelerations(monkeypatch, replace_forces)
    explode(line(3), replace(DEFAULT, repulsion_cutoff=1.5))
    assert np.linalg.norm(seen_frames[0][0]) == pytest.approx(DEFAULT.tension * DEFAULT.spring)


def test_cancelled_or_too_long_explosion_keeps_its_frames() -> None:
    chain = coil(24)
    record = explode(chain, DEFAULT, cancelled=Mock(side_effect=[False, False, True]))
    assert (record.status, record.steps) == ("cancelled", 75)
    assert len(record.frames) > 1
    short_record = explode(chain, replace(DEFAULT, max_steps=30))
    assert (short_record.status, short_record.steps) == ("timeout", 30)
    assert "after 30 steps" in str(short_record.reason)
    for frames in (record.frames, short_record.frames):
        np.testing.assert_array_equal(frames.joint_angles_rad[0], chain.folded_rad)


def watch_accelerations(
    monkeypatch: pytest.MonkeyPatch, replace_forces: Callable[[int, WholeChain, Array], Array]
) -> None:
    """Pass the number of each acceleration call to a function that returns other forces."""

    def watched(number: int, original: Any, chain: WholeChain, forces: Array) -> Acceleration:
        return original(chain, replace_forces(number, chain, forces))

    intercept(monkeypatch, WholeChain, "acceleration_under", watched)


@pytest.mark.parametrize("after", [0, 40])
def test_accelerations_that_are_not_finite_end_the_run_and_leave_the_sound_frames(
    after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = coil(24)
    watch_accelerations(
        monkeypatch, lambda call, _, forces: forces if call <= after else forces * np.nan
    )
    record = explode(chain, DEFAULT)
    assert record.status == "diverged"
    assert "finite" in str(record.reason)
    assert np.isfinite(record.frames.joint_angles_rad).all()
    assert np.isfinite(record.frames.root_position).all()
    np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)
    assert (len(record.frames) > 3) is (after > 30)


def test_failed_step_is_repeated_from_a_state_whose_contacts_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked_at: list[Array] = []

    def fail_once(call: int, chain: WholeChain, forces: Array) -> Array:
        if call in (26, 51, 140, 141):  # the first two after a commit
            raise SimulationError("a hiccup.")
        if call in (27, 52):
            assert any(np.array_equal(chain.state.angles, angles) for angles in looked_at)
        looked_at.append(chain.state.angles.copy())
        return forces

    watch_accelerations(monkeypatch, fail_once)
    record = explode(coil(24), DEFAULT)
    assert record.status == "straight"
    assert (np.diff(record.frames.time_s) > 0.0).all()


@pytest.mark.slow
def test_knot_opens_by_creeping() -> None:
    chain = knotted()
    assert knot_of(chain.folded_poses.positions).verdict == "knotted"
    record = explode(chain, DEFAULT)
    assert record.status == "straight"
    # No module passed through another one on the way.
    assert sweep(chain, record.frames.joint_angles_rad, module_size=0.9).clearance > 0.0


def test_chain_that_does_not_move_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    # Nothing moves: no pulse makes progress, so the run must end.
    def frozen(_: int, original: Any, *arguments: Any) -> Acceleration:
        judged = original(*arguments)
        return replace(judged, hinges=0.0 * judged.hinges, linear=np.zeros(3), angular=np.zeros(3))

    intercept(monkeypatch, WholeChain, "acceleration_under", frozen)
    monkeypatch.setattr("foldback.planner.explosion.simultaneous.JAM_CHECK_STEPS", 10)
    record = explode(coil(12), DEFAULT)
    assert record.status == "stalled"
    assert "stuck" in str(record.reason)
    assert "another seed" in str(record.reason)
    assert "90°" in str(record.reason)


def test_auto_releases_all_modules_calmly_and_simultaneous_as_before(folded: Any) -> None:
    chain = folded.chain
    usual, calm = explode(chain, DEFAULT), explode(chain, DEFAULT, calm=True)
    straight = np.abs(chain.folded_rad) < 1e-6

    def travel(record: Any) -> Array:
        return np.abs(np.diff(record.frames.joint_angles_rad, axis=0)).sum(axis=0)

    assert calm.status == "straight"
    assert travel(calm).sum() < travel(usual).sum()
    assert travel(calm)[straight].sum() < 0.5 * travel(usual)[straight].sum()
    first = AttemptSpec(0, 0, "simultaneous")
    for strategy, spec, expected in (
        ("auto", first, calm),
        ("auto", replace(first, plain=True), usual),
        ("simultaneous", first, usual),
    ):
        record = exploding.explode(chain, spec, Parameters(strategy=strategy), Watch())
        np.testing.assert_array_equal(
            record.frames.joint_angles_rad, expected.frames.joint_angles_rad
        )
