"""The command line: ``foldback``."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Final

import typer

COMMANDS: Final = (
    "serve",
    "worker",
    "fold",
    "refold",
    "settings",
    "smooth",
    "shape",
    "verify",
    "play",
    "export",
    "movie",
    "retime",
    "doctor",
    "admin",
)


def application(commands: Iterable[str] = COMMANDS) -> typer.Typer:
    """The command line with some of its commands, each in a module of its name."""
    app = typer.Typer(no_args_is_help=True, pretty_exceptions_show_locals=False)

    @app.callback()
    def foldback(
        version: Annotated[
            bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell it.")
        ] = False,
    ) -> None:
        """Plans how a straight chain of modules folds into a solid."""

    del foldback
    for name in commands:
        command = getattr(import_module(f"server.commands.{name}"), name)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)
    return app


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"foldback {version('foldback')}")
        raise typer.Exit


def main() -> None:
    """The entry point. Only the command that is asked for is imported: others may be heavy."""
    # Read when NumPy is imported. Threads of linear algebra bring nothing at these sizes.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    asked = sys.argv[1:2]
    application(asked if asked and asked[0] in COMMANDS else COMMANDS)(prog_name="foldback")


if __name__ == "__main__":
    main()
