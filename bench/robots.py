"""Published robots: each of their modules folds into three shapes."""

from __future__ import annotations

from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any, Final

from bench.machine import processor_seconds
from bench.sections import Section
from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.formats import read
from foldback.planner.readers.gallery import gallery

ROBOT_TAG: Final = "robot"
"""Tag of their shapes in the gallery."""
ROBOT_COUNT: Final = 5
SHAPE_COUNT: Final = 3
"""Bar: number of robots, and of shapes that each folds into."""
MIN_MODULES: Final = 8
"""Bar: number of modules of each chain."""


def robots(reference_seconds: float) -> Section:
    """Fold each chain file of a published robot with the default options."""
    section = Section(name="robots")
    section.rows = [
        _row(shape.data, shape.filename, reference_seconds)
        for shape in gallery()
        if ROBOT_TAG in shape.tags
    ]
    verified: dict[str, int] = {}
    for row in section.rows:
        counted = bool(row["verified"]) and row["modules"] >= MIN_MODULES
        verified[row["robot"]] = verified.get(row["robot"], 0) + counted
    complete = [robot for robot, count in verified.items() if count >= SHAPE_COUNT]
    section.add(
        f"robots that fold into {SHAPE_COUNT} shapes, verified",
        f"{len(complete)} of {len(verified)}: {', '.join(complete)}",
        f"{ROBOT_COUNT} of {ROBOT_COUNT}",
        len(complete) == ROBOT_COUNT,
    )
    return section


def _row(data: bytes, filename: str, reference_seconds: float) -> dict[str, Any]:
    before_s = processor_seconds()
    with TemporaryDirectory() as scratch:
        directory = FilePath(scratch)
        Workspace(directory).write_request(FoldRequest(filename=filename), data)
        try:
            run_stages(directory, workers=1)
            plan = Plan.load(directory / "plan.npz")
        except InputError as error:
            return _refused(data, filename, error)
    seconds = processor_seconds() - before_s
    certificate = plan.certificate
    return {
        "robot": plan.chain.module.name,
        "shape": plan.chain.name,
        "modules": len(plan.chain),
        "strategy": plan.attempts[-1]["strategy"],
        "attempts": len(plan.attempts),
        "verified": certificate.verified,
        "verdict": certificate.verdict,
        "bound": certificate.clearance_bound,
        "cpu s": round(seconds, 2),
        "ratio": round(seconds / reference_seconds, 2) if reference_seconds else None,
    }


def _refused(data: bytes, filename: str, error: InputError) -> dict[str, Any]:
    """Return the row of a chain that is refused."""
    chain: Any = read(data, filename=filename)
    return {
        "robot": chain.module.name,
        "shape": chain.name,
        "modules": len(chain),
        "strategy": None,
        "attempts": 0,
        "verified": False,
        "verdict": error.message,
        "bound": None,
        "cpu s": None,
        "ratio": None,
    }
