"""Explosion: forces on the folded chain until it is straight. The paper's *record*.

Motors are off. Each module is pulled from the centre of mass (eq. 1, 2) and pushed away from near
modules that are not linked to it (eq. 3). Gains, time step and drag adapt: the radial gain so that
the force that adds up along the chain stays within what the joints' springs can order, the step so
that no contact goes deeper than the module size that the plan is verified at allows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.explosion.contact_depth import ContactDepth
from planner.explosion.recorder import Recorder, Step
from planner.explosion.straightening import straightening
from planner.kernels.pairs import largest_approach_speed, near_pairs, repulsion
from planner.motion.frames import Frames
from planner.motion.record import Record, RecordStatus
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.parameters import ExplosionParameters
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Acceleration, Segments, State

Array = NDArray[np.float64]
Engine = Segments | Blocks
LINKED: Final = 1
"""Modules this many links apart are linked, and don't repel."""
COMMIT_EVERY: Final = 25
FINISH_EVERY: Final = 50
JAM_WINDOW: Final = 400
JAM_PULSE: Final = (120, 300)
"""Steps of weak tension and strong repulsion, and of the whole pulse."""
MOST_PULSES: Final = 8
"""Pulses in a row that may bring no progress."""
STUCK_RAD: Final = 1.0
LEAST_PROGRESS: Final = 0.005
DEEP: Final = 0.02
"""Contacts are never deeper; less where the module size to verify leaves less."""
MOST_RETRIES: Final = 6
REPORT_EVERY_S: Final = 0.1
UNEVENNESS: Final = 0.02
"""Relative spread of the radial gain over the modules: what the seed decides."""


