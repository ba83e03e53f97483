"""World of the whole chain: its state, its engine, and the pairs of modules that repel."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.extension import bending_hinges, extended_length
from foldback.planner.core import (
    chain_inverse_step_limit,
    chain_steps,
    near_pairs,
    unfolded_share,
)
from foldback.planner.core.structures import (
    ChainLimits,
    ChainSteps,
    ControlLimits,
    ExplodingChain,
    PairLimits,
    SteppedState,
)
from foldback.planner.explosion.loop.explosion_loop import UNREPELLED_LINKS
from foldback.planner.explosion.loop.radial_forces import RadialForces
from foldback.planner.explosion.loop.recorder import Step
from foldback.planner.explosion.loop.step_control import CONTACT_MODEL, StepControl
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.simulation.mujoco_chain import MujocoChain
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import Acceleration, State
from foldback.planner.simulation.rigid_blocks import Blocks
from foldback.planner.simulation.segments import Segments

REPELLED_LINKS: Final = UNREPELLED_LINKS + 1
"""Minimum number of links between two modules that repel each other."""
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
        self.folded_bend_rad = folded_bend_rad(chain)
        """Sum of the bends of the folded chain, rad."""
        self.length = extended_length(chain)
        """Distance of the ends of the extended chain, pitches."""
        self.bending = bending_hinges(chain)
        """(J,) True for the hinges whose turn shortens the extended chain."""
        p, radius = parameters, chain.module.radius
        self._limits = ChainLimits(
            p.joint_cap_rad,
            body_cap_scale(chain) * p.body_cap,  # the ends of a long chain go as far as it is long
            p.loose_rad,
            packed=PairLimits(radius, p.pair_cap, p.slide_cap),
            loose=PairLimits(radius, p.pair_cap_loose, p.slide_cap),
        )

    @property
    def largest_bend_rad(self) -> float:
        """Largest angle of a hinge that bends the chain; others twist it about its own line."""
        return float(np.abs(self.state.angles[self.bending]).max(initial=0.0))

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
        self.pairs = near_pairs(positions, self.parameters.repulsion_cutoff, REPELLED_LINKS)

    def snapshot(self) -> Step:
        """Return the present state as a snapshot."""
        return Step.of(self.time_s, self.state, self.engine.positions)

    def make_steps(
        self, engine: Segments, control: StepControl, limits: ControlLimits, count: int
    ) -> tuple[list[Step], int]:
        """Make steps until one is not finite or its contacts are too deep, or of a creep one.

        Args:
            engine: Engine of the chain.
            control: Step, drag and tension; they adapt.
            limits: Limits of the control.
            count: Maximum number of steps.

        Returns:
            The states before each step, and how the last step ended: ``MOVED``, ``TOO_DEEP`` or
            ``NOT_FINITE``.
        """
        state, forces = self.state, self.forces
        if forces.creeps(self):
            engine.place(state)
            count = 1
        steps = ChainSteps.empty(count, len(state.angles), len(self.chain))
        done, forces.looseness = chain_steps(
            ExplodingChain(
                engine.stepped_chain(CONTACT_MODEL, limits),
                self.chain.module.hull,
                self.material.geom_size,
                self.parameters.repulsion_cutoff,
                REPELLED_LINKS,
                self._limits,
            ),
            forces.drive(self, control),
            SteppedState(
                state.reduced, engine.modules, engine.stiffness, control.controlled, self.time_s
            ),
            partial(engine.find_placed, state),
            steps,
        )
        forces.pulses.advance(done.made)
        self.time_s = done.time_s
        control.go_on_with(done.control)
        times = steps.time_s[: done.made].tolist()
        return [
            Step(time_s=t, angles=angles, position=position, rotation=rotation, centres=centres)
            for t, angles, position, rotation, centres in zip(times, *steps[1:], strict=False)
        ], done.outcome

    def accelerations(self, control: StepControl) -> Acceleration:
        """Return MuJoCo's acceleration of the placed state under eq. 1 and 3."""
        engine = self.engine
        assert not isinstance(engine, Segments)
        engine.set_contact_time_constant(control.contact_time_constant_s)
        if isinstance(engine, MujocoChain):
            engine.set_step(control.step_s)
        return engine.accelerations(self.state, self.forces.forces(self, control))

    def advance(self, step_s: float) -> None:
        """Integrate the configuration."""
        if isinstance(self.engine, MujocoChain):
            self.engine.advance(self.state, step_s)
        else:
            self.state.advance(step_s)

    def inverse_step_limit(self) -> float:
        """Return 1/Δt_max, 1/s, of hinges, near modules, and all modules."""
        state, engine = self.state, self.engine
        engine.place(state)
        return chain_inverse_step_limit(state.reduced, engine.modules, self.pairs, self._limits)

    def limit_hinges(self) -> None:
        """Leave no hinge beyond its stop; rigid blocks have none."""
        if self.all_joints_free:
            self.state.stop_at(self.chain.stops_rad(self.material.stops_early_rad))

    def unfolded(self) -> float:
        """Return the progress, 0 to 1: half by the joints' bends, half by the chain's span."""
        return unfolded_share(
            self.state.angles, self.engine.positions, self.folded_bend_rad, self.length
        )


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


def folded_bend_rad(chain: Chain) -> float:
    """Return the sum of the bends of the folded chain, rad; not 0."""
    # A chain that folds into a line has nothing to unbend.
    return max(float(np.abs(chain.folded_rad).sum()), 1e-9)
