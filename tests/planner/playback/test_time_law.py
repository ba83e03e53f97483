from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from planner.playback.reference import Reference
from planner.playback.time_law import TimeLaw, smooth_law, torque_bounded_law
from planner.simulation.model import Material
from planner.simulation.tree import Tree


def largest_torque(reference: Reference, tree: Tree, law: TimeLaw) -> float:
    """Of a chain that follows the reference by a law exactly."""
    worst = 0.0
    for k in range(len(law) + 1):
        u, rate, acceleration = law.u[k], law.rate[k], law.acceleration[k]
        first = reference.first(u)
        tree.evaluate(reference.spline(u), first * rate)
        torques = tree.torques_for(reference.second(u) * rate**2 + first * acceleration)
        worst = max(worst, float(np.abs(torques).max()))
    return worst


@pytest.fixture(scope="module")
def bounded(folded: Callable[..., Any]) -> tuple[Reference, Tree, TimeLaw]:
    fold = folded("wrench-24")
    angles = fold.record.frames.joint_angles_rad[::-1]
    reference = Reference.through(fold.chain, angles, spacing_rad=0.03, distance_weight=0.03)
    tree = Tree(fold.chain, Material(), step_s=0.02)
    law = torque_bounded_law(reference, fold.chain.module, steps=900, step_s=0.02, samples=220)
    return reference, tree, law


def belongs_together(law: TimeLaw) -> None:
    """Whether rates and accelerations are those of the places."""
    by_difference = np.gradient(law.u, law.step_s)[1:-1]
    assert np.abs(by_difference - law.rate[1:-1]).max() < 0.02 * np.abs(law.rate).max()
    by_difference = np.gradient(law.rate, law.step_s)[2:-2]
    assert (
        np.abs(by_difference - law.acceleration[2:-2]).max() < 0.05 * np.abs(law.acceleration).max()
    )


def check(law: TimeLaw, steps: int, step_s: float) -> None:
    total = steps * step_s
    assert len(law) == steps
    assert len(law.u) == len(law.rate) == len(law.acceleration) == steps + 1
    assert law.u[0] == pytest.approx(0.0, abs=1e-9)
    assert law.u[-1] == pytest.approx(1.0, abs=1e-9)
    # At rest at both ends, and never backwards.
    assert abs(law.rate[0]) < 1e-6 / step_s
    assert abs(law.rate[-1]) < 1e-6 / step_s
    assert np.diff(law.u).min() > -1e-9
    belongs_together(law)
    assert law.rate.max() < 3.0 / total


def test_smooth_law_and_its_way_back() -> None:
    law = smooth_law(steps=400, step_s=0.02)
    check(law, 400, 0.02)
    np.testing.assert_allclose(law.u + law.u[::-1], 1.0, atol=1e-12)
    assert law.acceleration[0] == law.acceleration[-1] == 0.0
    back = law.backwards()
    np.testing.assert_array_equal(back.u, law.u[::-1])
    belongs_together(back)


def test_bounded_law_needs_less_torque(bounded: tuple[Reference, Tree, TimeLaw]) -> None:
    reference, tree, law = bounded
    check(law, 900, 0.02)
    smooth = smooth_law(steps=len(law), step_s=law.step_s)
    assert largest_torque(reference, tree, law) < 0.5 * largest_torque(reference, tree, smooth)


def test_bounded_law_of_a_chain_at_rest(folded: Callable[..., Any]) -> None:
    chain = folded("wrench-24").chain
    still = np.zeros((2, len(chain.folded_rad)))
    reference = Reference.through(chain, still, spacing_rad=0.03, distance_weight=0.03)
    law = torque_bounded_law(reference, chain.module, steps=400, step_s=0.02, samples=100)
    assert np.isfinite(law.u).all()
    assert law.u[-1] == pytest.approx(1.0)
