"""``foldback verify``: check a plan independently, from its files alone."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from foldback import foldback_check
from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import refuse
from foldback.cli.options import SIZE_OF_PLAN_HELP, AsJson
from foldback.planner.certificate.swept_motions import followed
from foldback.planner.clearance.margins import largest_size as find_largest
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from foldback.planner.storage.file_names import PLAN, PLAYBACK
from foldback.planner.verification.verify import Verification
from foldback.planner.verification.verify import verify as verify_files
from foldback.words import certificate as certificate_words
from foldback.words.messages import PEOPLE
from foldback.words.quantities import spacings


class OtherProgram(StrEnum):
    """Third-party program that can check a plan's motion."""

    IPCTK = "ipctk"


def verify(
    directory: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="Folder written by `foldback fold`, or a plan alone: plan.npz."
        ),
    ],
    module_size: Annotated[
        str | None, typer.Option(metavar="FLOAT", help=SIZE_OF_PLAN_HELP)
    ] = None,
    largest_size: Annotated[
        bool,
        typer.Option(
            "--largest-size",
            help="Also find the largest module size without collisions.",
        ),
    ] = False,
    program: Annotated[
        OtherProgram | None,
        typer.Option(
            "--with",
            help="Also use another program, ipctk "
            r"(pip install 'foldback\[ipctk]'), "
            "to check the motion from frame to frame for collisions.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Recheck a plan's files and figures; replay the plan in the simulator MuJoCo."""
    if directory.is_file():
        if largest_size or program:
            error = InputError(
                "no-directory",
                "got a file, expected the whole folder of a fold for --largest-size and --with.",
                where=str(directory),
            )
            refuse(error, as_json)
        _verify_plan(directory, module_size, as_json=as_json)
        return
    with_ipctk = program is OtherProgram.IPCTK
    result = _verification(directory, module_size, third_opinion=with_ipctk, as_json=as_json)
    largest = _largest(directory, result) if largest_size and result.verified else None
    if as_json:
        sized = {"largest_size": largest and largest[0]} if largest_size else {}
        print(json.dumps({**result.as_dict(), **sized}), flush=True)
    else:
        _show(result, largest)
    if not result.verified:
        raise typer.Exit(NOT_ACHIEVED)


def _verify_plan(path: Path, module_size: str | None, *, as_json: bool) -> None:
    """Prove from a plan's file alone that its motion is clear; end the command if it is not."""
    try:
        request = FoldRequest.of(module_size=module_size)
        request.check()
        result = foldback_check.check(str(path), request.module_size)
    except InputError as error:
        refuse(error, as_json)
    except ValueError as error:
        refuse(
            InputError("bad-plan", f"{error}; expected plan.npz of a fold.", where=str(path)),
            as_json,
        )
    foldback_check.show(result, as_json)
    if str(result["verdict"]).startswith("not "):
        raise typer.Exit(NOT_ACHIEVED)


def _verification(
    directory: Path, module_size: str | None, *, third_opinion: bool, as_json: bool
) -> Verification:
    """Return the verification of a directory; end the command if it is not possible."""
    try:
        request = FoldRequest.of(module_size=module_size)
        request.check()
        if not directory.is_dir():
            raise InputError(
                "no-directory",
                "Folder not found; expected a folder that `foldback fold` wrote, or plan.npz.",
                where=str(directory),
            )
        return verify_files(directory, module_size=request.module_size, third_opinion=third_opinion)
    except InputError as error:
        refuse(error, as_json)
    except TimelineError as error:
        refuse(InputError("no-timeline", str(error)), as_json)


def _show(result: Verification, largest: tuple[float, str] | None) -> None:
    """Print a verification, and the largest module size with the motions that it holds for."""
    console = Console(soft_wrap=True, highlight=False)
    headline = certificate_words.headline(result.certificate.as_dict())
    if result.robots_repeated is False:
        headline += "; the figures of the simulated robots are reported only"
    if not result.problems or not result.certificate.verified:
        console.print(headline, markup=False)
    for line in result.problems:
        console.print(line, markup=False)
    if result.reason is not None:
        holds = "confirmed" if result.reason.confirmed else "refuted"
        reason = result.reason.diagnosis.text(PEOPLE)
        console.print(f"The reason why unfolding stalled is {holds}: {reason}.", markup=False)
    if result.replay is not None:
        depth = result.replay.overlap
        overlap = f"modules overlap by up to {spacings(depth, 2)}" if depth else "no overlap"
        console.print(
            f"replay of {result.replay.frames} frames in MuJoCo: module positions differ from the "
            f"plan's by at most {spacings(result.replay.pose_difference, 1)}; {overlap}"
        )
    for line in result.checked:
        console.print(f"checked: {line}", markup=False)
    for line in result.notes:
        console.print(f"note: {line}", markup=False)
    if largest is not None:
        size, exponent_text = largest
        console.print(
            f"{exponent_text} free of collisions up to a module size of {size:.3f} × the pitch "
            "(distance "
            "between neighbouring modules)"
        )


def _largest(directory: Path, result: Verification) -> tuple[float, str]:
    """Return the largest module size at which motions are free of collisions, and those motions."""
    plan = Plan.load(directory / PLAN)
    motions = (plan.motion,)
    if (path := directory / PLAYBACK).exists():
        motions = followed(Playback.load(path))
    size = find_largest(plan.chain, motions, clear_at=result.certificate.module_size)
    return size, "plan is" if len(motions) < 2 else "plan and simulated folding motion are"
