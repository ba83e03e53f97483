"""Chains of tetrahedra from their angles to a verified plan, on the same code as cubes."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.module import TETRAHEDRON
from planner.clearance.clearance import closest
from planner.clearance.margins import largest_size
from planner.clearance.sweep import sweep
from planner.errors import InputError
from planner.pathfinding.tetrahedra import find_trails
from planner.plan.shape_files import write_chain
from planner.readers import read
from planner.readers.angle_strings import read_angle_string
from planner.shapes.shape import Shape

RING = "- - - + - - - + - - -"


def cube(side: int) -> Chain:
    cells = np.array(list(product(range(side), repeat=3)))
    return Chain.from_trail(find_trails(Shape.from_cells(cells)).trails[0])


def test_linked_tetrahedra_are_checked_too() -> None:
    """A hinge keeps two tetrahedra apart only up to a right angle; cubes share their joint."""
    chain = Chain.from_angles(TETRAHEDRON, np.zeros(2))
    poses = chain.poses(np.deg2rad([100.0, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    found = closest(TETRAHEDRON, poses.positions, poses.rotations, size=0.99)
    assert found.clearance < 0.0
    assert found.modules == (0, 1)


def test_chain_file_keeps_its_place() -> None:
    chain = cube(2)
    again = read(write_chain(chain, title="Cube", tags=("solid",)))
    assert isinstance(again, Chain)
    np.testing.assert_allclose(
        again.folded_poses.positions, chain.folded_poses.positions, atol=1e-9
    )
    np.testing.assert_array_equal(again.folded_rad, chain.folded_rad)


@pytest.mark.parametrize(
    ("key", "value", "code"),
    [
        ("first_wxyz", [0, 0, 0, 0], "bad-orientation"),
        ("first_wxyz", [1, 0, 0], "wrong-type"),
        ("first_position", ["a", 0, 0], "wrong-type"),
        ("joint_angles_deg", [0, 91.5], "out-of-range"),
        ("joint_angles_deg", [[0, 90], 0], "wrong-count"),
    ],
)
def test_bad_chain_files_are_refused(key: str, value: object, code: str) -> None:
    import json

    document = {
        "format": "foldback-chain/1",
        "module": "tetrahedron",
        "joint_angles_deg": [0, 90],
        key: value,
    }
    with pytest.raises(InputError) as refusal:
        read(json.dumps(document).encode())
    assert refusal.value.code == code


def test_largest_size_without_a_collision() -> None:
    chain = read_angle_string(RING)
    # From straight half way to folded, evenly: never closer than at its end.
    motion = np.linspace(0.0, 1.0, 40)[:, None] * chain.folded_rad[None]
    partly = motion[:24]
    size = largest_size(chain, (partly,), clear_at=0.5)
    assert sweep(chain, partly, size=size).clearance >= 0.0
    assert size == 1.0 or sweep(chain, partly, size=min(1.0, size + 0.03)).clearance < 0.0
