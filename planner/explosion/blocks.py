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
from planner.motion.frames import Frames
from planner.motion.record import Record
from planner.parameters.explosion import ExplosionParameters
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments

Ints = NDArray[np.int64]
BLOCK_MODULES: Final = 64
"""Modules of a rigid block, at least."""
MOST_BLOCKS: Final = 24
"""Blocks of a chain, at most: all their tethers are one tree, whose steps cost the cube of them."""
TETHER_MODULES: Final = 4
"""Modules at either end of a block whose joints stay free. With none, or one, packed blocks hinge
into each other and jam: docs/decisions/0015-hard-paths.md."""
TENSION: Final = 4.0
"""Factor of the tension on rigid blocks, which are heavier than single modules."""
STEP_IN_CONTACT: Final = 0.1
"""Largest time step in contact, in s: blocks are heavier and slower than modules."""
COARSER_TURN: Final = 3.0
"""Factor of the turn between two snapshots."""
COARSER_WAY: Final = 8.0
"""Factor of the way between two snapshots; the certificate bounds what lies between."""
FEWEST_STEPS: Final = 200
"""Steps before the blocks may be let go."""
LOOSE_RAD: Final = 0.35
"""Mean bend of the tethers' hinges below which the blocks have come apart."""
WINDOW: Final = 100
"""Steps between two looks at the tethers."""
LEAST_EASED: Final = 0.03
"""Share by which the tethers' bends must fall from look to look; with less, blocks are as far
apart as they get."""


def explode_blocks_first(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    sink: Callable[[Frames], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explodes a folded chain of cubes: first its blocks, then all of it.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: How it is let go.
        seed, sink, progress, cancelled: As in ``planner.explosion.simultaneous.explode``.

    Raises:
        InputError: ``no-blocks`` for modules that don't fill cells, or a chain off the lattice.
    """
    coarser = replace(
        parameters,
        snapshot_rad=COARSER_TURN * parameters.snapshot_rad,
        snapshot_distance=COARSER_WAY * parameters.snapshot_distance,
    )
    block = max(BLOCK_MODULES, -(-len(chain) // MOST_BLOCKS))
    starts = block_starts(len(chain), block, TETHER_MODULES)
    run = _BlocksFirst(chain, coarser, seed, sink, starts)
    return run.run(progress, cancelled)


def block_starts(modules: int, block: int, tether: int) -> Ints:
    """First modules of the rigid pieces: blocks without their tethers, and the tethers' modules."""
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
        sink: Callable[[Frames], None] | None,
        starts: Ints,
    ) -> None:
        self.starts = starts
        super().__init__(
            chain,
            replace(
                parameters,
                tension=TENSION * parameters.tension,
                step_in_contact_s=STEP_IN_CONTACT,
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
        if isinstance(self.engine, Blocks) and not self.steps % WINDOW and moved:
            bent = self._bent()
            eased = bent < (1.0 - LEAST_EASED) * self.bent
            self.bent = bent
            if self.steps >= FEWEST_STEPS and (bent < LOOSE_RAD or not eased):
                self._let_go()
        return moved

    def finish(self) -> bool:
        return not isinstance(self.engine, Blocks) and super().finish()

    def unjam(self) -> bool:
        return isinstance(self.engine, Blocks) or super().unjam()

    def _bent(self) -> float:
        """Mean bend of the hinges that are free in the first stage and bent when folded."""
        assert isinstance(self.engine, Blocks)
        free = self.engine.free[np.abs(self.chain.folded_rad[self.engine.free]) > 0.1]
        return float(np.abs(self.state.angles[free]).mean()) if len(free) else 0.0

    def _let_go(self) -> None:
        self.commit()
        self.parameters = self.afterwards
        self.engine = Segments(self.chain, self.material)
        self.engine.place(self.state)
        self.window_angles = np.abs(self.state.angles)
