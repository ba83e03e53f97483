"""``foldback smooth``: make a verified plan shorter and smoother, without a service."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import SIZE_OF_PLAN_HELP, AsJson, FoldDirectory, PlanDirectory, takes
from foldback.cli.progress_bars import compute
from foldback.cli.summary import finish
from foldback.planner.errors import InputError
from foldback.planner.pipeline.fold_layout import replacing_fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.progress import STAGES
from foldback.words.smoothing import smoothing_gain, smoothing_note, smoothing_rows


@takes(
    "seed",
    "module_size",
    lines={"module_size": SIZE_OF_PLAN_HELP},
)
def smooth(
    *,
    fold: FoldDirectory,
    out: PlanDirectory,
    request: FoldRequest,
    as_json: AsJson = False,
) -> None:
    """Make a motion shorter and smoother, and verify it again; exits like `fold`."""
    try:
        plan = read_plan(fold)
        if out.exists() and out.samefile(fold):
            raise InputError(
                "smooth-in-place",
                f"got {out} for the smoothed plan, expected another directory; this directory "
                "holds the original plan.",
            )
        request = FoldRequest.smoothing(plan, seed=request.seed, module_size=request.module_size)
        with replacing_fold(out) as place:
            Workspace(place).write_request(request, write_chain(plan.chain), recorded=plan)
            run_stage(STAGES[0], place)
            summary = compute(place, 1, explode="Smoothing")
    except InputError as error:
        refuse(error, as_json)
    finish(summary, out, as_json, show_details=compare)


def compare(summary: dict[str, Any]) -> None:
    """Print how smoothing has changed the plan."""
    smoothing = summary["smoothing"]
    table = Table("", box=None, pad_edge=False)
    for heading in ("Before", "After", "Ratio"):
        table.add_column(heading, justify="right")
    for row in smoothing_rows(smoothing):
        table.add_row(row["label"], row["before"], row["after"], row["ratio"])
    Console().print()
    Console().print(table)
    for text in (smoothing_gain(smoothing), smoothing_note(smoothing)):
        if text is not None:
            Console(highlight=False).print(text, markup=False, soft_wrap=True)
