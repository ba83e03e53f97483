"""Simulation work: which playbacks are simulated, by the time that this is expected to take.

Time is estimated from counts, and depends on no clock: the same fold is simulated on any machine.
"""

from __future__ import annotations

from typing import Final

from foldback.planner.parameters.playback import PlaybackParameters

ALWAYS_SIMULATED_MODULES: Final = 500
"""Number of modules up to which every playback is simulated."""
MAX_ESTIMATED_MODULES: Final = 2000
"""Number of modules above which no playback is simulated unless a setting asks for it: the errors
of robots add up along the chain."""
MAX_SIMULATION_S: Final = 8.0
"""Maximum expected processor time, s, that the robots of a playback of more than
``ALWAYS_SIMULATED_MODULES`` modules add to a fold: docs/decisions/0061-simulated-by-default.md."""
SQUARE_FRAME_S: Final = 4.7e-9
"""Processor time, s, that one robot adds to a fold for each frame of the record, divided by the
square of the number of modules, all of which are simulated. As all seconds here, it is that of a
processor which makes 1000 steps of a MuJoCo tree of 160 cubes in 0.26 s. Measured:
docs/decisions/0061-simulated-by-default.md."""
WINDOW_FRAME_S: Final = 0.6e-3
"""Processor time, s, that one robot adds for each frame of a peeling, of which a window is
simulated. Measured, too."""


def simulation_seconds(modules: int, frames: int, robots: int, *, is_windowed: bool) -> float:
    """Return the processor time, s, that the robots of a playback are expected to add to a fold.

    Args:
        modules: Number of modules.
        frames: Number of frames of the record that is played back.
        robots: Number of robots; 0 for one ideal robot.
        is_windowed: True if a window of the chain moves at a time.
    """
    frame_s = WINDOW_FRAME_S if is_windowed else SQUARE_FRAME_S * modules**2
    return max(1, robots) * frames * frame_s


def is_simulated(
    modules: int, frames: int, limit: int | None, robots: int, *, is_windowed: bool
) -> bool:
    """Return True if a playback of so many modules and frames is simulated.

    Args:
        modules, frames, robots, is_windowed: As for ``simulation_seconds``.
        limit: Longest chain that is simulated, in modules; None if the expected time decides.
    """
    if limit is not None:
        return modules <= limit
    if modules <= ALWAYS_SIMULATED_MODULES:
        return True
    seconds = simulation_seconds(modules, frames, robots, is_windowed=is_windowed)
    return modules <= MAX_ESTIMATED_MODULES and seconds <= MAX_SIMULATION_S


def simulates(
    modules: int, frames: int, parameters: PlaybackParameters, *, is_windowed: bool
) -> bool:
    """Return True if a playback with such parameters is simulated; of windows, robots only are."""
    able = not is_windowed or parameters.controller == "robot"
    limit, robots = parameters.simulated_modules, parameters.robot.robots
    return able and is_simulated(modules, frames, limit, robots, is_windowed=is_windowed)
