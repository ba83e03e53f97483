import pytest

from foldback.server.target_streams.stream_clock import MAX_CLOCK_STEP_S, StreamClock

TICK = 0.01


class Driven:
    """Stream clock with a wall clock that tests advance."""

    def __init__(self, *, speed: float = 1.0, ramp_s: float = 0.1) -> None:
        self.now = 100.0
        self.clock = StreamClock(
            10.0, speed=speed, ramp_s=ramp_s, threshold_rad=0.05, silence_s=1.0, now=self.now
        )

    def run(self, seconds: float, error: float | None) -> float:
        """Return the time that the clock reaches with a report at every tick."""
        before = self.clock.time_s
        for _ in range(round(seconds / TICK)):
            if error is not None:
                self.clock.report(error, self.now)
            self.now += TICK
            self.clock.advance(self.now)
        return self.clock.time_s - before


def test_clock_reaches_its_speed_after_a_ramp() -> None:
    for speed in (0.5, 20.0):
        driven = Driven(speed=speed)
        driven.run(0.1, 0.0)
        assert driven.clock.rate == pytest.approx(speed)
        assert driven.run(0.2, 0.0) == pytest.approx(0.2 * speed)


def test_clock_stands_while_the_error_is_above_the_threshold() -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    # It slows down within its ramp, for half of the distance at full speed.
    assert driven.run(1.0, 0.06) == pytest.approx(0.05, abs=0.01)
    assert driven.clock.rate == 0.0
    assert driven.clock.waiting(driven.now) == "error"
    assert driven.run(0.5, 0.04) == pytest.approx(0.45, abs=0.01)


def test_clock_stops_without_reports() -> None:
    driven = Driven()
    assert driven.run(0.5, None) == 0.0
    assert driven.clock.waiting(driven.now) == "start"
    driven.run(0.5, 0.0)
    driven.run(1.2, None)
    assert driven.clock.waiting(driven.now) == "silence"
    assert driven.run(1.0, None) == 0.0


@pytest.mark.parametrize("word", ["paused", "behind"])
def test_clock_stands_while_paused_or_behind(word: str) -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    setattr(driven.clock, word, True)
    driven.run(0.2, 0.0)
    assert driven.run(0.5, 0.0) == 0.0
    setattr(driven.clock, word, False)
    assert driven.run(0.5, 0.0) > 0.4


def test_clock_does_not_catch_up_after_a_delay() -> None:
    driven = Driven()
    driven.run(0.5, 0.0)
    driven.now += 5.0
    driven.clock.report(0.0, driven.now)
    before = driven.clock.time_s
    driven.clock.advance(driven.now)
    assert driven.clock.time_s - before == pytest.approx(MAX_CLOCK_STEP_S)


def test_clock_is_over_when_the_client_has_arrived() -> None:
    driven = Driven(speed=100.0)
    driven.run(0.5, 0.0)
    driven.clock.report(0.2, driven.now)
    assert driven.clock.time_s == 10.0
    assert not driven.clock.over(driven.now)
    driven.clock.report(0.01, driven.now)
    assert driven.clock.over(driven.now)
