"""``python -m bench.ode``: measure, store the figures, and write the texts that show them.

``--own`` measures foldback's own method only, and ``--tell`` nothing.
"""

from __future__ import annotations

import argparse

from rich.console import Console

from bench.ode.comparison import Comparison, measure, measure_own, section
from bench.ode.texts import README, readme
from bench.reproduction.__main__ import DOCUMENT, PAPER
from bench.reproduction.experiments import experiments
from bench.reproduction.reproduce import tell


def main() -> None:
    """Measure and store the figures, then write the README's table and the page /paper."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tell", action="store_true", help="measure nothing, write texts anew")
    parser.add_argument("--own", action="store_true", help="measure only foldback's own method")
    options = parser.parse_args()
    if not options.tell:
        comparison = measure_own(Comparison.load()) if options.own else measure()
        comparison.save()
        section(comparison).show(Console(width=160))
    README.write_text(readme(README.read_text(encoding="utf-8")), encoding="utf-8")
    tell(experiments(), PAPER, DOCUMENT)


if __name__ == "__main__":
    main()
