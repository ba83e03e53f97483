"""Explosion: forces on the folded chain until it is straight. The paper's *record*.

Motors are off. Each module is pulled from the centre of mass (eq. 1, 2) and pushed away from near
modules that are not linked to it (eq. 3). Gains, time step and drag adapt: the radial gain so that
the force that adds up along the chain stays within what the joints' springs can order, the step so
that no contact goes deeper than the module size that the plan is verified at allows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.module import UNSMOOTHED_FROM_MODULES
from planner.errors import SimulationError
from planner.explosion.explosion import (
    COMMIT_EVERY_STEPS,
    MAX_CHECKPOINT_RETRIES,
    PULSE_REPULSION_SCALE,
    PULSE_TENSION_SCALE,
    STOP_COMPLIANCE_RAD,
    UNREPELLED_LINKS,
    ContactDepth,
    Ended,
    Explosion,
)
from planner.explosion.recorder import FrameRecorder, Step
from planner.explosion.straightening import straightening
from planner.kernels.pairs import PairLimits, max_inverse_step_limit, near_pairs, repulsion
from planner.motion.motion import Motion
from planner.motion.record import Record
from planner.parameters.explosion import ExplosionParameters
from planner.pathfinding.knots import knot_of
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.reduced import Acceleration, State
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
Engine = Segments | Blocks
FIRST_FINISH_STEPS: Final = 50
"""Steps between two attempts to straighten the chain by kinematics, at first. Chosen."""
FINISH_BACKOFF: Final = (1.5, 800.0)
"""Growth factor of those steps after each failed attempt, and their maximum: an attempt takes as
long as ten steps of a long chain, or more. Chosen."""
KNOT_CHECK_STEPS: Final = 200
"""Steps between two tests for a knot. Chosen."""
MIN_KNOT_CHECK_PROGRESS: Final = 0.4
"""Minimum ``unfolded``, 0…1, before a chain is tested for a knot: packed ends show knots that are
none. Chosen."""
REPTATION_FORCE: Final = 0.1
"""Force on each module of a creeping chain along the chain, in module weights. All modules move
along the chain itself, whose curve stays in place: one end follows it through every loop and out.
Larger values creep faster. Chosen."""
REPULSION_RAMP: Final = (0.05, 0.25)
"""Values of ``unfolded``, 0…1, at which the repulsion begins to grow, and at which it is largest.
Chosen."""
JAM_CHECK_STEPS: Final = 400
"""Steps between two checks for a jam. Chosen."""
BODY_CAP_REFERENCE_MODULES: Final = 512
"""Number of modules up to which the speed cap is ``ExplosionParameters.body_cap``; beyond it the
cap grows with the chain's length. Chosen."""
MAX_BODY_CAP_SCALE: Final = 2.5
"""Maximum factor of the speed cap of longer chains: a larger one would outrun the search for near
pairs. The distance of snapshots grows with its square once the chain has come apart. Chosen."""
STUCK_HINGE_BEND_RAD: Final = 1.0
"""Bend, rad, above which a hinge that has not moved counts as stuck. Chosen."""
MIN_UNFOLDING_PROGRESS: Final = 0.005
"""Minimum growth of ``unfolded``, 0…1, between two checks. Larger values start pulses earlier.
Chosen."""
MAX_EXPLOSION_DEPTH_PITCH: Final = 0.02
"""Maximum depth of contacts, pitches; less where the module size to verify leaves less. Larger
values allow faster steps and less clearance. Chosen."""


