"""The explosion as published: constant gains, fixed step, snapshots at a fixed interval.

The paper gives figures without units and leaves some out. How it was read, and which variants were
tried, stands in docs/decisions/0002-published-preset.md. Lengths are in pitches here and a module
weighs 1, so a force in the paper's units is divided by a module's mass in grams and the pitch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.extension import extended_length
from foldback.planner.chain.module import DEFAULT_MODULE_SIZE, Module
from foldback.planner.core import near_pairs, repulsion, unfolded_share
from foldback.planner.explosion.loop.checkpoint import Checkpoint, Pulses
from foldback.planner.explosion.loop.explosion_loop import (
    STRAIGHT,
    UNREPELLED_LINKS,
    End,
    Explosion,
    Watch,
    run,
)
from foldback.planner.explosion.loop.recorder import FrameRule, Recorder, Step
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.explosion.loop.whole_chain import chain_at_rest, folded_bend_rad
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record, Spent
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.reduced_state import Acceleration
from foldback.planner.simulation.segments import Segments

REST_CHECK_STEPS: Final = 5000
"""Number of simulation steps between two checks of whether nothing moves any more, in which case an
unfolding by the published method (preset ``paper``) ends as failed."""
MAX_SNAPSHOT_ANGLES: Final = 20_000_000
"""Maximum number of hinge angles in all snapshots of one run together (160 MB of memory); beyond it
the run fails and asks for a longer snapshot interval. The wrench of 160 cubes needs 3 million."""
MAX_STOP_RAD: Final = float(np.deg2rad(92.0))
"""Largest angle of the stops that can be set, rad, in an unfolding by the published method. Hinges
of modules with larger ranges stop at the ends of these."""
FRAME_SPACING_RAD: Final = 0.03
"""Turn of a hinge since the last displayed frame, rad, at which a recorded configuration becomes
the next displayed frame, in an unfolding by the published method, which records one every 10
steps."""


def explode_as_published(
    chain: Chain,
    parameters: PaperExplosionParameters,
    *,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explode a chain with the paper's parameters; see ``planner.explosion.simultaneous.explode``.

    The last snapshot, nearly straight, is followed by the straight configuration itself. Playback
    follows all snapshots; only those that show the motion become frames.
    """
    p = parameters
    control = StepControl.fixed(p.step_s, p.damping / (1.0 - p.damping) / p.step_s)
    world = PublishedChain(chain, p, control)
    rule = FrameRule(
        chain=chain,
        snapshot_rad=FRAME_SPACING_RAD,
        snapshot_distance=1.0,
        size=DEFAULT_MODULE_SIZE,
    )
    explosion = Published(
        world=world,
        control=control,
        checkpoint=Checkpoint(world.time_s, world.state),
        pulses=Pulses(0),
        recorder=Recorder(rule, sink),
        watch=Watch(progress, cancelled, "exploding with the published parameters"),
        parameters=p,
    )
    record = run(explosion, "simultaneous")
    snapshots = np.array(explosion.snapshots).reshape(-1, len(chain.folded_rad))
    snapshots = quantised(snapshots, chain.stops_rad())
    return replace(record, snapshots_rad=snapshots)


class PublishedChain:
    """World of a whole chain under eq. 1 and 3 with constant gains.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: Gains and joints.
        control: Constant step.
    """

    def __init__(
        self, chain: Chain, parameters: PaperExplosionParameters, control: StepControl
    ) -> None:
        p = parameters
        self._control = control
        self.chain = chain
        self.segments = Segments(chain, explosion_material(p, chain.module))
        self.state = chain_at_rest(chain)
        self.time_s = 0.0
        force = p.module_mass_g(chain.module) * p.pitch_cm
        self._radial_gain = p.radial_gain / force
        self._repulsion_gain = p.repulsion_gain / p.pitch_cm**2 / force
        self._cutoff = p.repulsion_cutoff
        self._reach = 2.0 * chain.module.radius * p.geom_size
        self.length = extended_length(chain)
        """Distance of the ends of the extended chain, pitches."""

    def place(self) -> None:
        """Compute the poses of the present state."""
        self.segments.place(self.state)

    def snapshot(self) -> Step:
        """Return the present state as a snapshot, at a whole number of steps."""
        time_s = self._control.steps * self._control.step_s
        return Step.of(time_s, self.state, self.segments.positions)

    def accelerations(self, control: StepControl) -> Acceleration:
        """Return the acceleration of the placed state."""
        del control
        segments, state = self.segments, self.state
        positions = segments.positions
        forces = self._radial_gain * (positions - positions.mean(axis=0))
        pairs = near_pairs(positions, self._cutoff, UNREPELLED_LINKS + 1)
        repulsion(positions, pairs, self._repulsion_gain, forces)
        near = (
            pairs
            if self._reach <= self._cutoff
            else near_pairs(positions, self._reach, UNREPELLED_LINKS + 1)
        )
        if segments.is_free(state, near):
            return segments.free_accelerations(state, forces)
        return segments.accelerations(state, forces)

    def inverse_step_limit(self) -> float:
        """Return 0: the speed of a step is not limited."""
        return 0.0

    def advance(self, step_s: float) -> None:
        """Integrate the configuration."""
        self.state.advance(step_s)

    def limit_hinges(self) -> None:
        """Leave hinges to their stops."""

    def unfolded(self) -> float:
        """Return the progress, 0 to 1: half by the joints' bends, half by the chain's span."""
        return unfolded_share(
            self.state.angles, self.segments.positions, folded_bend_rad(self.chain), self.length
        )


