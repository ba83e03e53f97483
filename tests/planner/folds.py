"""Folds of quick chains, asked for and run to their end, and comparisons of what comes of them."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_files import write_path
from tests.planner.chains import COIL


def asked(directory: FilePath, data: bytes = write_path(COIL), **values: Any) -> FilePath:
    """Return a directory with the request for a fold, of a coil if no shape is given."""
    directory.mkdir(parents=True, exist_ok=True)
    Workspace(directory).write_request(FoldRequest(**values), data)
    return directory


def made(directory: FilePath, data: bytes = write_path(COIL), **values: Any) -> Plan:
    """Return the plan of a fold that has been through all stages in a directory."""
    run_stages(asked(directory, data, **values))
    return Plan.load(directory / "plan.npz")


def timeless(value: Any) -> Any:
    """Return a value without what a clock says."""
    if isinstance(value, dict):
        return {k: timeless(v) for k, v in value.items() if k != "seconds"}
    return [timeless(v) for v in value] if isinstance(value, (list, tuple)) else value


def same_motion(one: Any, other: Any) -> None:
    """Compare all columns of two motions."""
    for name in type(one).__dataclass_fields__:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
