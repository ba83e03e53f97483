"""Blocks first: an explosion in two stages, for chains that are too packed for one.

In the first stage blocks of consecutive modules are rigid, but for some modules at both ends of
each: these tethers come loose and let the blocks part. In the second stage all joints are free, and
contacts are those within a block. Both are one run of ``planner.explosion.simultaneous`` with the
same state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.loop.explosion_loop import Watch, run
from foldback.planner.explosion.simultaneous import Simultaneous
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.simulation.rigid_blocks import Blocks

TETHER_MODULES: Final = 4
"""Number of modules at either end of a rigid block whose joints stay free, so that blocks can part.
With 0 or 1, packed blocks hinge into each other and jam; more are slower to simulate:
docs/decisions/0015-hard-paths.md."""
TETHER_CHECK_STEPS: Final = 100
"""Number of simulation steps between two checks of whether rigid blocks have parted."""


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
        snapshot_rad=3.0 * parameters.snapshot_rad,
        snapshot_distance=8.0 * parameters.snapshot_distance,
    )
    # A simulation step takes time by the cube of the number of blocks.
    block = max(64, -(-len(chain) // 24))
    starts = block_starts(len(chain), block, TETHER_MODULES)
    watch = Watch(progress, cancelled, "exploding")
    explosion = Simultaneous.from_parameters(
        chain,
        replace(
            coarser,
            tension=4.0 * parameters.tension,  # blocks are heavier than modules
            step_in_contact_s=0.1,
        ),
        seed=seed,
        sink=sink,
        watch=watch,
        block_starts=starts,
        release=Tethers(parameters).release_when_apart,
    )
    return run(explosion, "blocks")


def block_starts(modules: int, block: int, tether: int) -> Ints:
    """Return the first modules of the rigid pieces: blocks without tethers, and tether modules."""
    starts = {0}
    for first in range(block, modules, block):
        starts.update(range(max(1, first - tether), min(modules, first + tether + 1)))
    return np.array(sorted(starts), dtype=np.int64)


@dataclass(slots=True)
class Tethers:
    """Release of all joints, once the modules between rigid blocks have straightened.

    Attributes:
        parameters: Tension and step in contact after the release.
        bend_rad: Mean bend of the tethers' hinges at the last check, rad.
    """

    parameters: ExplosionParameters
    bend_rad: float | None = None

    def release_when_apart(self, explosion: Simultaneous) -> None:
        """Free all joints of a run if the blocks are apart, or get no farther apart."""
        world, steps = explosion.world, explosion.control.steps
        if not isinstance(world.engine, Blocks) or steps % TETHER_CHECK_STEPS:
            return
        folded = world.chain.folded_rad
        free = world.engine.free[np.abs(folded[world.engine.free]) > 0.1]
        before = mean_bend_rad(folded[free]) if self.bend_rad is None else self.bend_rad
        self.bend_rad = bend = mean_bend_rad(world.state.angles[free])
        eased = bend < 0.97 * before
        if steps >= 200 and (bend < 0.35 or not eased):  # the blocks have parted, or are stuck
            explosion.commit()
            world.forces.tension = self.parameters.tension
            explosion.control.max_step_in_contact_s = self.parameters.step_in_contact_s
            world.release_all()
            explosion.jam.compare_with(world.state.angles)


def mean_bend_rad(angles: Array) -> float:
    """Return the mean bend of hinges, rad; 0 for none."""
    return float(np.abs(angles).mean()) if len(angles) else 0.0
