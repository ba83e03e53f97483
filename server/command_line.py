"""The command line: ``foldback``."""

from __future__ import annotations

import typer

from server.commands.fold import fold
from server.commands.play import play
from server.commands.serve import serve
from server.commands.verify import verify
from server.commands.worker import worker

app = typer.Typer(
    name="foldback",
    help="Plans how a straight chain of modules folds into a solid.",
    no_args_is_help=True,
    pretty_exceptions_show_locals=False,
)
app.command()(serve)
app.command()(worker)
app.command()(fold)
app.command()(verify)
app.command()(play)


def main() -> None:
    """The entry point."""
    app()


if __name__ == "__main__":
    main()
