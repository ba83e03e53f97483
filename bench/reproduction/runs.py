"""Runs: one experiment at a time, its figures as a row and its pictures as files."""

from __future__ import annotations

import json
import os
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.machine import processor, processor_seconds, reference_seconds
from bench.reproduction.experiments import Experiment, experiments
from bench.reproduction.pictures import Moment, keep_pictures
from bench.shape_files import SHAPES
from foldback.planner.errors import InputError
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.reasons import ReasonFigures
from foldback.planner.storage.files import write_whole
from foldback.planner.storage.plain_values import from_plain
from foldback.planner.sweeps.planner_digest import planner_digest
from foldback.web.timeline.view import TimelineView

STARTS_DIR: Final = Path(__file__).parents[2] / "out" / "reproduction"
"""Directory of plans that other experiments start from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """One simulation of a fold: its explosion or its playback.

    Attributes:
        status: Status at its end.
        steps: Number of time steps.
        simulated_s: Simulated time, s.
        wall_s: Wall time, s.
        frames: Number of snapshots of the explosion, or of stored frames of the playback.
    """

    status: str
    steps: int
    simulated_s: float
    wall_s: float
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """The largest overlap of two modules.

    Attributes:
        depth: Depth, pitches.
        modules: Numbers of the two modules.
        of: Motion that contains it: the ``plan``, or its simulated ``playback``.
        frame: Frame of the whole timeline, which may lie between two.
        share: Position in the fold, from 0 to 1.
    """

    depth: float
    modules: tuple[int, int]
    of: str
    frame: float
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Result of an experiment. Lengths in pitches.

    Attributes:
        id, asked: Values of the experiment.
        modules: Number of modules of the chain.
        module: Kind of the modules.
        verified: True if the fold is verified.
        verdict: Verdict of the certificate, or reason of a refusal.
        reason: Reason why the fold is not verified; None if it is, or if the input was refused.
        explosion, playback: Its simulations; None if there was none.
        wall_s: Wall time of all stages, from reading to written files, s.
        processor_s: Processor time of the same, s.
        rms: RMS position error at the end of the playback; None if it was not simulated.
        lag_rad: Largest joint error of the playback, rad.
        clearance_plan: Least clearance found in the plan.
        clearance_playback: Least clearance found in the simulated playback.
        bound: Proved lower bound of both; None if nothing is proved.
        overlap: Largest overlap of modules; None if there is none.
        stuck: Numbers of the modules at which an explosion stalled.
        folder_mb: Size of all files of the fold, MB.
        frames: Number of frames of the stored film; 0 without a film.
        stuck_frame: Frame of the film that shows the failure; None if it does not fail.
        planner: Version of the planner's code.
        cores, processor: Number of cores and processor of the machine.
        reference_s: Time of the reference run just before, s; see ``bench.machine``.
    """

    id: str
    asked: str
    modules: int
    module: str
    verified: bool
    verdict: str
    reason: ReasonFigures | None
    explosion: Phase | None
    playback: Phase | None
    wall_s: float
    processor_s: float
    rms: float | None
    lag_rad: float | None
    clearance_plan: float | None
    clearance_playback: float | None
    bound: float | None
    overlap: Overlap | None
    stuck: tuple[int, ...]
    folder_mb: float
    frames: int
    stuck_frame: int | None
    planner: str
    cores: int
    processor: str
    reference_s: float

    @property
    def refused(self) -> bool:
        """True if the input was refused."""
        return not self.verified and self.reason is None


def run(experiment: Experiment, files: Path) -> Run:
    """Run the fold of an experiment, and store its film and pictures.

    Args:
        experiment: The experiment.
        files: Directory for films and pictures, which get a subdirectory of their own.
    """
    reference_s = reference_seconds()
    with tempfile.TemporaryDirectory(prefix="foldback-reproduction-") as place:
        directory = Path(place)
        start_s, worked = time.perf_counter(), 0.0
        summary: dict[str, Any] | None = None
        try:
            _ask(directory, experiment)
            start_s, worked = time.perf_counter(), processor_seconds()
            summary = run_stages(directory)
            certificate = summary["certificate"]
            result = {name: certificate[name] for name in ("verified", "verdict", "reason")}
        except InputError as error:
            result = {"verified": False, "verdict": f"refused: {error.detail}", "reason": None}
        wall_s, processor_s = time.perf_counter() - start_s, processor_seconds() - worked
        return Run(
            id=experiment.id,
            asked=experiment.asked,
            **result,
            wall_s=round(wall_s, 2),
            processor_s=round(processor_s, 2),
            planner=planner_digest(),
            cores=os.cpu_count() or 1,
            processor=processor(),
            reference_s=round(reference_s, 3),
            **_figures(directory, experiment, summary, files),
        )


