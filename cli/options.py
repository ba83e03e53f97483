"""Options that several commands have, each with one name and one help text."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from planner.errors import InputError
from planner.parameters.settings import IDEAL

ROBOT_KINDS: Final = {"typical": (), "ideal": (IDEAL,)}
"""Values of the option ``--robot``, with the planner settings that each one adds: ``typical`` keeps
the default number of simulated robots with errors, ``ideal`` tests the plan on none of them."""
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object as the last line.")]
FoldDirectory = Annotated[
    Path, typer.Argument(metavar="DIR", help=("Folder written by `foldback fold`."))
]
PlanDirectory = Annotated[
    Path, typer.Option("--out", help="Directory for the plan; created if missing.")
]
Preset = Annotated[
    str,
    typer.Option(
        help="default, paper (as published), or direct (direct servoing; fails for most shapes)."
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A setting, e.g. mass_error=0.05, damping=0.05 (paper) or table_friction=0.1 (table); "
        "repeatable. `foldback settings` lists them.",
    ),
]
Robot = Annotated[
    str,
    typer.Option(
        help="Simulated robots: typical (three imperfect robots; the worst one is reported) or "
        "ideal (one perfect robot)."
    ),
]
Seed = Annotated[str, typer.Option(metavar="INTEGER", help="Random seed.")]
ModuleSize = Annotated[
    str | None,
    typer.Option(
        metavar="FLOAT", help="Module size in the clearance check, as a fraction of the pitch."
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Parallel explosions when one stalls. Default: the number of cores."),
]
Prefer = Annotated[
    str,
    typer.Option(
        help="Preferred plan: computing (the first verified one), time (the fastest of several), "
        "torque (the least torque at equal time) or clearance (the most clearance)."
    ),
]
Strategy = Annotated[
    str,
    typer.Option(help="Explosion strategy: auto, simultaneous, blocks, peel or one-by-one."),
]
Module = Annotated[str, typer.Option(help="cube or tetrahedron.")]
Modules = Annotated[
    str | None, typer.Option(metavar="INTEGER", help="Approximate number of modules, for a mesh.")
]
Method = Annotated[str, typer.Option(help="Path method: auto, blocks, exact or snake.")]
Repair = Annotated[
    bool, typer.Option("--repair", help="Add or remove cells if the shape has no path.")
]
Ends = Annotated[
    str, typer.Option(help="Ends of the chain: any, or surface (both on the outside).")
]
Start = Annotated[
    str | None, typer.Option(metavar="X,Y,Z", help="The cell where the chain starts.")
]
World = Annotated[
    str, typer.Option(help="floating (no gravity), or table (on a table, with gravity).")
]
AsVoxels = Annotated[
    bool, typer.Option("--as-voxels", help="Read a list of cells as a shape, not as a path.")
]


def settings_text_of(settings: list[str] | None, robot: str) -> str:
    """Return the settings of ``--set`` and ``--robot`` as one text.

    Raises:
        InputError: ``bad-robot``.
    """
    if robot not in ROBOT_KINDS:
        raise InputError("bad-robot", f"got the robot {robot!r}, expected typical or ideal.")
    return ",".join([*(settings or ()), *ROBOT_KINDS[robot]])
