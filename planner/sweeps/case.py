"""A case of a sweep: a computation with limits, and the row that it becomes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from foldback.planner.progress import Cancelled

TIME_LIMIT: Final = "time limit"
MEMORY_LIMIT: Final = "memory limit"
"""Verdicts of cases that have used up their wall or processor time, or their memory."""
ERROR: Final = "error"
"""Verdict of a case whose computation has raised an error."""
LOST: Final = "lost"
"""Verdict of a case that its executor has given up, such as one whose machines all ended."""
Value = str | int | float | bool | None
Row = dict[str, Value]
"""A row of a sweep's table: values by the names of their columns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of the process that computes a case.

    Attributes:
        cpu_s: Processor time, s, after which the computation is asked to end. It is killed after
            twice this time and ``CPU_GRACE_S``, for code that does not ask.
        wall_s: Wall time, s, after which the process is killed.
        memory_bytes: Resident memory, in bytes, beyond which the process is killed.
    """

    cpu_s: float = 60.0
    wall_s: float = 300.0
    memory_bytes: int = 2 * 2**30


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Row of a case, and the files of its plan.

    Attributes:
        row: Values of the case's row.
        files: Contents of the files that are stored in ``Case.files_dir``, by their paths relative
            to it.
    """

    row: Row
    files: dict[str, bytes] = field(default_factory=dict[str, bytes])


Task = Callable[[Cancelled], Row | Outcome]
"""Computation of a case. It can be pickled, and is called in a process of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A case of a sweep.

    Attributes:
        key: Identifies the case and its inputs: equal keys have equal results.
        columns: Values that its row has whatever happens; those of the task replace them.
        task: Computes the row.
        limits: Limits of its process.
        planner_digest: Digest of the planner that computes it; empty for any.
        files_dir: Directory for the files of the outcome, on the machine of the command; None to
            store none.
    """

    key: str
    columns: Row
    task: Task
    limits: Limits = Limits()
    planner_digest: str = ""
    files_dir: Path | None = None