@dataclass(slots=True, kw_only=True, eq=False)
class Published(Explosion[PublishedChain, Step]):
    """Run of the published recipe: it steps on until the chain is straight, or at rest.

    Attributes:
        parameters: Interval of snapshots, and maximum number of steps.
        snapshots: (J,) hinge angles of each snapshot, rad; some of them become frames.
    """

    parameters: PaperExplosionParameters
    snapshots: list[Array] = field(default_factory=list)

    @property
    def max_steps(self) -> int:
        """Maximum number of steps of the run."""
        return self.parameters.max_steps

    @property
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""
        return Spent("retries", 0, 0)

    def begin(self) -> None:
        """Do nothing: the first step is a snapshot."""

    def record(self) -> End | None:
        """Record a snapshot every few steps; end a run that is straight, at rest or too long."""
        steps, world = self.control.steps, self.world
        if steps % self.parameters.snapshot_interval == 0:
            snapshot = world.snapshot()
            self.recorder.add(snapshot)
            self.snapshots.append(snapshot.angles)
            if len(self.snapshots) % 10 == 0:
                self.recorder.commit()
        hinges, count = len(world.state.angles), len(self.snapshots)
        if count * hinges > MAX_SNAPSHOT_ANGLES:
            return End(
                "timeout",
                Reason.of(Code.MAX_SNAPSHOTS, snapshots=count),
                Spent("snapshots", MAX_SNAPSHOT_ANGLES // hinges, count),
            )
        if steps % 25:
            return None
        # too slow to become straight within the permitted steps
        at_rest = np.abs(world.state.rates).max() < 1e-7
        if steps and steps % REST_CHECK_STEPS == 0 and at_rest:
            return End(
                "stalled",
                Reason.of(Code.AT_REST, steps=steps),
                Spent("motion", self.max_steps, steps),
            )
        positions = world.segments.positions
        span = float(np.linalg.norm(positions[-1] - positions[0])) / world.length
        if np.abs(world.state.angles).max() < 0.05 and span >= 0.99:
            world.state.angles[:] = 0.0
            return STRAIGHT
        return self.watch.check(self, simulated_s=steps * self.control.step_s)

    def close(self, end: End) -> None:
        """Make all steps final; the last state is a frame, and a snapshot if it is straight."""
        self.recorder.commit(end=True)
        self.world.place()
        last = self.world.snapshot()
        if end.status == "straight":
            self.snapshots.append(last.angles)
        self.recorder.add(last)
        self.recorder.close()

    def may_restart(self, *, after_error: bool) -> bool:
        """Return False: an error ends the run, and contacts may be as deep as they get."""
        del after_error
        return False

    def restart(self) -> None:
        """Do nothing: no run restarts."""

    def check_step(self, *, moved: bool) -> None:
        """Step on."""
        del moved


def explosion_material(p: PaperExplosionParameters, module: Module) -> Material:
    """Return the joints and surfaces of the chain as it explodes."""
    farthest = module.largest_angle_rad
    early = farthest - float(np.deg2rad(p.stop_deg)) if farthest <= MAX_STOP_RAD else 0.0
    return Material(
        geom_size=p.geom_size,
        friction=p.friction,
        stiffness=p.spring / (p.module_mass_g(module) * p.pitch_cm**2),
        stops_early_rad=early,
        stiff_stops=True,
    )
