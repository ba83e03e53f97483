"""Options that several commands have, each with one name and one help text."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from planner.errors import InputError
from planner.pipeline.settings import IDEAL

ROBOTS: Final = {"typical": (), "ideal": (IDEAL,)}
"""What each kind of robot is in settings."""
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object as the last line.")]
FoldDirectory = Annotated[Path, typer.Argument(metavar="DIR", help="What `fold` has written.")]
PlanDirectory = Annotated[
    Path, typer.Option("--out", help="Directory for the plan; made if it is not there.")
]
Preset = Annotated[
    str, typer.Option(help="default, paper (as published) or direct (a baseline that fails).")
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Another value, as mass_error=0.05, damping=0.05 for paper, or table_friction=0.1 on "
        "a table; again for more. `foldback settings` lists them.",
    ),
]
Robot = Annotated[
    str,
    typer.Option(
        help="Who folds in simulation: typical (three robots with faults, the worst is shown) or "
        "ideal (one without)."
    ),
]
Seed = Annotated[str, typer.Option(metavar="INTEGER", help="What randomness starts from.")]
ModuleSize = Annotated[
    str | None,
    typer.Option(metavar="FLOAT", help="Size at which to verify, as a fraction of the pitch."),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Explosions at once, when one sticks; as many as there are cores."),
]
Prefer = Annotated[
    str,
    typer.Option(
        help="Which plan: computing (the first that is verified), or of several time (the "
        "quickest), torque (the least in the same time) or clearance (the most room)."
    ),
]
Module = Annotated[str, typer.Option(help="cube or tetrahedron.")]
Modules = Annotated[
    str | None, typer.Option(metavar="INTEGER", help="About how many modules, for a mesh.")
]
Method = Annotated[str, typer.Option(help="Path by: auto, blocks, exact or snake.")]
Repair = Annotated[
    bool, typer.Option("--repair", help="Add or drop cells where there is no path otherwise.")
]
Ends = Annotated[str, typer.Option(help="any, or surface for both ends outside.")]
Start = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="The cell that the chain begins in.")
]
AsVoxels = Annotated[
    bool, typer.Option("--as-voxels", help="Read a list of cells as a shape, not as a path.")
]


def settings_text_of(settings: list[str] | None, robot: str) -> str:
    """What ``--set`` and ``--robot`` ask for, as one text.

    Raises:
        InputError: ``bad-robot``.
    """
    if robot not in ROBOTS:
        raise InputError("bad-robot", f"got the robot {robot!r}, expected typical or ideal.")
    return ",".join([*(settings or ()), *ROBOTS[robot]])
