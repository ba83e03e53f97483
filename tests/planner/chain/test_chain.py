from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.module import CUBE
from planner.chain.overlap import first_close_pair
from planner.chain.path import Path
from planner.chain.rotations import matrix_from_wxyz
from planner.errors import InputError
from tests.planner.lattice import walks

QUARTER = np.pi / 2
Cells = NDArray[np.int64]


def chain_of(cells: Cells) -> Chain:
    return Chain.from_path(Path.from_cells(cells))


def test_angles_of_a_known_fold(hook_chain: Chain) -> None:
    # The chain starts along x. To y: +90° about z. Then to z, which is up: −90° about y.
    np.testing.assert_array_equal(hook_chain.folded_rad, [0, 0, QUARTER, 0, 0, -QUARTER])
    assert hook_chain.joint_names[2] == "joint_2_z"
    assert (hook_chain.name, hook_chain.pitch_m, len(hook_chain)) == ("hook", 0.02, 5)


@given(walks())
def test_folded_chain_is_in_the_cells_of_its_path(cells: Cells) -> None:
    chain = chain_of(cells)
    np.testing.assert_allclose(chain.folded_poses.positions, cells, atol=1e-12)
    assert len(chain) == len(cells)
    assert np.isin(chain.folded_rad, [-QUARTER, 0.0, QUARTER]).all()
    assert (np.count_nonzero(chain.folded_rad.reshape(-1, 2), axis=1) <= 1).all()


@given(walks())
def test_chain_from_the_angles_of_a_path_has_its_shape(cells: Cells) -> None:
    folded = chain_of(cells)
    again = Chain.from_angles(CUBE, folded.folded_rad.reshape(-1, 2))
    frame = matrix_from_wxyz(folded.folded_wxyz)
    moved = again.folded_poses.positions @ frame.T + folded.folded_position
    np.testing.assert_allclose(moved, cells, atol=1e-12)


@given(walks(), st.data())
def test_overlapping_modules_are_named(cells: Cells, data: st.DataObject) -> None:
    # Fold the chain's tail onto itself: four quarter turns about z close a square.
    at = data.draw(st.integers(0, len(cells) - 3))
    angles = chain_of(cells).folded_rad.reshape(-1, 2)
    closed = np.concatenate([angles[:at], np.tile([QUARTER, 0.0], (4, 1))])
    with pytest.raises(InputError) as refusal:
        Chain.from_angles(CUBE, closed)
    assert refusal.value.code == "overlap"
    first, second = (int(w) for w in refusal.value.where.split() if w.isdigit())
    positions = forward_kinematics(CUBE, closed.reshape(-1)).positions
    assert first < second
    assert np.linalg.norm(positions[first] - positions[second]) < 0.98


def test_modules_that_graze_are_refused() -> None:
    # Three bends of 85° bring module 0 and module 4 to less than a pitch of each other.
    with pytest.raises(InputError, match="overlap"):
        Chain.from_angles(CUBE, np.deg2rad([85.0, 0.0] * 3 + [85.0, 0.0]))
    assert len(Chain.from_angles(CUBE, np.deg2rad([60.0, 0.0] * 3))) == 5


@pytest.mark.parametrize(
    ("angles_deg", "code", "where"),
    [
        ([], "wrong-count", None),
        ([0.0, 0.0, 0.0], "wrong-count", None),
        ([0.0, np.nan], "not-finite", "angle 1"),
        ([0.0, 0.0, np.inf, 0.0], "not-finite", "angle 2"),
        ([0.0, 0.0, 0.0, 93.0], "out-of-range", "joint 1"),
        ([-360.0, 0.0], "out-of-range", "joint 0"),
    ],
)
def test_angles_out_of_range_are_refused(
    angles_deg: list[float], code: str, where: str | None
) -> None:
    with pytest.raises(InputError) as refusal:
        Chain.from_angles(CUBE, np.deg2rad(angles_deg))
    assert (refusal.value.code, refusal.value.where) == (code, where)


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.floats(0.5, 8.0))
def test_first_close_pair_agrees_with_all_distances(seed: int, count: int, size: float) -> None:
    points = np.random.default_rng(seed).uniform(-size, size, (count, 3))
    distances = np.linalg.norm(points[:, None] - points[None], axis=-1)
    np.fill_diagonal(distances, np.inf)
    pair = first_close_pair(points, 0.98)
    if pair is None:
        assert distances.min() >= 0.98
    else:
        i, j = pair
        assert i < j
        assert distances[i, j] < 0.98


def test_thousands_of_points_in_one_place_need_little_memory() -> None:
    assert first_close_pair(np.zeros((20_000, 3)), 0.98) is not None
