"""Warm-up: compiles the kernels into their cache ahead of the first fold."""

from __future__ import annotations

import os
import sys
from contextlib import nullcontext
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from foldback.planner.certificate.frame_figures import clearances_of
from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import floating_torques
from foldback.planner.chain.module import CUBE, DEFAULT_MODULE_SIZE, TETRAHEDRON
from foldback.planner.chain.path import Path
from foldback.planner.clearance.exempt_pairs import exempt_pairs
from foldback.planner.clearance.sweep import sweep
from foldback.planner.compilation.compiling import (
    Compiling,
    beside,
    end_with_parent,
    second_process,
)
from foldback.planner.compilation.compiling_lock import (
    FIRST_LOCK,
    PATHS_LOCK,
    REST_LOCK,
    CompilingLock,
)
from foldback.planner.compilation.cpu_cores import cores
from foldback.planner.explosion.published_explosion import explode_as_published
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.kernels.articulated import Accelerations, ArticulatedBodies
from foldback.planner.kernels.contact_forces import ContactModel, PairContacts, add_many_contacts
from foldback.planner.kernels.module import ModuleStates
from foldback.planner.kernels.trails import one_circuit
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.playback import RobotParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pipeline.fold import fold, smooth_plan
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.warm_up_paths import (
    WARM_UP_CELLS,
    warm_up_chains,
    warm_up_fit,
    warm_up_paths,
)
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.progress import Progress, Report, silent
from foldback.planner.robot.retiming import retime
from foldback.planner.simulation.contact_finder import robot_contacts
from foldback.planner.simulation.engine import build_chain_model
from foldback.planner.simulation.mujoco_models import SOLIMP
from foldback.planner.simulation.robot import Robot
from foldback.planner.turns.beam_search import unfold
from foldback.planner.turns.cube_turns import cube_turning
from foldback.planner.turns.tetrahedron_turns import tetrahedron_turning

BACKGROUND_NICENESS: Final = 10
"""Niceness (POSIX) of a process that compiles kernels in advance."""


def warm_up(
    progress: Report = silent,
    *,
    soon: bool = False,
    at_once: bool = False,
    directory: FilePath | None = None,
) -> None:
    """Fold, retime, smooth, balance, peel, explode as published and find a path, each once.

    That takes a moment once the kernels are compiled. Where they are not, another process compiles
    a part of them at the same time; of several processes that warm up, one compiles at a time.

    Args:
        progress: Called with ``COMPILING`` and a fraction whenever a kernel was compiled.
        soon: Return once a path can be folded; another process compiles the remaining kernels.
        at_once: Compile the remaining kernels in two processes, too, as nobody folds yet.
        directory: Directory of the locks; beside the compiled kernels if None.
    """
    place = _locks_in(directory)
    plan, compiled = warm_up_folding(progress, directory=directory)
    if soon and compiled:
        beside("all", place)
        return
    with Compiling(progress, lock=CompilingLock(place / REST_LOCK)) as compiling:
        retime(plan, 1.0, 1.0)
        beside_too = at_once and compiling.has_reported and cores() > 1
        with second_process("turns", place, compiling) if beside_too else nullcontext():
            with TemporaryDirectory() as folder:
                smooth_plan(plan, directory=folder)
            table_certificate(plan.chain, plan.motion)
            _many_contacts(plan.chain)
            _explode_as_published()
        warm_up_paths()
        _peel_fit_and_turn()


def warm_up_folding(
    progress: Report = silent, *, directory: FilePath | None = None
) -> tuple[Plan, bool]:
    """Fold a path, so that the kernels of a fold are compiled and loaded.

    Args:
        progress: Called with ``COMPILING`` and a fraction whenever a kernel was compiled.
        directory: Directory of the locks; beside the compiled kernels if None.

    Returns:
        The plan, and True if a kernel had to be compiled.
    """
    place = _locks_in(directory)
    with Compiling(progress, lock=CompilingLock(place / FIRST_LOCK)) as compiling:
        chain = warm_up_chains()
        beside_too = compiling.has_reported and cores() > 1
        with second_process("paths-and-motions", place, compiling) if beside_too else nullcontext():
            warm_up_clearance(chain)
            warm_up_torques(chain)
        warm_up_motions(chain)
        with TemporaryDirectory() as folder:  # figures are only made of what is written
            plan = fold(Path.from_cells(list(WARM_UP_CELLS), name="warm-up"), directory=folder)
    return plan, compiling.has_reported


def warm_up_clearance(chain: Chain) -> None:
    """Look at a motion between two frames, which shares few kernels with what makes motions."""
    still = np.tile(chain.folded_rad, (2, 1))
    sweep(chain, still, module_size=DEFAULT_MODULE_SIZE)
    exempt_pairs(chain, (still,), module_size=DEFAULT_MODULE_SIZE)
    clearances_of(chain, still, module_size=DEFAULT_MODULE_SIZE)


