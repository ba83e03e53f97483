"""Stream clock: the clock of a target stream, which stops while its client does not follow.

The rule is the paper's: servo to a target until the largest angle error is less than a threshold,
then continue. Here the targets are dense on a trajectory, and the clock slows down and speeds up
within the acceleration limit of the joints.
"""

from __future__ import annotations

from typing import Final, Literal

Reason = Literal["start", "pause", "silence", "behind", "error"]
MAX_CLOCK_STEP_S: Final = 0.1
"""Maximum time by which the clock of a target stream advances in one update, in s.
After a delayed update the motion goes on from the same point instead of jumping."""


class StreamClock:
    """Clock of one motion. Callers pass the time of a monotonic clock as ``now``.

    Attributes:
        time_s: Current time of the motion, s.
        rate: Current rate of the clock; 1 is real time.
        paused: True if the client has requested a pause.
        behind: True if the client has not answered too many targets.
        error_rad: Last reported joint error of the client.

    Args:
        duration_s: Duration of the motion, s.
        speed: Rate of the clock if the client keeps up; 1 is real time.
        ramp_s: Time from a stop to that rate, s.
        threshold_rad: Joint error above which the clock stops.
        silence_s: Time without a report after which the clock stops, s.
    """

    def __init__(
        self,
        duration_s: float,
        *,
        speed: float,
        ramp_s: float,
        threshold_rad: float,
        silence_s: float,
        now: float,
    ) -> None:
        self.duration_s = duration_s
        self.time_s = 0.0
        self.rate = 0.0
        self.paused = False
        self.behind = False
        self.error_rad: float | None = None
        self.heard = now
        self._speed = speed
        self._ramp_s = ramp_s
        self._threshold = threshold_rad
        self._silence_s = silence_s
        self._last = now

    def report(self, error_rad: float, now: float) -> None:
        """Record the client's largest joint error."""
        self.error_rad = error_rad
        self.heard = now

    def waiting(self, now: float) -> Reason | None:
        """Return the reason why the clock stops or slows down; None while it runs."""
        if self.paused:
            return "pause"
        if self.error_rad is None:
            return "start"
        if now - self.heard > self._silence_s:
            return "silence"
        if self.behind:
            return "behind"
        if self.error_rad > self._threshold:
            return "error"
        return None

    def advance(self, now: float) -> None:
        """Advance the motion to the time ``now``."""
        step = min(max(0.0, now - self._last), MAX_CLOCK_STEP_S)
        self._last = now
        target_rate = self._speed if self.waiting(now) is None else 0.0
        max_change = self._speed * step / self._ramp_s
        before = self.rate
        self.rate += min(max(target_rate - before, -max_change), max_change)
        self.time_s = min(self.duration_s, self.time_s + 0.5 * (before + self.rate) * step)

    def over(self, now: float) -> bool:
        """Return True if the client has followed the motion to its end."""
        return self.time_s >= self.duration_s and self.waiting(now) is None
