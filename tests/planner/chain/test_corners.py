import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.corners import lowest_corners, placed_corners, placed_faces
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.errors import InputError
from tests.planner.brackets import BRACKETS

POSES = forward_kinematics(TETRAHEDRON, np.array([0.3, -0.7, 1.1, 0.2]))


def test_corners_and_faces_are_those_of_each_module_s_piece() -> None:
    positions, rotations = POSES.positions, POSES.rotations
    corners = placed_corners(BRACKETS, positions, rotations)
    lowest = lowest_corners(BRACKETS, positions, rotations, module_size=0.9)
    count, members = 0, np.array([0, 1, 3])
    faces = placed_faces(BRACKETS, positions, rotations, members)
    for i, (position, rotation) in enumerate(zip(positions, rotations, strict=True)):
        piece = BRACKETS.piece(i)
        local = (corners - position) @ rotation
        for corner in piece.corners:
            assert np.abs(local - corner).max(axis=1).min() < 1e-12
        count += len(piece.corners)
        expected = (0.9 * piece.corners @ rotation.T + position)[:, 2].min()
        assert lowest[i] == pytest.approx(expected)
        own = np.flatnonzero(faces.modules == i)
        assert len(own) == (sum(len(part.loops) for part in piece.parts) if i in members else 0)
        assert faces.numbers[own].tolist() == list(range(len(own)))
    assert len(corners) == count
    for normal, middle, ring in zip(faces.normals, faces.middles, faces.corners, strict=True):
        assert middle == pytest.approx(ring.mean(axis=0))
        assert (ring - middle) @ normal == pytest.approx(0.0)
        ahead, following = ring[1] - ring[0], ring[2] - ring[1]
        assert np.cross(ahead, following) @ normal > 0.0
    assert {len(ring) for ring in faces.corners} == {3, 4}


def test_faces_that_two_modules_share_are_inner() -> None:
    # The second one is next to the first one: a face of each of the two boxes lies on one.
    positions = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [9.0, 0.0, 0.4]])
    faces = placed_faces(BRACKETS, positions, np.stack([np.eye(3)] * 4), np.array([1, 3]))
    assert faces.outer().all()
    positions[3] = positions[1] + [0.0, 0.0, 0.4]
    touching = placed_faces(BRACKETS, positions, np.stack([np.eye(3)] * 4), np.array([1, 3]))
    assert (~touching.outer()).sum() == 4


def test_overlap_of_parts_is_refused_and_a_hollow_is_not() -> None:
    Chain.from_angles(BRACKETS, np.full(4, 1.2))
    with pytest.raises(InputError, match="overlap") as refused:
        Chain.from_angles(BRACKETS, np.full(4, 1.5))
    assert refused.value.code == "overlap"
    assert refused.value.values["modules"] == [0, 4]
