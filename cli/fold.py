"""``foldback fold``: compute a verified plan from a file, without a service."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Annotated, Final

import typer

from foldback.cli.inputs import read_input, refuse
from foldback.cli.options import AsJson, PlanDirectory, Workers, takes
from foldback.cli.progress_bars import compute
from foldback.cli.summary import finish, show_choice
from foldback.cli.typed_codes import Snake, SnakeCube, TypedWord
from foldback.planner.errors import InputError
from foldback.planner.parameters.option import options_of
from foldback.planner.pathfinding.path_options import table_warning
from foldback.planner.pipeline.fold_layout import replacing_fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.progress import STAGES
from foldback.words.plan_choice import choice_of

MODULE_LINE: Final = (
    f"{options_of(FoldRequest)['module'].line} Or a module file, for an INPUT with joint angles or "
    "--angles."
)


@takes(lines={"module": MODULE_LINE})
def fold(
    *,
    out: PlanDirectory,
    shape: Annotated[
        str | None,
        typer.Argument(
            metavar="INPUT",
            help="File with a mesh, a picture, voxels, a path or a chain; name of an example; or a "
            "word, as word:Anna.",
        ),
    ] = None,
    angles: Annotated[
        str | None,
        typer.Option(
            help="Instead of INPUT, a chain of tetrahedra: one sign per hinge, such as "
            "'0 - - + 0'. 0 is straight; + and - are quarter turns in opposite directions. With a "
            "module file: angles in degrees, such as '0 90 -45'."
        ),
    ] = None,
    snake: Snake = None,
    snake_cube: SnakeCube = None,
    word: TypedWord = None,
    request: FoldRequest,
    own_module: str | None = None,
    workers: Workers = None,
    as_json: AsJson = False,
) -> None:
    """Plan how a chain folds into a shape, and verify the plan.

    Exits with 0 if the plan is verified, with 3 if it is not, and with 2 if the input is bad.
    """
    try:
        data, filename = read_input(
            shape, angles, own_module, snake=snake, snake_cube=snake_cube, word=word
        )
        with replacing_fold(out) as place:
            Workspace(place).write_request(replace(request, filename=filename), data)
            read = run_stage(STAGES[0], place)
            if warning := table_warning(read["modules"], request.world):
                print(warning, file=sys.stderr)
            summary = compute(place, workers)
            choice = choice_of(place, request.prefer)
    except InputError as error:
        refuse(error, as_json)
    finish(summary, out, as_json, lambda _: show_choice(choice))
