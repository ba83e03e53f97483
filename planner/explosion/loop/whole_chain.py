"""World of the whole chain: its state, its engine, and the pairs of modules that repel."""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.core import max_inverse_step_limit, near_pairs
from foldback.planner.core.structures import PairLimits
from foldback.planner.explosion.loop.explosion_loop import UNREPELLED_LINKS
from foldback.planner.explosion.loop.radial_forces import RadialForces
from foldback.planner.explosion.loop.recorder import Step
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.simulation.mujoco_chain import MujocoChain
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import Acceleration, State
from foldback.planner.simulation.rigid_blocks import Blocks
from foldback.planner.simulation.segments import Segments

ChainEngine = Segments | Blocks | MujocoChain


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
        engine: ChainEngine,
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
        return not isinstance(self.engine, Blocks)

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
        if isinstance(self.engine, MujocoChain):
            self.engine.set_step(control.step_s)
        return self.acceleration_under(self.forces.forces(self, control))

    def acceleration_under(self, forces: Array) -> Acceleration:
        """Return the acceleration under (n, 3) forces on the modules."""
        engine = self.engine
        if isinstance(engine, Segments):
            return engine.lean_accelerations(self.state, forces, self.pairs)
        return engine.accelerations(self.state, forces)

    def advance(self, step_s: float) -> None:
        """Integrate the configuration."""
        if isinstance(self.engine, MujocoChain):
            self.engine.advance(self.state, step_s)
        else:
            self.state.advance(step_s)

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


def body_cap_scale(chain: Chain) -> float:
    """Return the factor of the speed cap of a chain, by its length."""
    # The ends of longer chains go farther.
    return float(np.clip(len(chain) / 512, 1.0, 2.5))


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
