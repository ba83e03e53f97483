from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.module import TETRAHEDRON
from planner.chain.path import Path
from planner.clearance.sweep import sweep
from planner.errors import InputError
from planner.explosion.blocks import (
    TETHER_CHECK_STEPS,
    Tethers,
    block_starts,
    explode_blocks_first,
)
from planner.explosion.explosion import Watch
from planner.explosion.simultaneous import Simultaneous
from planner.parameters.explosion import ExplosionParameters
from planner.pathfinding.assembly import assembly_path
from planner.progress import never, silent
from planner.simulation.model import Material
from planner.simulation.reduced import State
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments
from tests.planner.chains import coil

DEFAULT = ExplosionParameters()


def solid(x: int, y: int, z: int) -> Chain:
    """A box of so many blocks of 4 × 4 × 4 modules, one after the other."""
    coarse = np.argwhere(np.ones((x, y, z), dtype=bool))
    cells = assembly_path(coarse, np.random.default_rng(0), side=4)
    assert cells is not None
    return Chain.from_path(Path.from_cells(cells, name="solid"))


def engine(chain: Chain, starts: np.ndarray) -> Blocks:
    return Blocks(chain, Material(stiffness=3.0, armature=10.0), starts)


def test_pieces_are_blocks_and_the_modules_of_tethers() -> None:
    np.testing.assert_array_equal(block_starts(12, 6, 0), [0, 6])
    np.testing.assert_array_equal(block_starts(12, 6, 2), [0, 4, 5, 6, 7, 8])
    np.testing.assert_array_equal(block_starts(4, 8, 2), [0])
    np.testing.assert_array_equal(block_starts(10, 8, 4), [0, 4, 5, 6, 7, 8, 9])


def test_a_chain_of_single_modules_moves_as_segments_do() -> None:
    # With every joint free it is the same chain in another model.
    chain = coil(16)
    rng = np.random.default_rng(0)
    folded = chain.folded_poses
    state = State.at_rest(
        0.2 * rng.normal(size=len(chain.folded_rad)),
        folded.positions[chain.root],
        folded.rotations[chain.root],
    )
    forces = rng.normal(size=(len(chain), 3))
    found = []
    for one in (
        engine(chain, np.arange(16)),
        Segments(chain, Material(stiffness=3.0, armature=10.0)),
    ):
        one.place(state)
        found.append(one.accelerations(state, forces))
    scale = np.abs(found[1].hinges).max()
    np.testing.assert_allclose(found[0].hinges, found[1].hinges, atol=0.02 * scale)
    np.testing.assert_allclose(found[0].linear, found[1].linear, atol=0.02)


def test_hinges_within_a_block_stay() -> None:
    chain = solid(1, 1, 2)
    blocks = engine(chain, block_starts(128, 64, 2))
    folded = chain.folded_poses
    state = State.at_rest(
        chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
    )
    blocks.place(state)
    np.testing.assert_allclose(blocks.positions, folded.positions, atol=1e-9)
    found = blocks.accelerations(state, folded.positions - folded.positions.mean(axis=0))
    assert found.contacts == 0
    held = np.ones(len(chain.folded_rad), dtype=bool)
    held[blocks.free] = False
    assert (found.hinges[held] == 0.0).all()
    assert np.abs(found.hinges[~held]).max() > 0.0
    # Five joints of two hinges are free.
    assert (~held).sum() == 10


def test_blocks_collide_but_for_the_two_modules_of_a_joint() -> None:
    chain = solid(1, 1, 2)
    blocks = engine(chain, np.array([0, 64]))
    folded = chain.folded_poses
    for hinge in blocks.free.tolist():
        for turn in (-0.3, 0.3):
            angles = chain.folded_rad.copy()
            angles[hinge] += turn
            state = State.at_rest(
                angles, folded.positions[chain.root], folded.rotations[chain.root]
            )
            blocks.place(state)
            contacts = blocks.accelerations(state, np.zeros((128, 3))).contacts
            clear = sweep(chain, angles[None], size=0.99).clearance
            assert (contacts > 0) == (clear < 0.0)


@pytest.mark.parametrize(
    "case", ["tetrahedra", "off the lattice"], ids=["tetrahedra", "off the lattice"]
)
def test_other_chains_are_refused(case: str) -> None:
    if case == "tetrahedra":
        chain = Chain.from_angles(TETRAHEDRON, np.zeros(6))
    else:
        chain = Chain.from_angles(coil(8).module, np.full(12, 0.3))
    with pytest.raises(InputError, match="expected"):
        explode_blocks_first(chain, DEFAULT)


@pytest.mark.long
def test_blocks_come_apart_and_out_straight() -> None:
    chain = solid(1, 2, 2)
    record = explode_blocks_first(chain, DEFAULT)
    assert record.status == "straight", record.reason
    angles = record.frames.joint_angles_rad
    np.testing.assert_array_equal(angles[0], chain.folded_rad)
    np.testing.assert_array_equal(angles[-1], 0.0)
    assert len(record.frames) < 500
    for size in (0.95, 0.98):
        found = sweep(chain, angles, size=size)
        assert found.clearance > 0.0
        assert found.bound > 0.0


def test_the_same_seed_gives_the_same_record() -> None:
    chain = solid(1, 1, 2)
    short = replace(DEFAULT, max_steps=60)
    first, again = (explode_blocks_first(chain, short, seed=2) for _ in range(2))
    assert first.status == "timeout"
    np.testing.assert_array_equal(first.frames.joint_angles_rad, again.frames.joint_angles_rad)


def test_blocks_are_not_released_in_the_step_that_restarted() -> None:
    """The restored state is recorded already; what was proposed before may not be sound."""
    chain = solid(2, 2, 1)
    run = Simultaneous.from_parameters(
        chain,
        DEFAULT,
        watch=Watch(silent, never, "exploding"),
        block_starts=block_starts(len(chain), 64, 2),
        release=Tethers(DEFAULT).release_when_apart,
    )
    run.control.steps = 10 * TETHER_CHECK_STEPS
    run.check_step(moved=False)
    assert isinstance(run.world.engine, Blocks)
    run.world.place()
    run.check_step(moved=True)
    assert isinstance(run.world.engine, Segments)