def warm_up_torques(chain: Chain) -> None:
    """Compute the torques of a motion."""
    still = np.tile(chain.folded_rad, (2, 1))
    floating_torques(CUBE, still, 0.0 * still, 0.0 * still)


def warm_up_motions(chain: Chain) -> None:
    """Step a robot, and begin to explode a chain.

    The explosion comes last: it uses kernels of the clearance, which another process has compiled
    by then.
    """
    contacts = robot_contacts(chain, geom_size=DEFAULT_MODULE_SIZE, step_s=0.01)
    contacts.allocate(len(chain))
    robot = Robot(chain, contacts, RobotParameters(), peak_torque=1.0, seed=[0], step_s=0.01)
    robot.place(chain.folded_rad, chain.folded_position, chain.folded_wxyz)
    robot.begin_step()
    still = np.zeros(len(chain.folded_rad))
    robot.follow(still, still, still)  # as from a controller: writable arrays
    robot.end_step()
    robot.stop_drifting()
    explode(chain, ExplosionParameters(), cancelled=lambda: True)


def _peel_fit_and_turn() -> None:
    """Compile the kernels of long chains, fitted paths and turns."""
    _peel()
    warm_up_fit()
    _turn()


def _many_contacts(chain: Chain) -> None:
    """Push two modules apart as if they touched in more points than are solved exactly."""
    n, module = len(chain), chain.module
    aba = ArticulatedBodies.zeros(n, module.hinges_per_joint)
    aba.root_inertia[:] = np.eye(6)
    aba.D[:] = np.eye(module.hinges_per_joint)
    still = np.zeros((n, 3))
    normal = np.array([[0.0, 0.0, 1.0]])
    add_many_contacts(
        PairContacts(np.array([[0, 2]]), normal, np.zeros((1, 3)), np.full(1, 0.01)),
        ContactModel(0.02, 1.0, np.array(SOLIMP)),
        build_chain_model(chain, root=0),
        ModuleStates(still, np.zeros((n, 3, 3)), still, still),
        aba,
        Accelerations(np.zeros(len(chain.folded_rad)), np.zeros(6)),
    )


def _explode_as_published() -> None:
    """Steps from hinges at their stops into the open, where nothing touches."""
    corner = Path.from_cells(((0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0)))
    explode_as_published(Chain.from_path(corner), PaperExplosionParameters(max_steps=10))


def _peel() -> None:
    """Compile the kernels of long chains, by peeling a small box."""
    # more modules than are released at a time
    path = Path.from_cells(layered_snake((2, 4, 5)), name="warm-up")
    with TemporaryDirectory(prefix="foldback-") as place:
        Workspace(FilePath(place)).write_request(FoldRequest(strategy="peel"), write_path(path))
        run_stages(FilePath(place))


def _turn() -> None:
    """Compile the kernels of turns, with chains whose turns all fit into one step."""
    bent = Chain.from_angles(TETRAHEDRON, np.full(2, np.pi / 2))
    for turning in (
        cube_turning(warm_up_chains(), DEFAULT_MODULE_SIZE),
        tetrahedron_turning(bent, DEFAULT_MODULE_SIZE),
    ):
        unfolded = unfold(turning, turning.folded, room=0.0, width=1, seed=0)
        turning.pairs(turning.folded)
        hinges = np.zeros(0, np.int64)
        turning.clear_turns(unfolded.states[-1], hinges, hinges, room=0.0)


def main() -> None:
    """Compile all kernels, or what another process leaves to this one."""
    if len(sys.argv) == 1:
        warm_up(_show, at_once=True)
        return
    part, directory = sys.argv[1], FilePath(sys.argv[2]) if sys.argv[2:] else None
    end_with_parent()
    if part == "all":
        os.nice(BACKGROUND_NICENESS)
        warm_up(directory=directory)
        return
    place = _locks_in(directory)
    if part == "turns":
        with Compiling(lock=CompilingLock(place / REST_LOCK), joined=True):
            _peel_fit_and_turn()
        return
    with Compiling(lock=CompilingLock(place / PATHS_LOCK)):
        warm_up_paths()
    if part == "paths-and-motions":
        with Compiling(lock=CompilingLock(place / FIRST_LOCK), joined=True):
            warm_up_motions(warm_up_chains())
    else:
        os.nice(BACKGROUND_NICENESS)  # the first fold needs no fit
        warm_up_fit()


def _locks_in(directory: FilePath | None) -> FilePath:
    """Return the directory of the locks: by default that of the compiled kernels."""
    return directory or FilePath(str(one_circuit.stats.cache_path))


def _show(progress: Progress) -> None:
    """Print how far the compilation is, where somebody looks."""
    if sys.stderr.isatty():
        print(f"\r{progress.message} {progress.fraction:.0%} ", end="", file=sys.stderr)


if __name__ == "__main__":
    main()
