"""Which playbacks are simulated: a matter of counts, not of a clock."""

import pytest

from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.playback import simulation_work
from foldback.planner.playback.playback import play_back
from foldback.planner.playback.simulation_work import simulates
from tests.case import case
from tests.planner.conftest import Folded

ROBOTS_20 = PlaybackParameters(robot=RobotParameters(robots=20))
LIMIT_600 = PlaybackParameters(simulated_modules=600)


def test_expected_time_decides_which_long_chains_are_simulated() -> None:
    for modules, frames, windowed, parameters, expected in (
        (500, 10**6, False, PlaybackParameters(), True),
        (1000, 453, False, PlaybackParameters(), True),  # a box in layers
        (1000, 453, False, ROBOTS_20, False),
        (2000, 855, False, PlaybackParameters(), False),  # another one
        (2000, 4300, True, PlaybackParameters(), True),  # a box, peeled
        (2001, 4300, True, PlaybackParameters(), False),
        (1152, 5000, False, PlaybackParameters(), False),  # a path found by search
        (1008, 2700, True, PlaybackParameters(), True),  # a ball, peeled
        (2000, 6000, True, PlaybackParameters(), False),
        (600, 10**6, False, LIMIT_600, True),
        (601, 1, False, LIMIT_600, False),
        (24, 100, True, PlaybackParameters(controller="computed-torque"), False),
    ):
        with case((modules, frames, windowed)):
            assert simulates(modules, frames, parameters, is_windowed=windowed) == expected


def test_playback_follows_the_expected_time(
    folded: Folded, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation_work, "ALWAYS_SIMULATED_MODULES", 1)
    parameters = PlaybackParameters(robot=RobotParameters(robots=1))
    assert play_back(folded.chain, folded.record, parameters).kind == "dynamic"
    monkeypatch.setattr(simulation_work, "MAX_SIMULATION_S", 0.0)
    assert play_back(folded.chain, folded.record, parameters).kind == "kinematic"