def explode(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    sink: Callable[[Frames], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explodes a folded chain and records how it comes out straight.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: How it is let go.
        seed: Decides a slight unevenness of the radial gain.
        sink: Gets the snapshots as they are made.
        progress: Told how far it is, a few times a second.
        cancelled: Asked now and then whether to stop.

    Returns:
        The record, whatever came of it.
    """
    return Explosion(chain, parameters, seed, sink).run(progress, cancelled)


class Explosion:
    """One run. Holds the simulation's engine and its state."""

    def __init__(
        self,
        chain: Chain,
        parameters: ExplosionParameters,
        seed: int,
        sink: Callable[[Frames], None] | None,
    ) -> None:
        self.chain = chain
        self.parameters = parameters
        self.material = Material(
            geom_size=parameters.geom_size,
            stiffness=parameters.spring,
            armature=parameters.armature,
            stop_rad=chain.module.stop_rad,
        )
        room = 2.0 * chain.module.inner_radius * (parameters.geom_size - parameters.verify_size)
        self.allowed = ContactDepth.within(room, DEEP)
        self.engine = self.first_engine()
        self.recorder = Recorder(
            chain,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            size=parameters.verify_size,
            sink=sink,
        )
        folded = chain.folded_poses
        self.state = State.at_rest(
            chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
        )
        spread = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(chain), 1))
        self.weights = 1.0 + UNEVENNESS * spread
        self.time_s = 0.0
        self.step_s = 5.0 * parameters.step_s[0]
        self.drag = 1.0
        self.tension = 1.0
        self.steps = 0
        self.depth = 0.0
        self.sound = self.saved = (0.0, self.state.copy())
        self.retries = 0
        self.pulse_left = 0
        self.pulses = 0
        self.unfolded = -1.0
        self.window_angles = np.abs(chain.folded_rad)

    def first_engine(self) -> Engine:
        """What gives the accelerations from the folded configuration on."""
        return Segments(self.chain, self.material)

    def run(self, progress: Report, cancelled: Cancelled) -> Record:
        """Steps until the chain is straight, or it is known that it won't be."""
        begun = time.perf_counter()
        reported = begun
        reported_steps = 0
        status: RecordStatus = "timeout"
        reason = (
            f"the chain was not straight after {self.parameters.max_steps} steps; try another "
            "seed, or another path through the same cells."
        )
        # The folded configuration itself, so that there is a record whatever comes.
        self.engine.place(self.state)
        self.recorder.add(Step.of(self.time_s, self.state, self.engine.positions))
        self.recorder.commit()
        try:
            while self.steps < self.parameters.max_steps:
                contacts = self.step()
                if self.steps % COMMIT_EVERY == 0:
                    if contacts >= 0 and self.depth < self.allowed.back_off:
                        self.commit()
                    if cancelled():
                        status, reason = "cancelled", "it was cancelled."
                        break
                    now = time.perf_counter()
                    if now - reported >= REPORT_EVERY_S:
                        rate = (self.steps - reported_steps) / (now - reported)
                        progress(self._progress(rate))
                        reported, reported_steps = now, self.steps
                if self.steps % FINISH_EVERY == 0 and contacts == 0 and self.finish():
                    status, reason = "straight", ""
                    break
                if self.steps % JAM_WINDOW == 0 and not self.unjam():
                    status, reason = "stalled", self._stall_reason()
                    break
        except SimulationError as error:
            status, reason = "diverged", f"the simulation broke off: {error}"
        self.recorder.commit(end=status != "straight")
        return Record(
            status=status,
            reason=reason,
            frames=self.recorder.frames(),
            steps=self.steps,
            seconds=time.perf_counter() - begun,
        )

    def step(self) -> int:
        """One step of the simulation; the number of contacts in it, −1 when it went back."""
        p = self.parameters
        state = self.state
        self.steps += 1
        self.engine.place(state)
        positions = self.engine.positions
        self.recorder.add(Step.of(self.time_s, state, positions))
        pairs = near_pairs(positions, p.repulsion_cutoff, LINKED + 1)
        self.engine.set_contact_time_constant(max(2.0 * self.step_s, 0.03))
        acceleration = self._accelerations(self._forces(positions, pairs))
        if acceleration is None:
            return -1
        if self.steps % COMMIT_EVERY == 0:
            self.sound = (self.time_s, state.copy())
        state.accelerate(acceleration, self.step_s, self.drag)
        self._limit(positions, pairs)
        if acceleration.contacts:
            self.step_s = min(self.step_s, p.step_in_contact_s)
        state.advance(self.step_s)
        self.time_s += self.step_s
        return acceleration.contacts

    def _forces(self, positions: Array, pairs: NDArray[np.int64]) -> Array:
        """(n, 3) forces: eq. 1 with the gain that gives the wanted tension, and eq. 3."""
        p = self.parameters
        weak = self.pulse_left > JAM_PULSE[1] - JAM_PULSE[0]
        self.pulse_left = max(0, self.pulse_left - 1)
        arms = positions - positions.mean(axis=0)
        diameter = 2.0 * float(np.sqrt((arms**2).sum(axis=1).max()))
        radial = self.weights * arms / diameter
        radial -= radial.mean(axis=0)
        summed = float(np.sqrt((np.cumsum(radial, axis=0) ** 2).sum(axis=1).max()))
        gain = p.tension * p.spring * self.tension / summed * (0.05 if weak else 1.0)
        forces = gain * radial
        repulsion(positions, pairs, p.repulsion_gain * (4.0 if weak else 1.0), forces)
        return forces

    def _accelerations(self, forces: Array) -> Acceleration | None:
        """The acceleration, or None when the run had to go back to its last sound state."""
        try:
            acceleration = self.engine.accelerations(self.state, forces)
        except SimulationError:
            if self.retries >= MOST_RETRIES:
                raise
            self._go_back()
            return None
        worse = acceleration.depth > self.depth
        self.depth = acceleration.depth
        if acceleration.depth > self.allowed.back_off:
            self.tension = max(0.05, 0.85 * self.tension)
        else:
            self.tension = min(1.0, 1.02 * self.tension)
        if acceleration.depth > self.allowed.most and worse and self.retries < MOST_RETRIES:
            self._go_back()
            return None
        return acceleration

    def _limit(self, positions: Array, pairs: NDArray[np.int64]) -> None:
        """Caps what one step may move by scaling all velocities; adapts step and drag to it."""
        p = self.parameters
        state, engine = self.state, self.engine
        engine.place(state)
        loose = np.abs(state.angles).max() < p.loose_rad
        approach = largest_approach_speed(
            positions, engine.velocities, engine.spins, pairs, self.chain.module.radius
        )
        excess = self.step_s * max(
            float(np.abs(state.rates).max()) / p.joint_cap_rad,
            approach / (p.pair_cap_loose if loose else p.pair_cap),
            float(np.sqrt((engine.velocities**2).sum(axis=1).max())) / p.body_cap,
        )
        if excess > 1.0:
            state.scale_velocities(1.0 / excess)
            self.drag = min(p.drag[1], 1.05 * self.drag)
            self.step_s = max(p.step_s[0], 0.97 * self.step_s)
        else:
            self.drag = max(p.drag[0], 0.97 * self.drag)
            self.step_s = min(p.step_s[1], 1.03 * self.step_s)

    def commit(self) -> None:
        """Makes the steps so far final: the run goes back to the last one, not behind.

        That is one whose contacts were looked at, and not where its step has led since.
        """
        self.recorder.commit()
        self.saved = self.sound
        self.retries = 0

    def _go_back(self) -> None:
        self.retries += 1
        self.recorder.take_back()
        self.time_s, saved = self.saved[0], self.saved[1].copy()
        saved.scale_velocities(0.3)
        self.state = saved
        self.step_s = max(self.parameters.step_s[0], 0.5 * self.step_s)
        self.tension = max(0.05, 0.5 * self.tension)
        self.depth = 0.0

    def finish(self) -> bool:
        """Ends the run by pure kinematics if the chain can be straightened without a touch."""
        if np.abs(self.state.angles).max() > self.parameters.finish_rad:
            return False
        rest = straightening(
            self.chain,
            self.state,
            start_s=self.time_s,
            snapshot_rad=self.parameters.snapshot_rad,
            snapshot_distance=self.parameters.snapshot_distance,
            size=self.parameters.verify_size,
        )
        if rest is None:
            return False
        self.engine.place(self.state)
        self.recorder.add(Step.of(self.time_s, self.state, self.engine.positions))
        self.recorder.commit(end=True)
        self.recorder.append(rest)
        return True

    def unjam(self) -> bool:
        """Starts a pulse when nothing moves on; False when enough of them were in vain."""
        angles = np.abs(self.state.angles)
        stuck = (angles > STUCK_RAD) & (angles > self.window_angles - 0.05)
        eased = (angles > 0.6).sum() < 0.95 * (self.window_angles > 0.6).sum()
        self.window_angles = angles
        unfolded = self._unfolded()
        advanced = unfolded > self.unfolded + LEAST_PROGRESS
        if advanced:
            self.unfolded = unfolded
            self.pulses = 0
        if (stuck.any() and not eased) or not advanced:
            self.pulses += 1
            self.pulse_left = JAM_PULSE[1]
        return self.pulses <= MOST_PULSES

    def _unfolded(self) -> float:
        """0 when folded, 1 when straight: half by the joints' bends, half by the chain's span."""
        positions = self.engine.positions
        # A chain that folds into a line has nothing to unbend.
        bent = np.abs(self.state.angles).sum() / max(np.abs(self.chain.folded_rad).sum(), 1e-9)
        span = np.linalg.norm(positions[-1] - positions[0]) / (len(positions) - 1)
        return float(0.5 * (1.0 - bent) + 0.5 * span)

    def _stall_reason(self) -> str:
        angles = np.abs(self.state.angles).reshape(-1, self.chain.module.hinges_per_joint)
        worst = int(np.argmax(angles.max(axis=1))) + self.chain.module.rigid_links
        return (
            f"the chain is stuck: {self.pulses} pushes in a row moved nothing on, and the joint of "
            f"module {worst} stays bent by {np.rad2deg(angles.max()):.0f}°; it may be knotted. Try "
            "another seed, or another path through the same cells."
        )

    def _progress(self, rate: float) -> Progress:
        return Progress(
            stage="explode",
            fraction=float(np.clip(self._unfolded(), 0.0, 0.99)),
            steps=self.steps,
            steps_per_second=rate,
            message="exploding",
            pushes=self.pulses,
        )
