"""Contacts of modules with the floor and with each other."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.statics.contacts import FLOOR, MODULE_GAP, contacts
from tests.planner.chains import chain_of, line
from tests.planner.statics.standing import standing


def turned(axis: str, angle: float) -> np.ndarray:
    return Rotation.from_euler(axis, angle).as_matrix()


def two(at: tuple[float, float, float], turn: np.ndarray) -> np.ndarray:
    """Return the contacts of cubes at the origin and at ``at``; a third one is far from both."""
    positions = np.array([(0.0, 0.0, 9.0), (0.5, 0.5, 8.0), (*at[:2], at[2] + 9.0)])
    computed_contacts = contacts(CUBE, positions, np.array([np.eye(3), np.eye(3), turn]))
    return np.column_stack(
        [
            computed_contacts.points - [0.0, 0.0, 9.0],
            computed_contacts.normals,
            computed_contacts.gaps,
        ]
    )


def test_faces_touch_at_the_corners_of_their_common_area() -> None:
    found_contacts = two((0.25, 0.0, 1.0), np.eye(3))
    assert sorted(map(tuple, found_contacts[:, :2].round(9))) == [
        (-0.25, -0.5),
        (-0.25, 0.5),
        (0.5, -0.5),
        (0.5, 0.5),
    ]
    assert np.allclose(found_contacts[:, 2:], [0.5, 0.0, 0.0, 1.0, 0.0])


def test_gaps_up_to_the_bound_are_contacts() -> None:
    assert len(two((0.0, 0.0, 1.0 + MODULE_GAP - 1e-3), np.eye(3))) == 4
    assert len(two((0.0, 0.0, 1.0 + MODULE_GAP + 1e-3), np.eye(3))) == 0
    # Neighbours across an edge or a corner of the lattice do not touch.
    assert len(two((1.0, 0.0, 1.0), np.eye(3))) == 0
    assert len(two((1.0, 1.0, 1.0), np.eye(3))) == 0


def test_tilted_face_touches_with_its_lower_edge() -> None:
    tilt = turned("y", 0.1)
    height = 0.5 * (np.cos(0.1) + np.sin(0.1))
    found_contacts = two((0.0, 0.0, 0.5 + height), tilt)
    assert len(found_contacts) == 2
    assert np.allclose(found_contacts[:, 2], 0.5, atol=1e-6)
    assert np.allclose(np.abs(found_contacts[:, 1]), 0.5)


def test_corner_on_a_face_is_one_contact() -> None:
    turn = turned("y", np.arctan(np.sqrt(0.5))) @ turned("x", np.pi / 4)
    depth = (turn @ CUBE.pieces[0].corners.T)[2].min()
    found_contacts = two((0.1, 0.1, 0.5 - depth + 0.01), turn)
    assert len(found_contacts) == 1
    assert found_contacts[0, 6] == pytest.approx(0.01)
    assert found_contacts[0, 2] == pytest.approx(0.505)


def test_crossing_edges_have_one_contact() -> None:
    # One stands on an edge along x, the other lies with one along y: rotated by 45° each.
    positions = np.array([(0.0, 0.0, 9.0), (0.5, 0.5, 8.0), (0.1, 0.2, 9.0 + np.sqrt(2.0) + 0.02)])
    rotations = np.array([turned("x", np.pi / 4), np.eye(3), turned("y", np.pi / 4)])
    computed_contacts = contacts(CUBE, positions, rotations)
    is_upper = computed_contacts.first == 2
    assert is_upper.sum() == 1
    assert computed_contacts.points[is_upper][0] == pytest.approx(
        [0.1, 0.0, 9.0 + np.sqrt(0.5) + 0.01]
    )
    assert computed_contacts.normals[is_upper][0] == pytest.approx([0.0, 0.0, 1.0])
    assert computed_contacts.gaps[is_upper][0] == pytest.approx(0.02)


def test_linked_cubes_have_no_contacts() -> None:
    chain = chain_of([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    computed_contacts = contacts(CUBE, *standing(chain)[:2])
    pairs = {
        (a, b)
        for a, b in zip(computed_contacts.first, computed_contacts.second, strict=True)
        if b != FLOOR
    }
    assert pairs == {(3, 0)}
    assert computed_contacts.on_floor.sum() == 16


def test_contacts_of_linked_tetrahedra() -> None:
    chain = Chain.from_angles(TETRAHEDRON, np.array([np.pi / 2, 0.0]))
    poses = chain.folded_poses
    computed_contacts = contacts(TETRAHEDRON, poses.positions + [0.0, 0.0, 9.0], poses.rotations)
    assert set(
        zip(computed_contacts.first.tolist(), computed_contacts.second.tolist(), strict=True)
    ) <= {(1, 0), (0, 1)}
    assert len(computed_contacts) == 3  # ends of the hinge and the corner that is farthest from it
    straight = Chain.from_angles(TETRAHEDRON, np.zeros(2)).folded_poses
    apart = contacts(TETRAHEDRON, straight.positions + [0.0, 0.0, 9.0], straight.rotations)
    arms = apart.points - [0.5, 0.0, 9.0]
    near = (apart.first == 1) & (apart.second == 0) | (apart.first == 0) & (apart.second == 1)
    assert np.abs(arms[near][:, :2]).max(initial=0.0) < 1e-6  # only on the hinge itself


def test_floor_bears_corners_up_to_a_bound() -> None:
    poses = line(3).folded_poses
    for lift, count in ((0.515, 12), (0.525, 0)):
        computed_contacts = contacts(CUBE, poses.positions + [0.0, 0.0, lift], poses.rotations)
        assert computed_contacts.on_floor.sum() == count
