"""Allowance for rounding: what the derivation says, for dense and for windowed motions."""

from typing import Final

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.rounding_errors import BERNSTEIN_NORM, clearance_rounding
from foldback.planner.clearance.sweep import windows_shape
from foldback.planner.core import ROTATION, VELOCITY
from foldback.planner.motion.motion import as_motion
from tests.planner.chains import unvalidated
from tests.planner.peels import peel, snake, windows_of

U: Final = 2.0**-53
SIZE: Final = 0.98


def sheet(rows: int, columns: int) -> Chain:
    """Return a chain that folds into a flat sheet, row by row."""
    angles = np.zeros((rows * columns - 2, 2))
    ends = np.arange(1, rows) * columns - 1  # last module of each row but the last row
    turns = np.where(np.arange(rows - 1) % 2 == 0, np.pi / 2, -np.pi / 2)
    angles[ends - 1, 0] = angles[ends, 0] = turns
    return unvalidated(CUBE, angles.ravel())


@pytest.mark.parametrize(
    ("rows", "columns", "below"), [(100, 1000, 1e-4), (1000, 1000, 1e-3)], ids=["1e5", "1e6"]
)
def test_allowance_of_windows_is_that_of_the_derivation(
    rows: int, columns: int, below: float
) -> None:
    chain, links = sheet(rows, columns), 160
    n = len(chain)
    # From one frame to the next, a window of 159 joints moves by one joint.
    windows = windows_of(chain, [5000, 5002], [np.zeros(2 * 159)] * 2)
    angle = (10.0 * CUBE.largest_angle_rad + 8.0) * U
    e = 2.0 * np.sqrt(2.0) * (2.0 * angle + 3.0 * U)
    extent = 1.0 + float(np.hypot(rows - 1, columns - 1))
    thickness = 2.0 * CUBE.radius * SIZE
    core = n * (extent + thickness) * (2.0 * e + 48.0 * U)
    moving = (2 * links + 1) * (n + extent + thickness) * (2.0 * e + 48.0 * U)
    rest = 256.0 * U * (n + extent + thickness)
    expected = BERNSTEIN_NORM * (core + moving + rest)
    assert clearance_rounding(chain, windows, SIZE) == pytest.approx(expected, rel=1e-6)
    assert expected < below


def test_allowance_of_a_dense_motion_grows_with_the_square() -> None:
    small, large = (
        clearance_rounding(chain, as_motion(chain.folded_rad[None]), SIZE)
        for chain in (sheet(10, 100), sheet(100, 100))
    )
    assert large == pytest.approx(100.0 * small, rel=0.01)
    assert small == pytest.approx(5.4e-7, rel=0.02)


@pytest.mark.parametrize("sides", [(2, 2, 2), (3, 3, 3), (6, 6, 6), (4, 4, 60)])
def test_allowance_of_windows_is_no_larger_than_of_all_angles(sides: tuple[int, int, int]) -> None:
    chain = snake(sides)
    windows = peel(chain, width=24, step=1.5)
    dense = clearance_rounding(chain, windows.dense(chain), SIZE)
    assert 0.0 < clearance_rounding(chain, windows, SIZE) <= dense


def test_folded_rotations_of_a_sweep_are_orthonormal() -> None:
    # The rounding errors of so many links would stretch a long tail.
    chain = unvalidated(TETRAHEDRON, np.resize([0.7, -1.2, 0.3, 1.1], 20_000))
    rotations = windows_shape(chain, SIZE).core[:, ROTATION:VELOCITY].reshape(-1, 3, 3)
    off = np.linalg.norm(rotations @ rotations.swapaxes(1, 2) - np.eye(3), axis=(1, 2))
    assert off.max() < 32 * U
