"""Store of golden digests: one file for each machine, named by the machine's key."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Any, Final

from foldback.planner.pipeline.derived_files import complete
from tests.golden.cases import CASES
from tests.golden.digests import Digests, Values, digests, summary
from tests.golden.machine import machine, machine_key

STORED_DIR: Final = FilePath(__file__).parent / "stored"
RELATIVE_TOLERANCE: Final = 0.25
"""Maximum relative difference of a figure between two machines; a larger one may be a fault."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of one case.

    Attributes:
        summary: Readable figures.
        digests: Digests of all parts.
    """

    summary: Values
    digests: Digests

    @classmethod
    def from_directory(cls, directory: FilePath) -> "Result":
        """Return the result of a fold in a directory."""
        return cls(summary=summary(directory), digests=digests(directory))


def compute(name: str) -> Result:
    """Fold one case in a directory of its own."""
    with TemporaryDirectory(prefix="golden-") as place:
        CASES[name].fold(FilePath(place))
        complete(FilePath(place))
        return Result.from_directory(FilePath(place))


def load(name: str) -> tuple[Result | None, list[Result]]:
    """Return the stored result of a case for this machine, and those of all machines."""
    own_file = STORED_DIR / f"{machine_key(machine())}.json"
    everywhere: dict[FilePath, Result] = {}
    for path in sorted(STORED_DIR.glob("*.json")):
        folds = json.loads(path.read_bytes())["folds"]
        if name in folds:
            everywhere[path] = Result(**folds[name])
    return everywhere.get(own_file), list(everywhere.values())


def save(results: dict[str, Result]) -> FilePath:
    """Store results for this machine; stored results of other cases remain."""
    values = machine()
    path = STORED_DIR / f"{machine_key(values)}.json"
    earlier = json.loads(path.read_bytes())["folds"] if path.exists() else {}
    new = {name: asdict(result) for name, result in results.items()}
    folds = {name: (earlier | new)[name] for name in CASES if name in earlier | new}
    text = json.dumps({"machine": values, "folds": folds}, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
    return path


def summary_differences(stored: Values, computed: Values) -> list[str]:
    """Return the figures of a summary that differ by more than they may between machines."""
    return [
        f"{name}: got {computed.get(name)!r}, expected {stored.get(name)!r}"
        for name in dict.fromkeys((*stored, *computed))
        if not _is_close(stored.get(name), computed.get(name))
    ]


def _is_close(first: Any, second: Any) -> bool:
    numbers = isinstance(first, (int, float)) and isinstance(second, (int, float))
    if not numbers:
        return bool(first == second)
    return abs(first - second) <= RELATIVE_TOLERANCE * max(abs(first), abs(second))
