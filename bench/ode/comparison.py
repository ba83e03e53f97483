"""Comparison: the published algorithm on ODE and foldback's own, on one chain in one sitting."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from bench.machine import machine, processor_seconds, reference_seconds
from bench.ode.program import OdeMissingError, OdeRun, Solver, build, run
from bench.sections import Section
from foldback.planner.arrays import Array
from foldback.planner.certificate.plan_figures import distances_from_shape, rms
from foldback.planner.certificate.verdict import MAX_VERIFIED_ERROR_PITCH
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.clearance.sweep import sweep
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stage
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.progress import STAGES
from foldback.planner.readers import read
from foldback.planner.readers.gallery import Gallery, GalleryShape

STORED: Final = Path(__file__).parents[1] / "data" / "ode.json"
"""Figures that the README and the page /paper show."""
SHAPE: Final = "wrench-160"
"""Shape of the gallery that both methods fold."""
SOLVERS: Final = {
    "iterative": Solver(explosion_iterations=20, playback_iterations=20, steps_per_snapshot=10),
    "direct": Solver(explosion_iterations=20, playback_iterations=0, steps_per_snapshot=1),
}
"""Solvers of ODE. 20 iterations are its default. A step by the direct solver takes a hundred times
as long; docs/decisions/0057-published-on-ode.md compares them."""
BAR_SOLVER: Final = "iterative"
"""Solver of ODE with which foldback's time is compared: the faster one."""
OWN: Final = "foldback"
"""Id of foldback's own method."""
SIZES: Final = (0.99, 0.98, 0.97, 0.96, 0.95)
"""Module sizes that are tried, pitches: the first one at which a fold is verified is stated."""
OWN_RUNS: Final = 3
"""Number of runs of foldback's own method; the median of its times counts."""


MIN_SPEED_RATIO: Final = 200.0
"""Target of the benchmark: processor time of the published algorithm on ODE over that of foldback's
explosion and playback. Below it the target is reported as not met."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Figures of one method. Lengths in pitches, which are 1 cm on ODE.

    Attributes:
        id: ``foldback``, or a key of ``SOLVERS``.
        status: Status of the playback.
        robots: Number of robots whose playback is simulated.
        explosion_steps, playback_steps: Number of time steps; the playback's are of one robot.
        explosion_s, playback_s: Processor time, s; the playback's is that of all robots.
        references: Both times together over that of the reference run, see ``bench.machine``.
        lag_rad: Largest joint error of the playback, rad.
        end_error: RMS distance of the modules from the folded shape at the end.
        joint_gap: Largest distance by which a joint came apart in the playback.
        overlap: Deepest overlap of modules that are not linked in the playback.
        size: Largest of ``SIZES`` at which the fold is verified: the motions of the plan and of
            the playback are proved to be free of overlaps, and it ends in the folded shape.
    """

    id: str
    status: str
    robots: int
    explosion_steps: int
    playback_steps: int
    explosion_s: float
    playback_s: float
    references: float
    lag_rad: float
    end_error: float
    joint_gap: float
    overlap: float
    size: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """Figures of all methods, measured in one sitting.

    Attributes:
        machine: The machine, see ``bench.machine.machine``.
        date: Day of the measurement.
        rows: Figures of each method.
    """

    machine: dict[str, Any]
    date: str
    rows: tuple[Row, ...]

    @classmethod
    def load(cls, path: Path = STORED) -> Comparison:
        """Read stored figures."""
        values = json.loads(path.read_text(encoding="utf-8"))
        rows = tuple(Row(**row) for row in values["rows"])
        return cls(machine=values["machine"], date=values["date"], rows=rows)

    def save(self, path: Path = STORED) -> None:
        """Write the figures as JSON."""
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")

    def row(self, name: str) -> Row:
        """Return the figures of a method."""
        return next(row for row in self.rows if row.id == name)


def measure() -> Comparison:
    """Fold the shape by each method.

    Raises:
        OdeMissingError: The compiler or ODE is not installed.
    """
    about, shape = machine(), _shape()
    path = read(shape.data, filename=shape.filename)
    assert isinstance(path, CellPath)
    rows = (*_ode_rows(Chain.from_path(path)), _own_row(shape))
    return Comparison(machine=about, date=time.strftime("%Y-%m-%d"), rows=rows)


def measure_own(comparison: Comparison) -> Comparison:
    """Fold the shape by foldback's own method, and return the figures with its new row."""
    others = [row for row in comparison.rows if row.id != OWN]
    return replace(comparison, rows=(*others, _own_row(_shape())))


def _shape() -> GalleryShape:
    shape = Gallery().shape(SHAPE)
    assert shape is not None
    return shape


