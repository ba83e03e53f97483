"""Folds of short chains through all stages, and comparisons of their results."""

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.pipeline import certifying
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.moment_search import moments_of
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.plan.steps import find_steps
from foldback.planner.storage.file_names import CERTIFICATE, MOMENTS, PLAN, TIMELINE
from foldback.planner.storage.files import write_json
from tests.planner.chains import COIL


def write_request(directory: FilePath, data: bytes = write_path(COIL), **values: Any) -> FilePath:
    """Write the request for a fold, of a coil if no shape is given; return the directory."""
    directory.mkdir(parents=True, exist_ok=True)
    Workspace(directory).write_request(FoldRequest(**values), data)
    return directory


def run_fold(directory: FilePath, data: bytes = write_path(COIL), **values: Any) -> Plan:
    """Run all stages of a fold in a directory and return its plan."""
    run_stages(write_request(directory, data, **values))
    return Plan.load(directory / "plan.npz")


def untimed(value: Any) -> Any:
    """Return a value without its wall times."""
    if isinstance(value, dict):
        return {k: untimed(v) for k, v in value.items() if k != "seconds"}
    return [untimed(v) for v in value] if isinstance(value, (list, tuple)) else value


def compare_motions(first: Any, second: Any) -> None:
    """Compare all columns of two motions."""
    for name in type(first).__dataclass_fields__:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def intercept(
    monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, call: Callable[..., Any]
) -> None:
    """Replace a function by ``call``, which first gets the number of the call and the original."""
    original, numbers = getattr(owner, name), count(1)
    monkeypatch.setattr(owner, name, lambda *a, **extra: call(next(numbers), original, *a, **extra))


def falsify(monkeypatch: pytest.MonkeyPatch, times: int, **changes: Any) -> None:
    """Replace fields of the first ``times`` certificates."""

    def certify(number: int, original: Any, *arguments: Any, **extra: Any) -> Certificate:
        intercepted = original(*arguments, **extra)
        return replace(intercepted, **changes) if number <= times else intercepted

    intercept(monkeypatch, certifying, "certify", certify)


def write_resting_fold(directory: FilePath, plan: Plan) -> FilePath:
    """Write the directory of a fold whose plan rests between steps; nothing is computed."""
    directory.mkdir(parents=True)
    plan = replace(plan, certificate=replace(plan.certificate, frames=len(plan.time_s)))
    with TimelineWriter.create(directory / TIMELINE, plan.chain) as writer:
        writer.append(plan.motion)
    plan.save_npz(directory / PLAN)
    write_json(directory / CERTIFICATE, plan.certificate.as_dict())
    moments = moments_of(
        Timeline.open(directory / TIMELINE), module_size=0.95, direct=False, steps=find_steps(plan)
    )
    assert moments is not None
    write_json(directory / MOMENTS, moments.as_dict())
    return directory
