"""Worker process of ``foldback serve``; its argument is the time between two pulses, in s."""

from __future__ import annotations

import sys

from foldback.server.ops.leash import Leash
from foldback.server.ops.stop_signals import end_at_stop_signals


def main() -> None:
    """Compute folds until a signal, or until the process of the service ends."""
    end_at_stop_signals()
    leash = Leash(float(sys.argv[1]))

    # Imports take seconds, in which the leash holds already.
    from foldback.server.jobs.worker import work
    from foldback.server.ops.startup_errors import settings_of

    work(settings_of(), leash=leash)


if __name__ == "__main__":
    main()
