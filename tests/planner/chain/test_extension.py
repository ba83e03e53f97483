"""Extension: which hinges bend an extended chain, and how a twisted rod comes to rest."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.extension import bending_hinges, extended_length
from foldback.planner.chain.module_file import with_pattern
from foldback.planner.clearance.sweep import sweep
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.parameters.explosion import ExplosionParameters
from tests.planner.chains import Array, coil, unvalidated

SNAKE_CUBE = module_named("snake-cube")


def snake(pattern: str, angles_deg: list[float]) -> Chain:
    """Return a snake cube of straight (s) and corner (c) pieces."""
    names = {"s": "straight", "c": "corner"}
    module = with_pattern(SNAKE_CUBE, [names[letter] for letter in pattern])
    return unvalidated(module, np.deg2rad(angles_deg))


def ends_distance(chain: Chain, angles: Array) -> float:
    poses = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return float(np.linalg.norm(poses.positions[-1] - poses.positions[0]))


@pytest.mark.parametrize(
    "chain",
    [
        coil(9),
        Chain.from_angles(module_named("snake-prism"), np.zeros(7)),
        snake("ssss", [0.0] * 3),
        snake("sccss", [0.0] * 4),
        snake("scscscs", [0.0] * 6),
    ],
    ids=["cubes", "prisms", "rod", "corners", "stairs"],
)
def test_hinges_that_bend_are_those_that_change_the_distance_of_the_ends(chain: Chain) -> None:
    hinges = len(chain.folded_rad)
    length, bending = extended_length(chain), bending_hinges(chain)
    assert length == pytest.approx(ends_distance(chain, np.zeros(hinges)))
    for hinge in range(hinges):
        turned = [ends_distance(chain, angle * np.eye(hinges)[hinge]) for angle in (0.4, 1.5, 3.0)]
        assert bending[hinge] == (np.abs(np.array(turned) - length).max() > 1e-9)


def test_a_rod_that_is_only_twisted_turns_back_at_once() -> None:
    chain = snake("sssss", [90.0, 180.0, -90.0, 45.0])
    assert not bending_hinges(chain).any()
    record = explode(chain, ExplosionParameters())
    assert record.status == "straight" and record.steps <= 50
    assert np.abs(record.frames.joint_angles_rad[-1]).max() == 0.0
    assert sweep(chain, record.frames, module_size=0.95).bound > 0.0
