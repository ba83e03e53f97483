"""Command line of ``foldback``."""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Final, NoReturn

import typer
from typer.core import TyperGroup
from typer.main import get_command

from foldback.server.cli.interrupts import INTERRUPTED, Interrupts

if TYPE_CHECKING:
    from typer._click import Command, Context

    from foldback.planner.errors import InputError

COMMANDS: Final = {
    "serve": "Start the service. Environment variables such as FOLDBACK_PORT configure it.",
    "worker": "Compute folds for a service, using the service's data directory or database.",
    "fold": "Plan how a chain folds into a shape, and verify the plan.",
    "refold": "Unfold a folded chain and fold it into another shape.",
    "sweep": "Fold many shapes in many ways, on this machine or a cluster, into one table.",
    "settings": "List the settings for `fold --set NAME=VALUE`.",
    "smooth": "Make a motion shorter and smoother, and verify it again.",
    "shape": "Find a path through a shape.",
    "module": "Check a module for faults, or read a module out of a URDF file.",
    "solve": "Solve a snake cube, or find pieces that fill a solid.",
    "verdict": "Say whether turns of joints lead to a figure, with a proof.",
    "verify": "Recheck a plan's files and figures; replay the plan in the simulator MuJoCo.",
    "play": "Show a fold in the browser.",
    "export": "Export a finished fold as URDF, MCAP, an animated scene and more.",
    "movie": "Make a movie of a fold: the straight chain folds into its shape.",
    "site": "Create a static website: folds, the published paper's experiments, benchmarks.",
    "tour": "Draft a tour of a fold: captions for its most important frames.",
    "retime": "Add time stamps to a plan so that it keeps to a robot's limits.",
    "servos": "List servos that are strong enough for a torque.",
    "table": "Check whether a plan works on a table, and compute the joint torques.",
    "doctor": "Check that this machine meets the requirements of the service.",
    "admin": "Manage the folds, backups and database of a service.",
}
"""Commands of ``foldback`` with the first line of their help; the list of commands is printed
without importing their modules."""

SERVICE_PACKAGES: Final[dict[str, str]] = dict.fromkeys(
    ("serve", "worker", "sweep", "play", "movie", "site", "doctor", "admin"), "foldback.server.cli"
)
"""Packages of the commands that need the web service's code or processes; each command is a module
of its package. All other commands are modules of ``cli``, which imports nothing of the service."""

OPENGL_COMMANDS: Final = frozenset(("serve", "worker", "movie", "doctor"))
"""Commands that draw or start processes that draw. For all others MuJoCo's OpenGL is not loaded,
which makes their start faster."""

GC_THRESHOLD_OBJECTS: Final = 100_000
"""Number of newly allocated objects after which Python's garbage collector runs (threshold 0 of
``gc.set_threshold``). With Python's default the imports take 0.2 s longer."""

FULL_DISK_ERRORS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Error numbers (errno) of a full disk, a used-up quota, and a file above the permitted size."""

MEMORY_ERRORS: Final = (
    "Could not allocate memory",  # MuJoCo
    "can't start new thread",  # Python
    "failed to map segment from shared object",  # the loader of libraries
)
"""Texts in errors that are no MemoryError when memory is used up."""


INTERRUPTS: Final = Interrupts()


class LazyCommands(TyperGroup):
    """Commands that are imported when called, because most import a simulator or a web server."""

    def resolve_command(
        self, ctx: Context, args: list[str]
    ) -> tuple[str | None, Command | None, list[str]]:
        """Import the command that is called and return it with its arguments."""
        name, command, remaining_args = super().resolve_command(ctx, args)
        return name, command if name is None else imported(name), remaining_args

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command line; report an error of the operating system in one sentence."""
        try:
            return super().main(*args, **kwargs)
        except OSError as error:
            _refuse(_system_error(error))
        except Exception as error:
            if INTERRUPTS.came:
                sys.exit(INTERRUPTED)
            if not is_memory_error(error):
                raise
            _refuse(_memory_error())


def application() -> typer.Typer:
    """Return the command line."""
    app = typer.Typer(cls=LazyCommands, no_args_is_help=True, pretty_exceptions_show_locals=False)

    @app.callback()
    def foldback(
        version: Annotated[
            bool,
            typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
        ] = False,
        resident: Annotated[
            bool | None,
            typer.Option(
                "--resident/--no-resident",
                help="Run in a process that has imported the planner already, which ends after "
                "ten idle minutes. By default, that is so in a terminal, on Linux.",
            ),
        ] = None,
    ) -> None:
        """Plan how a straight chain of modules folds into a solid."""
        del resident  # read by resident_client.py, before anything is imported

    del foldback
    for name, help_text in COMMANDS.items():
        app.command(name, help=help_text)(_not_imported)
    return app


