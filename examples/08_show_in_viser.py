"""Show a fold in a viser server while it is computed, add to its user interface, and play it.

In a terminal the server runs until Ctrl-C. In a notebook `show(plan)` at the end of a cell shows
the plan in place.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path as FilePath

from foldback import Chain, Path, fold, read
from foldback.viewer import show

SHAPES = FilePath(__file__).parent / "shapes"


def main() -> None:
    shape = read((SHAPES / "wrench-24.json").read_bytes())
    assert isinstance(shape, Path | Chain)
    with show.live() as live:
        print(f"Look at {live.url}", flush=True)
        plan = fold(shape, directory="wrench-24", progress=live)
        print(f"{plan.certificate.verdict}, {plan.certificate.min_clearance:.3f} pitches clear")

        # It is a plain viser server: all that viser offers can be added to it.
        gui = live.server.gui
        gui.add_markdown(f"Verdict: {plan.certificate.verdict}")
        start = gui.add_button("To the start")

        @start.on_click
        def _(_: object) -> None:
            live.frame = 0

        live.frame = 0
        live.play()
        if sys.stdout.isatty():
            with suppress(KeyboardInterrupt):
                live.server.sleep_forever()


if __name__ == "__main__":
    main()
