"""Progress bars in the terminal, one for each stage of a fold."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from foldback.planner.cpu_cores import cores
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.progress import MARGINS_MESSAGE, STAGES, Report
from foldback.planner.progress import Progress as StageProgress

STAGE_VERBS = {
    "explode": "Unfolding",
    "play_back": "Folding",
    "certify": "Checking",
    "export": "Writing",
}


def compute(out: Path, workers: int | None, **words: str) -> dict[str, Any]:
    """Run the stages after reading, with a bar for each; return the plan's figures.

    Args:
        out: The fold's directory.
        workers: Maximum number of concurrent explosions; the number of cores if None.
        words: Labels of stages that differ from the default ones.
    """
    with Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
    ) as bars:

        @contextmanager
        def bar_of(stage: str) -> Generator[Report]:
            bar = bars.add_task({**STAGE_VERBS, **words}[stage], total=1.0, note="")

            def report(progress: StageProgress) -> None:
                bars.update(bar, completed=progress.fraction)
                if progress.steps:
                    bars.update(bar, note=_steps(progress))
                elif stage == "certify":
                    is_verified = progress.message == MARGINS_MESSAGE
                    bars.update(bar, note=progress.message if is_verified else "")

            yield report

        return run_stages(out, first=STAGES[1], workers=workers or cores(), around=bar_of)


def _steps(progress: StageProgress) -> str:
    """Return the progress of a simulation: ``48200 steps · 482 s simulated``."""
    simulated = f" · {progress.simulated_s:.0f} s simulated" if progress.simulated_s else ""
    return f"{progress.steps} steps{simulated}"
