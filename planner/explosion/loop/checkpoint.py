"""Checkpoint, pulses and progress: when a run restarts, and when it is jammed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.motion.record import Spent
from foldback.planner.simulation.reduced_state import State

MAX_CHECKPOINT_RETRIES: Final = 6
"""Maximum number of times that a simulation goes back to the same saved state. Beyond it deep
contacts are accepted, and a solver error ends the run."""
RESTORED_VELOCITY_SCALE: Final = 0.3
"""Factor of all velocities when a simulation goes back to a saved state because contacts were too
deep or the solver failed. Measured from 0.21 to 0.42 on a thick trefoil: other motions, equally
good (decision 0051)."""
PULSE_STEPS: Final = (120, 300)
"""A pulse loosens a jam: it weakens the pull along the chain and makes modules repel each other
more. Number of simulation steps of that phase, and of the whole pulse with the recovery after
it."""
MAX_STALLED_PULSES: Final = {"simultaneous": 40, "blocks": 40, "peel": 8}
"""Maximum number of pulses (short phases of weak tension and strong repulsion that loosen a jam) in
a row after which the chain is no straighter, by unfolding strategy; one more ends the run as
stalled."""


class Checkpoint:
    """Last state that a run may restart from.

    Args:
        time_s: Simulated time of the first one, s.
        state: First state.
    """

    def __init__(self, time_s: float, state: State) -> None:
        self._saved = self._candidate = (time_s, state.copy())
        self.retries = 0
        """Number of restarts from the present checkpoint."""

    @property
    def is_worn_out(self) -> bool:
        """True if the run has restarted from it as often as it may."""
        return self.retries >= MAX_CHECKPOINT_RETRIES

    def save(self, time_s: float, state: State) -> None:
        """Make a state the checkpoint."""
        self._saved = (time_s, state.copy())
        self.retries = 0

    def propose(self, time_s: float, state: State) -> None:
        """Remember a state, whose contacts have been checked, for ``confirm``."""
        self._candidate = (time_s, state.copy())

    def confirm(self) -> None:
        """Make the last proposed state the checkpoint."""
        self._saved = self._candidate
        self.retries = 0

    def restore(self) -> tuple[float, State]:
        """Count a restart; return the time, s, and a slowed copy of the state."""
        self.retries += 1
        time_s, state = self._saved[0], self._saved[1].copy()
        state.scale_velocities(RESTORED_VELOCITY_SCALE)
        return time_s, state


@dataclass(slots=True)
class Pulses:
    """Pulses: a while of weak tension and strong repulsion that loosens a jam.

    Attributes:
        max_count: Maximum number of pulses in a row without progress.
        count: Number of pulses in a row without progress.
        remaining_steps: Steps until the present pulse is over.
    """

    max_count: int
    count: int = 0
    remaining_steps: int = 0

    @property
    def is_weak(self) -> bool:
        """True if the next step has weak tension and strong repulsion."""
        return self.weak_steps > 0

    @property
    def weak_steps(self) -> int:
        """Number of the next steps that have weak tension and strong repulsion."""
        return max(0, self.remaining_steps - (PULSE_STEPS[1] - PULSE_STEPS[0]))

    @property
    def are_used_up(self) -> bool:
        """True if there were more pulses in a row than allowed."""
        return self.count > self.max_count

    @property
    def spent(self) -> Spent:
        """Pulses as a limit that has ended a run."""
        return Spent("pushes", self.max_count, self.count)

    def advance(self, steps: int = 1) -> None:
        """Count steps of the present pulse."""
        self.remaining_steps = max(0, self.remaining_steps - steps)

    def weaken(self) -> None:
        """Begin with the weak part of a pulse."""
        self.remaining_steps = PULSE_STEPS[1]

    def start(self) -> None:
        """Begin the next pulse."""
        self.count += 1
        self.weaken()


class JamDetector:
    """Detector of jams of a whole chain: bent hinges that do not move, or no progress.

    Args:
        folded_rad: (J,) angles of the folded chain, rad.
        pulses: Pulses that loosen a jam.
    """

    def __init__(self, folded_rad: Array, pulses: Pulses) -> None:
        self._pulses = pulses
        self._bends_rad = np.abs(folded_rad)
        self._unfolded = -1.0

    def compare_with(self, angles: Array) -> None:
        """Compare the bends of the next check with those of (J,) angles, rad."""
        self._bends_rad = np.abs(angles)

    def check(self, angles: Array, unfolded: float) -> None:
        """Start a pulse if there was no progress since the last check.

        Args:
            angles: (J,) present angles, rad.
            unfolded: Progress, 0…1.
        """
        before, bends = self._bends_rad, np.abs(angles)
        stuck = (bends > 1.0) & (bends > before - 0.05)
        eased = (bends > 0.6).sum() < 0.95 * (before > 0.6).sum()
        self._bends_rad = bends
        advanced = unfolded > self._unfolded + 0.005
        if advanced:
            self._unfolded = unfolded
            self._pulses.count = 0
        if (stuck.any() and not eased) or not advanced:
            self._pulses.start()


@dataclass(slots=True)
class BendDecrease:
    """Detector of jams of a peeling: the sum of all bends has not decreased for some steps.

    Attributes:
        min_decrease_rad: Minimum decrease that counts as progress, rad.
        patience: Number of steps without progress that count as a jam.
        min_rad: Least sum so far, rad.
        since_step: Step since which there was no progress.
    """

    min_decrease_rad: float
    patience: int
    min_rad: float = np.inf
    since_step: int = 0

    def begin_anew(self, remaining_rad: float, step: int) -> None:
        """Count progress from a state on."""
        self.min_rad, self.since_step = remaining_rad, step

    def check(self, remaining_rad: float, step: int) -> Literal["progress", "jam"] | None:
        """Return the result of a check; None while it is too early for one."""
        if remaining_rad < self.min_rad - self.min_decrease_rad:
            self.begin_anew(remaining_rad, step)
            return "progress"
        if step - self.since_step >= self.patience:
            self.since_step = step
            return "jam"
        return None
