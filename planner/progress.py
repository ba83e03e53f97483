"""Progress of a long computation, told as it goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

COMPILING: Final = "compiling"
"""The message while kernels are compiled, which happens once on a machine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far a stage has come.

    Attributes:
        stage: One of ``planner.pipeline.stages.STAGES``.
        fraction: 0 to 1, an honest guess.
        steps: Simulation steps so far.
        steps_per_second: Simulation steps a second of wall time, lately.
        simulated_s: Simulated time so far, in seconds.
        message: A few plain words.
        pushes: How many pushes in a row moved nothing on; from a few on it may well be stuck.
    """

    stage: str
    fraction: float
    steps: int = 0
    steps_per_second: float = 0.0
    simulated_s: float = 0.0
    message: str = ""
    pushes: int = 0


Report = Callable[[Progress], None]
Cancelled = Callable[[], bool]


def silent(progress: Progress) -> None:
    """Reports to nobody."""
    del progress


def never() -> bool:
    """Nobody cancels."""
    return False
