"""World of the whole chain: its engine, and the paper's forces (eq. 1 and 3) with adapted gains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.explosion.checkpoint import Pulses
from planner.explosion.explosion import (
    PULSE_REPULSION_SCALE,
    PULSE_TENSION_SCALE,
    RADIAL_GAIN_JITTER,
    UNREPELLED_LINKS,
)
from planner.explosion.recorder import Step
from planner.explosion.step_control import StepControl
from planner.kernels.pairs import PairLimits, max_inverse_step_limit, near_pairs, repulsion
from planner.parameters.explosion import ExplosionParameters
from planner.simulation.model import Material
from planner.simulation.reduced import Acceleration, State
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
Engine = Segments | Blocks
REPTATION_FORCE: Final = 0.1
"""Force on each module along the chain, in module weights, that makes a knotted or jammed chain
creep along its own curve, so that one end slides out through every loop. Larger values creep
faster. Chosen."""
REPULSION_RAMP: Final = (0.05, 0.25)
"""Progress, 0 (folded) … 1 (straight), at which the repulsion between modules begins to grow, and
at which it is largest. Larger values keep the repulsion of a packed chain weak for longer.
Chosen."""
BODY_CAP_REFERENCE_MODULES: Final = 512
"""Number of modules up to which the limit of a module's motion in one simulation step (parameter
``body_cap``) holds as it is; for longer chains it grows with the length, as their ends go farther.
Larger values take more steps for long chains. Chosen."""
MAX_BODY_CAP_SCALE: Final = 2.5
"""Maximum factor by which the limit of a module's motion in one simulation step grows for long
chains. Larger values take fewer steps, but modules could meet before the search for near pairs
finds them. Chosen."""


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

    def forces(self, world: WholeChain, control: StepControl) -> Array:
        """Return (n, 3) forces on the modules of a placed chain, and go on with the pulse."""
        p, pulses, positions = self.parameters, self.pulses, world.engine.positions
        weak = pulses.is_weak
        pulses.advance()
        creeps = self._creeps(world)
        arms = positions - positions.mean(axis=0)
        diameter = 2.0 * float(np.sqrt((arms**2).sum(axis=1).max()))
        radial = self.weights[:, None] * arms / diameter
        radial -= radial.mean(axis=0)
        summed = float(np.sqrt((np.cumsum(radial, axis=0) ** 2).sum(axis=1).max()))
        gain = self.tension * p.spring * control.tension / summed
        forces = gain * (PULSE_TENSION_SCALE if weak or creeps else 1.0) * radial
        if creeps:
            forces += self._creep(world, control.step_s)
        low, high = REPULSION_RAMP
        self.looseness = float(np.clip((world.unfolded() - low) / (high - low), 0.0, 1.0))
        push = p.repulsion_gain * (1.0 + (p.loose_repulsion - 1.0) * self.looseness)
        push *= PULSE_REPULSION_SCALE if weak and not creeps else 1.0
        repulsion(positions, world.pairs, push, forces)
        return forces

    def _creeps(self, world: WholeChain) -> bool:
        """Return True if the chain creeps: while it is knotted, and in every other pulse."""
        pulses = self.pulses
        pulse = pulses.remaining_steps > 0 and pulses.count % 2 == 0 and world.all_joints_free
        return self.is_knotted or pulse

    def _creep(self, world: WholeChain, step_s: float) -> Array:
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


class WholeChain:
    """World of a chain whose modules, or rigid blocks of them, all move at once.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: Limits of a step, and the cutoff of the repulsion.
        material: Joints and surfaces of the chain.
        engine: Engine that computes the accelerations at first.
        forces: Forces on the modules.
    """

    def __init__(
        self,
        chain: Chain,
        parameters: ExplosionParameters,
        material: Material,
        engine: Engine,
        forces: RadialForces,
    ) -> None:
        self.chain = chain
        self.parameters = parameters
        self.material = material
        self.engine = engine
        self.forces = forces
        self.state = chain_at_rest(chain)
        self.time_s = 0.0
        self.pairs = np.zeros((0, 2), dtype=np.int64)
        """(P, 2) pairs of modules that repel each other, as placed last."""
        # The ends of a long chain go as far as it is long.
        self._body_cap = body_cap_scale(chain) * parameters.body_cap

    @property
    def all_joints_free(self) -> bool:
        """True unless blocks are rigid."""
        return isinstance(self.engine, Segments)

    def release_all(self) -> None:
        """Free the joints within rigid blocks."""
        self.engine = Segments(self.chain, self.material)
        self.engine.place(self.state)

    def place(self) -> None:
        """Compute the poses of the present state, and the pairs of near modules."""
        self.engine.place(self.state)
        positions = self.engine.positions
        self.pairs = near_pairs(positions, self.parameters.repulsion_cutoff, UNREPELLED_LINKS + 1)

    def snapshot(self) -> Step:
        """Return the present state as a snapshot."""
        return Step.of(self.time_s, self.state, self.engine.positions)

    def accelerations(self, control: StepControl) -> Acceleration:
        """Return the acceleration of the placed state under eq. 1 and 3."""
        self.engine.set_contact_time_constant(control.contact_time_constant_s)
        return self.acceleration_under(self.forces.forces(self, control))

    def acceleration_under(self, forces: Array) -> Acceleration:
        """Return the acceleration under (n, 3) forces on the modules."""
        engine = self.engine
        if isinstance(engine, Segments):
            return engine.lean_accelerations(self.state, forces, self.pairs)
        return engine.accelerations(self.state, forces)

    def inverse_step_limit(self) -> float:
        """Return 1/Δt_max, 1/s, of hinges, near modules, and all modules."""
        p = self.parameters
        state, engine = self.state, self.engine
        engine.place(state)
        loose = np.abs(state.angles).max() < p.loose_rad
        limits = PairLimits(
            radius=self.chain.module.radius,
            approach=p.pair_cap_loose if loose else p.pair_cap,
            slide=p.slide_cap,
        )
        return max(
            float(np.abs(state.rates).max()) / p.joint_cap_rad,
            max_inverse_step_limit(engine.modules, self.pairs, limits),
            float(np.sqrt((engine.velocities**2).sum(axis=1).max())) / self._body_cap,
        )

    def limit_hinges(self) -> None:
        """Leave no hinge beyond its stop; rigid blocks have none."""
        if self.all_joints_free:
            self.state.stop_at(self.material.stop_of(self.chain.module))

    def unfolded(self) -> float:
        """Return the progress, 0 to 1: half by the joints' bends, half by the chain's span."""
        return unfolded_share(self.chain, self.state.angles, self.engine.positions)


def radial_weights(seed: int, modules: int) -> Array:
    """Return (n,) relative radial gains, slightly uneven."""
    spread = np.random.default_rng(seed).uniform(-1.0, 1.0, modules)
    return 1.0 + RADIAL_GAIN_JITTER * spread


def body_cap_scale(chain: Chain) -> float:
    """Return the factor of the speed cap of a chain, by its length."""
    return float(np.clip(len(chain) / BODY_CAP_REFERENCE_MODULES, 1.0, MAX_BODY_CAP_SCALE))


def chain_at_rest(chain: Chain) -> State:
    """Return the folded configuration at rest."""
    folded = chain.folded_poses
    return State.at_rest(
        chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
    )


def unfolded_share(chain: Chain, angles: Array, positions: Array) -> float:
    """Return the progress of a chain, 0 to 1: half by its bends, half by its span."""
    # A chain that folds into a line has nothing to unbend.
    bent = np.abs(angles).sum() / max(np.abs(chain.folded_rad).sum(), 1e-9)
    span = np.linalg.norm(positions[-1] - positions[0]) / (len(positions) - 1)
    return float(0.5 * (1.0 - bent) + 0.5 * span)
