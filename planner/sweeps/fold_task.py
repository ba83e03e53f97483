"""Fold task: one fold of a sweep, from the bytes of a shape to the figures of a row."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from foldback.planner.chain.built_in_modules import document_of
from foldback.planner.errors import InputError
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.progress import STAGES, Cancelled
from foldback.planner.storage.file_names import ATTEMPTS, CHAIN
from foldback.planner.sweeps.case import TIME_LIMIT, Outcome, Row


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldTask:
    """Task of a case: a fold up to its certificate, and its files if they are kept.

    Attributes:
        data: Bytes of the shape.
        request: Request of the fold.
        keep: Folds whose files are kept: ``none``, ``failed`` or ``all``.
    """

    data: bytes = field(repr=False)
    request: FoldRequest
    keep: str = "none"

    def __call__(self, cancelled: Cancelled) -> Outcome:
        """Fold; return the figures of the row, and the files of a fold that is kept."""
        # Imported late: the command and its workers need nothing that computes.
        from foldback.planner.pipeline.stages import run_stage, run_stages
        from foldback.planner.pipeline.workspace import Workspace

        with tempfile.TemporaryDirectory(prefix="foldback-sweep-") as place:
            directory = Path(place)
            Workspace(directory).write_request(self.request, self.data)
            try:
                certificate = run_stages(directory, until=STAGES[-1], cancelled=cancelled)
            except InputError as error:
                verdict = f"refused: {error.code}"
                return Outcome(row={"verdict": verdict, "verified": False, "error": str(error)})
            row = _figures(directory, certificate)
            if cancelled() and not row["verified"]:
                row["verdict"] = TIME_LIMIT
            if self.keep == "none" or (self.keep == "failed" and row["verified"]):
                return Outcome(row=row)
            run_stage(STAGES[-1], directory)
            paths = [path for path in directory.rglob("*") if path.is_file()]
            files = {path.relative_to(directory).as_posix(): path.read_bytes() for path in paths}
            return Outcome(row=row, files=files)


def _figures(directory: Path, certificate: dict[str, Any]) -> Row:
    """Return the figures of a fold that has a certificate."""
    chain = json.loads((directory / CHAIN).read_bytes())
    attempts = json.loads((directory / ATTEMPTS).read_bytes())
    reason = certificate["reason"] or {}
    return {
        "module": document_of(chain["module"])["name"],
        "modules": chain["modules"],
        "verdict": certificate["verdict"],
        "verified": certificate["verified"],
        "simulated": certificate["simulated"],
        "reason": reason.get("code"),
        "clearance_bound_pitch": certificate["clearance_bound"],
        "min_clearance_pitch": certificate["min_clearance"],
        "frames": certificate["frames"],
        "steps": sum(attempt["steps"] for attempt in attempts),
        "attempts": len(attempts),
        "strategy": attempts[-1]["strategy"] if attempts else None,
        **({"table_torque_wp": table["torque"]} if (table := certificate.get("table")) else {}),
    }
