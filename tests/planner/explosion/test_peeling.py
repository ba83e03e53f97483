"""Peeling: straight, clear and reproducible results; buried chains are refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import window_inverse_step_limit
from foldback.planner.core.structures import CoreCells, ModuleStates, PairLimits, StepLimits
from foldback.planner.errors import InputError
from foldback.planner.explosion.loop.checkpoint import PULSE_STEPS
from foldback.planner.explosion.loop.explosion_loop import Watch, return_to_checkpoint
from foldback.planner.explosion.loop.radial_forces import radial_weights
from foldback.planner.explosion.loop.step_control import ContactDepth
from foldback.planner.explosion.peeling.peeling import floating_peeling, peel
from foldback.planner.explosion.peeling.recorder import Proof
from foldback.planner.explosion.peeling.window import WindowConfiguration
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.pathfinding.snake import snake_path
from foldback.planner.progress import Progress, never, silent
from tests.planner.chains import chain_of, coil, line
from tests.planner.explosion import window_reference

DEFAULT = PeelingParameters()


@cache
def snake() -> tuple[Chain, Record]:
    chain = chain_of(snake_path((5, 5, 8)))
    return chain, peel(chain, DEFAULT)


def test_modules_of_nearly_full_size_are_peeled() -> None:
    """Folded neighbours of this size are close, which must not cause a return to the checkpoint."""
    chain = chain_of(snake_path((4, 4, 4)))
    record = peel(chain, replace(DEFAULT, geom_size=0.9995, verify_size=0.9985))
    assert record.status == "straight", record.reason


def test_core_stays_in_place_until_it_is_released() -> None:
    chain, record = snake()
    frames = record.frames
    assert record.summary()["frames"] == len(frames) < 5 * len(chain)
    assert np.abs(frames.angles_rad).max() <= np.float32(chain.module.largest_angle_rad)
    assert (np.diff(frames.first) <= 0).all()
    assert frames.first[0] > 250 and frames.first[-1] == 0
    np.testing.assert_array_equal(
        frames.anchor_position, np.tile([0.0, 0.0, 0.0], (len(frames), 1))
    )
    # Only the window is recorded.
    assert np.diff(frames.offsets).max() <= 2 * DEFAULT.most_modules


def test_step_limit_ignores_cells_that_the_core_has_left() -> None:
    """Removed cells once slowed the tail: the last layers of a box of 100 000 never came off."""
    count, rod, turn = 6, 100, 0.01
    positions = np.array([[0.0, 0.0, z] for z in range(count)])
    along_z = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    spins = np.tile([0.0, turn, 0.0], (count, 1))
    core_box = np.array([[0, 0, 0], [0, 0, 1]])
    modules = ModuleStates(
        positions, np.tile(along_z, (count, 1, 1)), np.cross(spins, positions), spins
    )
    clearances: list[float] = []
    for height in (2, 60):
        grid = np.arange(height, dtype=np.int32).reshape(1, 1, height)
        core = CoreCells(grid=grid, low=np.zeros(3, dtype=np.int64), box=core_box, first=0)
        pair = PairLimits(1.0, 0.03, 0.1)
        limits = StepLimits(joint_rad=0.03, body=0.4, tail_turn_rad=0.03, pair=pair)
        still = np.zeros(2 * (count - 2))
        cutoff = DEFAULT.repulsion_cutoff
        clearances.append(window_inverse_step_limit(still, modules, core, rod, cutoff, limits))
    assert clearances[0] == clearances[1] < 2.0


def test_run_continues_from_a_state_with_contacts_that_are_too_deep() -> None:
    """A ball of 10 000 once returned to one state forever, as each first step was too deep."""
    watch = Watch(silent, never, "peeling")
    run = floating_peeling(chain_of(snake_path((4, 4, 4))), DEFAULT, watch=watch)
    control, window, checkpoint = run.control, run.world, run.checkpoint
    before = (window.time_s, window.state.copy())
    while control.depth < 1e-4:
        before = (window.time_s, window.state.copy())
        run.make_steps()
        assert control.steps < 500
    control.allowed = ContactDepth(limit=0.5 * control.depth, back_off=0.4 * control.depth)
    checkpoint.save(*before)
    return_to_checkpoint(run)
    angles = window.state.angles.copy()
    run.make_steps()
    assert checkpoint.retries == 1
    assert (window.state.angles != angles).any()


def test_compiled_steps_are_those_of_plain_numpy() -> None:
    chain, watch = chain_of(snake_path((4, 4, 4))), Watch(silent, never, "peeling")
    compiled, plain = (floating_peeling(chain, DEFAULT, watch=watch) for _ in range(2))
    weights = radial_weights(0, len(chain))
    contacts = 0
    for k in range(20):
        if k == 4:
            for run in (compiled, plain):
                run.pulses.remaining_steps = PULSE_STEPS[1] - PULSE_STEPS[0] + 7
        assert compiled.make_steps()
        while plain.control.steps < compiled.control.steps:
            window_reference.step(plain, weights)
        contacts += plain.control.contacts
        np.testing.assert_allclose(compiled.world.state.angles, plain.world.state.angles, atol=1e-9)
        np.testing.assert_allclose(compiled.world.state.rates, plain.world.state.rates, atol=1e-8)
        np.testing.assert_allclose(compiled.control.controlled, plain.control.controlled, rtol=1e-8)
        assert compiled.world.time_s == pytest.approx(plain.world.time_s, rel=1e-9)
        assert compiled.pulses.remaining_steps == plain.pulses.remaining_steps
        np.testing.assert_array_equal(compiled.world.heading.aim, plain.world.heading.aim)
    assert compiled.control.steps == 100 and contacts > 0
    assert len(np.unique(plain.world.model.stiffness)) > 3


def test_cancelled_complete_and_refused_peelings() -> None:
    chain = coil(24)
    record = peel(chain, DEFAULT, cancelled=lambda: True)
    assert (record.status, record.steps) == ("cancelled", 25)
    reports: list[Progress] = []
    parts: list[Motion] = []
    whole_record = peel(chain, DEFAULT, sink=parts.append, progress=reports.append)
    assert whole_record.status == "straight"
    np.testing.assert_array_equal(Motion.joined(parts).angles_rad, whole_record.frames.angles_rad)
    assert all(0.0 <= p.fraction < 1.0 for p in reports)
    assert peel(line(3), DEFAULT).status == "straight"
    with pytest.raises(InputError, match="lattice"):
        peel(Chain.from_angles(chain.module, np.full_like(chain.folded_rad, 0.1)), DEFAULT)


def test_recorder_proves_the_same_clearance_as_the_certificate() -> None:
    chain, record = snake()
    proof = Proof(chain, 0.98)
    frames = record.frames
    bends = [
        WindowConfiguration(
            time_s=float(frames.time_s[k]),
            first=int(frames.first[k]) // 2,
            angles=frames.angles_rad[frames.offsets[k] : frames.offsets[k + 1]].astype(np.float64),
        )
        for k in range(100, 160)
    ]
    least_share, each_share = proof.keeps(bends, 0.015)
    swept = sweep(chain, frames[100:160], module_size=0.98)
    assert least_share == pytest.approx(min(swept.clearance, 0.015), abs=1e-12)
    np.testing.assert_allclose(each_share, np.minimum(swept.per_frame, 0.015), atol=1e-12)


def test_recorder_proves_no_way_through_the_core() -> None:
    chain, _ = snake()
    proof = Proof(chain, 0.98)
    first = 120
    folded = chain.folded_rad[2 * first : 2 * first + 40]
    start = WindowConfiguration(time_s=0.0, first=first, angles=folded)
    end = WindowConfiguration(time_s=1.0, first=first, angles=-folded)
    assert proof.keeps([start], 0.015)[0] == 0.015
    assert proof.keeps([start, end], 0.015)[0] <= 0.0
