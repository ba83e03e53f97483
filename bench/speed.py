"""Speed: the processor time of whole commands in reference runs (r), and the time of their parts.

``python -m bench.speed [CASE …]`` runs some of the commands, or 100 000 modules or the simulated
playback of 4096 modules, which ``make bench`` omits.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any, Final

from rich.console import Console

from bench.command import Run, fold
from bench.machine import machine
from bench.ode.comparison import BAR_SOLVER, Comparison
from bench.scaling import CASES, LONGER, stl
from bench.scaling import Case as Command
from bench.sections import Section
from bench.shape_files import path_file, path_of
from bench.thin_meshes import rings
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.explosion.blocks_first import explode_blocks_first
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.motion.record import Record
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.playback.playback import play_back
from foldback.planner.progress import STAGES
from foldback.planner.readers.gallery import Gallery

RUNS_PER_COMMAND: Final = 3
"""Number of times that each command is run; the median of its times counts."""
WRENCH: Final = "wrench-160"
"""Case that is compared with the published algorithm."""
BOX_SIDES: Final = (10, 10, 10)
"""Sides of the box of 1000 modules, in cells."""
SIMULATE_ALL_MODULES: Final = 10**6
"""Maximum number of modules up to which the measured folds are simulated with motors and contacts
(``simulated_modules``). It exceeds every chain, so that none is computed by kinematics only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """A command and its bar.

    Attributes:
        command: The command.
        references: Maximum processor time, in reference runs.
    """

    command: Command
    references: float


def _own(kind: str) -> Callable[[], bytes]:
    """Return a function that writes a path through a box, as a file with its cells in order."""

    def data() -> bytes:
        cells = path_of(kind, BOX_SIDES, 0)
        assert cells is not None, f"a box has {kind} paths"
        return path_file(cells)

    return data


def _larger(name: str) -> Command:
    """Return a command of ``bench.scaling`` with modules of size 0.98."""
    command = {**CASES, **LONGER}[name]
    return replace(command, options=(*command.options, "--module-size", "0.98"))


def _kinematic(name: str) -> Command:
    """Return a command whose playback is not simulated, as in all earlier measurements."""
    command = {**CASES, **LONGER}[name]
    return replace(command, options=(*command.options, "--set", "simulated_modules=500"))


def _folded_by_robots(name: str) -> Command:
    """Return a command whose playback is simulated, however long its chain is."""
    command = {**CASES, **LONGER}[name]
    return replace(command, options=(*command.options, "--set", "simulated_modules=20000"))


LAYERED: Final = Command(
    shape="box.txt",
    data=lambda: _layered(BOX_SIDES),
    options=("--strategy", "simultaneous", "--set", "simulated_modules=2000"),
)
RINGS: Final = Command(
    shape="rings.stl",
    data=stl(rings),
    options=("--modules", "1500"),
)
COMMANDS: Final = {
    WRENCH: Bar(command=CASES["wrench-160"], references=6.0),
    "simultaneous-512": Bar(command=CASES["simultaneous-512"], references=20.0),
    "capsule-1000": Bar(command=_kinematic("capsule-1000"), references=17.0),
    "torus-1000": Bar(command=_kinematic("torus-1000"), references=17.0),
    "ball-1000": Bar(command=_kinematic("ball-1000"), references=9.0),
    "layered-1000": Bar(command=LAYERED, references=35.0),
    "rings-1500": Bar(command=RINGS, references=80.0),
    "own-block-1000": Bar(command=Command(shape="own.txt", data=_own("block")), references=40.0),
    "own-search-1000": Bar(command=Command(shape="own.txt", data=_own("exact")), references=80.0),
    "box-4096": Bar(command=CASES["box-4096"], references=40.0),
    "box-9600": Bar(command=_larger("box-9600"), references=80.0),
    "ball-10000": Bar(command=_larger("ball-10000"), references=50.0),
}
ROBOTS: Final = {
    "ball-1000-robots": Bar(command=_folded_by_robots("ball-1000"), references=40.0),
    "box-4096-robots": Bar(command=_folded_by_robots("box-4096"), references=250.0),
}
"""Peeled chains whose playback is simulated; the bars hold for the playback."""
LONG: Final = {"box-100000": Bar(command=_larger("box-100000"), references=400.0)}
"""Commands that ``make bench`` omits."""
SIMULATED: Final = {
    "simulated-1000": ((10, 10, 10), 40.0),
    "simulated-4096": ((16, 16, 16), 250.0),
}
"""Sides, in cells, of layered boxes that fold all at once, and the maximum reference runs of their
simulated playback."""
USUAL: Final = (*COMMANDS, *ROBOTS, "simulated-1000")
"""Names of the commands and playbacks that ``make bench`` measures."""


def speed(reference_seconds: float, names: tuple[str, ...] = USUAL) -> Section:
    """Measure the commands of these names, then parts of a fold."""
    section = Section(name="speed")
    for name in names:
        if name in SIMULATED:
            _simulated(section, *SIMULATED[name], reference_seconds)
        else:
            _command(section, name, {**COMMANDS, **ROBOTS, **LONG}[name], reference_seconds)
    _stages(section, reference_seconds)
    _steps(section)
    return section


