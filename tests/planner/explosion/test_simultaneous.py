from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.clearance.sweep import sweep
from planner.errors import SimulationError
from planner.explosion.explosion import Watch, step
from planner.explosion.simultaneous import Simultaneous, explode
from planner.explosion.whole_chain import WholeChain
from planner.motion.motion import Motion
from planner.parameters.explosion import ExplosionParameters
from planner.pathfinding.knots import knot_of
from planner.progress import Progress, never, silent
from planner.readers import read
from planner.simulation.reduced import Acceleration
from tests.planner.chains import coil, knotted, line, overlapping
from tests.planner.conftest import REAL, SHAPES

Array = NDArray[np.float64]
DEFAULT = ExplosionParameters()


def begun(chain: Chain) -> Simultaneous:
    """Parts of a run that has not made a step."""
    watch = Watch(silent, never, "exploding")
    return Simultaneous.from_parameters(chain, DEFAULT, watch=watch)


def make_step(run: Simultaneous) -> None:
    """Makes one step."""
    run.world.place()
    run.record()
    step(run)


@pytest.mark.parametrize("shape", REAL)
def test_real_shapes_come_out_straight(shape: str, folded: Callable[..., Any]) -> None:
    chain, record = folded(shape).chain, folded(shape).record
    frames = record.frames
    assert record.status == "straight"
    assert record.reason == ""
    np.testing.assert_array_equal(frames.joint_angles_rad[0], chain.folded_rad)
    np.testing.assert_array_equal(frames.joint_angles_rad[-1], 0.0)
    start = chain.poses(frames.joint_angles_rad[0], frames.root_position[0], frames.root_wxyz[0])
    np.testing.assert_allclose(start.positions, chain.folded_poses.positions, atol=1e-12)
    assert set(frames.phase.tolist()) == {0}
    assert (np.diff(frames.time_s) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(frames.root_wxyz, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("shape", REAL)
def test_snapshots_follow_one_another_closely(shape: str, folded: Callable[..., Any]) -> None:
    chain, frames = folded(shape).chain, folded(shape).record.frames
    turned = np.abs(np.diff(frames.joint_angles_rad, axis=0)).max(axis=1)
    poses = chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz)
    moved = np.linalg.norm(np.diff(poses.positions, axis=0), axis=2).max(axis=1)
    # A single step may be more than a snapshot's distance; its own cap holds for the time step
    # that was, which may have grown by 3 % since.
    assert turned.max() <= 1.03 * max(DEFAULT.snapshot_rad, DEFAULT.joint_cap_rad)
    assert moved.max() <= 1.03 * max(DEFAULT.snapshot_distance, DEFAULT.body_cap)


@pytest.mark.long
@pytest.mark.slow
def test_contacts_are_as_shallow_as_the_size_to_verify_wants() -> None:
    chain = Chain.from_path(read((SHAPES / "cactus.json").read_bytes()))
    clearances = {}
    for size in (0.95, 0.99):
        pressed = replace(DEFAULT, tension=100.0, loose_repulsion=1.0, verify_size=size)
        record = explode(chain, pressed)
        assert not record.frames.is_windowed
        clearances[size] = sweep(chain, record.frames.joint_angles_rad, size=0.99).clearance
    assert clearances[0.95] < 0.0 < clearances[0.99]


@pytest.mark.slow
def test_tetrahedra_come_apart_that_nearly_fill_their_place() -> None:
    chain = read((SHAPES / "tetra-letter-f.json").read_bytes())
    assert isinstance(chain, Chain)
    record = explode(chain, replace(DEFAULT, verify_size=0.99))
    assert record.status == "straight"
    assert not record.frames.is_windowed
    assert sweep(chain, record.frames.joint_angles_rad, size=0.99).clearance > 0.0


@pytest.mark.parametrize("shape", REAL)
def test_nothing_passes_through_anything(shape: str, folded: Callable[..., Any]) -> None:
    chain, frames = folded(shape).chain, folded(shape).record.frames
    found = sweep(chain, frames.joint_angles_rad, size=0.95)
    assert found.clearance > 0.0
    assert found.bound > 0.0


@pytest.mark.parametrize("shape", REAL)
def test_the_centre_of_mass_stays(shape: str, folded: Callable[..., Any]) -> None:
    # All forces are inner ones: radial forces sum to zero, repulsion is mutual, so are contacts.
    chain, frames = folded(shape).chain, folded(shape).record.frames
    poses = chain.poses(frames.joint_angles_rad, frames.root_position, frames.root_wxyz)
    centres = poses.positions.mean(axis=1)
    wandered = np.linalg.norm(centres - centres[0], axis=1).max()
    assert wandered < 0.02 * len(chain)


def test_momentum_is_not_made_from_nothing() -> None:
    chain = coil(24)
    seen: list[float] = []
    original = WholeChain.acceleration_under

    def watched(self: WholeChain, forces: Array) -> Acceleration:
        assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
        momentum = self.engine.velocities.sum(axis=0)
        scale = np.linalg.norm(self.engine.velocities, axis=1).sum()
        if scale > 1e-3:
            seen.append(float(np.linalg.norm(momentum)) / scale)
        return original(self, forces)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WholeChain, "acceleration_under", watched)
        # What integration adds grows with the way of a step.
        assert explode(chain, replace(DEFAULT, slide_cap=0.025)).status == "straight"
    assert len(seen) > 50
    assert np.median(seen) < 0.02


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_no_hinge_goes_beyond_its_stop(way: float) -> None:
    chain = line(6)
    stop = chain.module.stop_rad
    run = begun(chain)
    state = run.world.state
    state.angles[2] = way * (stop - 0.001)
    state.rates[2] = way
    make_step(run)
    assert state.angles[2] == way * stop
    assert state.rates[2] == 0.0


