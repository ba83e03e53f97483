import mujoco
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.rotations import (
    aligned_distances,
    matrix_from_wxyz,
    motion_in_plane,
    wxyz_from_matrix,
)
from tests.planner.chains import Array, random_rotation


def some_angles(seed: int, joints: int, frames: int = 3) -> Array:
    return np.random.default_rng(seed).uniform(-1.5, 1.5, (frames, 2 * joints))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.data())
def test_any_root_gives_the_same_poses(seed: int, joints: int, data: st.DataObject) -> None:
    angles = some_angles(seed, joints)
    ends = forward_kinematics(CUBE, angles)
    root = data.draw(st.integers(0, joints + 1))
    second_poses = forward_kinematics(
        CUBE,
        angles,
        root=root,
        root_position=ends.positions[:, root],
        root_wxyz=ends.wxyzs[:, root],
    )
    np.testing.assert_allclose(second_poses.positions, ends.positions, atol=1e-12)
    np.testing.assert_allclose(second_poses.rotations, ends.rotations, atol=1e-12)


def mujoco_chain(modules: int) -> mujoco.MjModel:
    """Return a chain as MJCF: body k + 1 is a child of body k, with hinges at k's centre."""
    xml = ""
    for k in range(modules - 1, 0, -1):
        hinges = "".join(
            f'<joint type="hinge" axis="{axis}" pos="0 0 0"/>' for axis in ("0 0 1", "0 1 0")
        )
        # The frame of body k is at the centre of module k − 1; its box is one pitch further.
        body = '<geom type="box" size=".4 .4 .4" pos="1 0 0" contype="0" conaffinity="0"/>'
        site = f'<site name="m{k}" pos="1 0 0"/>'
        place = "0 0 0" if k == 1 else "1 0 0"
        xml = f'<body pos="{place}">{hinges if k > 1 else ""}{body}{site}{xml}</body>'
    base = '<geom type="box" size=".4 .4 .4"/><site name="m0"/>'
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body>{base}{xml}</body></worldbody></mujoco>"
    )


@given(st.integers(0, 2**32 - 1))
def test_poses_agree_with_mujoco(seed: int) -> None:
    model = mujoco_chain(6)
    data = mujoco.MjData(model)
    data.qpos[:] = some_angles(seed, 4, frames=1)[0]
    mujoco.mj_kinematics(model, data)
    poses = forward_kinematics(CUBE, data.qpos)
    np.testing.assert_allclose(poses.positions, data.site_xpos, atol=1e-12)
    np.testing.assert_allclose(poses.rotations.reshape(-1, 9), data.site_xmat, atol=1e-12)


quaternions = (
    arrays(np.float64, (5, 4), elements=st.floats(-1, 1))
    .filter(lambda q: bool((np.linalg.norm(q, axis=1) > 0.1).all()))
    .map(lambda q: q / np.linalg.norm(q, axis=1, keepdims=True))
)


@given(quaternions)
def test_quaternion_is_recovered_from_its_matrix(q: np.ndarray) -> None:
    restored_wxyz_from_matrix = wxyz_from_matrix(matrix_from_wxyz(q))
    np.testing.assert_allclose(np.abs((restored_wxyz_from_matrix * q).sum(axis=1)), 1.0, atol=1e-12)
    assert (restored_wxyz_from_matrix[:, 0] >= 0).all()
    np.testing.assert_allclose(matrix_from_wxyz(3.0 * q), matrix_from_wxyz(q), atol=1e-12)


def test_quarter_turns() -> None:
    half = np.sqrt(0.5)
    turned = matrix_from_wxyz(np.array([half, 0.0, 0.0, half])) @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned, [0.0, 1.0, 0.0], atol=1e-15)
    matrices = np.rint(Rotation.create_group("O").as_matrix()).reshape(2, 12, 3, 3)
    matrices_again = matrix_from_wxyz(wxyz_from_matrix(matrices))
    np.testing.assert_allclose(matrices_again, matrices, atol=1e-15)


def test_motion_in_plane_leaves_heights_alone() -> None:
    draws = np.random.default_rng(3)
    points = draws.normal(size=(6, 9, 3))
    angles = draws.uniform(-np.pi, np.pi, 6)
    still = np.zeros(6)
    turns = matrix_from_wxyz(
        np.column_stack([np.cos(angles / 2), still, still, np.sin(angles / 2)])
    )
    column_stack = np.column_stack([draws.normal(size=(6, 2)), still])
    target = points @ turns.swapaxes(1, 2) + column_stack[:, None]
    moved_points, shifts = motion_in_plane(points, target + [0.0, 0.0, 2.0])
    np.testing.assert_allclose(moved_points, turns, atol=1e-12)
    np.testing.assert_allclose(shifts, column_stack, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_aligned_distances_are_the_smallest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, points = rng.normal(size=(2, 12, 3))
    moved = target @ random_rotation(rng).T + rng.normal(size=3) * 10.0
    np.testing.assert_allclose(aligned_distances(moved, target), 0.0, atol=1e-9)
    assert aligned_distances(target * [1.0, 1.0, -1.0], target).max() > 0.1  # mirrored
    best = (aligned_distances(points, target) ** 2).sum()
    moved = points - points.mean(axis=0)
    fixed = target - target.mean(axis=0)
    for _ in range(20):
        other_total = ((moved @ random_rotation(rng) - fixed) ** 2).sum()
        assert best <= other_total + 1e-9


def test_points_in_a_line_are_aligned() -> None:
    straight = np.stack([np.arange(9.0), np.zeros(9), np.zeros(9)], axis=1)
    rotation = random_rotation(np.random.default_rng(3))
    distances = aligned_distances(straight @ rotation.T, straight)
    np.testing.assert_allclose(distances, 0.0, atol=1e-9)
