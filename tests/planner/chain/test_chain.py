import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.close_points import first_close_pair
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.chain.path import MAX_COORDINATE, Path
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.errors import InputError
from tests.case import case
from tests.planner.chains import chain_of
from tests.planner.lattice import Ints, walks
from tests.refusal import refused

QUARTER = np.pi / 2


def test_angles_of_a_known_fold(hook_chain: Chain) -> None:
    # The chain starts along x. A turn by +90° about z leads to y, then −90° about y to z (up).
    np.testing.assert_array_equal(hook_chain.folded_rad, [0, 0, QUARTER, 0, 0, -QUARTER])
    assert hook_chain.joint_names[2] == "joint_2_z"
    assert (hook_chain.name, hook_chain.pitch_m, len(hook_chain)) == ("hook", 0.02, 5)


@given(walks())
def test_folded_chain_is_in_the_cells_of_its_path(cells: Ints) -> None:
    chain = chain_of(cells)
    np.testing.assert_allclose(chain.folded_poses.positions, cells, atol=1e-12)
    assert len(chain) == len(cells)
    assert np.isin(chain.folded_rad, [-QUARTER, 0.0, QUARTER]).all()
    assert (np.count_nonzero(chain.folded_rad.reshape(-1, 2), axis=1) <= 1).all()


@given(walks())
def test_chain_from_the_angles_of_a_path_has_its_shape(cells: Ints) -> None:
    folded = chain_of(cells)
    second_chain = Chain.from_angles(CUBE, folded.folded_rad.reshape(-1, 2))
    frame = matrix_from_wxyz(folded.folded_wxyz)
    moved = second_chain.folded_poses.positions @ frame.T + folded.folded_position
    np.testing.assert_allclose(moved, cells, atol=1e-12)


@given(walks(), st.data())
def test_overlapping_modules_are_named(cells: Ints, data: st.DataObject) -> None:
    # The tail is folded onto the chain: four quarter turns about z close a square.
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
    # Three bends of 85° bring modules 0 and 4 closer than one pitch.
    with pytest.raises(InputError, match="overlap"):
        Chain.from_angles(CUBE, np.deg2rad([85.0, 0.0] * 3 + [85.0, 0.0]))
    assert len(Chain.from_angles(CUBE, np.deg2rad([60.0, 0.0] * 3))) == 5


def test_angles_out_of_range_are_refused() -> None:
    for angles_deg, code, error_place in (
        ([], "wrong-count", None),
        ([0.0, 0.0, 0.0], "wrong-count", None),
        ([0.0, np.nan], "not-finite", "angle 1"),
        ([0.0, 0.0, np.inf, 0.0], "not-finite", "angle 2"),
        ([0.0, 0.0, 0.0, 93.0], "out-of-range", "joint 1"),
        ([-360.0, 0.0], "out-of-range", "joint 0"),
    ):
        with case((angles_deg, code)), refused(code, error_place):
            Chain.from_angles(CUBE, np.deg2rad(angles_deg))


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


def test_invalid_paths_are_refused_with_their_place() -> None:
    for cells, code, error_place in (
        ([], "not-cells", None),
        ([(0, 0, 0)], "too-few-cells", None),
        ([(0, 0), (1, 0), (2, 0)], "not-cells", None),
        ([("a", "b", "c")] * 3, "not-cells", None),
        ([[True, False, True]] * 3, "not-cells", None),
        ([(0, 0, 0), (1, 0, 0), (1, 1.5, 0)], "not-whole", "cell 2"),
        ([(0, 0, 0), (np.nan, 0, 0), (1, 1, 0)], "not-finite", "cell 1"),
        ([(0, 0, 0), (np.inf, 0, 0), (1, 1, 0)], "not-finite", "cell 1"),
        ([(MAX_COORDINATE + 1, 0, 0), (0, 0, 0), (1, 0, 0)], "too-far", "cell 0"),
        ([(0, 0, 0), (1, 0, 0), (0, 0, 0)], "repeated-cell", "cells 0 and 2"),
        ([(0, 0, 0), (1, 0, 0), (3, 0, 0)], "not-adjacent", "cells 1 and 2"),
        ([(0, 0, 0), (1, 1, 0), (2, 1, 0)], "not-adjacent", "cells 0 and 1"),
    ):
        with case((cells, code)), refused(code, error_place):
            Path.from_cells(cells)  # type: ignore[arg-type]


@pytest.mark.parametrize("pitch_m", [0.0, -1.0, float("nan"), 2000.0])
def test_pitch_out_of_range_is_refused(pitch_m: float) -> None:
    with refused("bad-pitch"):
        Path.from_cells([(0, 0, 0), (1, 0, 0), (2, 0, 0)], pitch_m=pitch_m)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON])
def test_hinges_and_modules_name_each_other(module: Module) -> None:
    chain = Chain.from_angles(module, np.zeros(6 * module.hinges_per_joint))
    hinges = np.arange(len(chain.folded_rad))
    before, after = chain.module_before(hinges), chain.module_after(hinges)
    assert before[0] == module.rigid_links and after[-1] == len(chain) - 1
    for name, module_of in zip(chain.joint_names, before.tolist(), strict=True):
        assert name.split("_")[1] == str(module_of)
    joints = np.arange(chain.joint_count)
    np.testing.assert_array_equal(chain.hinges_of(joints).ravel(), hinges)
    np.testing.assert_array_equal(chain.hinges_of(2), np.flatnonzero(before == before[0] + 2))
    np.testing.assert_array_equal(module.joint_after(before[:: module.hinges_per_joint]), joints)
    assert chain.module_after(0) == 1 + chain.module_before(0) == after[0]
    assert module.module_count(len(hinges)) == len(chain)
