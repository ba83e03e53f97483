"""Options shared by several commands, each with one name and one help text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from foldback.cli.inputs import refuse
from foldback.planner.errors import InputError
from foldback.planner.parameters.option import Option, options_of
from foldback.planner.parameters.settings_text import IDEAL
from foldback.planner.pathfinding.path_options import MODULE_CHOICES, PathOptions
from foldback.planner.pipeline.request import FoldRequest

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
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A setting, such as mass_error=0.05; repeatable. Some settings need an option: "
        "damping=0.05 needs --preset paper, table_friction=0.1 needs --world table. "
        "`foldback settings` lists all settings.",
    ),
]
Robot = Annotated[
    str,
    typer.Option(
        help="Simulated robots: typical (three imperfect robots; the worst one is reported) or "
        "ideal (one perfect robot)."
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Number of explosions (unfolding simulations) to run in parallel after the first one "
        "has stalled. Default: number of cores.",
    ),
]
OWN_MODULE: Final = "own_module"
"""Parameter of a command that also takes a module file, or another module of foldback's, as the
value of ``--module``."""
PATH_OPTIONS: Final = (*options_of(PathOptions), "seed")
"""Names of the options that turn a shape into a path."""
METAVARS: Final = {int: "INTEGER", float: "FLOAT"}
"""Placeholders for option values in help texts, by type; texts have none."""


SIZE_OF_PLAN_HELP: Final = (
    f"{options_of(FoldRequest)['module_size'].title}. Default: the plan's module size."
)
"""Help of the module size of commands that take a plan."""


def takes(
    *names: str,
    schema: type[FoldRequest] = FoldRequest,
    lines: Mapping[str, str] | None = None,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that reads the parameter ``request`` of a command from its options.

    The command gets a checked request; one that is refused ends it with 2. A command with the
    parameter ``own_module`` gets there what ``--module`` says, if it is none of the choices.

    Args:
        names: Options, in the order of the help; all if there are none.
        schema: Class of the request.
        lines: Help of options that mean something else here, by their names.
    """
    options = options_of(schema)
    names, lines = names or tuple(options), lines or {}

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        own_signature = signature(command, eval_str=True)
        own_parameters = {**own_signature.parameters}
        takes_module = own_parameters.pop(OWN_MODULE, None) is not None
        parameters = list(own_parameters.values())
        place = list(own_parameters).index("request")
        parameters[place : place + 1] = [
            parameter
            for name in names
            for parameter in _parameters(options[name], lines.get(name, options[name].line))
        ]

        @wraps(command)
        def call(*, as_json: bool, **arguments: Any) -> None:
            try:
                if "settings" in names:
                    arguments["settings"] = settings_text_of(
                        arguments["settings"], arguments.pop("robot")
                    )
                values = {name: arguments.pop(name) for name in names}
                if takes_module:
                    arguments[OWN_MODULE] = None
                    if values["module"] not in MODULE_CHOICES:
                        arguments[OWN_MODULE] = values.pop("module")
                request = schema.of(**values)
                request.check()
            except InputError as error:
                refuse(error, as_json)
            command(request=request, as_json=as_json, **arguments)

        return with_parameters(call, parameters)

    return with_options


def with_parameters(
    command: Callable[..., None], parameters: Sequence[Parameter]
) -> Callable[..., None]:
    """Give a command the parameters that typer reads its options from; return the command."""
    vars(command)["__signature__"] = Signature(parameters)
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command


def _parameters(option: Option, line: str) -> Iterator[Parameter]:
    """Yield the parameters of a command that make one option; the settings are two."""
    if option.name == "settings":
        yield Parameter("settings", Parameter.KEYWORD_ONLY, default=None, annotation=Settings)
        yield Parameter("robot", Parameter.KEYWORD_ONLY, default="typical", annotation=Robot)
        return
    flag = f"--{option.name.replace('_', '-')}"
    if option.kind is bool:
        kind, default = bool, option.default
    else:  # the planner parses the text and reports errors in it
        kind = str | None if option.optional else str
        default = None if option.default is None else str(option.default)
    metavar = option.metavar or METAVARS.get(option.kind)
    about = typer.Option(flag, metavar=metavar, help=line)
    yield Parameter(
        option.name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, about]
    )


def settings_text_of(settings: list[str] | None, robot: str) -> str:
    """Return the settings of ``--set`` and ``--robot`` as one text.

    Raises:
        InputError: If the robot is unknown; its code is ``bad-robot``.
    """
    if robot not in ROBOT_KINDS:
        raise InputError("bad-robot", f"got the robot {robot!r}, expected typical or ideal.")
    return ",".join([*(settings or ()), *ROBOT_KINDS[robot]])