def _command(section: Section, name: str, bar: Bar, reference_seconds: float) -> None:
    """Measure a whole command, imports and files included."""
    runs = [_run(bar.command) for _ in range(1 if name in LONG else RUNS_PER_COMMAND)]
    processor = statistics.median(run.processor_s for run in runs)
    summary = runs[0].summary
    verified = all(run.code == 0 for run in runs)
    section.rows.append(
        {
            "case": name,
            "modules": summary["modules"],
            "strategy": summary["explosion"]["strategy"],
            "verdict": summary["certificate"]["verdict"],
            "steps": summary["explosion"]["steps"],
            "explosion s": statistics.median(r.summary["explosion"]["seconds"] for r in runs),
            "playback s": statistics.median(r.summary["playback"]["seconds"] for r in runs),
            "processor s": processor,
            "× reference": processor / reference_seconds,
            "memory MB": max(run.peak_mb for run in runs),
        }
    )
    row = section.rows[-1]
    if name == WRENCH:
        total_references = (row["explosion s"] + row["playback s"]) / reference_seconds
        published = Comparison.load().row(BAR_SOLVER).references
        section.add(
            f"{name}: explosion and playback",
            f"{total_references:.1f} r, {published / total_references:.0f} times as fast as the "
            "published method on ODE",
            "≤ 4.4 r",
            total_references <= 4.4,
        )
    if name in ROBOTS:
        playback = row["playback s"] / reference_seconds
        error = summary["certificate"]["max_angle_error_rad"]
        section.add(
            f"{name}: playback simulated, {row['modules']} modules, peeled",
            f"{playback:.0f} r ({row['playback s']:.1f} s), joint error {1e3 * error:.2f} mrad, "
            f"{row['memory MB']:.0f} MB, {summary['status']}",
            f"≤ {bar.references:g} r, verified",
            verified and playback <= bar.references,
        )
        return
    references = processor / reference_seconds
    section.add(
        f"{name}: whole command, {row['modules']} modules",
        f"{references:.1f} r ({processor:.1f} s), {row['memory MB']:.0f} MB, {summary['status']}",
        f"≤ {bar.references:g} r, verified",
        verified and references <= bar.references,
    )


def _run(command: Command) -> Run:
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        shape = command.shape
        if command.data is not None:
            file = FilePath(folder) / command.shape
            file.write_bytes(command.data())
            shape = str(file)
        return fold(shape, *command.options)


def _stages(section: Section, reference_seconds: float) -> None:
    """Measure the stages after the explosion of 1000 modules."""
    times_s: list[float] = []
    for _ in range(RUNS_PER_COMMAND):
        with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
            directory = FilePath(place)
            Workspace(directory).write_request(FoldRequest(strategy="peel"), _layered(BOX_SIDES))
            took: dict[str, float] = {}
            for stage in STAGES:
                start_s = time.perf_counter()
                run_stage(stage, directory)
                took[stage] = time.perf_counter() - start_s
            times_s.append(took["certify"] + took["export"])
    seconds = statistics.median(times_s)
    section.add(
        "certificate, figures and export, 1000 modules",
        f"{seconds:.2f} s ({seconds / reference_seconds:.1f} r)",
        "≤ 5.6 r",
        seconds <= 5.6 * reference_seconds,
    )


def _layered(sides: tuple[int, int, int]) -> bytes:
    return write_path(CellPath.from_cells(layered_snake(sides), name="box"))


def _steps(section: Section) -> None:
    """Measure the time of a simulation step for each module."""
    shape = Gallery().shape(WRENCH)
    assert shape is not None
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        directory = FilePath(place)
        Workspace(directory).write_request(FoldRequest(filename=shape.filename), shape.data)
        results = {stage: run_stage(stage, directory) for stage in STAGES[:3]}
    modules = results["read"]["modules"]
    explosion = 1e6 * results["explode"]["seconds"] / results["explode"]["steps"] / modules
    robots = Parameters().playback.robot.robots
    steps = robots * results["play_back"]["steps"]
    playback = 1e6 * results["play_back"]["seconds"] / steps / modules
    section.add(
        f"a step for a module, {WRENCH}: explosion, a robot's playback",
        f"{explosion:.1f} µs, {playback:.1f} µs",
        "≤ 4.5 and 3 µs",
        explosion <= 4.5 and playback <= 3.0,
    )


def _simulated(
    section: Section,
    sides: tuple[int, int, int],
    bar: float,
    reference_seconds: float,
) -> None:
    """Measure the simulated playback, with robots and contacts, of a layered box."""
    chain = Chain.from_path(CellPath.from_cells(layered_snake(sides), name="box"))
    parameters = Parameters()
    record: Record
    if len(chain) > 2000:
        record = explode_blocks_first(chain, parameters.explosion)  # type: ignore[arg-type]
    else:
        record = explode(chain, parameters.explosion)  # type: ignore[arg-type]
    playback = play_back(
        chain,
        record,
        replace(parameters.playback, simulated_modules=SIMULATE_ALL_MODULES),
        module_size=parameters.module_size,
    )
    references = playback.seconds / reference_seconds
    error = playback.max_angle_error_rad
    step_us = 1e6 * playback.seconds / max(1, playback.steps) / len(chain)
    section.add(
        f"playback simulated, {len(chain)} modules, {parameters.playback.robot.robots} robots",
        f"{references:.0f} r ({playback.seconds:.1f} s), {playback.status}, "
        f"joint error {'–' if error is None else f'{1e3 * error:.2f} mrad'}, "
        f"{playback.steps} steps of {step_us:.1f} µs a module",
        f"≤ {bar:g} r",
        references <= bar and playback.status == "folded",
    )


def main() -> None:
    """Print the commands of the command line."""
    about: dict[str, Any] = machine()
    names = tuple(sys.argv[1:]) or USUAL
    speed(about["reference_seconds"], names).show(Console(width=160))


if __name__ == "__main__":
    main()
