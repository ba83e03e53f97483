"""Remaining time: the error of the time that a service predicts for a running fold."""

from __future__ import annotations

import bisect
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from bench.sections import Section
from tests.server.service_process import Service

KNOWN_SHAPES: Final = (
    *("wrench-80", "mallet-160", "wrench-24", "cactus", "hammer", "ring", "boat", "elephant"),
    *("chair", "tower", "arrow", "anvil"),
)
"""Shapes that the service folds first, on which its predictions are based."""
PREDICTED_SHAPES: Final = (
    *("wrench-160", "wrench-94", "duck", "key", "table", "mallet-64", "cup", "whale", "star"),
    *("rocket", "sofa", "guitar"),
)
"""Shapes of the folds whose remaining time is predicted."""
CHECKED_AT: Final = (0.25, 0.5, 0.75)
"""Moments of the comparison, as fractions of the fold's whole time."""
MAX_MEDIAN_ERROR: Final = 0.25
"""Target of the benchmark: the predicted remaining time of running folds has a smaller median error
than this, as a fraction of the fold's duration. At or above it the target is reported as not
met."""


def remaining_time(reference_seconds: float) -> Section:
    """Fold the known shapes, then the others, and compare predictions with their ends."""
    del reference_seconds
    section = Section(name="remaining")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        service = Service(Path(folder) / "data", prewarm=True).start()
        try:
            service.wait_workers(1)
            for shape in KNOWN_SHAPES:
                service.wait_over(service.fold(shape=shape)["id"])
            for shape in PREDICTED_SHAPES:
                section.rows.append(_followed(service, shape))
        finally:
            service.stop()
    for at in CHECKED_AT:
        errors = [row["errors"][str(at)] for row in section.rows if str(at) in row["errors"]]
        if not errors:
            continue
        parts = [abs(error["error_s"]) / error["whole_s"] for error in errors]
        middle, worst = statistics.median(parts), max(parts)
        label = f"error of the time left after {at:.0%} of {len(errors)} folds, of the whole time"
        value_text = f"median {middle:.0%}, largest {worst:.0%}"
        section.add(
            label,
            value_text,
            bar=f"median < {MAX_MEDIAN_ERROR:.0%}",
            is_met=middle < MAX_MEDIAN_ERROR,
        )
        seconds = statistics.median(abs(error["error_s"]) for error in errors)
        section.add(f"the same in seconds after {at:.0%}", f"median {seconds:.1f} s")
    return section


def _followed(service: Service, shape: str) -> dict[str, Any]:
    """Fold a shape; return the errors of the predictions at the moments of comparison."""
    fold = service.fold(shape=shape)["id"]
    events: list[tuple[float, dict[str, Any]]] = []
    for name, data in service.events(fold):
        events.append((time.monotonic(), data))
        if name == "done":
            break
    first, last = events[0][0], events[-1][0]
    times = [moment for moment, _ in events]
    errors: dict[str, dict[str, float]] = {}
    for at in CHECKED_AT:
        now = first + at * (last - first)
        moment, data = events[bisect.bisect_right(times, now) - 1]
        if data["remaining_s"]:
            predicted_error_s = data["remaining_s"] - (now - moment)
            errors[str(at)] = {"error_s": predicted_error_s - (last - now), "whole_s": last - first}
    return {
        "shape": shape,
        "modules": events[-1][1]["modules"],
        "whole_s": last - first,
        "errors": errors,
    }