def test_linked_modules_are_pulled_apart_by_the_tension_alone() -> None:
    seen: list[Array] = []

    def watched(self: WholeChain, forces: Array) -> Acceleration:
        del self
        seen.append(forces.copy())
        raise SimulationError("seen")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WholeChain, "acceleration_under", watched)
        explode(line(3), replace(DEFAULT, repulsion_cutoff=1.5))
    assert np.linalg.norm(seen[0][0]) == pytest.approx(DEFAULT.tension * DEFAULT.spring)


def test_the_same_seed_gives_the_same_record_bit_for_bit() -> None:
    chain = coil(16)
    first, again, other = (explode(chain, DEFAULT, seed=seed) for seed in (3, 3, 4))
    assert first.steps == again.steps
    for name, column in first.frames.columns().items():
        np.testing.assert_array_equal(column, again.frames.columns()[name])
    assert (
        first.frames.joint_angles_rad.shape != other.frames.joint_angles_rad.shape
        or (first.frames.joint_angles_rad != other.frames.joint_angles_rad).any()
    )


@pytest.mark.parametrize("modules", [3, 4, 12, 30])
def test_a_chain_that_folds_into_a_line_is_straight_already(modules: int) -> None:
    told: list[Progress] = []
    record = explode(line(modules), DEFAULT, progress=told.append)
    assert record.status == "straight"
    assert np.abs(record.frames.joint_angles_rad).max() < 1e-6
    assert all(0.0 <= p.fraction <= 1.0 for p in told)


def test_the_sink_gets_the_record_as_it_grows() -> None:
    parts: list[Motion] = []
    record = explode(coil(16), DEFAULT, sink=parts.append)
    assert len(parts) > 5
    np.testing.assert_array_equal(
        Motion.joined(parts).joint_angles_rad, record.frames.joint_angles_rad
    )


def test_progress_is_told_and_rises_overall(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.explosion.explosion.PROGRESS_PERIOD_S", 0.0)
    told: list[Progress] = []
    record = explode(coil(24), DEFAULT, progress=told.append)
    assert {p.stage for p in told} == {"explode"}
    assert all(0.0 <= p.fraction < 1.0 for p in told)
    assert told[-1].fraction > told[0].fraction
    assert 0 < told[-1].steps <= record.steps


def test_a_cancelled_explosion_keeps_what_it_has() -> None:
    chain = coil(24)
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked == 3

    record = explode(chain, DEFAULT, cancelled=cancelled)
    assert record.status == "cancelled"
    assert record.steps == 75
    np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)
    assert len(record.frames) > 1


@pytest.mark.parametrize("most", [0, 1, 2, 30, 60])
def test_too_few_steps_end_as_data(most: int) -> None:
    chain = coil(24)
    record = explode(chain, replace(DEFAULT, max_steps=most))
    assert record.status == "timeout"
    assert f"after {most} steps" in record.reason
    assert record.steps == most
    np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)


