"""``python -m bench.load [--short] [--only NAME …]``: print the figures and write them as JSON."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from bench.load.classes import classes
from bench.load.disks import inside
from bench.load.faults import FAULTS, FAULTS_SEED, faults, signals
from bench.load.mutated_files import mutated_uploads
from bench.load.scrubbing import scrubbing
from bench.load.several_machines import several_machines
from bench.load.starts import starts
from bench.load.strangers import strangers
from bench.load.takeover import takeover
from bench.load.uploads import uploads
from bench.load.viewers import viewers
from bench.load.workers import workers
from bench.machine import machine
from bench.sections import Section, write_sections

SHORT_FAULTS = ("worker killed", "server killed", "disk full")
"""Faults of a run with ``--short``."""


def _faults(short: bool, rounds: int | None, seed: int, only: list[str]) -> Section:
    named = tuple(only) or (SHORT_FAULTS if short else tuple(FAULTS))
    return faults(rounds or (3 if short else 120), seed=seed, only=named)


def _several(short: bool, rounds: int | None, seed: int, only: list[str]) -> Section:
    return several_machines(rounds or (3 if short else 120), seed=seed, only=tuple(only))


FAULTY = {"faults": _faults, "several": _several}
"""Sections that inject faults into a service; they need a disk that can be mounted."""


SECTIONS: dict[str, Callable[[bool], Section]] = {
    "classes": classes,
    "scrubbing": scrubbing,
    "starts": starts,
    "strangers": strangers,
    "takeover": takeover,
    "uploads": uploads,
    "mutated": mutated_uploads,
    "viewers": viewers,
    "workers": workers,
}


def main() -> int:
    """Run the requested sections, one after the other; return 1 if a bar is not met."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [*SECTIONS, *FAULTY]
    parser.add_argument("--only", nargs="*", choices=names, default=names)
    parser.add_argument("--short", action="store_true", help="as in `make test`")
    parser.add_argument("--rounds", type=int, help="of the faults")
    parser.add_argument("--seed", type=int, default=FAULTS_SEED, help="of the faults")
    parser.add_argument("--faults", nargs="*", choices=list(FAULTS), default=[])
    parser.add_argument("--out", type=Path, default=Path("out/load.json"))
    arguments = parser.parse_args()
    if FAULTY.keys() & set(arguments.only):
        code = inside(["-m", "bench.load", *sys.argv[1:]])
        if code is not None:
            return code
    signals()
    sections = (
        FAULTY[name](arguments.short, arguments.rounds, arguments.seed, arguments.faults)
        if name in FAULTY
        else SECTIONS[name](arguments.short)
        for name in arguments.only
    )
    sections_done = write_sections(sections, machine(), arguments.out)
    return int(any(figure.met is False for section in sections_done for figure in section.figures))


if __name__ == "__main__":
    sys.exit(main())
