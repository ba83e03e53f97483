"""Progress of a long computation, told as it goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Final, Literal, get_args

Stage = Literal["read", "explode", "play_back", "certify", "export"]
STAGES: Final[tuple[Stage, ...]] = get_args(Stage)
"""Stages of a fold, in their order. A fold can be stopped after each and go on with the next."""
STAGE_TEXTS: Final = {
    "read": "reading the input",
    "explode": "unfolding",
    "play_back": "folding",
    "certify": "the clearance check",
    "export": "writing the plan",
}
"""Stages of a fold as phrases."""
PROGRESS_PERIOD_S: Final = 0.1
"""Minimum wall time between two progress reports of one run, in s."""


MARGINS_MESSAGE: Final = "verified; computing the margins"
"""Message of the stage ``certify`` once the verdict is certain; pages and the command line show
it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Progress of one stage.

    Attributes:
        stage: One of ``STAGES``.
        fraction: Estimated progress of the stage, 0 to 1.
        steps: Simulation steps so far.
        steps_per_second: Simulation steps a second of wall time, lately.
        simulated_s: Simulated time so far, in seconds.
        message: Short text for people.
        pushes: Consecutive pulses without progress; several mean that the explosion may be stalled.
        plan: Number of the plan that is computed, from 1; 0 where it is not counted.
        plans: About how many plans are computed in all; 0 where that is not known.
        directory: Directory in which the fold is computed, with its timeline; None if it is not
            reported, and in memory. That of ``foldback.fold`` is temporary: after the last stage,
            ``export``, has reported its end, the files move to the fold's directory.
    """

    stage: str
    fraction: float
    steps: int = 0
    steps_per_second: float = 0.0
    simulated_s: float = 0.0
    message: str = ""
    pushes: int = 0
    plan: int = 0
    plans: int = 0
    directory: str | None = None


Report = Callable[[Progress], None]
Cancelled = Callable[[], bool]


def naming(directory: FilePath, report: Report) -> Report:
    """Return a report that also states the fold's directory."""
    return lambda progress: report(replace(progress, directory=str(directory)))


def silent(progress: Progress) -> None:
    """Discard a report."""
    del progress


def never() -> bool:
    """Return False: the computation is not cancelled."""
    return False
