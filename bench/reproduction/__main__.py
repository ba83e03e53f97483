"""``make reproduction``: run the missing experiments of the paper and write the page.

Figures are stored in ``web/paper/runs.jsonl``, with films and stills beside it;
``docs/reproduction.md`` and ``web/paper/page.json`` are written from these. It can be stopped at
any time and continues where it stopped.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from bench.reproduction.experiments import experiments
from bench.reproduction.reproduce import reproduce, tell
from bench.reproduction.runs import stored_runs
from foldback.planner.sweeps.planner_digest import planner_digest

ROOT: Final = Path(__file__).parents[2]
PAPER: Final = ROOT / "web" / "paper"
DOCUMENT: Final = ROOT / "docs" / "reproduction.md"


def main() -> None:
    """Run what is missing, then write the page and the document."""
    every = experiments()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--only", nargs="*", choices=[experiment.id for experiment in every], metavar="ID"
    )
    parser.add_argument("--tell", action="store_true", help="run nothing, write pages anew")
    parser.add_argument("--again", action="store_true", help="run anew what is there")
    parser.add_argument("--stale", action="store_true", help="run anew what another planner made")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    runs = stored_runs(PAPER / "runs.jsonl")
    now = planner_digest()
    selected = [
        experiment
        for experiment in every
        if (options.only is None or experiment.id in options.only)
        and not (options.stale and experiment.id in runs and runs[experiment.id].planner == now)
    ]
    if not options.tell:
        repeats = options.again or options.stale
        reproduce(selected, every, PAPER, repeats=repeats, workers=options.workers)
    tell(every, PAPER, DOCUMENT)


if __name__ == "__main__":
    main()
