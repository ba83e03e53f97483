"""``foldback verify``: check a plan independently, from its files alone."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from cli.inputs import refuse
from cli.options import AsJson, FoldDirectory
from planner.certificate.certificate import followed
from planner.clearance.margins import largest_size as find_largest
from planner.errors import InputError, TimelineError
from planner.file_names import PLAN, PLAYBACK
from planner.pipeline.request import FoldRequest
from planner.plan.plan import Plan
from planner.playback.playback import Playback
from planner.verification.verify import Verification
from planner.verification.verify import verify as verify_files
from words import certificate as certificate_words


class OtherProgram(StrEnum):
    """Program of other people that can look at a plan's motion."""

    IPCTK = "ipctk"


def verify(
    directory: FoldDirectory,
    module_size: Annotated[
        str | None, typer.Option(metavar="FLOAT", help="Module size. Default: the plan's.")
    ] = None,
    largest_size: Annotated[
        bool,
        typer.Option(
            "--largest-size",
            help="Also find the largest module size without collisions.",
        ),
    ] = False,
    other: Annotated[
        OtherProgram | None,
        typer.Option(
            "--with",
            help="Also let another program look for contacts between frames: ipctk "
            r"(pip install 'foldback\[ipctk]').",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check a plan again: its files, its figures, and a replay in plain MuJoCo."""
    try:
        request = FoldRequest.of(module_size=module_size)
        request.check()
        if not directory.is_dir():
            what = "This is not a folder" if directory.exists() else "Folder not found"
            raise InputError(
                "no-directory",
                f"{what}; expected a folder that `foldback fold` wrote.",
                where=str(directory),
            )
        found = verify_files(
            directory,
            module_size=request.module_size,
            third_opinion=other is OtherProgram.IPCTK,
        )
    except InputError as error:
        refuse(error, as_json)
    except TimelineError as error:
        refuse(InputError("no-timeline", str(error)), as_json)
    largest = _largest(directory, found) if largest_size and found.verified else None
    if as_json:
        sized = {"largest_size": largest and largest[0]} if largest_size else {}
        print(json.dumps({**found.as_dict(), **sized}), flush=True)
    else:
        console = Console(soft_wrap=True, highlight=False)
        told = certificate_words.headline(found.certificate.as_dict())
        for line in found.problems or (told,):
            console.print(line, markup=False)
        if found.reason is not None:
            holds = "confirmed" if found.reason.confirmed else "refuted"
            console.print(f"Reason {holds}: {found.reason.words}.", markup=False)
        if found.replay is not None:
            console.print(
                f"plain MuJoCo, {found.replay.frames} configurations: poses agree to "
                f"{found.replay.pose_difference:.1g} pitch, deepest overlap "
                f"{found.replay.overlap:.2g} pitch"
            )
        for line in found.checked:
            console.print(f"checked: {line}", markup=False)
        for line in found.notes:
            console.print(f"note: {line}", markup=False)
        if largest is not None:
            size, what = largest
            console.print(f"{what} free of collisions up to a module size of {size:.3f} pitch")
    if not found.verified:
        raise typer.Exit(3)


def _largest(directory: Path, found: Verification) -> tuple[float, str]:
    """Return the largest module size at which motions are free of collisions, and those motions."""
    plan = Plan.load(directory / PLAN)
    motions = (plan.motion,)
    if (path := directory / PLAYBACK).exists():
        motions = followed(Playback.load(path))
    size = find_largest(plan.chain, motions, clear_at=found.certificate.module_size)
    return size, "plan is" if len(motions) < 2 else "plan and playback are"
