"""``python -m bench [--only NAME …]``: measure, print the figures and write them as JSON."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.calm import calm
from bench.clearance.checking import checking
from bench.clearance.sweeps import sweeps as swept_motions
from bench.constants.varying import constants
from bench.first_minutes import first_minutes
from bench.folds import folds
from bench.hard_paths import hard_paths
from bench.joint_errors import joint_error
from bench.likeness import likeness, likeness_folds, likeness_tetrahedra, previews
from bench.long_folds import long_folds
from bench.machine import machine
from bench.meshes import meshes
from bench.motion_quality import motion_quality
from bench.mujoco_robot import mujoco_robot
from bench.ode.comparison import ode
from bench.page_speed import page_speed
from bench.paths import paths
from bench.peeling import peeling
from bench.plan_files import plan_files
from bench.portfolio import portfolio
from bench.refolds import refolds
from bench.robots import robots
from bench.scaling import scaling
from bench.sections import write_sections
from bench.service.browser_check import browser_check
from bench.service.dropped_mesh import dropped_mesh
from bench.service.film import films
from bench.service.kiosk import kiosk
from bench.service.link_views import link_views
from bench.service.movies import movies
from bench.service.page_weights import page_weights
from bench.service.remaining_time import remaining_time
from bench.service.sites import sites
from bench.service.tours import tours
from bench.smoothing import smoothing
from bench.snake_cubes import snake_cubes
from bench.snakes import snake_folds, snakes
from bench.speed import speed
from bench.sweep_sections import baselines, gallery, published, seeds
from bench.sweeps.faults import sweep_faults
from bench.sweeps.figures import sweeps
from bench.sweeps.many import sweep_many
from bench.table.folds import table_folds, table_long_folds
from bench.table.meshes import table_meshes
from bench.table.offers import table_offers_section
from bench.table.paths import table_path_section
from bench.table.playback import table_playback
from bench.table.statics import statics
from bench.table.tetrahedra import table_tetrahedra
from bench.tetrahedra import tetrahedra
from bench.turns import turns, turns_long
from bench.words_and_pictures import words_and_pictures

SECTIONS = {
    "first": first_minutes,
    "folds": folds,
    "gallery": gallery,
    "seeds": seeds,
    "meshes": meshes,
    "likeness": likeness,
    "likeness-folds": likeness_folds,
    "likeness-tetrahedra": likeness_tetrahedra,
    "previews": previews,
    "paths": paths,
    "peeling": peeling,
    "scaling": scaling,
    "speed": speed,
    "portfolio": portfolio,
    "refolds": refolds,
    "mujoco-robot": mujoco_robot,
    "robots": robots,
    "calm": calm,
    "hard": hard_paths,
    "joint-error": joint_error,
    "swept-motions": swept_motions,
    "sweeps": sweeps,
    "sweep-many": sweep_many,
    "sweep-faults": sweep_faults,
    "checking": checking,
    "constants": constants,
    "table-folds": table_folds,
    "table-long-folds": table_long_folds,
    "table-meshes": table_meshes,
    "table-offers": table_offers_section,
    "table-paths": table_path_section,
    "table-playback": table_playback,
    "table-tetrahedra": table_tetrahedra,
    "tetrahedra": tetrahedra,
    "smoothing": smoothing,
    "motion-quality": motion_quality,
    "snakes": snakes,
    "snake-folds": snake_folds,
    "snake-cubes": snake_cubes,
    "turns": turns,
    "turns-long": turns_long,
    "statics": statics,
    "plan-files": plan_files,
    "page": page_speed,
    "long-folds": long_folds,
    "checked": browser_check,
    "dropped": dropped_mesh,
    "kiosk": kiosk,
    "movies": movies,
    "film": films,
    "remaining": remaining_time,
    "sites": sites,
    "tours": tours,
    "weights": page_weights,
    "views": link_views,
    "baselines": baselines,
    "published": published,
    "ode": ode,
    "words-and-pictures": words_and_pictures,
}


def main() -> None:
    """Run the requested sections, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=list(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--out", type=Path, default=Path("out/bench.json"))
    arguments = parser.parse_args()
    about = machine()
    sections = (SECTIONS[name](about["reference_seconds"]) for name in arguments.only)
    write_sections(sections, about, arguments.out)


if __name__ == "__main__":
    main()
