"""Stored sweeps: ``python -m bench.stored_sweeps NAME …`` folds what is missing and stores results.

- ``success-map`` stores the newest row of each fold, whatever version of the planner has computed
  it, and draws these rows for the page /benchmarks.
- ``gallery`` stores the results of the gallery with the default options.
- ``table`` stores the results of shapes of up to 64 cubes on a table, which the gallery shows.

It can be stopped at any time and continues where it stopped.
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from bench.sweep_sections import OUT, SPECS, Row, current_rows, fold_missing
from foldback.planner.storage.files import write_whole
from foldback.planner.sweeps.map import SweepMap
from foldback.planner.sweeps.rows import ROWS_DIR, Rows
from foldback.planner.sweeps.spec import SweepSpec

ROOT: Final = Path(__file__).parents[1]
RESULTS: Final = {
    "gallery": ROOT / "examples" / "results.json",
    "table": ROOT / "examples" / "table_results.json",
}
"""Files with the results of sweeps of the gallery."""
RESULTS_FORMAT: Final = "foldback-results/1"
MAP: Final = "success-map"
"""Name of the success map's sweep."""
MAP_ROWS: Final = ROOT / "bench" / "data" / "success-map.jsonl"
"""File with the newest row of each fold of the success map, in the format of a sweep."""
PICTURE: Final = ROOT / "web" / "static" / "success-map.svg"
"""File of the success map, which the page /benchmarks shows."""
FOLD: Final = ("group", "shape", "method", "seed")
"""Columns that name a fold, whatever version of the planner has computed it."""
MAP_NAMES: Final = {
    "method": {
        "direct": "joints turned directly",
        "one-by-one": "one hinge at a time",
        "paper": "as in the paper",
        "simultaneous": "all at once",
        "blocks": "blocks first",
        "peel": "from one end",
        "auto": "automatic",
    },
    "group": {
        "snake": "row by row",
        "assembly": "removable",
        "block": "2×2×2",
        "exact": "searched",
        "random": "random",
    },
}
"""Names of methods and of kinds of paths in the success map, by column and by name in the spec."""


def store_results(name: str) -> None:
    """Store the result of each shape of the gallery, one per line."""
    results = results_of(current_rows(name))
    lines = [f"    {json.dumps(shape)}: {json.dumps(results[shape])}" for shape in sorted(results)]
    head = f'{{\n  "format": "{RESULTS_FORMAT}",\n  "shapes": {{\n'
    write_whole(RESULTS[name], (head + ",\n".join(lines) + "\n  }\n}\n").encode())


def results_of(rows: list[Row]) -> dict[str, Row]:
    """Return the result of each shape: that of its last seed, with the attempts of all seeds."""
    results: dict[str, Row] = {}
    for row in sorted(rows, key=lambda row: row["seed"]):
        earlier = results.get(row["shape"], {"attempts": 0})
        results[row["shape"]] = {
            "modules": row["modules"],
            "verified": row["verified"],
            "verdict": row["verdict"],
            "seed": row["seed"],
            "attempts": earlier["attempts"] + (row.get("attempts") or 0),
            "clearance": row.get("min_clearance_pitch"),
            "torque_wp": row.get("table_torque_wp"),
            "cpu_s": row.get("cpu_s"),
            "digest": row["shape_digest"],
        }
    return results


def store_map() -> None:
    """Store the newest row of each fold of the success map, and draw these rows."""
    rows = Rows(OUT / MAP).read().values()
    newest = {tuple(str(row[column]) for column in FOLD): row for row in rows}
    stored = [newest[fold] | {"host": ""} for fold in sorted(newest)]
    write_whole(MAP_ROWS, "".join(json.dumps(row) + "\n" for row in stored).encode())
    write_whole(PICTURE, map_of(stored).encode())


def map_of(rows: list[Row]) -> str:
    """Return the picture of the success map."""
    spec = SweepSpec.from_toml(SPECS / f"{MAP}.toml")
    methods, groups = MAP_NAMES["method"], MAP_NAMES["group"]
    renamed = replace(
        spec,
        methods={methods[name]: part for name, part in spec.methods.items()},
        shapes={groups[name]: part for name, part in spec.shapes.items()},
    )
    shown = [{**row, **{by: MAP_NAMES[by][row[by]] for by in MAP_NAMES}} for row in rows]
    return SweepMap.of(renamed, shown).picture()


def main() -> None:
    """Fold what is missing of the sweeps that the command line names, and store them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="+", choices=[MAP, *RESULTS], metavar="NAME")
    parser.add_argument("--as-is", action="store_true", help="fold nothing, store what is there")
    options = parser.parse_args()
    for name in options.names:
        stored_earlier = OUT / name / ROWS_DIR / "0000.jsonl"
        if name == MAP and not stored_earlier.exists():
            stored_earlier.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(MAP_ROWS, stored_earlier)
        if not options.as_is:
            fold_missing(name)
        store_map() if name == MAP else store_results(name)


if __name__ == "__main__":
    main()
