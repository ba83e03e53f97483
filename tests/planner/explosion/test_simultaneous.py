from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core.structures import NOT_FINITE
from foldback.planner.explosion.loop import explosion_loop
from foldback.planner.explosion.loop.checkpoint import PULSE_STEPS
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.explosion.loop.whole_chain import WholeChain
from foldback.planner.explosion.simultaneous import Simultaneous, explode
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pipeline import exploding
from foldback.planner.pipeline.attempt import AttemptSpec
from foldback.planner.pipeline.search import Watch
from foldback.planner.progress import never, silent
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import Array, coil, knotted, line
from tests.planner.explosion import chain_reference
from tests.planner.folds import intercept

DEFAULT = ExplosionParameters()


def test_linked_modules_are_pulled_apart_by_the_tension_alone() -> None:
    run = run_of(line(3), replace(DEFAULT, repulsion_cutoff=1.5))
    run.world.place()
    forces = run.world.forces.forces(run.world, run.control)
    assert np.linalg.norm(forces[0]) == pytest.approx(DEFAULT.tension * DEFAULT.spring)


def run_of(chain: Chain, parameters: ExplosionParameters = DEFAULT) -> Simultaneous:
    """Return a run that has begun."""
    watch = explosion_loop.Watch(silent, never, "exploding")
    run = Simultaneous.from_parameters(chain, parameters, watch=watch)
    run.begin()
    return run


@pytest.mark.parametrize("weak", [False, True], ids=["strong", "weak"])
def test_compiled_steps_are_those_of_plain_numpy(weak: bool) -> None:
    compiled, plain = run_of(coil(24)), run_of(coil(24))
    if weak:
        for run in (compiled, plain):
            run.pulses.start()  # the chain creeps in every other pulse
            run.pulses.remaining_steps = PULSE_STEPS[1] - PULSE_STEPS[0] + 7
    contacts = 0
    assert isinstance(compiled.world.engine, Segments)
    while compiled.control.steps < 60:
        assert compiled.make_steps(compiled.world.engine)
        while plain.control.steps < compiled.control.steps:
            chain_reference.step(plain)
            contacts += plain.control.contacts
        for name in ("angles", "rates", "position", "rotation", "velocity", "spin"):
            np.testing.assert_allclose(
                getattr(compiled.world.state, name),
                getattr(plain.world.state, name),
                atol=1e-8,
                err_msg=name,
            )
        np.testing.assert_allclose(compiled.control.controlled, plain.control.controlled, rtol=1e-7)
        assert compiled.world.time_s == pytest.approx(plain.world.time_s, rel=1e-9)
        assert compiled.pulses.remaining_steps == plain.pulses.remaining_steps
    assert contacts > 0


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


@pytest.mark.parametrize("after", [0, 40])
def test_accelerations_that_are_not_finite_end_the_run_and_leave_the_sound_frames(
    after: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spoilt(_: int, original: Any, world: WholeChain, *arguments: Any) -> Any:
        control: StepControl = arguments[1]
        if control.steps >= after:
            world.forces.weights = world.forces.weights * np.nan
        return original(world, *arguments)

    intercept(monkeypatch, WholeChain, "make_steps", spoilt)
    chain = coil(24)
    record = explode(chain, DEFAULT)
    assert record.status == "diverged"
    assert "infinite" in str(record.reason)
    assert np.isfinite(record.frames.joint_angles_rad).all()
    assert np.isfinite(record.frames.root_position).all()
    np.testing.assert_array_equal(record.frames.joint_angles_rad[0], chain.folded_rad)
    assert (len(record.frames) > 3) is (after > 30)


def test_failed_step_is_repeated_from_a_state_whose_contacts_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked_at: list[Array] = []

    def fail_at_times(number: int, original: Any, world: WholeChain, *arguments: Any) -> Any:
        control: StepControl = arguments[1]
        if number in (3, 5, 12, 13):  # the first two after a commit
            control.steps += 1
            return [], NOT_FINITE
        if number in (4, 6):
            assert any(np.array_equal(world.state.angles, angles) for angles in looked_at)
        steps, outcome = original(world, *arguments)
        looked_at.extend(step.angles for step in steps)
        return steps, outcome

    intercept(monkeypatch, WholeChain, "make_steps", fail_at_times)
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
    def frozen(_: int, original: Any, world: WholeChain, *arguments: Any) -> Any:
        before = world.state.copy()
        result = original(world, *arguments)
        world.state = before
        return result

    intercept(monkeypatch, WholeChain, "make_steps", frozen)
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
