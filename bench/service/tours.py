"""Tours: each sentence of drafted tours of the gallery is compared with the motion and certificate.

``python -m bench.service.tours [N]`` folds the gallery, or its first N shapes, and drafts a tour of
each fold. The statements are computed again by other means: distances by linear programs and
SciPy's SLSQP, figures from ``certificate.json``. Only knots use the same test as paths.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.optimize import LinearConstraint, linprog, minimize

from bench.machine import machine
from bench.processes import each_of
from bench.sections import Section
from bench.shape_files import SHAPES
from foldback.cli.tour import drafted, facts_of
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.tour import Stop
from foldback.planner.storage.file_names import CERTIFICATE, DERIVED_FILES, FIGURES, TIMELINE
from foldback.planner.storage.files import json_of
from foldback.words.certificate import CERTIFICATE_DIGITS
from foldback.words.quantities import quantity
from foldback.words.tour import StopKind, draft_stops

Array = NDArray[np.float64]
MAX_DRAFT_S: Final = 1.0
"""Target of the benchmark: composing the guided tour of a fold (captions at selected frames) takes
at most this wall time, in s, with the search for the frames. Above it the target is reported as not
met."""
DRAFTS_PER_TOUR: Final = 3
"""Number of times that the guided tour of each fold is composed; the fastest counts, as other
processes only slow some of them down."""
STRAIGHT_TOLERANCE: Final = 1e-9
"""Tolerance for rounding errors with which the benchmark checks a caption that calls a chain
straight: all joint angles, in rad, and, of cubes, the differences between the vectors from each
module's centre to the next, in pitches, must be smaller."""


def tours(reference_seconds: float, count: int | None = None) -> Section:
    """Draft tours of the gallery's folds and check each sentence."""
    paths = sorted(SHAPES.glob("*.json"))[:count]
    section = Section(name="tours")
    section.rows = list(each_of(_folded_and_told, paths))
    wrong = [row for row in section.rows if row["wrong"]]
    stops = sum(row["stops"] for row in section.rows)
    slowest = max(row["s"] for row in section.rows)
    section.add("tours drafted", f"{len(section.rows)}, {stops} stops", f"{len(paths)}")
    section.add("tours with a wrong sentence", str(len(wrong)), "0", not wrong)
    section.add("slowest draft", f"{slowest:.2f} s", f"≤ {MAX_DRAFT_S:g} s", slowest <= MAX_DRAFT_S)
    section.add("the same, in reference runs", f"{slowest / reference_seconds:.2f}")
    return section


def _folded_and_told(path: FilePath) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        request = FoldRequest(filename=path.name)
        directory = FilePath(folder)
        Workspace(directory).write_request(request, path.read_bytes())
        run_stages(directory)
        seconds = min(_seconds(directory) for _ in range(DRAFTS_PER_TOUR))
        fold = _Fold.of(directory)
        stops = draft_stops(*facts_of(directory))
        wrong = [stop.caption for kind, stop in stops if not fold.is_true(kind, stop)]
    return {"shape": path.stem, "stops": len(stops), "wrong": wrong, "s": round(seconds, 3)}


def _seconds(directory: FilePath) -> float:
    for name in DERIVED_FILES:  # so that the search for moments is timed, too
        path = directory / name
        rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
    start_s = time.perf_counter()
    drafted(directory)
    return time.perf_counter() - start_s