def _ode_rows(chain: Chain) -> Iterator[Row]:
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        program = build(Path(place))
        for name, solver in SOLVERS.items():
            before_s = reference_seconds()
            result = run(program, chain, solver, Path(place))
            reference_s = (before_s + reference_seconds()) / 2.0
            yield _ode_row(name, chain, result, reference_s)


def _ode_row(name: str, chain: Chain, result: OdeRun, reference_s: float) -> Row:
    explosion, playback = result.explosion, result.playback
    end_error = float("inf")
    if playback.status == "folded":
        end_error = rms(distances_from_shape(chain, result.frames_rad[-1]))
    motions = (result.snapshots_rad, result.frames_rad)
    return Row(
        id=name,
        status=playback.status,
        robots=1,
        explosion_steps=explosion.steps,
        playback_steps=playback.steps,
        explosion_s=explosion.processor_s,
        playback_s=playback.processor_s,
        references=(explosion.processor_s + playback.processor_s) / reference_s,
        lag_rad=result.max_angle_error_rad,
        end_error=end_error,
        joint_gap=playback.joint_gap_cm,
        overlap=playback.overlap_cm,
        size=next((size for size in SIZES if is_clear(chain, motions, size)), None)
        if end_error <= MAX_VERIFIED_ERROR_PITCH
        else None,
    )


def is_clear(chain: Chain, motions: Iterable[Array], size: float) -> bool:
    """Return True if motions of (F, J) hinge angles are proved to be free of overlaps."""
    return all(sweep(chain, motion, module_size=size).bound > 0.0 for motion in motions)


@dataclass(frozen=True, slots=True, kw_only=True)
class _OwnRun:
    """One run of foldback's own method: processor time and figures of each stage."""

    seconds: dict[str, float]
    results: dict[str, dict[str, Any]]

    @property
    def both_s(self) -> float:
        """Processor time of explosion and playback, s."""
        return self.seconds["explode"] + self.seconds["play_back"]


def _own_row(shape: GalleryShape) -> Row:
    """Fold by the default preset, repeatedly; the first run is not measured."""
    request, data = FoldRequest(filename=shape.filename), shape.data
    _fold(request, data)
    references: list[float] = [reference_seconds()]
    runs: list[_OwnRun] = []
    for _ in range(OWN_RUNS):
        runs.append(_fold(request, data))
        references.append(reference_seconds())
    median = sorted(runs, key=lambda run: run.both_s)[OWN_RUNS // 2]
    explosion, playback = median.results["explode"], median.results["play_back"]
    certificate = median.results["certify"]
    return Row(
        id=OWN,
        status=playback["status"],
        robots=Parameters().playback.robot.robots,
        explosion_steps=explosion["steps"],
        playback_steps=playback["steps"],
        explosion_s=median.seconds["explode"],
        playback_s=median.seconds["play_back"],
        references=median.both_s / statistics.median(references),
        lag_rad=playback["max_angle_error_rad"],
        end_error=playback["rms_position_error"],
        joint_gap=0.0,
        overlap=max(0.0, -certificate["min_clearance_playback"]),
        size=next((size for size in SIZES if _is_verified(request, data, size)), None),
    )


def _is_verified(request: FoldRequest, data: bytes, size: float) -> bool:
    return _fold(replace(request, module_size=size), data).results["certify"]["verified"]


def _fold(request: FoldRequest, data: bytes) -> _OwnRun:
    """Fold a shape in this process."""
    run = _OwnRun(seconds={}, results={})
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as place:
        Workspace(Path(place)).write_request(request, data)
        for stage in STAGES:
            start_s = processor_seconds()
            run.results[stage] = run_stage(stage, Path(place))
            run.seconds[stage] = processor_seconds() - start_s
    return run


def section(comparison: Comparison) -> Section:
    """Return the figures as a section of ``make bench``."""
    result = Section(name="ode", rows=[asdict(row) for row in comparison.rows])
    own = comparison.row(OWN)
    for name in SOLVERS:
        row = comparison.row(name)
        ratio = row.references / own.references
        has_bar = name == BAR_SOLVER
        result.add(
            f"{SHAPE}: explosion and playback, foldback and ODE ({name})",
            f"{own.references:.1f} r and {row.references:.0f} r: {ratio:.0f} times as fast",
            f"≥ {MIN_SPEED_RATIO:g} times" if has_bar else "",
            ratio >= MIN_SPEED_RATIO if has_bar else None,
        )
        result.add(
            f"{SHAPE}: largest joint error, foldback and ODE ({name})",
            f"{own.lag_rad:.2g} and {row.lag_rad:.2g} rad",
        )
    return result


def ode(reference: float) -> Section:
    """Measure both methods; without ODE, say what is missing."""
    del reference
    try:
        return section(measure())
    except OdeMissingError as error:
        missing = Section(name="ode")
        missing.add(f"{SHAPE}: the published algorithm on ODE", str(error), "measured", False)
        return missing