@pytest.mark.parametrize("most", [1, 3, 5, 40])
def test_a_chain_that_lies_in_itself_ends_as_data(most: int) -> None:
    # It goes back again and again from the first step on; there is a record all the same.
    record = explode(overlapping(), replace(DEFAULT, max_steps=most))
    assert record.status in ("timeout", "straight", "diverged")
    assert len(record.frames) >= 1
    assert np.isfinite(record.frames.joint_angles_rad).all()


def poison(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """From a given step on, MuJoCo's accelerations are no numbers."""
    original = WholeChain.acceleration_under
    calls = 0

    def broken(self: WholeChain, forces: Array) -> Acceleration:
        nonlocal calls
        calls += 1
        if calls > after:
            forces = np.full_like(forces, np.nan)
        return original(self, forces)

    monkeypatch.setattr(WholeChain, "acceleration_under", broken)


@pytest.mark.parametrize("after", [0, 1, 40, 90])
def test_bad_numbers_end_the_run_and_leave_the_sound_frames(
    after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = coil(24)
    poison(monkeypatch, after)
    record = explode(chain, DEFAULT)
    assert record.status == "diverged"
    assert "finite" in record.reason
    assert np.isfinite(record.frames.joint_angles_rad).all()
    assert np.isfinite(record.frames.root_position).all()
    np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)
    assert (len(record.frames) > 3) is (after > 30)


def test_a_hiccup_is_survived_by_going_back(monkeypatch: pytest.MonkeyPatch) -> None:
    original = WholeChain.acceleration_under
    calls = 0

    def hiccup(self: WholeChain, forces: Array) -> Acceleration:
        nonlocal calls
        calls += 1
        if calls in (60, 61, 140):
            raise SimulationError("a hiccup.")
        return original(self, forces)

    monkeypatch.setattr(WholeChain, "acceleration_under", hiccup)
    record = explode(coil(24), DEFAULT)
    assert record.status == "straight"
    assert (np.diff(record.frames.time_s) > 0.0).all()


def test_it_goes_back_to_where_contacts_were_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    original = WholeChain.acceleration_under
    looked_at: list[Array] = []
    calls = 0

    def hiccup(self: WholeChain, forces: Array) -> Acceleration:
        nonlocal calls
        calls += 1
        if calls in (26, 51):  # right after a commit
            raise SimulationError("a hiccup.")
        if calls in (27, 52):
            assert any(np.array_equal(self.state.angles, angles) for angles in looked_at)
        looked_at.append(self.state.angles.copy())
        return original(self, forces)

    monkeypatch.setattr(WholeChain, "acceleration_under", hiccup)
    assert explode(coil(24), DEFAULT).status == "straight"


def test_a_knotted_chain_moves_along_itself_until_it_has_gone_its_length() -> None:
    chain = knotted()
    run = begun(chain)
    engine, forces = run.world.engine, run.world.forces
    forces.is_knotted = True
    for _ in range(30):
        make_step(run)
    way = forces.creep_direction
    along = np.gradient(engine.positions, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    speeds = way * (engine.velocities * along).sum(axis=1)
    assert abs(way) == 1
    assert np.median(speeds) > 0.0
    assert forces.creep_distance > 0.0
    forces.creep_distance = len(chain)
    make_step(run)
    assert forces.creep_direction == -way


@pytest.mark.slow
def test_a_knot_slips_out_of_a_chain_that_creeps_along_itself() -> None:
    chain = knotted()
    assert knot_of(chain.folded_poses.positions).verdict == "knotted"
    record = explode(chain, DEFAULT)
    assert record.status == "straight"
    # It did not cheat: nothing passed through anything on the way.
    assert sweep(chain, record.frames.joint_angles_rad, size=0.9).clearance > 0.0


def test_a_chain_without_a_way_out_is_called_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    # Nothing moves: every push is in vain, and the run says so instead of going on forever.
    original = WholeChain.acceleration_under

    def frozen(self: WholeChain, forces: Array) -> Acceleration:
        found = original(self, forces)
        return replace(found, hinges=0.0 * found.hinges, linear=np.zeros(3), angular=np.zeros(3))

    monkeypatch.setattr(WholeChain, "acceleration_under", frozen)
    monkeypatch.setattr("planner.explosion.simultaneous.JAM_CHECK_STEPS", 10)
    record = explode(coil(12), DEFAULT)
    assert record.status == "stalled"
    assert "stuck" in record.reason
    assert "another seed" in record.reason
    assert "90°" in record.reason
