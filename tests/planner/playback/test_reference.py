from typing import Any

import numpy as np
import pytest

from foldback.planner.clearance.sweep import sweep
from foldback.planner.playback.reference_curve import Reference, record_lengths
from tests.planner.chains import line


def test_reference_follows_the_record_smoothly_and_clear(folded: Any) -> None:
    record = folded.record.frames.joint_angles_rad
    reference = Reference.through(
        folded.chain, record[::-1], spacing_rad=0.03, distance_weight=0.03
    )
    np.testing.assert_allclose(reference.spline(0.0), 0.0, atol=1e-12)
    np.testing.assert_allclose(reference.spline(1.0), folded.chain.folded_rad, atol=1e-12)
    u = np.linspace(0.01, 0.99, 200)
    h = 1e-5
    slope = (reference.spline(u + h) - reference.spline(u - h)) / (2 * h)
    scale = np.abs(slope).max()
    np.testing.assert_allclose(reference.first(u), slope, atol=1e-4 * scale)
    bend = (reference.first(u + h) - reference.first(u - h)) / (2 * h)
    np.testing.assert_allclose(reference.second(u), bend, atol=2e-2 * np.abs(bend).max())
    # C²: the second derivative has no jumps, not even at knots.
    knots = np.unique(reference.spline.t)[1:-1]
    jumps = np.abs(reference.second(knots + 1e-9) - reference.second(knots - 1e-9)).max()
    assert jumps < 1e-3 * np.abs(bend).max()
    curve = reference.spline(np.linspace(0.0, 1.0, 400))
    gaps = np.abs(curve[:, None] - record[None]).max(axis=2).min(axis=1)
    assert gaps.max() < 0.05
    assert sweep(folded.chain, curve, module_size=0.95).clearance > 0.0


def test_lengths_count_the_largest_hinge_motion_and_displacements() -> None:
    chain = line(5)
    angles = np.zeros((4, 6))
    angles[:, 0] = [0.0, 0.1, 0.3, 0.2]
    angles[:, 3] = [0.0, 0.05, 0.0, 0.4]
    lengths = record_lengths(chain, angles, distance_weight=0.0)
    np.testing.assert_allclose(lengths, [0.0, 0.1, 0.3, 0.7])
    # The middle hinge of 41 modules is turned a little: the ends move some 5 pitches per radian.
    chain = line(41)
    angles = np.zeros((2, len(chain.folded_rad)))
    angles[1, chain.joint_names.index("joint_20_z")] = 0.1
    assert record_lengths(chain, angles, distance_weight=0.03)[-1] == pytest.approx(0.1)
    assert record_lengths(chain, angles, distance_weight=1.0)[-1] > 0.5
