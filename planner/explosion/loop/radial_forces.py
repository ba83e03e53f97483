"""Forces of the paper on a whole chain (eq. 1 and 3), with adapted gains, and its creep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.core import chain_forces
from foldback.planner.core.structures import RadialDrive
from foldback.planner.explosion.loop.checkpoint import Pulses
from foldback.planner.explosion.loop.explosion_loop import (
    PULSE_REPULSION_SCALE,
    RADIAL_GAIN_JITTER,
)
from foldback.planner.explosion.loop.step_control import WEAK_TENSION_SCALE, StepControl
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.simulation.reduced_state import State

REPTATION_FORCE: Final = 0.1
"""Force on each module along the chain, in module weights, that makes a knotted or jammed chain
creep along its own curve, so that one end slides out through every loop. Measured from 0.07 to 0.14
on a thick trefoil: other motions, equally good (decision 0051)."""
REPULSION_RAMP: Final = (0.05, 0.25)
"""Progress, 0 (folded) … 1 (straight), at which the repulsion between modules begins to grow, and
at which it is largest. Measured from 0.7 to 1.4 times as much: equally good (decision 0051)."""


class PlacedModules(Protocol):
    """Modules whose poses and velocities have been computed."""

    @property
    def positions(self) -> Array:
        """(n, 3) centres of the modules, pitches."""
        ...

    @property
    def velocities(self) -> Array:
        """(n, 3) velocities of the centres, pitches/s."""
        ...


class PlacedChain(Protocol):
    """A chain that forces act on, as placed last.

    Attributes:
        state: Reduced state of the chain.
        pairs: (P, 2) pairs of modules that repel each other.
    """

    state: State
    pairs: Ints

    @property
    def engine(self) -> PlacedModules:
        """Poses and velocities of the modules."""
        ...

    @property
    def all_joints_free(self) -> bool:
        """True unless blocks are rigid."""
        ...

    @property
    def length(self) -> float:
        """Distance of the ends of the extended chain, pitches."""
        ...

    @property
    def folded_bend_rad(self) -> float:
        """Sum of the bends of the folded chain, rad."""
        ...


@dataclass(slots=True)
class RadialForces:
    """Forces on a whole chain: eq. 1 with the gain that gives the wanted tension, and eq. 3.

    Attributes:
        parameters: Gains.
        weights: (n,) relative radial gains of the modules.
        pulses: Pulses of weak tension and strong repulsion.
        tension: Largest force that may add up along the chain, as a multiple of the springs'
            stiffness.
        looseness: State of the chain at the last step: 0 while it is packed, 1 once it has come
            apart.
        is_knotted: True if the last test found a knot: then the chain creeps along itself.
        creep_direction: Direction of the creep: 1 towards the last module, −1 the other way, 0
            while it is to be chosen.
        creep_distance: Distance that it has crept, pitches.
    """

    parameters: ExplosionParameters
    weights: Array
    pulses: Pulses
    tension: float
    looseness: float = 0.0
    is_knotted: bool = False
    creep_direction: int = 0
    creep_distance: float = 0.0

    def reset_creep(self) -> None:
        """Choose the direction of the creep anew."""
        self.creep_direction, self.creep_distance = 0, 0.0

    def forces(self, world: PlacedChain, control: StepControl) -> Array:
        """Return (n, 3) forces on the modules of a placed chain, and go on with the pulse."""
        positions = world.engine.positions
        forces = np.empty_like(positions)
        self.looseness = chain_forces(
            self.drive(world, control),
            control.tension,
            world.state.angles,
            positions,
            world.pairs,
            forces,
        )
        self.pulses.advance()
        return forces

    def drive(self, world: PlacedChain, control: StepControl) -> RadialDrive:
        """Return strengths of the forces in the next steps of a placed chain, or in one with creep.

        Without creep the chain need not be placed.
        """
        p, (begins, ends) = self.parameters, REPULSION_RAMP
        creeps = self.creeps(world)
        return RadialDrive(
            weights=self.weights,
            creep=self._creep(world, control.step_s) if creeps else np.zeros((0, 3)),
            bend_rad=world.folded_bend_rad,
            length=world.length,
            spring=p.spring,
            tension=self.tension,
            gain=p.repulsion_gain,
            loose_gain=p.loose_repulsion,
            weak_gain=PULSE_REPULSION_SCALE,
            weak_tension=WEAK_TENSION_SCALE,
            ramp_begins=begins,
            ramp_ends=ends,
            weak_steps=self.pulses.weak_steps,
        )

    def creeps(self, world: PlacedChain) -> bool:
        """Return True if the chain creeps: while it is knotted, and in every other pulse."""
        pulses = self.pulses
        pulse = pulses.remaining_steps > 1 and pulses.count % 2 == 0 and world.all_joints_free
        return self.is_knotted or pulse

    def _creep(self, world: PlacedChain, step_s: float) -> Array:
        """Return (n, 3) forces along the chain, from the end that its sharpest bends are nearer to.

        They reverse once the chain has crept its own length without success.
        """
        positions = world.engine.positions
        along = np.gradient(positions, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        if not self.creep_direction:
            bends = np.abs(world.state.angles)
            sharp = np.flatnonzero(bends > 0.5 * bends.max())
            self.creep_direction = 1 if sharp.mean() < 0.5 * len(bends) else -1
        speed = self.creep_direction * float((world.engine.velocities * along).sum(axis=1).mean())
        self.creep_distance += step_s * speed
        if self.creep_distance > len(positions):
            self.creep_direction, self.creep_distance = -self.creep_direction, 0.0
        return REPTATION_FORCE * self.creep_direction * along


def radial_weights(seed: int, modules: int) -> Array:
    """Return (n,) relative radial gains, slightly uneven."""
    spread = np.random.default_rng(seed).uniform(-1.0, 1.0, modules)
    return 1.0 + RADIAL_GAIN_JITTER * spread
