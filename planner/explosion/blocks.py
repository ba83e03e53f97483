"""Blocks first: an explosion in two stages, for chains that are too packed for one.

In the first stage blocks of consecutive modules are rigid, but for some modules at both ends of
each: these tethers come loose and let the blocks part. In the second stage all joints are free, and
contacts are those within a block. Both are one run of ``planner.explosion.simultaneous`` with the
same state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.explosion.simultaneous import Engine, Simultaneous
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.parameters.explosion import ExplosionParameters
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments

Ints = NDArray[np.int64]
MIN_BLOCK_MODULES: Final = 64
"""Minimum number of modules of a rigid block. Larger blocks are fewer and heavier. Chosen."""
MAX_BLOCKS: Final = 24
"""Maximum number of blocks of a chain: all tethers are one tree, and a step costs the cube of their
number. Chosen."""
TETHER_MODULES: Final = 4
"""Number of modules at either end of a block whose joints stay free. With none, or one, packed
blocks hinge into each other and jam: docs/decisions/0015-hard-paths.md."""
BLOCK_TENSION_SCALE: Final = 4.0
"""Factor of the tension while blocks are rigid, as they are heavier than single modules. Larger
values part them sooner and press contacts deeper. Chosen."""
BLOCK_STEP_IN_CONTACT_S: Final = 0.1
"""Maximum time step in contact, s: blocks are heavier and slower than modules. Larger steps are
fewer and press contacts deeper. Chosen."""
SNAPSHOT_TURN_SCALE: Final = 3.0
"""Factor of the turn between two snapshots. Larger values keep fewer snapshots. Chosen."""
SNAPSHOT_DISTANCE_SCALE: Final = 8.0
"""Factor of the distance between two snapshots. Larger values keep fewer snapshots; the certificate
bounds the clearance between them. Chosen."""
MIN_BLOCK_STEPS: Final = 200
"""Minimum number of steps before all joints are released. Chosen."""
LOOSE_TETHER_RAD: Final = 0.35
"""Mean bend of the tethers' hinges, rad, below which the blocks count as apart. Larger values
release all joints earlier. Chosen."""
TETHER_CHECK_STEPS: Final = 100
"""Steps between two checks of the tethers. Chosen."""
MIN_TETHER_EASING: Final = 0.03
"""Minimum relative decrease of the tethers' mean bend between two checks. With less, all joints are
released: the blocks are as far apart as they get. Chosen."""


def explode_blocks_first(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explode a folded chain of cubes: first its blocks, then all of it.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: Parameters of the explosion.
        seed, sink, progress, cancelled: As in ``planner.explosion.simultaneous.explode``.

    Raises:
        InputError: ``no-blocks`` for modules that don't fill cells, or a chain off the lattice.
    """
    coarser = replace(
        parameters,
        snapshot_rad=SNAPSHOT_TURN_SCALE * parameters.snapshot_rad,
        snapshot_distance=SNAPSHOT_DISTANCE_SCALE * parameters.snapshot_distance,
    )
    block = max(MIN_BLOCK_MODULES, -(-len(chain) // MAX_BLOCKS))
    starts = block_starts(len(chain), block, TETHER_MODULES)
    run = _BlocksFirst(chain, coarser, seed, sink, starts)
    return run.run(progress, cancelled)


def block_starts(modules: int, block: int, tether: int) -> Ints:
    """Return the first modules of the rigid pieces: blocks without tethers, and tether modules."""
    starts = {0}
    for first in range(block, modules, block):
        starts.update(range(max(1, first - tether), min(modules, first + tether + 1)))
    return np.array(sorted(starts), dtype=np.int64)


class _BlocksFirst(Simultaneous):
    strategy = "blocks"

    def __init__(
        self,
        chain: Chain,
        parameters: ExplosionParameters,
        seed: int,
        sink: Callable[[Motion], None] | None,
        starts: Ints,
    ) -> None:
        self.starts = starts
        super().__init__(
            chain,
            replace(
                parameters,
                tension=BLOCK_TENSION_SCALE * parameters.tension,
                step_in_contact_s=BLOCK_STEP_IN_CONTACT_S,
            ),
            seed,
            sink,
        )
        self.spacing = 1.0  # its snapshots are far apart from the start
        self.afterwards = parameters
        self.bent = self._bent()

    def first_engine(self) -> Engine:
        return Blocks(self.chain, self.material, self.starts)

    def step(self) -> bool:
        moved = super().step()
        # A state that it went back to may have to be looked at first.
        if isinstance(self.engine, Blocks) and not self.steps % TETHER_CHECK_STEPS and moved:
            bent = self._bent()
            eased = bent < (1.0 - MIN_TETHER_EASING) * self.bent
            self.bent = bent
            if self.steps >= MIN_BLOCK_STEPS and (bent < LOOSE_TETHER_RAD or not eased):
                self._let_go()
        return moved

    def finish(self) -> bool:
        return not isinstance(self.engine, Blocks) and super().finish()

    def unjam(self) -> bool:
        return isinstance(self.engine, Blocks) or super().unjam()

    def _bent(self) -> float:
        """Return the mean bend, rad, of the hinges that are free at first and bent when folded."""
        assert isinstance(self.engine, Blocks)
        free = self.engine.free[np.abs(self.chain.folded_rad[self.engine.free]) > 0.1]
        return float(np.abs(self.state.angles[free]).mean()) if len(free) else 0.0

    def _let_go(self) -> None:
        self.commit()
        self.parameters = self.afterwards
        self.engine = Segments(self.chain, self.material)
        self.engine.place(self.state)
        self.window_angles = np.abs(self.state.angles)
