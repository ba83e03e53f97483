"""The curve that is followed on a table: where it may not lie deep, and what it leaves alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.path import Path
from planner.motion.motion import Motion
from planner.playback.table_curve import MAX_TABLE_PENETRATION_PITCH, TableCurve
from planner.playback.window_course import WindowCurve
from planner.statics.contacts import floor_clearances

Array = NDArray[np.float64]
MODULES = 24
DIP = 0.04
"""Pitches by which the row's end goes into the table; the other way it rises."""
ACROSS, DOWN = 0, 1
"""Hinges of the first joint that turn a row that lies flat along the table, and into it."""


@pytest.fixture(scope="module")
def row() -> Chain:
    return Chain.from_path(Path.from_cells([(x, 0, 0) for x in range(MODULES)], name="row"))


def swept(row: Chain, dip: float) -> Motion:
    """A row that sweeps along the table by a radian and dips halfway, its end the farthest."""
    share = np.linspace(0.0, 1.0, 21)
    angles = np.zeros((len(share), len(row.folded_rad)))
    angles[:, ACROSS] = share * (1.0 - share)
    angles[:, DOWN] = dip / (MODULES - 2) * np.sin(np.pi * share) ** 2
    frames = Motion.from_frames(
        phase="explosion",
        time_s=share,
        joint_angles_rad=angles,
        root_position=np.zeros((len(share), 3)),
        root_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (len(share), 1)),
    )
    return frames.windowed(row)


def drawn(row: Chain, curve: WindowCurve) -> tuple[Array, float]:
    """Angles along a curve, and how high the lowest corner of all is."""
    angles = curve.at(np.linspace(0.0, curve.end, 200), slice(0, len(row.folded_rad)))
    poses = forward_kinematics(
        row.module,
        angles,
        root=0,
        root_position=row.folded_position - np.array([0.0, 0.0, row.table_height]),
        root_wxyz=row.folded_wxyz,
    )
    heights = floor_clearances(row.module, poses.positions, poses.rotations)
    return angles, float(heights.min())


def test_row_below_the_table_is_lifted_by_the_least_turn(row: Chain) -> None:
    windows = swept(row, DIP)
    plain, low = drawn(row, WindowCurve(row, windows, 0.03))
    assert low < -0.03
    mended, least = drawn(row, TableCurve(row, windows, 0.03))
    assert least > -MAX_TABLE_PENETRATION_PITCH - 1e-3
    turned = np.abs(mended - plain).max(axis=0)
    assert turned.max() < 1.5 * abs(DIP) / MODULES
    assert turned[ACROSS] < 0.1 * turned[DOWN]
    np.testing.assert_array_equal(mended[[0, -1]], plain[[0, -1]])


def test_row_within_the_tolerance_or_above_the_table_is_unchanged(row: Chain) -> None:
    for dip in (0.2 * DIP, -DIP):
        windows = swept(row, dip)
        plain, _ = drawn(row, WindowCurve(row, windows, 0.03))
        mended, _ = drawn(row, TableCurve(row, windows, 0.03))
        np.testing.assert_array_equal(mended, plain)


def test_curve_does_not_lift_a_row_before_the_record(row: Chain) -> None:
    """A smooth curve would lift it before: it would hang where the record has it stand."""
    share = np.linspace(0.0, 1.0, 21)
    windows = swept(row, 0.0)
    angles = windows.dense(row).joint_angles_rad.copy()
    angles[:, ACROSS], angles[:, DOWN] = share, -np.maximum(share - 0.5, 0.0)
    windows = windows.dense(row).with_columns(joint_angles_rad=angles).windowed(row)
    hangs = [hanging(row, kind(row, windows, 0.03)) for kind in (WindowCurve, TableCurve)]
    assert hangs[0] > 0.02
    assert hangs[1] < 0.01


def hanging(row: Chain, curve: WindowCurve) -> float:
    """How high the row's end is where the record is about to lift it."""
    places = np.arange(1.0, curve.end - 1.0)
    angles = curve.at(places, slice(0, len(row.folded_rad)))
    before = angles[:, ACROSS] < 0.5 + 1e-6
    return float((-angles[before, DOWN]).max() * (MODULES - 2))