def explode(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explode a folded chain and record its motion.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: Parameters of the explosion.
        seed: Seed of the slight unevenness of the radial gain.
        sink: Receives the snapshots as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Returns:
        The record, whether straight or not.
    """
    return Simultaneous(chain, parameters, seed, sink).run(progress, cancelled)


class Simultaneous(Explosion[Step, ExplosionParameters]):
    """A run in which all modules are released at once."""

    strategy = "simultaneous"
    doing = "exploding"

    def __init__(
        self,
        chain: Chain,
        parameters: ExplosionParameters,
        seed: int,
        sink: Callable[[Motion], None] | None,
    ) -> None:
        room = 2.0 * chain.module.inner_radius * (parameters.geom_size - parameters.verify_size)
        longer = float(np.clip(len(chain) / BODY_CAP_REFERENCE_MODULES, 1.0, MAX_BODY_CAP_SCALE))
        self.spacing = longer**2
        """Factor of the distance of snapshots once the chain has come apart."""
        self.frames = FrameRecorder(
            chain,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            size=parameters.verify_size,
            sink=sink,
        )
        super().__init__(
            parameters,
            ContactDepth.within(room, MAX_EXPLOSION_DEPTH_PITCH),
            self.frames,
            seed=seed,
            modules=len(chain),
        )
        self.chain = chain
        self.material = Material(
            geom_size=parameters.geom_size,
            stiffness=parameters.spring,
            armature=parameters.armature,
            stop_rad=chain.module.stop_rad
            - (STOP_COMPLIANCE_RAD if len(chain) > UNSMOOTHED_FROM_MODULES else 0.0),
        )
        # The ends of a long chain go as far as it is long.
        self.body_cap = longer * parameters.body_cap
        self.engine = self.first_engine()
        folded = chain.folded_poses
        self.state = State.at_rest(
            chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
        )
        self.sound = self.saved = (0.0, self.state.copy())
        self.contacts = 0
        """Number of contacts in the last step; −1 if the run went back."""
        self.pairs = np.zeros((0, 2), dtype=np.int64)
        self.farthest = -1.0
        """Value of ``unfolded`` at the last progress."""
        self.window_angles = np.abs(chain.folded_rad)
        self.knotted = False
        """True if the last test found a knot."""
        self.way, self.crept = 0, 0.0
        """Direction of the creep: 1 towards the last module, −1 the other way, 0 while it is to be
        chosen; and its distance so far, pitches."""
        self.finish_at, self.finish_wait = 0, float(FIRST_FINISH_STEPS)

    def first_engine(self) -> Engine:
        """Return the engine that computes the accelerations at first."""
        return Segments(self.chain, self.material)

    @property
    def most_steps(self) -> int:
        """Maximum number of steps of the run."""
        return self.parameters.max_steps

    def place(self) -> None:
        """Compute the poses of the present state."""
        self.engine.place(self.state)

    def snapshot(self) -> Step:
        """Return the present state as a snapshot."""
        return Step.of(self.time_s, self.state, self.engine.positions)

    def motion(self) -> Motion:
        """Return all snapshots."""
        return self.frames.motion()

    def look(self) -> Ended | None:
        """Check for a chain that can be straightened, is knotted, or is stuck."""
        if self.steps % FIRST_FINISH_STEPS == 0 and self.contacts == 0 and self.finish():
            return "straight"
        if self.steps % KNOT_CHECK_STEPS == 0 and self.may_creep():
            loose = self.knotted or self.unfolded() >= MIN_KNOT_CHECK_PROGRESS
            was, self.knotted = self.knotted, loose and not self.is_unknot()
            if was != self.knotted:
                self.way, self.crept = 0, 0.0
        if self.steps % JAM_CHECK_STEPS == 0 and not self.unjam():
            return "stalled"
        return None

    def accelerations(self) -> Acceleration | None:
        """Return the acceleration under eq. 1 and 3; None if the run went back."""
        positions = self.engine.positions
        self.pairs = near_pairs(positions, self.parameters.repulsion_cutoff, UNREPELLED_LINKS + 1)
        self.engine.set_contact_time_constant(self.contact_time_constant())
        self.contacts = -1
        forces = self._forces(positions)
        try:
            acceleration = self.acceleration_under(forces)
        except SimulationError:
            if self.retries >= MAX_CHECKPOINT_RETRIES:
                raise
            self.go_back()
            return None
        if self.adapt_tension(acceleration.depth) and self.retries < MAX_CHECKPOINT_RETRIES:
            self.go_back()
            return None
        if self.steps % COMMIT_EVERY_STEPS == 0:
            self.sound = (self.time_s, self.state.copy())
        self.contacts = acceleration.contacts
        return acceleration

    def acceleration_under(self, forces: Array) -> Acceleration:
        """Return the acceleration under (n, 3) forces on the modules."""
        engine = self.engine
        if isinstance(engine, Segments):
            return engine.lean_accelerations(self.state, forces, self.pairs)
        return engine.accelerations(self.state, forces)

    def step(self) -> bool:
        """Make one step, after which no hinge is beyond its stop."""
        moved = super().step()
        if isinstance(self.engine, Segments):
            self.state.stop_at(self.material.stop_of(self.chain.module))
        return moved

    def _forces(self, positions: Array) -> Array:
        """Return (n, 3) forces: eq. 1 with the gain that gives the wanted tension, and eq. 3."""
        p = self.parameters
        weak, creeps = self.advance_pulse(), self.creeps()
        arms = positions - positions.mean(axis=0)
        diameter = 2.0 * float(np.sqrt((arms**2).sum(axis=1).max()))
        radial = self.weights[:, None] * arms / diameter
        radial -= radial.mean(axis=0)
        summed = float(np.sqrt((np.cumsum(radial, axis=0) ** 2).sum(axis=1).max()))
        gain = p.tension * p.spring * self.tension / summed
        forces = gain * (PULSE_TENSION_SCALE if weak or creeps else 1.0) * radial
        if creeps:
            forces += self._creep(positions)
        apart = self.apart()
        self.frames.spacing = 1.0 + (self.spacing - 1.0) * apart
        push = p.repulsion_gain * (1.0 + (p.loose_repulsion - 1.0) * apart)
        push *= PULSE_REPULSION_SCALE if weak and not creeps else 1.0
        repulsion(positions, self.pairs, push, forces)
        return forces

    def apart(self) -> float:
        """Return 0 while the chain is packed, 1 once it has come apart, or a value between."""
        low, high = REPULSION_RAMP
        return float(np.clip((self.unfolded() - low) / (high - low), 0.0, 1.0))

    def _creep(self, positions: Array) -> Array:
        """Return (n, 3) forces along the chain, from the end that its sharpest bends are nearer to.

        They reverse once the chain has crept its own length without success.
        """
        along = np.gradient(positions, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        if not self.way:
            bends = np.abs(self.state.angles)
            sharp = np.flatnonzero(bends > 0.5 * bends.max())
            self.way = 1 if sharp.mean() < 0.5 * len(bends) else -1
        speed = self.way * float((self.engine.velocities * along).sum(axis=1).mean())
        self.crept += self.step_s * speed
        if self.crept > len(positions):
            self.way, self.crept = -self.way, 0.0
        return REPTATION_FORCE * self.way * along

    def may_creep(self) -> bool:
        """Return True if all joints are free, and no blocks are rigid."""
        return isinstance(self.engine, Segments)

    def is_unknot(self) -> bool:
        """Return True if the present configuration is proved to be no knot."""
        return knot_of(self.engine.positions).verdict == "unknot"

    def creeps(self) -> bool:
        """Return True if the chain creeps: while it is knotted, and in every other pulse."""
        pushed = self.pulse_left > 0 and self.pushes % 2 == 0 and self.may_creep()
        return self.knotted or pushed

    def excess(self) -> float:
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
            float(np.sqrt((engine.velocities**2).sum(axis=1).max())) / self.body_cap,
        )

    def commit(self) -> None:
        """Make the steps so far final: the run goes back to the last one at most.

        The checkpoint is the last state whose contacts were checked, before its step.
        """
        self.recorder.commit()
        self.saved = self.sound
        self.retries = 0

    def finish(self) -> bool:
        """End the run by pure kinematics if the chain can be straightened without contact."""
        if self.steps < self.finish_at:
            return False
        if np.abs(self.state.angles).max() > self.parameters.finish_rad:
            return False
        rest = straightening(
            self.chain,
            self.state,
            start_s=self.time_s,
            snapshot_rad=self.spacing * self.parameters.snapshot_rad,
            snapshot_distance=self.spacing * self.parameters.snapshot_distance,
            size=self.parameters.verify_size,
        )
        if rest is None:
            factor, most = FINISH_BACKOFF
            self.finish_wait = min(factor * self.finish_wait, most)
            self.finish_at = self.steps + round(self.finish_wait)
            return False
        self.place()
        self.recorder.add(self.snapshot())
        self.recorder.commit(end=True)
        self.frames.append(rest)
        return True

    def unjam(self) -> bool:
        """Start a pulse if nothing moves; return False at the limit of pulses without progress."""
        angles = np.abs(self.state.angles)
        stuck = (angles > STUCK_HINGE_BEND_RAD) & (angles > self.window_angles - 0.05)
        eased = (angles > 0.6).sum() < 0.95 * (self.window_angles > 0.6).sum()
        self.window_angles = angles
        unfolded = self.unfolded()
        advanced = unfolded > self.farthest + MIN_UNFOLDING_PROGRESS
        if advanced:
            self.farthest = unfolded
            self.pushes = 0
        if (stuck.any() and not eased) or not advanced:
            self.push()
        return self.pushes <= self.most_pushes

    def unfolded(self) -> float:
        """Return the progress, 0 to 1: half by the joints' bends, half by the chain's span."""
        positions = self.engine.positions
        # A chain that folds into a line has nothing to unbend.
        bent = np.abs(self.state.angles).sum() / max(np.abs(self.chain.folded_rad).sum(), 1e-9)
        span = np.linalg.norm(positions[-1] - positions[0]) / (len(positions) - 1)
        return float(0.5 * (1.0 - bent) + 0.5 * span)

    def stall_reason(self) -> str:
        """Describe which joint stays bent."""
        angles = np.abs(self.state.angles).reshape(-1, self.chain.module.hinges_per_joint)
        worst = int(np.argmax(angles.max(axis=1))) + self.chain.module.rigid_links
        return (
            f"the chain is stuck: {self.pushes} random pushes in a row made no progress. The joint "
            f"of module {worst} is still bent by {np.rad2deg(angles.max()):.0f}°. Try another "
            "seed, or another path through the same cells."
        )
