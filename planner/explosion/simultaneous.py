"""Explosion of all modules at once: forces on the folded chain until it is straight.

Motors are off. Each module is pulled from the centre of mass (eq. 1, 2) and pushed away from near
modules that are not linked to it (eq. 3). Gains, time step and drag adapt: the radial gain so that
the force that adds up along the chain stays within what the joints' springs can order, the step so
that no contact goes deeper than the module size that the plan is verified at allows.

A *calm* explosion has stiffer springs and larger rotor inertias, and hinges that end straight are
nearly locked, so that hinges make few detours: docs/decisions/0034-calm-motion.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import MAX_SMOOTH_CURVE_MODULES
from foldback.planner.explosion.loop.checkpoint import (
    MAX_CHECKPOINT_RETRIES,
    MAX_STALLED_PULSES,
    Checkpoint,
    JamDetector,
    Pulses,
)
from foldback.planner.explosion.loop.explosion_loop import (
    COMMIT_EVERY_STEPS,
    STOP_COMPLIANCE_RAD,
    STRAIGHT,
    End,
    Explosion,
    Watch,
    return_to_checkpoint,
    run,
)
from foldback.planner.explosion.loop.radial_forces import RadialForces, radial_weights
from foldback.planner.explosion.loop.recorder import FrameRule, Recorder, Step
from foldback.planner.explosion.loop.step_control import ContactDepth, StepControl
from foldback.planner.explosion.loop.straightening import straightening
from foldback.planner.explosion.loop.whole_chain import WholeChain, body_cap_scale
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record, Spent
from foldback.planner.parameters.explosion import MUJOCO, ExplosionParameters
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.mujoco_chain import MujocoChain
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.rigid_blocks import Blocks
from foldback.planner.simulation.segments import Segments

FIRST_FINISH_STEPS: Final = 50
"""Number of simulation steps between two attempts to straighten the chain without simulation, by
shrinking all angles evenly; it grows after failed attempts. Measured from 35 to 70: equally good
(decision 0051)."""
JAM_CHECK_STEPS: Final = 400
"""Number of simulation steps between two checks of whether the unfolding chain is jammed; a jam
starts a loosening pulse."""
CALM_SPRING_SCALE: Final = 3.0
"""Factor of the stiffness of all hinges' springs in a calm explosion: the experiments are in
docs/decisions/0034-calm-motion.md."""
CALM_ARMATURE_SCALE: Final = 6.0
"""Factor of all hinges' rotor inertias in a calm explosion: see ``CALM_SPRING_SCALE``."""
STRAIGHT_HINGE_SCALE: Final = 10.0
"""Further factor of both, for the hinges that are straight in the folded chain: see
``CALM_SPRING_SCALE``."""
MAX_STRAIGHT_HINGE_RAD: Final = 1e-4
"""Maximum angle of a hinge of the folded chain that counts as straight, rad: rounding."""