def _figures(
    directory: Path, experiment: Experiment, summary: dict[str, Any] | None, files: Path
) -> dict[str, Any]:
    """Return the figures in a run's directory; store its film and pictures."""
    if summary is None:
        return {
            **dict.fromkeys(("explosion", "playback", "rms", "lag_rad", "bound", "overlap")),
            **dict.fromkeys(("clearance_plan", "clearance_playback", "stuck_frame")),
            **{"modules": 0, "module": "", "stuck": (), "folder_mb": 0.0, "frames": 0},
        }
    certificate, playback = summary["certificate"], summary["playback"] or {}
    film = TimelineView(directory / "timeline")
    stages = {phase["name"]: (phase["from"], phase["to"]) for phase in film.outline()["phases"]}
    overlap = _overlap(certificate, stages, len(film))
    stuck = tuple((summary["stuck"] or {}).get("modules") or ())
    moment = None
    if overlap is not None:
        moment = Moment(frame=overlap.frame, modules=overlap.modules)
    elif not certificate["verified"]:
        moment = Moment(frame=float(len(film) - 1), modules=stuck)
    frames, stuck_frame = keep_pictures(
        film,
        files / experiment.id,
        moment=moment,
        strip=experiment.strip,
        straight=experiment.straight,
    )
    if any(experiment_run.start == experiment.id for experiment_run in experiments()):
        _keep_start(experiment.id, directory / "plan.npz")
    return {
        "modules": summary["modules"],
        "module": summary["module"],
        "explosion": _explosion(directory, summary["explosion"]),
        "playback": _playback(playback, film, _whole(stages)),
        "rms": playback.get("rms_position_error"),
        "lag_rad": playback.get("max_angle_error_rad"),
        "clearance_plan": certificate["min_clearance"],
        "clearance_playback": certificate["min_clearance_playback"],
        "bound": certificate["clearance_bound"],
        "overlap": overlap,
        "stuck": stuck,
        "folder_mb": round(_bytes(directory) / 1e6, 2),
        "frames": frames,
        "stuck_frame": stuck_frame,
    }


def _whole(stages: dict[str, tuple[int, int]]) -> tuple[int, int] | None:
    """Return the frames of a playback, with the unfolding of a refold; None without a playback."""
    stage_rows = [stages[name] for name in ("unfolding", "playback") if name in stages]
    return (stage_rows[0][0], stage_rows[-1][1]) if stage_rows else None


def _explosion(directory: Path, data: dict[str, Any]) -> Phase | None:
    record = Workspace(directory).read_record()
    if record is None:
        return None
    return _phase(data, record.frames.time_s, int(data["frames"]))


def _playback(
    data: dict[str, Any], film: TimelineView, frames: tuple[int, int] | None
) -> Phase | None:
    if not data.get("steps") or frames is None:
        return None
    return _phase(data, film.motion(*frames).time_s, frames[1] - frames[0])


def _phase(data: dict[str, Any], time_s: NDArray[np.float64], frames: int) -> Phase:
    return Phase(
        status=str(data["status"]),
        steps=int(data["steps"]),
        simulated_s=round(float(time_s[-1] - time_s[0]), 2),
        wall_s=round(float(data["seconds"]), 2),
        frames=frames,
    )


def _overlap(
    certificate: dict[str, Any], stages: dict[str, tuple[int, int]], total: int
) -> Overlap | None:
    """Return the largest overlap of the simulation, which pictures show; otherwise of the plan."""
    frames = _whole(stages)
    for of, name in (("playback", "min_clearance_playback"), ("plan", "min_clearance")):
        clearance, place = certificate[name], certificate[f"{name}_at"]
        if frames and clearance is not None and clearance < 0.0 and place and place["modules"]:
            a, b = place["modules"]
            return Overlap(
                depth=-float(clearance),
                modules=(int(a), int(b)),
                of=of,
                frame=min(frames[0] + float(place["frame"]), float(total - 1)),
                share=float(place["frame"]) / max(1, frames[1] - frames[0] - 1),
            )
    return None


def _ask(directory: Path, experiment: Experiment) -> None:
    shape = SHAPES / f"{experiment.shape}.json"
    refold = experiment.start is not None
    request = replace(experiment.request, filename=shape.name, refold=refold)
    if experiment.start is not None:
        Workspace(directory).write_start(_start(experiment))
    Workspace(directory).write_request(request, shape.read_bytes())


def _start(experiment: Experiment) -> Plan:
    """Return the plan that an experiment starts with; compute it if it is not stored."""
    (first,) = (candidate for candidate in experiments() if candidate.id == experiment.start)
    start_path = _start_file(first.id)
    if not start_path.exists():
        with tempfile.TemporaryDirectory(prefix="foldback-reproduction-") as place:
            _ask(Path(place), first)
            run_stages(Path(place))
            _keep_start(first.id, Path(place) / "plan.npz")
    return Plan.load(start_path)


def _keep_start(name: str, plan: Path) -> None:
    STARTS_DIR.mkdir(parents=True, exist_ok=True)
    write_whole(_start_file(name), plan.read_bytes())


def _start_file(name: str) -> Path:
    return STARTS_DIR / f"{name}-{planner_digest()}.npz"


def _bytes(directory: Path) -> int:
    return sum(path.stat().st_size for path in directory.rglob("*") if path.is_file())


def stored_runs(path: Path) -> dict[str, Run]:
    """Return the runs of a file by the id of their experiment."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    runs = [from_plain(json.loads(line), Run) for line in lines]
    return {run.id: run for run in runs}
