"""Success map: fraction of verified folds by method, kind of path and number of modules.

``make success-map`` runs the cases that are missing in ``data/success-map.jsonl`` and draws the
picture from that file. It can be stopped at any time and continues where it stopped; with
``--again`` it starts from the beginning. A run that takes longer than ``BUDGET_S`` of processor
time counts as not verified. The published method, whose time step is constant, has
``PAPER_BUDGET_S``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bench.success_map.picture import Shares, picture
from bench.success_map.stored import judge, run_missing
from foldback.planner.chain.path import Path
from foldback.planner.core import grow
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pathfinding.lattice import neighbours
from foldback.planner.pathfinding.path_search import find_paths
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.shapes.shape import Shape

Ints = NDArray[np.int64]
ROOT: Final = FilePath(__file__).parents[2]
RUNS_FILE: Final = FilePath(__file__).parents[1] / "data" / "success-map.jsonl"
"""File with one row for each run."""
PICTURE: Final = ROOT / "web" / "static" / "success-map.svg"
"""File of the picture, which the page /benchmarks shows."""
MODULE_SIZE: Final = 0.95
"""Size of the modules for which all folds of the success map must be free of collisions, as a
fraction of the pitch."""
BUDGET_S: Final = 60.0
"""Maximum processor time of one fold of the success map, in s, except with the published method;
beyond it the fold is ended and counts as not verified."""
PAPER_BUDGET_S: Final = 900.0
"""Maximum processor time of one fold of the success map by the published method, in s, which needs
more time as its time step is constant; beyond it the fold is ended and counts as not verified."""
MOVES_PER_MODULE: Final = 2000
"""Maximum number of random moves (backbite moves, which extend a path or turn its end) per module
in which a random path must fill its box; otherwise the case has no path."""
METHODS: Final = {
    "direct": {"preset": "direct"},
    "one-by-one": {"strategy": "one-by-one"},
    "paper": {"preset": "paper"},
    "simultaneous": {"strategy": "simultaneous"},
    "blocks": {"strategy": "blocks"},
    "peel": {"strategy": "peel"},
    "auto": {},
}
"""Methods of the map, with their options."""
BOXES: Final = {
    32: (2, 4, 4),
    64: (4, 4, 4),
    144: (4, 6, 6),
    288: (6, 6, 8),
    512: (8, 8, 8),
    1152: (8, 12, 12),
    4096: (16, 16, 16),
}
"""Sides of the boxes, in cells, by number of modules."""
RUNS_PER_KIND: Final = {32: 5, 64: 5, 144: 5, 288: 5, 512: 5, 1152: 1, 4096: 1}
"""Number of runs of each kind of path, by number of modules. Large ones take minutes each."""
RUNS_OF_SLOW_METHODS: Final = {"paper": 3, "direct": 3}
"""Number of runs of each kind of path with slow methods."""
RUN_ONCE_FROM_MODULES: Final = {"direct": 144}
"""Number of modules from which on a slow method is run only once."""
KINDS: Final = ("snake", "assembly", "block", "exact", "random")
"""Kinds of paths."""
RELATIVE_COSTS: Final = {"one-by-one": 1, "peel": 2, "auto": 4, "direct": 32, "paper": 64}
"""Approximate relative cost of a run by method; expensive runs come later."""
MAX_MODULES_OF_METHOD: Final = {
    "direct": 144,
    "paper": 512,
    "simultaneous": 1152,
    "blocks": 1152,
}
"""Maximum number of modules of a method; with more, it does not end within the budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One run: a box with a number of modules, filled by a kind of path and folded by a method."""

    method: str
    kind: str
    modules: int
    seed: int


def cases(largest: int) -> list[Case]:
    """Return all cases up to a number of modules, the cheapest first."""
    case_list = [
        Case(method=method, kind=kind, modules=modules, seed=seed)
        for modules in BOXES
        for method in METHODS
        for kind in KINDS
        for seed in range(_seeds(method, modules))
        if modules <= min(largest, MAX_MODULES_OF_METHOD.get(method, largest))
    ]
    return sorted(
        case_list,
        key=lambda case: case.modules * RELATIVE_COSTS.get(case.method, 8) * (1 + case.seed),
    )


def _seeds(method: str, modules: int) -> int:
    if modules >= RUN_ONCE_FROM_MODULES.get(method, modules + 1):
        return 1
    return RUNS_OF_SLOW_METHODS.get(method, RUNS_PER_KIND[modules])


def path_of(kind: str, sides: tuple[int, int, int], seed: int) -> Ints | None:
    """Return the (n, 3) cells of a box in the order of a path of a kind; None if none is found."""
    box = np.argwhere(np.ones(sides, dtype=bool))
    if kind == "snake":
        turned = np.roll(sides, seed)
        return layered_snake((int(turned[0]), int(turned[1]), int(turned[2])))
    if kind in ("assembly", "block"):
        method = "blocks" if kind == "block" else kind
        path_search = find_paths(Shape.from_cells(box), method=method, seed=seed, candidates=1)
        return path_search.paths[0].cells if path_search.paths else None
    if kind == "exact":
        path_search = find_paths(Shape.from_cells(box), method="exact", seed=seed, candidates=1)
        return path_search.paths[0].cells if path_search.paths else None
    count, order = grow(
        neighbours(box), np.ones(len(box), dtype=bool), -1, MOVES_PER_MODULE * len(box), seed
    )
    return box[order] if count == len(box) else None


def run(case: Case) -> dict[str, Any]:
    """Return the row of one case."""
    start_s = time.process_time()
    cells = path_of(case.kind, BOXES[case.modules], case.seed)
    outcome: dict[str, Any] = {
        **asdict(case),
        "verified": False,
        "simulated": None,
        "verdict": "no path",
        "seconds": 0.0,
    }
    if cells is None:
        return outcome
    start_s = time.process_time()
    budget_s = PAPER_BUDGET_S if case.method == "paper" else BUDGET_S

    def over() -> bool:
        return time.process_time() - start_s > budget_s

    path = Path.from_cells([tuple(cell) for cell in cells.tolist()], name="box")
    with tempfile.TemporaryDirectory() as place:
        directory = FilePath(place)
        request = FoldRequest(seed=case.seed, module_size=MODULE_SIZE, **METHODS[case.method])
        try:
            certificate = judge(directory, request, write_path(path), cancelled=over)
            outcome |= {name: certificate[name] for name in ("verified", "simulated", "verdict")}
        except InputError as error:
            outcome["verdict"] = f"refused: {error.code}"
    return {**outcome, "seconds": round(time.process_time() - start_s, 2)}


def shares(rows: list[dict[str, Any]]) -> Shares:
    """Count the verified folds by method, kind and modules; cases without a path are omitted."""
    case_shares: Shares = {}
    for row in rows:
        if row["verdict"] in ("no path", "refused: strategy-differs"):
            continue
        key = (row["method"], row["kind"], row["modules"])
        simulated, by_kinematics, count = case_shares.get(key, (0, 0, 0))
        case_shares[key] = (
            simulated + bool(row["verified"] and row["simulated"]),
            by_kinematics + bool(row["verified"] and not row["simulated"]),
            count + 1,
        )
    return case_shares


def show(rows: list[dict[str, Any]], console: Console) -> None:
    """Print the shares, a line for each kind and number of modules."""
    case_shares = shares(rows)
    grid = Table(title="verified folds", title_justify="left")
    for name in ("path", "modules", *METHODS):
        grid.add_column(name)
    for kind in KINDS:
        for modules in BOXES:
            cells = [case_shares.get((method, kind, modules)) for method in METHODS]
            if any(cells):
                texts = ["" if cell is None else f"{cell[0] + cell[1]}/{cell[2]}" for cell in cells]
                grid.add_row(kind, str(modules), *texts)
    console.print(grid)


def main() -> None:
    """Run what is missing, then print and draw all rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--largest", type=int, default=max(BOXES))
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--again", action="store_true", help="run all cases anew")
    options = parser.parse_args()
    if options.again:
        RUNS_FILE.unlink(missing_ok=True)
    rows = run_missing(
        RUNS_FILE, cases(options.largest), run, minutes=options.minutes, workers=options.workers
    )
    show(rows, Console())
    PICTURE.write_text(picture(shares(rows), tuple(METHODS), KINDS, tuple(BOXES)))


if __name__ == "__main__":
    # Imported by name: child processes cannot unpickle classes of a package's __main__.
    from bench.success_map.__main__ import main as begin

    begin()
