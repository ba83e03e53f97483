"""The loop of an explosion: the paper's *record* (Figure 2), of parts that a strategy chooses.

A ``World`` is what moves: the whole chain, rigid blocks of it, or a window. It computes its own
forces; a window, or a chain that our own engine moves, makes several steps at a time.
``StepControl`` adapts step, drag and tension, ``Checkpoint`` is the state to restart from,
``Pulses`` loosen jams, and the ``Recorder`` chooses the snapshots. An ``Explosion`` holds them all
and decides when to commit, what to do about a jam, and when the run ends: see ``simultaneous``,
``peeling.run`` and ``published_explosion``.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from foldback.planner.core.structures import MOVED, NOT_FINITE
from foldback.planner.errors import SimulationError
from foldback.planner.explosion.loop.checkpoint import Checkpoint, Pulses
from foldback.planner.explosion.loop.recorder import Recorder
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.motion.record import Record, RecordStatus, Spent
from foldback.planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.reduced_state import Acceleration, State

COMMIT_EVERY_STEPS: Final = 25
"""Number of simulation steps after which the state is saved, if contacts are shallow, as the point
to restart from. Measured from 18 to 35 on a thick trefoil: other motions, equally good (decision
0051)."""
STOP_COMPLIANCE_RAD: Final = 0.01
"""Angle by which a simulated joint stop is placed inside the joint's range, rad, as stops are
springs and give under load."""
PULSE_REPULSION_SCALE: Final = 4.0
"""Factor of the repulsion between near modules, during the first part of a pulse that loosens a
jam."""
RADIAL_GAIN_JITTER: Final = 0.02
"""Maximum relative deviation of a module's outward force gain from the mean, drawn from the random
seed, so that another seed gives another unfolding. Measured from 0.014 to 0.028: other motions,
equally good (decision 0051)."""
UNREPELLED_LINKS: Final = 1
"""Maximum number of links between two modules that do not repel each other in a simulated
unfolding: 1 exempts direct neighbours along the chain, as eq. 3 of the published method
(docs/reproduction.md) does."""

S = TypeVar("S")
S_co = TypeVar("S_co", covariant=True)
W = TypeVar("W", bound="World[Any]")


@dataclass(frozen=True, slots=True)
class End:
    """End of a run: its status, the reason if it failed, and the limit that ended it."""

    status: RecordStatus
    reason: Reason | None = None
    spent: Spent | None = None


STRAIGHT: Final = End("straight")


class World(Protocol[S_co]):
    """State of an explosion.

    Attributes:
        state: Reduced state that is integrated.
        time_s: Simulated time, s.
    """

    state: State
    time_s: float

    def place(self) -> None:
        """Compute the poses of the present state."""

    def snapshot(self) -> S_co:
        """Return a copy of the present state, whose poses have been computed."""
        ...

    def unfolded(self) -> float:
        """Return the progress: 0 when folded, 1 when straight."""
        ...


class SteppedWorld(World[S_co], Protocol[S_co]):
    """State of an explosion that makes one step at a time, and the forces on it."""

    def accelerations(self, control: StepControl) -> Acceleration:
        """Apply the forces to the placed state and return its acceleration.

        Raises:
            SimulationError: When the numbers are bad.
        """
        ...

    def inverse_step_limit(self) -> float:
        """Return 1/Δt_max, 1/s: the largest ratio of a speed to its allowed change per step."""
        ...

    def advance(self, step_s: float) -> None:
        """Integrate the configuration: q ← q + h q̇."""

    def limit_hinges(self) -> None:
        """Leave no hinge beyond its stop."""


class Watch:
    """Channel to the caller of a run: progress, a few times a second, and cancellation.

    Args:
        progress: Receives the progress.
        cancelled: Returns True to stop.
        message: Message that ``Progress`` shows.
    """

    def __init__(self, progress: Report, cancelled: Cancelled, message: str) -> None:
        self._progress = progress
        self._cancelled = cancelled
        self._message = message
        self._started_s = self._last = time.perf_counter()
        self._last_steps = 0

    @property
    def seconds(self) -> float:
        """Wall time since the run began, s."""
        return time.perf_counter() - self._started_s

    def check(self, explosion: Explosion[Any, Any], *, simulated_s: float = 0.0) -> End | None:
        """Report the progress if it is due; return the end of a cancelled run."""
        if self._cancelled():
            return End("cancelled", Reason.of(Code.EXPLOSION_CANCELLED))
        now, steps = time.perf_counter(), explosion.control.steps
        if now - self._last >= PROGRESS_PERIOD_S:
            self._progress(
                Progress(
                    stage="explode",
                    fraction=float(np.clip(explosion.world.unfolded(), 0.0, 0.99)),
                    steps=steps,
                    steps_per_second=(steps - self._last_steps) / (now - self._last),
                    simulated_s=simulated_s,
                    message=self._message,
                    pushes=explosion.pulses.count,
                )
            )
            self._last, self._last_steps = now, steps
        return None


@dataclass(slots=True, kw_only=True, eq=False)
class Explosion(ABC, Generic[W, S]):
    """Parts of a run, each with a state of its own, and the decisions of its strategy.

    Attributes:
        world: State and forces.
        control: Time step, drag and tension.
        checkpoint: State to restart from.
        pulses: Pulses that loosen a jam.
        recorder: Choice of the snapshots.
        watch: Channel to the caller.
    """

    world: W
    control: StepControl
    checkpoint: Checkpoint
    pulses: Pulses
    recorder: Recorder[S]
    watch: Watch

    @property
    @abstractmethod
    def max_steps(self) -> int:
        """Maximum number of steps of the run."""

    @property
    @abstractmethod
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""

    @abstractmethod
    def begin(self) -> None:
        """Record the folded configuration, so that there is a record whatever comes."""

    @abstractmethod
    def record(self) -> End | None:
        """Record a placed state; return how the run ends there, or None."""

    @abstractmethod
    def may_restart(self, *, after_error: bool) -> bool:
        """Return True if the run may restart, after an error or because of deep contacts."""

    @abstractmethod
    def restart(self) -> None:
        """Restart from the checkpoint."""

    @abstractmethod
    def check_step(self, *, moved: bool) -> End | None:
        """Commit, release, loosen; return how the run ends after a step, or None.

        Args:
            moved: False if the run restarted instead of moving on.
        """

    @abstractmethod
    def close(self, end: End) -> None:
        """Make all steps final."""

    def go_on(self) -> End | None:
        """Make a step, and return how the run ends after it, or None.

        Raises:
            SimulationError: When the numbers are bad and the run may not restart.
        """
        self.world.place()
        return self.record() or self.check_step(moved=step(self))

    def end_steps(self, states: list[S], outcome: int) -> bool:
        """Record the states before some steps; return False if the run restarted after them.

        Args:
            states: States before each step.
            outcome: How the last step ended.

        Raises:
            SimulationError: When the numbers are bad and the run may not restart.
        """
        for state in states:
            self.recorder.add(state)
        if outcome == NOT_FINITE and not self.may_restart(after_error=True):
            raise SimulationError("the accelerations became infinite or undefined.")
        if outcome != MOVED:
            self.restart()
        return outcome == MOVED


def run(explosion: Explosion[Any, Any], strategy: str) -> Record:
    """Record an explosion: step until the chain is straight, or a limit ends the run.

    Args:
        explosion: Parts of the run.
        strategy: Name of the strategy.
    """
    control, max_steps = explosion.control, explosion.max_steps
    end: End | None = None
    explosion.begin()
    try:
        while end is None and control.steps < max_steps:
            end = explosion.go_on()
    except SimulationError as error:
        reason = Reason.of(Code.SIMULATION_FAILED, detail=str(error))
        end = End("diverged", reason, explosion.error_limit)
    if end is None:
        reason = Reason.of(Code.MAX_STEPS, steps=max_steps)
        end = End("timeout", reason, Spent("steps", max_steps, control.steps))
    explosion.close(end)
    return Record(
        status=end.status,
        reason=end.reason,
        frames=explosion.recorder.motion(),
        steps=control.steps,
        seconds=explosion.watch.seconds,
        strategy=strategy,
        pushes=explosion.pulses.count,
        retries=explosion.checkpoint.retries,
        spent=end.spent,
    )


def step(explosion: Explosion[Any, Any]) -> bool:
    """Make one step from a placed state; return False if the run restarted instead."""
    world: SteppedWorld[Any] = explosion.world
    control = explosion.control
    control.steps += 1
    try:
        acceleration = world.accelerations(control)
    except SimulationError:
        if not explosion.may_restart(after_error=True):
            raise
        explosion.restart()
        return False
    too_deep = control.is_too_deep(acceleration.depth)
    control.adapt_tension(acceleration.depth)
    if too_deep and explosion.may_restart(after_error=False):
        explosion.restart()
        return False
    if control.steps % COMMIT_EVERY_STEPS == 0:
        explosion.checkpoint.propose(world.time_s, world.state)
    world.state.accelerate(acceleration, control.step_s, control.drag)
    control.limit_speeds(world.state, world.inverse_step_limit(), acceleration.contacts)
    world.advance(control.step_s)
    world.time_s += control.step_s
    world.limit_hinges()
    return True


def return_to_checkpoint(explosion: Explosion[Any, Any]) -> None:
    """Return to the checkpoint, slower and with less tension."""
    explosion.recorder.take_back()
    explosion.world.time_s, explosion.world.state = explosion.checkpoint.restore()
    explosion.control.restart()
