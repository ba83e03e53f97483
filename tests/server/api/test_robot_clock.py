from __future__ import annotations

import pytest

from server.api.robot_clock import MAX_CLOCK_STEP_S, RobotClock

TICK = 0.01


class Driven:
    """A pace, and the clock on the wall."""

    def __init__(self, *, speed: float = 1.0, ramp_s: float = 0.1) -> None:
        self.now = 100.0
        self.pace = RobotClock(
            10.0, speed=speed, ramp_s=ramp_s, threshold_rad=0.05, silence_s=1.0, now=self.now
        )

    def run(self, seconds: float, error: float | None) -> float:
        """How far the clock gets, with a report at every tick."""
        before = self.pace.time_s
        for _ in range(round(seconds / TICK)):
            if error is not None:
                self.pace.report(error, self.now)
            self.now += TICK
            self.pace.advance(self.now)
        return self.pace.time_s - before


def test_nothing_moves_before_the_first_report() -> None:
    driven = Driven()
    assert driven.run(0.5, None) == 0.0
    assert driven.pace.waiting(driven.now) == "start"


@pytest.mark.parametrize("speed", [0.5, 1.0, 20.0])
def test_it_runs_at_its_speed_after_a_ramp(speed: float) -> None:
    driven = Driven(speed=speed)
    driven.run(0.1, 0.0)
    assert driven.pace.rate == pytest.approx(speed)
    assert driven.run(0.2, 0.0) == pytest.approx(0.2 * speed)


def test_it_stands_above_the_threshold_and_goes_on_below() -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    # It runs down within its ramp, over half of what it would have gone.
    assert driven.run(1.0, 0.06) == pytest.approx(0.05, abs=0.01)
    assert driven.pace.rate == 0.0
    assert driven.pace.waiting(driven.now) == "error"
    assert driven.run(0.5, 0.04) == pytest.approx(0.45, abs=0.01)


def test_a_dead_robot_stops_it() -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    driven.run(1.2, None)
    assert driven.pace.waiting(driven.now) == "silence"
    assert driven.run(1.0, None) == 0.0


@pytest.mark.parametrize("word", ["paused", "behind"])
def test_it_stands_while_it_is_told_to(word: str) -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    setattr(driven.pace, word, True)
    driven.run(0.2, 0.0)
    assert driven.run(0.5, 0.0) == 0.0
    setattr(driven.pace, word, False)
    assert driven.run(0.5, 0.0) > 0.4


def test_a_delay_is_not_made_up_for() -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    driven.now += 5.0
    driven.pace.report(0.0, driven.now)
    before = driven.pace.time_s
    driven.pace.advance(driven.now)
    assert driven.pace.time_s - before == pytest.approx(MAX_CLOCK_STEP_S)


def test_it_is_over_only_when_the_robot_is_there_too() -> None:
    driven = Driven(speed=100.0)
    driven.run(0.5, 0.0)
    driven.pace.report(0.2, driven.now)
    assert driven.pace.time_s == 10.0
    assert not driven.pace.over(driven.now)
    driven.pace.report(0.01, driven.now)
    assert driven.pace.over(driven.now)
