import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.blocks_first import TETHER_CHECK_STEPS, Tethers, block_starts
from foldback.planner.explosion.loop.explosion_loop import Watch
from foldback.planner.explosion.simultaneous import Simultaneous
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.pathfinding.assembly import assembly_path
from foldback.planner.progress import never, silent
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.rigid_blocks import Blocks
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import chain_of, coil, folded_state

DEFAULT = ExplosionParameters()


def solid(x: int, y: int, z: int) -> Chain:
    """Return a box of x, y, z blocks of 4 × 4 × 4 modules along each axis, one after the other."""
    coarse = np.argwhere(np.ones((x, y, z), dtype=bool))
    cells = assembly_path(coarse, np.random.default_rng(0), side=4)
    assert cells is not None
    return chain_of(cells)


def engine(chain: Chain, starts: np.ndarray) -> Blocks:
    return Blocks(chain, Material(stiffness=3.0, armature=10.0), starts)


def test_block_starts() -> None:
    np.testing.assert_array_equal(block_starts(12, 6, 0), [0, 6])
    np.testing.assert_array_equal(block_starts(12, 6, 2), [0, 4, 5, 6, 7, 8])
    np.testing.assert_array_equal(block_starts(4, 8, 2), [0])
    np.testing.assert_array_equal(block_starts(10, 8, 4), [0, 4, 5, 6, 7, 8, 9])


def test_blocks_of_single_modules_move_as_segments() -> None:
    # With every joint free, both models describe the same chain.
    chain = coil(16)
    rng = np.random.default_rng(0)
    state = folded_state(chain)
    state.angles[:] = 0.2 * rng.normal(size=len(state.angles))
    forces = rng.normal(size=(len(chain), 3))
    progress_reports = []
    for first_engine in (
        engine(chain, np.arange(16)),
        Segments(chain, Material(stiffness=3.0, armature=10.0)),
    ):
        first_engine.place(state)
        progress_reports.append(first_engine.accelerations(state, forces))
    scale = np.abs(progress_reports[1].hinges).max()
    np.testing.assert_allclose(
        progress_reports[0].hinges, progress_reports[1].hinges, atol=0.02 * scale
    )
    np.testing.assert_allclose(progress_reports[0].linear, progress_reports[1].linear, atol=0.02)


def test_hinges_within_a_block_are_held() -> None:
    chain = solid(1, 1, 2)
    blocks = engine(chain, block_starts(128, 64, 2))
    folded, state = chain.folded_poses, folded_state(chain)
    blocks.place(state)
    np.testing.assert_allclose(blocks.positions, folded.positions, atol=1e-9)
    acceleration = blocks.accelerations(state, folded.positions - folded.positions.mean(axis=0))
    assert acceleration.contacts == 0
    held_mask = np.ones(len(chain.folded_rad), dtype=bool)
    held_mask[blocks.free] = False
    assert (acceleration.hinges[held_mask] == 0.0).all()
    assert np.abs(acceleration.hinges[~held_mask]).max() > 0.0
    # five joints of two hinges are free
    assert (~held_mask).sum() == 10


def test_blocks_are_not_released_in_the_step_that_restarted() -> None:
    """The restored state is already recorded, and releases proposed before may be invalid."""
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
