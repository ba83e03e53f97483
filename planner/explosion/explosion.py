"""The loop of an explosion: steps that adapt, until the chain is straight or it won't be.

Time step, drag and tension adapt so that no contact goes deeper than the module size that the plan
is verified at allows. From what goes deeper, the run goes back to its last sound state. What is
let go, by which forces, and what is recorded, is said by those who inherit it: ``simultaneous``,
``blocks`` and ``peeling``.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Generic, Literal, TypeVar

import numpy as np

from planner.errors import SimulationError
from planner.explosion.recorder import Recorder
from planner.motion.motion import Motion
from planner.motion.record import Record, RecordStatus, Spent
from planner.parameters.explosion import ExplosionParameters, PeelingParameters
from planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report
from planner.simulation.reduced import Acceleration, State

COMMIT_EVERY_STEPS: Final = 25
"""Steps between two checkpoints. Larger values lose more steps when a run goes back. Chosen."""
PULSE_STEPS: Final = (120, 300)
"""Steps with weak tension and strong repulsion at the start of a pulse, and steps of the whole
pulse. Chosen."""
PULSE_TENSION_SCALE: Final = 0.05
"""Factor of the tension in the weak part of a pulse. Smaller values loosen a jam more. Chosen."""
PULSE_REPULSION_SCALE: Final = 4.0
"""Factor of the repulsion in the weak part of a pulse. Larger values part modules more. Chosen."""
MAX_STALLED_PULSES: Final = {"simultaneous": 40, "blocks": 40, "peel": 8}
"""Maximum number of pulses in a row without progress, by strategy; one more ends the run as
stalled. Chosen."""
STOP_COMPLIANCE_RAD: Final = 0.01
"""Angle by which a simulated stop lies inside a joint's range, rad: stops are springs, and give.
Smaller values let joints pass their range. Chosen."""
MAX_CHECKPOINT_RETRIES: Final = 6
"""Maximum number of restarts from one checkpoint. Beyond it deep contacts are accepted and a solver
error ends the run. Chosen."""
MIN_TENSION_SCALE: Final = 0.05
"""Minimum factor to which deep contacts reduce the tension. Chosen."""
RESTORED_VELOCITY_SCALE: Final = 0.3
"""Factor of all velocities when a run goes back to a checkpoint. Smaller values avoid the same
contact more surely and cost more steps. Chosen."""
MIN_CONTACT_TIME_CONSTANT_S: Final = 0.03
"""Minimum time constant of contacts, s; else it is two steps, MuJoCo's limit of stability. Larger
values make contacts softer. Chosen."""

RADIAL_GAIN_JITTER: Final = 0.02
"""Maximum relative deviation of a module's radial gain from the mean, ±2 %: all that a seed
decides. Chosen."""
MIN_ALLOWED_DEPTH_PITCH: Final = 0.002
"""Minimum allowed depth of contacts, pitches, even where the size to verify leaves less. Chosen."""
BACK_OFF_DEPTH_SHARE: Final = 0.7
"""Depth of contacts, as a fraction of the allowed depth, beyond which the tension falls. Chosen."""

UNREPELLED_LINKS: Final = 1
"""Maximum number of links between two modules that do not repel each other (eq. 3). Chosen."""

Snapshot = TypeVar("Snapshot")
Parameters = TypeVar("Parameters", ExplosionParameters, PeelingParameters)
Ended = Literal["straight", "stalled"]


@dataclass(frozen=True, slots=True)
class ContactDepth:
    """Limits of the depth of contacts during an explosion, in pitches.

    Attributes:
        most: Maximum depth; a run goes back when a contact is deeper.
        back_off: Depth beyond which the tension falls.
    """

    most: float
    back_off: float

    @classmethod
    def within(cls, room: float, deepest: float) -> ContactDepth:
        """Build the limits for the room that the size to verify leaves, at most ``deepest``."""
        most = float(np.clip(room, MIN_ALLOWED_DEPTH_PITCH, deepest))
        return cls(most, BACK_OFF_DEPTH_SHARE * most)


class Reports:
    """Timer of the progress reports of a run: a few a second."""

    def __init__(self) -> None:
        self.begun = self._told = time.perf_counter()
        self._steps = 0

    @property
    def seconds(self) -> float:
        """Wall time since the run began, s."""
        return time.perf_counter() - self.begun

    def steps_per_second(self, steps: int) -> float | None:
        """Return the steps per second since the last report; None while no report is due."""
        now = time.perf_counter()
        if now - self._told < PROGRESS_PERIOD_S:
            return None
        rate = (steps - self._steps) / (now - self._told)
        self._told, self._steps = now, steps
        return rate


class Explosion(ABC, Generic[Snapshot, Parameters]):
    """One run of an explosion: the part that all strategies have in common.

    Args:
        parameters: Parameters of the explosion.
        allowed: Limits of the depth of contacts.
        recorder: Receives every step.
        seed: Seed of the slight unevenness of the radial gain.
        modules: Number of modules of the chain.
    """

    strategy: str
    doing: str
    """Message that ``Progress`` shows during a run."""

    def __init__(
        self,
        parameters: Parameters,
        allowed: ContactDepth,
        recorder: Recorder[Snapshot],
        *,
        seed: int,
        modules: int,
    ) -> None:
        self.parameters = parameters
        self.allowed = allowed
        self.recorder = recorder
        spread = np.random.default_rng(seed).uniform(-1.0, 1.0, modules)
        self.weights = 1.0 + RADIAL_GAIN_JITTER * spread
        self.state: State
        self.saved: tuple[float, State]
        self.time_s = 0.0
        self.step_s = 5.0 * parameters.step_s[0]
        self.drag = 1.0
        self.tension = 1.0
        self.steps = 0
        self.depth = 0.0
        self.retries = 0
        self.pulse_left = 0
        self.pushes = 0

    @property
    @abstractmethod
    def most_steps(self) -> int:
        """Maximum number of steps of the run."""

    @property
    def most_pushes(self) -> int:
        """Maximum number of pulses in a row without progress; one more ends the run."""
        return MAX_STALLED_PULSES[self.strategy]

    @property
    def stall_limit(self) -> Spent:
        """Limit that is used up when the run has stalled."""
        return Spent("pushes", self.most_pushes, self.pushes)

    @property
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""
        return Spent("retries", MAX_CHECKPOINT_RETRIES, self.retries)

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """Return a copy of the present state, whose poses have been computed."""

    @abstractmethod
    def place(self) -> None:
        """Compute the poses of the present state."""

    @abstractmethod
    def accelerations(self) -> Acceleration | None:
        """Return the acceleration of the present state, or None if the run went back."""

    @abstractmethod
    def excess(self) -> float:
        """Return 1/Δt_max, 1/s: the largest ratio of a speed to its allowed change per step."""

    @abstractmethod
    def commit(self) -> None:
        """Make the steps so far final, if they are sound."""

    @abstractmethod
    def look(self) -> Ended | None:
        """Check the progress every few steps; return how the run ended, if it has."""

    @abstractmethod
    def motion(self) -> Motion:
        """Return all snapshots."""

    @abstractmethod
    def unfolded(self) -> float:
        """Return the progress: 0 when folded, 1 when straight."""

    @abstractmethod
    def stall_reason(self) -> str:
        """Describe where the chain is stuck, and what to try."""

    def run(self, progress: Report, cancelled: Cancelled) -> Record:
        """Step until the chain is straight, or a limit ends the run."""
        reports = Reports()
        status: RecordStatus = "timeout"
        reason = (
            f"the chain was not straight after {self.most_steps} steps; try another seed, or "
            "another path through the same cells."
        )
        # The folded configuration itself, so that there is a record whatever comes.
        self.place()
        self.recorder.add(self.snapshot())
        self.recorder.commit()
        try:
            while self.steps < self.most_steps:
                moved = self.step()
                if self.steps % COMMIT_EVERY_STEPS == 0:
                    if moved and self.depth < self.allowed.back_off:
                        self.commit()
                    if cancelled():
                        status, reason = "cancelled", "the explosion was cancelled."
                        break
                    if (rate := reports.steps_per_second(self.steps)) is not None:
                        progress(self._progress(rate))
                if (ended := self.look()) is not None:
                    status = ended
                    reason = "" if ended == "straight" else self.stall_reason()
                    break
        except SimulationError as error:
            status, reason = "diverged", f"the simulation failed: {error}"
        self.recorder.commit(end=status != "straight")
        limits = {
            "timeout": Spent("steps", self.most_steps, self.steps),
            "stalled": self.stall_limit,
            "diverged": self.error_limit,
        }
        return Record(
            status=status,
            reason=reason,
            frames=self.motion(),
            steps=self.steps,
            seconds=reports.seconds,
            strategy=self.strategy,
            pushes=self.pushes,
            retries=self.retries,
            spent=limits.get(status),
        )

    def step(self) -> bool:
        """Make one step of the simulation; return True if it moved on, and did not go back."""
        self.steps += 1
        self.place()
        self.recorder.add(self.snapshot())
        acceleration = self.accelerations()
        if acceleration is None:
            return False
        self.state.accelerate(acceleration, self.step_s, self.drag)
        self._slow_down(self.step_s * self.excess())
        if acceleration.contacts:
            self.step_s = min(self.step_s, self.parameters.step_in_contact_s)
        self.state.advance(self.step_s)
        self.time_s += self.step_s
        return True

    def contact_time_constant(self) -> float:
        """Return the time constant of contacts in this step, s."""
        return max(2.0 * self.step_s, MIN_CONTACT_TIME_CONSTANT_S)

    def push(self) -> None:
        """Begin a pulse: weak tension and strong repulsion for a while."""
        self.pushes += 1
        self.pulse_left = PULSE_STEPS[1]

    def advance_pulse(self) -> bool:
        """Count one step of the pulse; return True if the step is in its weak part."""
        weak = self.pulse_left > PULSE_STEPS[1] - PULSE_STEPS[0]
        self.pulse_left = max(0, self.pulse_left - 1)
        return weak

    def adapt_tension(self, depth: float) -> bool:
        """Adapt the tension to the depth of contacts, pitches.

        Returns:
            True if contacts are deeper than allowed and than in the step before.
        """
        worse = depth > self.depth
        self.depth = depth
        if depth > self.allowed.back_off:
            self.tension = max(MIN_TENSION_SCALE, 0.85 * self.tension)
        else:
            self.tension = min(1.0, 1.02 * self.tension)
        return depth > self.allowed.most and worse

    def _slow_down(self, excess: float) -> None:
        """Limit the motion of one step by scaling all velocities; adapt time step and drag."""
        p = self.parameters
        if excess > 1.0:
            self.state.scale_velocities(1.0 / excess)
            self.drag = min(p.drag[1], 1.05 * self.drag)
            self.step_s = max(p.step_s[0], 0.97 * self.step_s)
        else:
            self.drag = max(p.drag[0], 0.97 * self.drag)
            self.step_s = min(p.step_s[1], 1.03 * self.step_s)

    def go_back(self) -> None:
        """Return to the last checkpoint, slower and with less tension."""
        self.retries += 1
        self.recorder.take_back()
        self.time_s, saved = self.saved[0], self.saved[1].copy()
        saved.scale_velocities(RESTORED_VELOCITY_SCALE)
        self.state = saved
        self.step_s = max(self.parameters.step_s[0], 0.5 * self.step_s)
        self.tension = max(MIN_TENSION_SCALE, 0.5 * self.tension)
        self.depth = 0.0

    def _progress(self, rate: float) -> Progress:
        return Progress(
            stage="explode",
            fraction=float(np.clip(self.unfolded(), 0.0, 0.99)),
            steps=self.steps,
            steps_per_second=rate,
            message=self.doing,
            pushes=self.pushes,
        )
