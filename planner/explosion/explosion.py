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
from planner.progress import Cancelled, Progress, Report
from planner.simulation.reduced import Acceleration, State

COMMIT_EVERY: Final = 25
"""Steps between two states that a run may go back to."""
JAM_PULSE: Final = (120, 300)
"""Steps of a pulse with weak tension and strong repulsion, and of the whole pulse."""
WEAK_TENSION: Final = 0.05
"""Factor of the tension in the weak part of a pulse."""
STRONG_REPULSION: Final = 4.0
"""Factor of the repulsion in the weak part of a pulse."""
MOST_PUSHES: Final = {"simultaneous": 40, "blocks": 40, "peel": 8}
"""Pulses in a row without progress after which a run by a strategy has stalled."""
STOP_GIVES_RAD: Final = 0.01
"""Angle by which a simulated stop lies inside a joint's range: stops are springs, and give."""
MOST_RETRIES: Final = 6
"""Times that a run goes back to one state; then deep contacts are let be, and an error ends it."""
LEAST_TENSION: Final = 0.05
"""Factor that deep contacts reduce the tension to, at most."""
SLOWER: Final = 0.3
"""Factor of all velocities when a run goes back to an earlier state."""
LEAST_TIME_CONSTANT_S: Final = 0.03
"""Time constant of contacts, at least; else it is two steps, MuJoCo's limit of stability."""
REPORT_EVERY_S: Final = 0.1
"""Seconds of wall time between two reports of progress."""
UNEVENNESS: Final = 0.02
"""Share by which a module's radial gain is off the mean, at most: all that a seed decides."""
LEAST_DEPTH: Final = 0.002
"""Pitches that contacts may be deep even where the size to verify leaves less."""
BACK_OFF: Final = 0.7
"""Share of the allowed depth from which on the tension falls."""

Snapshot = TypeVar("Snapshot")
Parameters = TypeVar("Parameters", ExplosionParameters, PeelingParameters)
Ended = Literal["straight", "stalled"]


@dataclass(frozen=True, slots=True)
class ContactDepth:
    """How deep modules may press into each other while a chain is let go, in pitches.

    Attributes:
        most: A run goes back when a contact is deeper.
        back_off: From here on the tension falls.
    """

    most: float
    back_off: float

    @classmethod
    def within(cls, room: float, deepest: float) -> ContactDepth:
        """For what the module size to verify leaves between hulls, never more than ``deepest``."""
        most = float(np.clip(room, LEAST_DEPTH, deepest))
        return cls(most, BACK_OFF * most)


class Reports:
    """When to tell how far a run is: a few times a second."""

    def __init__(self) -> None:
        self.begun = self._told = time.perf_counter()
        self._steps = 0

    @property
    def seconds(self) -> float:
        """Since the run began."""
        return time.perf_counter() - self.begun

    def steps_per_second(self, steps: int) -> float | None:
        """Steps in a second since the last report; None while none is due."""
        now = time.perf_counter()
        if now - self._told < REPORT_EVERY_S:
            return None
        rate = (steps - self._steps) / (now - self._told)
        self._told, self._steps = now, steps
        return rate


class Explosion(ABC, Generic[Snapshot, Parameters]):
    """One run: what all strategies have in common.

    Args:
        parameters: How the chain is let go.
        allowed: How deep contacts may be.
        recorder: Gets every step.
        seed: Decides a slight unevenness of the radial gain.
        modules: Of the chain.
    """

    strategy: str
    doing: str
    """What is said of it while it runs."""

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
        self.weights = 1.0 + UNEVENNESS * spread
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
        """After so many steps the run ends as it is."""

    @property
    def most_pushes(self) -> int:
        """Maximum number of pulses in a row without progress; one more ends the run."""
        return MOST_PUSHES[self.strategy]

    @property
    def stall_limit(self) -> Spent:
        """Limit that is used up when the run has stalled."""
        return Spent("pushes", self.most_pushes, self.pushes)

    @property
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""
        return Spent("retries", MOST_RETRIES, self.retries)

    @abstractmethod
    def snapshot(self) -> Snapshot:
        """The present state, whose poses have been computed."""

    @abstractmethod
    def place(self) -> None:
        """Computes the poses of the present state."""

    @abstractmethod
    def accelerations(self) -> Acceleration | None:
        """The acceleration of the present state, or None when the run went back."""

    @abstractmethod
    def excess(self) -> float:
        """How many times farther than it may anything goes in a time unit, once accelerated."""

    @abstractmethod
    def commit(self) -> None:
        """Makes the steps so far final, if they are sound."""

    @abstractmethod
    def look(self) -> Ended | None:
        """Looks at what has come of it so far, every few steps; how it ended, if it has."""

    @abstractmethod
    def motion(self) -> Motion:
        """All snapshots."""

    @abstractmethod
    def unfolded(self) -> float:
        """How far it is: 0 when folded, 1 when straight."""

    @abstractmethod
    def stall_reason(self) -> str:
        """Where it is stuck, and what to try."""

    def run(self, progress: Report, cancelled: Cancelled) -> Record:
        """Steps until the chain is straight, or it is known that it won't be."""
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
                if self.steps % COMMIT_EVERY == 0:
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
        """One step of the simulation; whether it moved on, and did not go back."""
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
        """Of contacts in this step, in seconds."""
        return max(2.0 * self.step_s, LEAST_TIME_CONSTANT_S)

    def push(self) -> None:
        """Begins a pulse: weak tension and strong repulsion for a while."""
        self.pushes += 1
        self.pulse_left = JAM_PULSE[1]

    def is_weak(self) -> bool:
        """Whether this step is in the weak part of a pulse, of which a step has gone then."""
        weak = self.pulse_left > JAM_PULSE[1] - JAM_PULSE[0]
        self.pulse_left = max(0, self.pulse_left - 1)
        return weak

    def is_too_deep(self, depth: float) -> bool:
        """Whether contacts are deeper than allowed and than before; adapts the tension to them."""
        worse = depth > self.depth
        self.depth = depth
        if depth > self.allowed.back_off:
            self.tension = max(LEAST_TENSION, 0.85 * self.tension)
        else:
            self.tension = min(1.0, 1.02 * self.tension)
        return depth > self.allowed.most and worse

    def _slow_down(self, excess: float) -> None:
        """Caps what one step may move by scaling all velocities; adapts step and drag to it."""
        p = self.parameters
        if excess > 1.0:
            self.state.scale_velocities(1.0 / excess)
            self.drag = min(p.drag[1], 1.05 * self.drag)
            self.step_s = max(p.step_s[0], 0.97 * self.step_s)
        else:
            self.drag = max(p.drag[0], 0.97 * self.drag)
            self.step_s = min(p.step_s[1], 1.03 * self.step_s)

    def go_back(self) -> None:
        """Returns to the last sound state, slower and with less tension."""
        self.retries += 1
        self.recorder.take_back()
        self.time_s, saved = self.saved[0], self.saved[1].copy()
        saved.scale_velocities(SLOWER)
        self.state = saved
        self.step_s = max(self.parameters.step_s[0], 0.5 * self.step_s)
        self.tension = max(LEAST_TENSION, 0.5 * self.tension)
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
