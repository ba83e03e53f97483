from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.playback.reference_curve import Reference, resting_reference
from foldback.planner.playback.setpoints import timed_torques
from foldback.planner.playback.time_scaling import (
    TimeScaling,
    resting_scaling,
    smooth_scaling,
    torque_bounded_resting_scaling,
    torque_bounded_scaling,
)
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import Tree


def largest_torque(reference: Reference, tree: Tree, scaling: TimeScaling) -> float:
    """Return the largest torque of a chain that follows the reference exactly."""
    worst = 0.0
    for k in range(len(scaling) + 1):
        u, rate, acceleration = scaling.u[k], scaling.rate[k], scaling.acceleration[k]
        first = reference.first(u)
        tree.evaluate(reference.spline(u), first * rate)
        torques = tree.torques_for(reference.second(u) * rate**2 + first * acceleration)
        worst = max(worst, float(np.abs(torques).max()))
    return worst


@pytest.fixture(scope="module")
def bounded(folded: Any) -> tuple[Reference, Tree, TimeScaling]:
    angles = folded.record.frames.joint_angles_rad[::-1]
    reference = Reference.through(folded.chain, angles, spacing_rad=0.03, distance_weight=0.03)
    tree = Tree(folded.chain, Material(), step_s=0.02)
    scaling = torque_bounded_scaling(
        reference, folded.chain.module, steps=900, step_s=0.02, samples=220
    )
    return reference, tree, scaling


def test_patient_scaling_needs_little_torque_near_straight(
    bounded: tuple[Reference, Tree, TimeScaling], folded: Any
) -> None:
    reference, tree, usual = bounded
    patient = torque_bounded_scaling(
        reference,
        folded.chain.module,
        steps=900,
        step_s=0.02,
        samples=220,
        straight_torque=0.02,
    )
    check(patient, 900, 0.02)

    def first_torque(scaling: TimeScaling) -> float:
        """Return the ratio of the torque at the first steps to the largest one."""
        first = TimeScaling(
            u=scaling.u[:4],
            rate=scaling.rate[:4],
            acceleration=scaling.acceleration[:4],
            step_s=scaling.step_s,
        )
        return largest_torque(reference, tree, first) / largest_torque(reference, tree, scaling)

    assert first_torque(patient) < 0.25 * first_torque(usual)


def check_derivatives(scaling: TimeScaling) -> None:
    """Check that rates and accelerations are the derivatives of the path parameter."""
    by_difference = np.gradient(scaling.u, scaling.step_s)[1:-1]
    assert np.abs(by_difference - scaling.rate[1:-1]).max() < 0.02 * np.abs(scaling.rate).max()
    by_difference = np.gradient(scaling.rate, scaling.step_s)[2:-2]
    assert (
        np.abs(by_difference - scaling.acceleration[2:-2]).max()
        < 0.05 * np.abs(scaling.acceleration).max()
    )


def check(scaling: TimeScaling, steps: int, step_s: float) -> None:
    total = steps * step_s
    assert len(scaling) == steps
    assert len(scaling.u) == len(scaling.rate) == len(scaling.acceleration) == steps + 1
    assert scaling.u[0] == pytest.approx(0.0, abs=1e-9)
    assert scaling.u[-1] == pytest.approx(1.0, abs=1e-9)
    # At rest at both ends, and never backwards.
    assert abs(scaling.rate[0]) < 1e-6 / step_s
    assert abs(scaling.rate[-1]) < 1e-6 / step_s
    assert np.diff(scaling.u).min() > -1e-9
    check_derivatives(scaling)
    assert scaling.rate.max() < 3.0 / total


def test_smooth_scaling_and_its_way_back() -> None:
    scaling = smooth_scaling(steps=400, step_s=0.02)
    check(scaling, 400, 0.02)
    np.testing.assert_allclose(scaling.u + scaling.u[::-1], 1.0, atol=1e-12)
    assert scaling.acceleration[0] == scaling.acceleration[-1] == 0.0
    time_scaling = scaling.backwards()
    np.testing.assert_array_equal(time_scaling.u, scaling.u[::-1])
    check_derivatives(time_scaling)


def test_bounded_scaling_needs_less_torque(bounded: tuple[Reference, Tree, TimeScaling]) -> None:
    reference, tree, scaling = bounded
    check(scaling, 900, 0.02)
    smooth = smooth_scaling(steps=len(scaling), step_s=scaling.step_s)
    assert largest_torque(reference, tree, scaling) < 0.5 * largest_torque(reference, tree, smooth)


def test_bounded_scaling_of_a_chain_at_rest(folded: Any) -> None:
    chain = folded.chain
    still = np.zeros((2, len(chain.folded_rad)))
    reference = Reference.through(chain, still, spacing_rad=0.03, distance_weight=0.03)
    scaling = torque_bounded_scaling(reference, chain.module, steps=400, step_s=0.02, samples=100)
    assert np.isfinite(scaling.u).all()
    assert scaling.u[-1] == pytest.approx(1.0)


def test_turns_that_move_long_parts_take_more_time_and_less_torque() -> None:
    """At one end first, then in the middle: the second turn moves half of the rod."""
    chain = Chain.from_path(Path.from_cells([(k, 0, 0) for k in range(24)], name="rod"))
    rests = np.zeros((3, len(chain.folded_rad)))
    rests[1:, 2] = rests[2, len(chain.folded_rad) // 2] = np.pi / 2.0
    reference = resting_reference(rests)
    assert reference.rests is not None
    bounded = torque_bounded_resting_scaling(reference, chain.module, seconds=12.0, step_s=0.08)
    even = resting_scaling(reference.rests, np.full(2, 6.0), step_s=0.08)
    (only_rest,) = bounded.rests
    assert 60 < only_rest < 0.47 * len(bounded)
    assert 150 <= len(bounded) <= 152
    assert bounded.u[[0, only_rest, -1]].tolist() == [0.0, 0.5, 1.0]
    assert np.abs(bounded.rate[[0, only_rest, -1]]).max() < 1e-9
    assert np.diff(bounded.u).min() > -1e-9
    # No hinge is faster than 1.25 times the mean speed, but for the spline between samples.
    assert bounded.rate.max() < 1.02 * 1.25 / 12.0
    torques = [
        np.abs(timed_torques(reference, scaling, chain.module)).max() for scaling in (bounded, even)
    ]
    assert torques[0] < 0.2 * torques[1]
