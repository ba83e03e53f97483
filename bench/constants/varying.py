"""Constants: which numbers of the planner change results when they are 0.7 and 1.4 times as large.

``python -m bench.constants.varying [--folds 30] [GROUP …]`` prints them; ``GROUPS`` has the groups.
With 30 folds, all groups take about 80 minutes of processor time, two thirds of it for the jams.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from types import ModuleType
from typing import Any, Final

from rich.console import Console

from bench.likeness import FORMS
from bench.sections import Section
from foldback.planner.chain.chain import Chain
from foldback.planner.explosion import simultaneous
from foldback.planner.explosion.loop import (
    checkpoint,
    explosion_loop,
    radial_forces,
    recorder,
    step_control,
    straightening,
)
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.pipeline.fold import fold, smooth_plan
from foldback.planner.plan.plan import Plan
from foldback.planner.playback import (
    reference_curve,
    reference_trajectory,
    robot_run,
    setpoints,
    time_scaling,
)
from foldback.planner.shapes import lattice_fits, voxel_choice
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.voxelise import voxelise
from foldback.planner.smoothing import smoothing, smoothing_targets
from foldback.planner.turns import beam_search
from tests.planner.chains import knotted, shuffled

FACTORS: Final = (0.7, 1.4)
"""Factors by which each number is varied."""
FOLDS: Final = 30
"""Number of folds, or of voxelised meshes, for each value."""
BOXES: Final = ((2, 3, 4), (3, 3, 3), (2, 4, 4), (3, 3, 4), (2, 4, 5), (2, 3, 5))
"""Boxes of 24 to 40 cells through which random paths are folded."""
MOVES: Final = 2000
"""Number of random changes of the path through a box."""
VOXELS: Final = 150
"""Requested number of cells of a voxelised mesh."""
NUMBERS: Final[dict[str, dict[ModuleType | type, tuple[str, ...]]]] = {
    "explosion": {
        ExplosionParameters: (
            *("repulsion_gain", "loose_repulsion", "repulsion_cutoff", "spring", "armature"),
            *("tension", "drag", "joint_cap_rad", "pair_cap", "slide_cap", "loose_rad"),
            *("snapshot_rad", "snapshot_distance", "finish_rad"),
        ),
        explosion_loop: ("RADIAL_GAIN_JITTER",),
        radial_forces: ("REPULSION_RAMP",),
        simultaneous: ("FIRST_FINISH_STEPS",),
    },
    "jams": {
        checkpoint: ("RESTORED_VELOCITY_SCALE", "PULSE_STEPS"),
        explosion_loop: ("COMMIT_EVERY_STEPS", "STOP_COMPLIANCE_RAD", "PULSE_REPULSION_SCALE"),
        radial_forces: ("REPTATION_FORCE",),
        recorder: ("CLEAR_ENOUGH_PITCH", "MIN_CLEARANCE_LOSS_PITCH"),
        step_control: ("WEAK_TENSION_SCALE", "MIN_CONTACT_TIME_CONSTANT_S"),
        straightening: ("STRAIGHTENING_CLEARANCE_PITCH",),
        ExplosionParameters: ("step_in_contact_s", "body_cap"),
    },
    "playback": {
        PlaybackParameters: ("spacing_rad", "distance_weight", "steps_per_rad", "bandwidth"),
        robot_run: ("FRAME_MOVE_PITCH", "MAX_FRAME_STEPS"),
        reference_curve: (
            *("REFERENCE_CLEARANCE_PITCH", "JOINT_LIMIT_MARGIN_RAD", "ARC_LENGTH_PER_TURN"),
        ),
        reference_trajectory: ("STRAIGHT_TORQUE_RATIO", "LAW_SAMPLES_PER_RAD"),
        setpoints: ("SETTLE_STEPS",),
        time_scaling: ("RAMP_SHARE", "STRAIGHT_SHARE", "MAX_SPEED_RATIO", "SMOOTHING_SAMPLES"),
    },
    "smoothing": {
        smoothing: (
            *("MAX_EVALUATIONS", "SMOOTHED_FRAMES", "MIN_PART_FRAMES", "MIN_FOLLOWED_SHARE"),
            *("MIN_PASS_GAIN", "DISTANCE_WEIGHT", "SWEEP_STEPS"),
        ),
        smoothing_targets: ("FADE_FRAMES",),
    },
    "turns": {
        beam_search: ("CONTACT_WEIGHT",),
    },
    "voxels": {
        voxel_choice: (*("COUNT_TOLERANCE", "COUNT_PENALTY", "SCORE_TOLERANCE", "UPRIGHT_BONUS"),),
        lattice_fits: ("THRESHOLD_LEVELS", "MAX_FILL_THRESHOLD", "WELD_TOLERANCE_SHARE"),
    },
}
"""Numbers that may change results, by the group of runs that uses them and the module of the
constant, or the class of the parameter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The result of one fold, or of one voxelised mesh.

    Attributes:
        good: True if the plan is verified, or cells were found.
        seconds: Processor time, s.
        quality: Proved bound of the clearance, pitches; of cells the overlap with the mesh (IoU).
        digest: Digest of the motion, or of the cells.
    """

    good: bool
    seconds: float
    quality: float
    digest: str


def constants(reference_seconds: float, folds: int = FOLDS, *groups: str) -> Section:
    """Vary each number of the groups by each factor."""
    section = Section(name="constants")
    for group in groups or GROUPS:
        run = GROUPS[group]
        run(0)  # import all libraries first
        usual = [run(number) for number in range(folds)]
        section.rows.append(_row(group, "all as they are", "", usual, usual, reference_seconds))
        without: list[str] = []
        for home, names in NUMBERS[group].items():
            for name in names:
                rows = [
                    _row(group, name, _text(value), usual, runs, reference_seconds)
                    for value, runs in _variations(home, name, run, folds)
                ]
                section.rows += rows
                print(
                    *(" ".join(map(_text, row.values())) for row in rows), sep="\n", file=sys.stderr
                )
                without += [name] * all(not row["changed"] for row in rows)
        total = sum(len(names) for names in NUMBERS[group].values())
        section.add(f"{group}: without effect", f"{len(without)} of {total}: {', '.join(without)}")
    return section


def _variations(
    home: ModuleType | type, name: str, run: Callable[[int], Run], folds: int
) -> Iterator[tuple[Any, list[Run]]]:
    """Yield each varied value and the runs with it."""
    for factor in FACTORS:
        with varied(home, name, factor) as value:
            yield value, [run(number) for number in range(folds)]


@contextmanager
def varied(home: ModuleType | type, name: str, factor: float) -> Generator[Any]:
    """Multiply a constant of a module, or the default of a parameter, while the context is open.

    A constant changes in all modules that import it by name, too; the compiled core and
    default values of functions keep the former one.
    """
    if isinstance(home, type):
        spaces = [vars(home)["__init__"].__kwdefaults__]
    else:
        value = vars(home)[name]
        modules = (module for key, module in sys.modules.items() if key.startswith("foldback."))
        spaces = [vars(module) for module in modules if vars(module).get(name) is value]
    former = spaces[0][name]
    changed = _times(former, factor)
    try:
        for space in spaces:
            space[name] = changed
        yield changed
    finally:
        for space in spaces:
            space[name] = former


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_times(item, factor) for item in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return value * factor


def _row(
    group: str, name: str, value: str, usual: list[Run], runs: list[Run], reference: float
) -> dict[str, Any]:
    before, seconds = (sum(run.seconds for run in runs_of_value) for runs_of_value in (usual, runs))
    return {
        "group": group,
        "number": name,
        "value": value,
        "verified": f"{sum(run.good for run in runs)} of {len(runs)}",
        "cpu s": seconds,
        "to usual": seconds / before,
        "to reference": seconds / reference if reference else float("nan"),
        "least quality": min((run.quality for run in runs if run.good), default=float("nan")),
        "changed": sum(a.digest != b.digest for a, b in zip(usual, runs, strict=True)),
    }


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@cache
def _chain(number: int) -> Chain:
    return shuffled(BOXES[number % len(BOXES)], MOVES, number)


@cache
def _knot(number: int) -> Chain:
    return knotted(6 + number)


@cache
def _plan(number: int) -> Plan:
    return fold(_chain(number), strategy="simultaneous")


@cache
def _solid(number: int) -> Solid:
    mesh = list(FORMS.values())[number % len(FORMS)]()
    return Solid.from_triangles(mesh.vertices, mesh.faces)


def _judged(plan_of: Callable[[], Plan]) -> Run:
    start_s = time.process_time()
    plan = plan_of()
    seconds = time.process_time() - start_s
    digest = sha256(b"".join(column.tobytes() for column in plan.motion.columns().values()))
    certificate = plan.certificate
    return Run(
        good=certificate.verified,
        seconds=seconds,
        quality=float(certificate.clearance_bound or 0.0),
        digest=digest.hexdigest(),
    )


def _explode(number: int) -> Run:
    return _judged(lambda: fold(_chain(number), strategy="simultaneous"))


def _untangle(number: int) -> Run:
    return _judged(lambda: fold(_knot(number), strategy="simultaneous"))


def _turn(number: int) -> Run:
    return _judged(lambda: fold(_chain(number), strategy="turns"))


def _smooth(number: int) -> Run:
    plan = _plan(number)
    return _judged(lambda: smooth_plan(plan))


def _voxelise(number: int) -> Run:
    solid = _solid(number)
    start_s = time.process_time()
    voxels = voxelise(solid, cells=VOXELS)
    return Run(
        good=True,
        seconds=time.process_time() - start_s,
        quality=voxels.iou,
        digest=sha256(voxels.shape.cells.tobytes()).hexdigest(),
    )


GROUPS: Final[dict[str, Callable[[int], Run]]] = {
    "explosion": _explode,
    "jams": _untangle,
    "playback": _explode,
    "smoothing": _smooth,
    "turns": _turn,
    "voxels": _voxelise,
}
"""What is run for the numbers of each group."""


def main() -> None:
    """Vary the numbers of the groups of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=", ".join(GROUPS))
    parser.add_argument("--folds", type=int, default=FOLDS)
    arguments = parser.parse_args()
    constants(0.0, arguments.folds, *arguments.groups).show(Console(width=160))


if __name__ == "__main__":
    main()
