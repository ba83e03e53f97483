"""``python -m tests.load [--short] [--only NAME …]``: prints the figures, writes them as JSON."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from tests.benchmarks.machine import machine
from tests.benchmarks.tables import Section
from tests.load.disks import inside
from tests.load.faults import FAULTS, SEED, faults, signals
from tests.load.mutated import mutated_uploads
from tests.load.scrubbing import scrubbing
from tests.load.several import several
from tests.load.strangers import strangers
from tests.load.uploads import uploads
from tests.load.viewers import viewers
from tests.load.workers import workers

SHORT_FAULTS = ("worker killed", "server killed", "disk full")


def _faults(short: bool, rounds: int | None, seed: int, only: list[str]) -> Section:
    named = tuple(only) or (SHORT_FAULTS if short else tuple(FAULTS))
    return faults(rounds or (3 if short else 120), seed=seed, only=named)


def _several(short: bool, rounds: int | None, seed: int, only: list[str]) -> Section:
    return several(rounds or (3 if short else 120), seed=seed, only=tuple(only))


FAULTY = {"faults": _faults, "several": _several}


SECTIONS: dict[str, Callable[[bool], Section]] = {
    "scrubbing": scrubbing,
    "strangers": strangers,
    "uploads": uploads,
    "mutated": mutated_uploads,
    "viewers": viewers,
    "workers": workers,
}


def main() -> int:
    """Runs the asked-for sections, one after the other; 1 when a bar is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [*SECTIONS, *FAULTY]
    parser.add_argument("--only", nargs="*", choices=names, default=names)
    parser.add_argument("--short", action="store_true", help="as in `make test`")
    parser.add_argument("--rounds", type=int, help="of the faults")
    parser.add_argument("--seed", type=int, default=SEED, help="of the faults")
    parser.add_argument("--faults", nargs="*", choices=list(FAULTS), default=[])
    parser.add_argument("--out", type=Path, default=Path("out/load.json"))
    arguments = parser.parse_args()
    if FAULTY.keys() & set(arguments.only):
        code = inside(["-m", "tests.load", *sys.argv[1:]])
        if code is not None:
            return code
    signals()
    console = Console(width=max(160, Console().width))
    about = machine()
    console.print(about)
    found = {"machine": about, "date": time.strftime("%Y-%m-%d"), "sections": []}
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    met = True
    for name in arguments.only:
        if name in FAULTY:
            faulty = FAULTY[name]
            section = faulty(arguments.short, arguments.rounds, arguments.seed, arguments.faults)
        else:
            section = SECTIONS[name](arguments.short)
        section.show(console)
        met &= all(figure.met is not False for figure in section.figures)
        found["sections"].append(section.as_dict())
        arguments.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
