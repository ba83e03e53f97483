"""The loop of an explosion: the paper's *record* (Figure 2), of parts that a strategy chooses.

A ``World`` is what moves: the whole chain, rigid blocks of it, or a window. It computes its own
forces. ``StepControl`` adapts step, drag and tension, ``Checkpoint`` is the state to restart from,
``Pulses`` loosen jams, and a ``Recording`` chooses the snapshots. A ``Policy`` says when to commit,
what to do about a jam, and when the run ends: see ``simultaneous``, ``peeling`` and ``paper``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

import numpy as np

from planner.errors import SimulationError
from planner.explosion.checkpoint import Checkpoint, Pulses
from planner.explosion.step_control import StepControl
from planner.motion.motion import Motion
from planner.motion.record import Record, RecordStatus, Spent
from planner.progress import PROGRESS_PERIOD_S, Cancelled, Progress, Report
from planner.simulation.reduced import Acceleration, State

COMMIT_EVERY_STEPS: Final = 25
"""Steps between two checkpoints. Larger values lose more steps when a run goes back. Chosen."""
STOP_COMPLIANCE_RAD: Final = 0.01
"""Angle by which a simulated stop lies inside a joint's range, rad: stops are springs, and give.
Smaller values let joints pass their range. Chosen."""
PULSE_TENSION_SCALE: Final = 0.05
"""Factor of the tension in the weak part of a pulse. Smaller values loosen a jam more. Chosen."""
PULSE_REPULSION_SCALE: Final = 4.0
"""Factor of the repulsion in the weak part of a pulse. Larger values part modules more. Chosen."""
RADIAL_GAIN_JITTER: Final = 0.02
"""Maximum relative deviation of a module's radial gain from the mean, ±2 %: all that a seed
decides. Chosen."""
UNREPELLED_LINKS: Final = 1
"""Maximum number of links between two modules that do not repel each other (eq. 3). Chosen."""

S = TypeVar("S")
S_co = TypeVar("S_co", covariant=True)
S_contra = TypeVar("S_contra", contravariant=True)


@dataclass(frozen=True, slots=True)
class End:
    """End of a run: its status, the reason if it failed, and the limit that ended it."""

    status: RecordStatus
    reason: str = ""
    spent: Spent | None = None


STRAIGHT: Final = End("straight")


class World(Protocol[S_co]):
    """State of an explosion, and the forces on it.

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

    def accelerations(self, control: StepControl) -> Acceleration:
        """Apply the forces to the placed state and return its acceleration.

        Raises:
            SimulationError: When the numbers are bad.
        """
        ...

    def inverse_step_limit(self) -> float:
        """Return 1/Δt_max, 1/s: the largest ratio of a speed to its allowed change per step."""
        ...

    def limit_hinges(self) -> None:
        """Leave no hinge beyond its stop."""

    def unfolded(self) -> float:
        """Return the progress: 0 when folded, 1 when straight."""
        ...


class Recording(Protocol[S_contra]):
    """Choice of the snapshots of a run."""

    def add(self, step: S_contra) -> None:
        """Add a step that may still be taken back."""

    def take_back(self) -> None:
        """Drop the steps since the last commit."""

    def close(self, step: S_contra, *, straight: bool) -> None:
        """Make all steps final; ``step`` is the state at the end."""

    def motion(self) -> Motion:
        """Return all snapshots."""
        ...


class Policy(Protocol):
    """Decisions of a strategy while it runs."""

    @property
    def max_steps(self) -> int:
        """Maximum number of steps of the run."""
        ...

    @property
    def error_limit(self) -> Spent:
        """Limit that is used up when an error of the simulation ends the run."""
        ...

    def begin(self) -> None:
        """Record the folded configuration, so that there is a record whatever comes."""

    def check_placed(self) -> End | None:
        """Return how the run ends at a state whose poses are known; None to step."""

    def may_restart(self, *, after_error: bool) -> bool:
        """Return True if the run may restart, after an error or because of deep contacts."""
        ...

    def restart(self) -> None:
        """Restart from the checkpoint."""

    def check_step(self, *, moved: bool) -> End | None:
        """Commit, release, loosen; return how the run ends after a step, or None.

        Args:
            moved: False if the run restarted instead of moving on.
        """


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
        self._begin = self._last = time.perf_counter()
        self._last_steps = 0

    @property
    def seconds(self) -> float:
        """Wall time since the run began, s."""
        return time.perf_counter() - self._begin

    def check(self, explosion: Explosion[S], *, simulated_s: float = 0.0) -> End | None:
        """Report the progress if it is due; return the end of a cancelled run."""
        if self._cancelled():
            return End("cancelled", "the explosion was cancelled.")
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Explosion(Generic[S]):
    """Parts of one run, each with a state of its own."""

    world: World[S]
    control: StepControl
    checkpoint: Checkpoint
    pulses: Pulses
    recorder: Recording[S]

    def step(self, policy: Policy) -> bool:
        """Make one step from a placed state; return False if the run restarted instead."""
        world, control = self.world, self.control
        control.steps += 1
        try:
            acceleration = world.accelerations(control)
        except SimulationError:
            if not policy.may_restart(after_error=True):
                raise
            policy.restart()
            return False
        too_deep = control.is_too_deep(acceleration.depth)
        control.adapt_tension(acceleration.depth)
        if too_deep and policy.may_restart(after_error=False):
            policy.restart()
            return False
        if control.steps % COMMIT_EVERY_STEPS == 0:
            self.checkpoint.propose(world.time_s, world.state)
        world.state.accelerate(acceleration, control.step_s, control.drag)
        control.limit_speeds(world.state, world.inverse_step_limit(), acceleration.contacts)
        world.state.advance(control.step_s)
        world.time_s += control.step_s
        world.limit_hinges()
        return True

    def restart(self) -> None:
        """Return to the checkpoint, slower and with less tension."""
        self.recorder.take_back()
        self.world.time_s, self.world.state = self.checkpoint.restore()
        self.control.restart()


def run(
    explosion: Explosion[S],
    policy: Policy,
    watch: Watch,
    *,
    strategy: str,
    advice: str = "; try another seed, or another path through the same cells",
) -> Record:
    """Record an explosion: step until the chain is straight, or a limit ends the run.

    Args:
        explosion: Parts of the run.
        policy: Decisions of the strategy.
        watch: Channel to the caller.
        strategy: Name of the strategy.
        advice: End of the reason if the steps are used up.
    """
    world, control, recorder = explosion.world, explosion.control, explosion.recorder
    end: End | None = None
    policy.begin()
    try:
        while end is None and control.steps < policy.max_steps:
            world.place()
            recorder.add(world.snapshot())
            end = policy.check_placed() or policy.check_step(moved=explosion.step(policy))
    except SimulationError as error:
        end = End("diverged", f"the simulation failed: {error}", policy.error_limit)
    if end is None:
        end = End(
            "timeout",
            f"the chain was not straight after {policy.max_steps} steps{advice}.",
            Spent("steps", policy.max_steps, control.steps),
        )
    world.place()
    recorder.close(world.snapshot(), straight=end.status == "straight")
    return Record(
        status=end.status,
        reason=end.reason,
        frames=recorder.motion(),
        steps=control.steps,
        seconds=watch.seconds,
        strategy=strategy,
        pushes=explosion.pulses.count,
        retries=explosion.checkpoint.retries,
        spent=end.spent,
    )
