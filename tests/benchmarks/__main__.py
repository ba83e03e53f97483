"""``python -m tests.benchmarks [--only NAME …]``: prints the figures and writes them as JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from tests.benchmarks.baselines import direct, paper
from tests.benchmarks.first import first
from tests.benchmarks.folds import folds, gallery
from tests.benchmarks.hard import hard
from tests.benchmarks.long_folds import long_folds
from tests.benchmarks.machine import machine
from tests.benchmarks.meshes import meshes
from tests.benchmarks.page import page
from tests.benchmarks.paths import paths
from tests.benchmarks.peeling import peeling
from tests.benchmarks.plan_files import plan_files
from tests.benchmarks.portfolio import portfolio
from tests.benchmarks.scaling import scaling
from tests.benchmarks.service.compiling import compiling
from tests.benchmarks.service.dropped import dropped
from tests.benchmarks.service.movies import movies
from tests.benchmarks.service.remaining import remaining
from tests.benchmarks.service.views import views
from tests.benchmarks.service.weights import weights
from tests.benchmarks.smoothing import smoothing
from tests.benchmarks.speed import speed
from tests.benchmarks.success_map.published import published
from tests.benchmarks.success_map.seeds import seeds
from tests.benchmarks.sweeps import sweeps
from tests.benchmarks.table.folds import table_folds, table_long_folds
from tests.benchmarks.table.offers import table_offers_section
from tests.benchmarks.table.paths import table_path_section
from tests.benchmarks.table.playback import table_playback
from tests.benchmarks.table.statics import statics
from tests.benchmarks.table.tetrahedra import table_tetrahedra
from tests.benchmarks.tables import write_sections
from tests.benchmarks.tetrahedra import tetrahedra

SECTIONS = {
    "first": first,
    "folds": folds,
    "gallery": gallery,
    "seeds": seeds,
    "meshes": meshes,
    "paths": paths,
    "peeling": peeling,
    "scaling": scaling,
    "speed": speed,
    "portfolio": portfolio,
    "hard": hard,
    "sweeps": sweeps,
    "table-folds": table_folds,
    "table-long-folds": table_long_folds,
    "table-offers": table_offers_section,
    "table-paths": table_path_section,
    "table-playback": table_playback,
    "table-tetrahedra": table_tetrahedra,
    "tetrahedra": tetrahedra,
    "smoothing": smoothing,
    "statics": statics,
    "plan-files": plan_files,
    "page": page,
    "long-folds": long_folds,
    "compiling": compiling,
    "dropped": dropped,
    "movies": movies,
    "remaining": remaining,
    "weights": weights,
    "views": views,
    "direct": direct,
    "paper": paper,
    "published": published,
}


def main() -> None:
    """Runs the asked-for sections, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"))
    arguments = parser.parse_args()
    about = machine()
    sections = (SECTIONS[name](about["reference_seconds"]) for name in arguments.only)
    write_sections(sections, about, arguments.out)


if __name__ == "__main__":
    main()