def explode(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    calm: bool = False,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explode a folded chain and record its motion.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: Parameters of the explosion.
        seed: Seed of the slight unevenness of the radial gain.
        calm: True if hinges are to make few detours.
        sink: Receives the snapshots as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Returns:
        The record, whether straight or not.
    """
    watch = Watch(progress, cancelled, "exploding")
    if calm:
        parameters = replace(
            parameters,
            spring=CALM_SPRING_SCALE * parameters.spring,
            armature=CALM_ARMATURE_SCALE * parameters.armature,
        )
    explosion = Simultaneous.from_parameters(chain, parameters, seed=seed, sink=sink, watch=watch)
    if calm:
        _lock_straight_hinges(explosion.world)
    return run(explosion, "simultaneous")


def _lock_straight_hinges(world: WholeChain) -> None:
    """Make the hinges that are straight in the folded chain stiffer and heavier."""
    straight = np.abs(world.chain.folded_rad) < MAX_STRAIGHT_HINGE_RAD
    scale = np.where(straight, STRAIGHT_HINGE_SCALE, 1.0)
    assert not isinstance(world.engine, Blocks)
    world.engine.set_stiffness(scale * world.material.stiffness)
    world.engine.set_rotor_inertias(scale * world.material.armature)


@dataclass(slots=True)
class KinematicFinish:
    """Attempts to end a run by pure kinematics, at growing intervals.

    Attributes:
        parameters: Largest bend, and distances of its snapshots.
        spacing: Factor of those distances.
        next_step: Step of the next attempt.
        wait_steps: Steps from a failed attempt to the next.
    """

    parameters: ExplosionParameters
    spacing: float
    next_step: int = 0
    wait_steps: float = FIRST_FINISH_STEPS

    def frames(self, world: WholeChain, step: int) -> Motion | None:
        """Return frames from a state to the straight one; None if modules may touch, or not yet."""
        p = self.parameters
        if step < self.next_step or world.largest_bend_rad > p.finish_rad:
            return None
        frames = straightening(
            world.chain,
            world.state,
            start_s=world.time_s,
            snapshot_rad=self.spacing * p.snapshot_rad,
            snapshot_distance=self.spacing * p.snapshot_distance,
            module_size=p.verify_size,
        )
        if frames is None:
            factor, max_wait_steps = 1.5, 800.0
            self.wait_steps = min(factor * self.wait_steps, max_wait_steps)
            self.next_step = step + round(self.wait_steps)
        return frames


@dataclass(slots=True, kw_only=True, eq=False)
class Simultaneous(Explosion[WholeChain, Step]):
    """Run in which all modules move at once; see ``from_parameters``.

    Attributes:
        finish: Attempts to straighten the chain by kinematics.
        jam: Detector of jams.
        release: Called after each step that has moved on: it may free more joints.
    """

    finish: KinematicFinish
    jam: JamDetector
    release: Callable[[Simultaneous], None] | None = None

    @classmethod
    def from_parameters(
        cls,
        chain: Chain,
        parameters: ExplosionParameters,
        *,
        seed: int = 0,
        sink: Callable[[Motion], None] | None = None,
        watch: Watch,
        block_starts: Ints | None = None,
        release: Callable[[Simultaneous], None] | None = None,
    ) -> Simultaneous:
        """Build the parts of a run.

        Args:
            chain, parameters, seed, sink: As in ``explode``.
            watch: Channel to the caller.
            block_starts: First modules of the rigid blocks; None if all joints are free.
            release: As in the class.
        """
        pulses = Pulses(MAX_STALLED_PULSES["simultaneous"])
        material = Material(
            geom_size=parameters.geom_size,
            stiffness=parameters.spring,
            armature=parameters.armature,
            stops_early_rad=chain.module.stops_early_rad
            + (STOP_COMPLIANCE_RAD if len(chain) > MAX_SMOOTH_CURVE_MODULES else 0.0),
        )
        if block_starts is not None:
            engine = Blocks(chain, material, block_starts)
        elif parameters.engine == MUJOCO:
            engine = MujocoChain(chain, material)
        else:
            engine = Segments(chain, material)
        weights = radial_weights(seed, len(chain))
        forces = RadialForces(parameters, weights, pulses, parameters.tension)
        world = WholeChain(chain, parameters, material, engine, forces)
        # Snapshots of blocks are far apart from the start.
        spacing = body_cap_scale(chain) ** 2 if block_starts is None else 1.0
        rule = FrameRule(
            chain=chain,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            size=parameters.verify_size,
            spacing=lambda: 1.0 + (spacing - 1.0) * forces.looseness,
        )
        room = 2.0 * chain.module.inner_radius * (parameters.geom_size - parameters.verify_size)
        allowed = ContactDepth.within(room, 0.02)  # pitches
        return cls(
            world=world,
            control=StepControl.adaptive(parameters, allowed),
            checkpoint=Checkpoint(world.time_s, world.state),
            pulses=pulses,
            recorder=Recorder(rule, sink),
            watch=watch,
            finish=KinematicFinish(parameters, spacing),
            jam=JamDetector(chain.folded_rad, pulses),
            release=release,
        )

    @property
    def max_steps(self) -> int:
        """Maximum number of steps of the run."""
        return self.world.parameters.max_steps

    @property
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""
        return Spent("retries", MAX_CHECKPOINT_RETRIES, self.checkpoint.retries)

    def begin(self) -> None:
        """Record the folded configuration."""
        self.world.place()
        self.record()
        self.recorder.commit()

    def record(self) -> None:
        """Record the present state; step in any case."""
        self.recorder.add(self.world.snapshot())

    def go_on(self) -> End | None:
        """Make steps up to the next check, or one step where MuJoCo computes it."""
        if not isinstance(self.world.engine, Segments):
            return Explosion.go_on(self)
        return self.check_step(moved=self.make_steps(self.world.engine))

    def make_steps(self, engine: Segments) -> bool:
        """Make steps up to the next check; return False if the run restarted instead.

        The state before the last of them is proposed as the checkpoint.

        Raises:
            SimulationError: When the numbers are bad and the run may not restart.
        """
        control, world = self.control, self.world
        before_last = COMMIT_EVERY_STEPS - 1 - control.steps % COMMIT_EVERY_STEPS
        if not before_last:
            self.checkpoint.propose(world.time_s, world.state)
        limits = control.limits
        if not self.may_restart(after_error=False):
            limits = limits._replace(max_depth=np.inf)
        count = min(max(before_last, 1), self.max_steps - control.steps)
        return self.end_steps(*world.make_steps(engine, control, limits, count))

    def close(self, end: End) -> None:
        """Make all steps final."""
        self.recorder.close()

    def may_restart(self, *, after_error: bool) -> bool:
        """Return True if the run has not restarted too often from its checkpoint."""
        del after_error
        return not self.checkpoint.is_worn_out

    def restart(self) -> None:
        """Restart from the checkpoint."""
        return_to_checkpoint(self)
        self.world.limit_hinges()

    def commit(self) -> None:
        """Make the steps so far final: the run restarts from the last one at the earliest.

        The checkpoint is the last state whose contacts were checked, before its step.
        """
        self.recorder.commit()
        self.checkpoint.confirm()

    def check_step(self, *, moved: bool) -> End | None:
        """Commit; end a run whose chain can be straightened, is stuck, or is cancelled."""
        control, world = self.control, self.world
        steps = control.steps
        if moved and self.release is not None:
            self.release(self)
        if steps % COMMIT_EVERY_STEPS == 0:
            if moved and control.is_shallow:
                self.commit()
            if (end := self.watch.check(self)) is not None:
                return end
        if steps % FIRST_FINISH_STEPS == 0 and moved and not control.contacts and self.straighten():
            return STRAIGHT
        if steps % 200 == 0 and world.all_joints_free:
            self._check_knot()
        if steps % JAM_CHECK_STEPS == 0 and world.all_joints_free:
            self.jam.check(world.state.angles, world.unfolded())
            if self.pulses.are_used_up:
                return self._stalled()
        return None

    def straighten(self) -> bool:
        """Straighten the chain by pure kinematics; return False if modules may touch."""
        world = self.world
        frames = self.finish.frames(world, self.control.steps)
        if frames is None:
            return False
        world.place()
        self.record()
        self.recorder.commit(end=True)
        self.recorder.append_motion(frames)
        return True

    def _check_knot(self) -> None:
        """Test a loose chain for a knot, and choose the direction of the creep anew."""
        world, forces = self.world, self.world.forces
        loose = forces.is_knotted or world.unfolded() >= 0.4
        knotted = loose and knot_of(world.engine.positions).verdict != "unknot"
        if knotted != forces.is_knotted:
            forces.reset_creep()
        forces.is_knotted = knotted

    def _stalled(self) -> End:
        """Return the end of a stuck run, with the joint that stays bent."""
        angles, pulses = np.abs(self.world.state.angles), self.pulses
        angles = angles * self.world.bending if self.world.bending.any() else angles
        worst = self.world.chain.module_before(int(np.argmax(angles)))
        reason = Reason.of(
            Code.STUCK, pushes=pulses.count, module=int(worst), bend_rad=float(angles.max())
        )
        return End("stalled", reason, pulses.spent)
