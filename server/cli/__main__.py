"""Start of the command ``foldback``."""

import sys
from typing import Final

SERVICE_COMMANDS: Final = ("serve", "worker")
"""Commands that run until a signal."""


def main() -> None:
    """Run the command line."""
    if sys.argv[1:2] and sys.argv[1] in SERVICE_COMMANDS:
        # First of all: until then, SIGINT is lost if the shell has started this with it ignored.
        from foldback.server.ops.stop_signals import end_at_stop_signals

        end_at_stop_signals()
    from foldback.server.cli.resident_client import run_resident

    sys.argv[1:] = run_resident(sys.argv[1:])
    from foldback.server.cli.command_line import main as run

    run()


if __name__ == "__main__":
    main()