@dataclass(frozen=True, slots=True)
class _Fold:
    """A finished fold, with the figures that sentences are compared with."""

    timeline: Timeline
    chain: Chain
    certificate: dict[str, Any]
    figures: FilePath

    @classmethod
    def of(cls, directory: FilePath) -> _Fold:
        """Read a fold from its directory."""
        timeline = Timeline.open(result_path(directory, TIMELINE))
        values = json_of(directory / CERTIFICATE)
        return cls(timeline, timeline.chain, values, result_path(directory, FIGURES))

    def is_true(self, kind: StopKind, stop: Stop) -> bool:
        """Return True if the frame, the modules and the numbers of a stop are right."""
        checks: dict[StopKind, Callable[[Stop], bool]] = {
            "unfolding": self._unfolding,
            "straight": self._straight,
            "contact": self._contact,
            "tightest": self._tightest,
            "knot": self._knot,
            "torque": self._torque,
            "direct": self._direct,
            "end": self._end,
        }
        return checks[kind](stop)

    def _unfolding(self, stop: Stop) -> bool:
        return stop.frame == stop.first == 1 and self._is_straight(stop.last or 0)

    def _straight(self, stop: Stop) -> bool:
        return (
            self._is_straight(stop.frame - 1)
            and f"{len(self.chain)} " in stop.caption
            and f"with {self.chain.joint_count} joints" in stop.caption
        )

    def _is_straight(self, index: int) -> bool:
        frame = self.timeline.frames(index, index + 1)
        centres = frame.poses(self.chain).positions[0]
        steps = np.diff(centres, axis=0)
        even = (
            np.abs(steps - steps[0]).max() < STRAIGHT_TOLERANCE or self.chain.module.name != "cube"
        )
        return bool(even and np.abs(frame.joint_angles_rad).max() < STRAIGHT_TOLERANCE)

    def _contact(self, stop: Stop) -> bool:
        first, second = sorted(stop.modules)
        at, before = (
            self._distance(stop.frame - frames_back, first, second) for frames_back in (1, 2)
        )
        return second - first >= 3 and at < 0.1 <= before + 1e-6

    def _tightest(self, stop: Stop) -> bool:
        min_clearance = self.certificate["min_clearance"]
        first, second = stop.modules
        return (
            [first - 1, second - 1] == self.certificate["min_clearance_at"]["modules"]
            and self._distance(stop.frame - 1, first, second) <= min_clearance + 0.05
            and f"{100 * min_clearance:.3g} %" in stop.caption
            and self._proved in stop.caption
        )

    def _knot(self, stop: Stop) -> bool:
        frames = [self.timeline.frames(k, k + 1) for k in (stop.frame - 2, stop.frame - 1)]
        verdicts = [knot_of(frame.poses(self.chain).positions[0]).verdict for frame in frames]
        return verdicts == ["unknot", "knotted"]

    def _torque(self, stop: Stop) -> bool:
        first, second = stop.modules
        value = quantity(self.certificate["peak_torque_nm"], "N·m", CERTIFICATE_DIGITS)
        return second == first + 1 and f": {value}" in stop.caption

    def _direct(self, stop: Stop) -> bool:
        """Look for the first per cent of the motion at which the modules overlap."""
        first, second = sorted(stop.modules)
        percent = next(
            (
                share
                for share in range(1, 101)
                if self._distance_at(share / 100 * self.chain.folded_rad, first, second) <= 0.0
            ),
            None,
        )
        return percent is not None and f"after {percent} %" in stop.caption

    def _end(self, stop: Stop) -> bool:
        time = f"{self.certificate['fold_time_s']:.3g} s"
        return (
            stop.frame == len(self.timeline)
            and time in stop.caption
            and self._proved in stop.caption
        )

    @property
    def _proved(self) -> str:
        """Proved clearance in % of the spacing, rounded down."""
        tenths = math.floor(1000 * self.certificate["clearance_bound"] + 1e-6)
        return f"{tenths / 10:.1f} %"

    def _distance(self, frame: int, first: int, second: int) -> float:
        poses = self.timeline.frames(frame, frame + 1).poses(self.chain)
        return self._gap(poses.positions[0], poses.rotations[0], first, second)

    def _distance_at(self, angles: Array, first: int, second: int) -> float:
        upright = np.array([[1.0, 0.0, 0.0, 0.0]])
        poses = self.chain.poses(angles[None], np.zeros((1, 3)), upright)
        return self._gap(poses.positions[0], poses.rotations[0], first, second)

    def _gap(self, centres: Array, rotations: Array, first: int, second: int) -> float:
        """Return the distance of two modules; 0 when they overlap."""
        size = float(self.certificate.get("module_size", 1.0))
        one, other = (
            [
                part.placed(centres[k - 1], rotations[k - 1], size=size)
                for part in self.chain.module.piece(k - 1).parts
            ]
            for k in (first, second)
        )
        return min(_distance(p.corners, q.corners) for p in one for q in other)


def _distance(a: Array, b: Array) -> float:
    """Return the distance of two convex hulls; 0 when they overlap (an LP finds a common point)."""
    unit_row, zeros = np.ones((1, len(a))), np.zeros((1, len(a)))
    weights = np.block([[a.T, -b.T], [unit_row, zeros], [zeros, unit_row]])
    if linprog(np.zeros(len(a) + len(b)), A_eq=weights, b_eq=[0, 0, 0, 1, 1]).status == 0:
        return 0.0
    difference = np.vstack([a, -b])

    def squared(w: Array) -> float:
        return float(((difference.T @ w) ** 2).sum())

    optimum = minimize(
        squared,
        np.full(len(difference), 1.0 / len(a)),
        bounds=[(0.0, 1.0)] * len(difference),
        constraints=LinearConstraint(weights[3:], 1.0, 1.0),
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return float(np.sqrt(optimum.fun))


def main() -> None:
    """Check the tours of the gallery's first folds."""
    about = machine()
    section = tours(about["reference_seconds"], int(sys.argv[1]) if len(sys.argv) > 1 else None)
    console = Console(width=160)
    console.print(about)
    section.show(console)


if __name__ == "__main__":
    main()
