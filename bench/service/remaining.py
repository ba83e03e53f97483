"""Remaining: how far off the time is that a service says a fold still takes."""

from __future__ import annotations

import bisect
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from bench.tables import Section
from tests.server.service import Service

KNOWN: Final = (
    *("wrench-80", "mallet-160", "wrench-24", "cactus", "hammer", "ring", "boat", "elephant"),
    *("chair", "tower", "arrow", "anvil"),
)
"""Shapes that the service has folded before."""
ASKED: Final = (
    *("wrench-160", "wrench-94", "duck", "key", "table", "mallet-64", "cup", "whale", "star"),
    *("rocket", "sofa", "guitar"),
)
"""Shapes that are asked for after those."""
AT: Final = (0.25, 0.5, 0.75)
BAR: Final = 0.25
"""Median error, as part of a fold's whole time, that is good enough."""


def remaining(reference_seconds: float) -> Section:
    """Folds some shapes, then others, and compares what was said with when they were over."""
    del reference_seconds
    section = Section(name="remaining")
    with tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder:
        service = Service(Path(folder) / "data", prewarm=True).start()
        try:
            service.wait_workers(1)
            for shape in KNOWN:
                service.wait_over(service.fold(shape=shape)["id"])
            for shape in ASKED:
                section.rows.append(_followed(service, shape))
        finally:
            service.stop()
    for at in AT:
        errors = [row["errors"][str(at)] for row in section.rows if str(at) in row["errors"]]
        if not errors:
            continue
        parts = [abs(each["error_s"]) / each["whole_s"] for each in errors]
        middle, worst = statistics.median(parts), max(parts)
        what = f"error of the time left after {at:.0%} of {len(errors)} folds, of the whole time"
        found = f"median {middle:.0%}, largest {worst:.0%}"
        section.add(what, found, bar=f"median < {BAR:.0%}", met=middle < BAR)
        seconds = statistics.median(abs(each["error_s"]) for each in errors)
        section.add(f"the same in seconds after {at:.0%}", f"median {seconds:.1f} s")
    return section


def _followed(service: Service, shape: str) -> dict[str, Any]:
    """One fold: all that was said of it, and how far off that was at some of its moments."""
    fold = service.fold(shape=shape)["id"]
    told: list[tuple[float, dict[str, Any]]] = []
    for name, data in service.events(fold):
        told.append((time.monotonic(), data))
        if name == "done":
            break
    first, last = told[0][0], told[-1][0]
    times = [moment for moment, _ in told]
    errors: dict[str, dict[str, float]] = {}
    for at in AT:
        now = first + at * (last - first)
        moment, data = told[bisect.bisect_right(times, now) - 1]
        if data["remaining_s"]:
            said = data["remaining_s"] - (now - moment)
            errors[str(at)] = {"error_s": said - (last - now), "whole_s": last - first}
    return {
        "shape": shape,
        "modules": told[-1][1]["modules"],
        "whole_s": last - first,
        "errors": errors,
    }