def _not_imported() -> None:
    """Stand in for a command in the list of commands."""


def imported(name: str) -> Command:
    """Return the command with a name, from the module of the same name."""
    package = SERVICE_PACKAGES.get(name, "foldback.cli")
    try:
        command: typer.Typer | Callable[..., None] = getattr(
            import_module(f"{package}.{name}"), name
        )
    except ModuleNotFoundError as error:
        if name not in SERVICE_PACKAGES or (error.name or "").startswith("foldback"):
            raise
        _refuse(_service_error(name))
    if isinstance(command, typer.Typer):
        return get_command(command)
    alone = typer.Typer(add_completion=False)
    alone.command(name)(command)
    return get_command(alone)


def _version(is_asked: bool) -> None:
    if is_asked:
        from importlib.metadata import version  # this import would double the time of `--help`

        typer.echo(f"foldback {version('foldback')}")
        raise typer.Exit


def main() -> None:
    """Run the command line."""
    INTERRUPTS.handle()
    _make_streams_safe()
    # NumPy reads these on import. Threads do not speed up linear algebra at these sizes.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    brief = not set(sys.argv[1:2]) & OPENGL_COMMANDS
    if brief:
        os.environ.setdefault("MUJOCO_GL", "off")
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search takes time
    # Imported objects stay in memory, so traversing them for garbage would waste 0.2 s.
    gc.set_threshold(GC_THRESHOLD_OBJECTS, *gc.get_threshold()[1:])
    try:
        application()(prog_name="foldback")
    except SystemExit as end:
        INTERRUPTS.end()
        if brief and (end.code is None or isinstance(end.code, int)):
            _leave(end.code or 0)
        raise


def _make_streams_safe() -> None:
    """Let output never fail: closed streams discard it, and unknown letters become ``?``."""
    # Otherwise the next file that is opened would get the number of a closed stream.
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _system_error(error: OSError) -> InputError:
    """Return an error of the operating system in one sentence.

    Raises:
        OSError: The error itself, if it concerns no file and thus is a fault of the program.
    """
    from foldback.planner.errors import InputError

    full = error.errno in FULL_DISK_ERRORS
    # Of a file that is copied, the second name is that of the copy, which a full disk concerns.
    path = error.filename2 or error.filename
    if not full and path is None:
        raise error
    reason = error.strerror or str(error)
    remedy = (
        "free some space, or name a directory on another disk"
        if full
        else "check the path and its permissions"
    )
    return InputError(
        "disk-full" if full else "no-file",
        f"a file cannot be read or written ({reason}); {remedy}.",
        where=None if path is None else os.fsdecode(path),
    )


def _service_error(name: str) -> InputError:
    """Return the error of a command of the service where only the planner is installed."""
    from foldback.planner.errors import InputError

    return InputError(
        "no-service", f"foldback {name} needs the service: pip install 'foldback[service]'"
    )


def is_memory_error(error: Exception) -> bool:
    """Return whether an error says that memory is used up."""
    return isinstance(error, MemoryError) or any(text in str(error) for text in MEMORY_ERRORS)


def _memory_error() -> InputError:
    from foldback.planner.errors import InputError

    return InputError(
        "memory-full",
        "this machine has too little free memory, or a limit (ulimit -v) permits too little. "
        "Close other programs, or raise the limit.",
    )


def _refuse(error: InputError) -> NoReturn:
    """Print an error, on standard error if standard output cannot be written, and exit with 2."""
    from foldback.cli.inputs import refuse

    try:
        try:
            refuse(error, as_json="--json" in sys.argv)
        except OSError:
            refuse(error, as_json=False)
    except typer.Exit as end:
        sys.exit(end.exit_code)


def _leave(code: int) -> None:
    """Exit the process at once, unless other threads run.

    Otherwise Python would first deallocate all imported modules, which takes 0.2 s.
    """
    if any(not thread.daemon for thread in threading.enumerate()[1:]):
        return
    atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # a full disk, which has been reported if the command has failed
            code = code or 2
    os._exit(code)


if __name__ == "__main__":
    main()
