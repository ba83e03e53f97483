"""Unfinished folds: what is shown of one that somebody or some limit has stopped."""

from __future__ import annotations

from math import isfinite
from pathlib import Path as FilePath
from typing import Any

from planner.explosion.diagnosis import stopped
from planner.pipeline.fold_layout import (
    CERTIFICATE,
    TIMELINE,
    certificate_values,
    last_frame,
    result,
)
from planner.pipeline.preference import COMPUTING, judgement
from planner.pipeline.workspace import Workspace


def settle(directory: FilePath) -> dict[str, Any]:
    """Of several attempts keeps the one that came farthest, and tells where it was.

    Args:
        directory: Of a fold that nothing computes any more.

    Returns:
        ``stuck``, as of ``Plan.summary``; of a plan that its certificate refuses ``explosion`` and
        ``certificate``. Empty when nothing was recorded.
    """
    workspace = Workspace(directory)
    workspace.publish(workspace.read_request().prefer if workspace.has_request else COMPUTING)
    certificate = certificate_values(directory / CERTIFICATE)
    verified, clearance = judgement(certificate)
    if isfinite(clearance) and not verified:
        record = workspace.read_record()
        return {
            "explosion": record and record.summary(),
            "certificate": certificate,
        }
    return stopped_where(directory)


def stopped_where(directory: FilePath) -> dict[str, Any]:
    """Where a fold ends that came to no plan, as ``settle`` tells it; touches nothing."""
    last = last_frame(result(directory, TIMELINE))
    return {} if last is None else {"stuck": stopped(*last).as_dict()}
