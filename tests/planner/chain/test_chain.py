from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.module import CUBE
from planner.chain.path import Path
from planner.chain.rotations import matrix_from_wxyz
from planner.errors import InputError
from tests.planner.lattice import ROTATIONS, walks

QUARTER = np.pi / 2
Cells = NDArray[np.int64]


def chain_of(cells: Cells) -> Chain:
    return Chain.from_path(Path.from_cells(cells))


def test_a_known_fold(hook_chain: Chain) -> None:
    # The chain starts along x. To y: +90° about z. Then to z, which is up: −90° about y.
    np.testing.assert_array_equal(hook_chain.folded_rad, [0, 0, QUARTER, 0, 0, -QUARTER])
    assert hook_chain.joint_names[2] == "joint_2_z"
    assert (hook_chain.name, hook_chain.pitch_m, len(hook_chain)) == ("hook", 0.02, 5)


@given(walks())
def test_the_folded_chain_sits_in_the_cells(cells: Cells) -> None:
    chain = chain_of(cells)
    np.testing.assert_allclose(chain.folded_poses.positions, cells, atol=1e-12)
    assert len(chain) == len(cells)


@given(walks())
def test_every_angle_is_a_quarter_turn_or_none_and_no_joint_bends_twice(cells: Cells) -> None:
    angles = chain_of(cells).folded_rad
    assert np.isin(angles, [-QUARTER, 0.0, QUARTER]).all()
    assert (np.count_nonzero(angles.reshape(-1, 2), axis=1) <= 1).all()


@given(walks(), st.lists(st.integers(-1000, 1000), min_size=3, max_size=3))
def test_moving_a_path_moves_the_chain_and_leaves_its_angles(cells: Cells, by: list[int]) -> None:
    here, there = chain_of(cells), chain_of(cells + by)
    np.testing.assert_array_equal(there.folded_rad, here.folded_rad)
    np.testing.assert_array_equal(there.folded_wxyz, here.folded_wxyz)
    np.testing.assert_array_equal(there.folded_position - here.folded_position, by)


@given(walks(), st.sampled_from(ROTATIONS))
def test_turning_a_path_turns_the_angles_up_to_the_first_frame(
    cells: Cells, rotation: NDArray[np.int64]
) -> None:
    here, there = chain_of(cells), chain_of(cells @ rotation.T)
    bends = [np.abs(c.folded_rad.reshape(-1, 2)).sum(axis=1) for c in (here, there)]
    np.testing.assert_array_equal(*bends)
    # Re-rooted with the frame of the turned chain, the same angles give the turned cells.
    frame = rotation @ matrix_from_wxyz(here.folded_wxyz)
    inner = np.abs(frame.T @ matrix_from_wxyz(there.folded_wxyz))
    np.testing.assert_allclose(inner[0], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(there.folded_poses.positions, cells @ rotation.T, atol=1e-12)


@given(walks())
def test_a_reversed_path_has_the_same_bends_in_reverse(cells: Cells) -> None:
    bends = [
        np.abs(chain_of(c).folded_rad.reshape(-1, 2)).sum(axis=1) for c in (cells, cells[::-1])
    ]
    np.testing.assert_array_equal(bends[0], bends[1][::-1])


@given(walks())
def test_a_chain_from_the_angles_of_a_path_has_its_shape(cells: Cells) -> None:
    folded = chain_of(cells)
    again = Chain.from_angles(CUBE, folded.folded_rad.reshape(-1, 2))
    frame = matrix_from_wxyz(folded.folded_wxyz)
    moved = again.folded_poses.positions @ frame.T + folded.folded_position
    np.testing.assert_allclose(moved, cells, atol=1e-12)


@given(walks(), st.data())
def test_an_overlap_is_found_and_named(cells: Cells, data: st.DataObject) -> None:
    # Fold the chain's tail onto itself: four quarter turns about z close a square.
    at = data.draw(st.integers(0, len(cells) - 3))
    angles = chain_of(cells).folded_rad.reshape(-1, 2)
    closed = np.concatenate([angles[:at], np.tile([QUARTER, 0.0], (4, 1))])
    with pytest.raises(InputError) as refusal:
        Chain.from_angles(CUBE, closed)
    assert refusal.value.code == "overlap"
    first, second = (int(w) for w in refusal.value.where.split() if w.isdigit())
    full = Chain._checked(
        name="",
        module=CUBE,
        folded=closed.reshape(-1).copy(),
        position=np.zeros(3),
        wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        pitch_m=1.0,
    ).folded_poses.positions
    assert first < second
    assert np.linalg.norm(full[first] - full[second]) < 0.98


def test_a_square_of_five_modules_runs_into_its_first() -> None:
    with pytest.raises(InputError, match="modules 0 and 4 overlap"):
        Chain.from_angles(CUBE, np.tile([QUARTER, 0.0], 4))


def test_modules_that_only_graze_are_refused_and_those_that_pass_are_not() -> None:
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
def test_angles_that_no_chain_can_have_are_refused(
    angles_deg: list[float], code: str, where: str | None
) -> None:
    with pytest.raises(InputError) as refusal:
        Chain.from_angles(CUBE, np.deg2rad(angles_deg))
    assert (refusal.value.code, refusal.value.where) == (code, where)


def test_the_callers_angles_are_not_frozen() -> None:
    angles = np.zeros(4)
    chain = Chain.from_angles(CUBE, angles)
    angles[0] = 1.0
    assert chain.folded_rad[0] == 0.0
