"""Sections whose folds are sweeps, by the specs in ``bench/sweeps``.

A section folds what is missing in ``out/sweeps``, so it can be stopped at any time and continues
where it stopped; ``foldback sweep bench/sweeps/seeds.toml --out out/sweeps/seeds`` does the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from bench.sections import Section
from bench.shape_files import write_shapes
from foldback.planner.sweeps.executors import Place
from foldback.planner.sweeps.planner_digest import planner_digest
from foldback.planner.sweeps.rows import Rows
from foldback.planner.sweeps.spec import SweepSpec
from foldback.planner.sweeps.sweep import SweepState

SPECS: Final = Path(__file__).parent / "sweeps"
"""Directory of the specs."""
OUT: Final = Path(__file__).parents[1] / "out" / "sweeps"
"""Directory of the sweeps' own directories."""
MIN_VERIFIED_AT_ONCE: Final = 0.98
"""Target of the benchmark: at least this fraction of folds is verified at the first attempt: of the
gallery's shapes with the first seed, and of the gallery and of meshes over all seeds. Below it the
target is reported as not met."""
MIN_PUBLISHED: Final = 24
"""Target of the benchmark: at least this number of 25 folds by the published algorithm (20 random
paths and 5 shapes of the paper) is verified. Below it the target is reported as not met."""
PAPER_STEPS: Final = 160_000
"""Number of time steps in which the published algorithm folds the wrench of 160 modules (section 4
of the paper that docs/reproduction.md names). It is only printed for comparison with the number of
steps here."""
COLUMNS: Final = (
    *("group", "shape", "modules", "method", "seed", "verdict", "attempts", "strategy", "steps"),
    *("clearance_bound_pitch", "min_clearance_pitch", "cpu_s", "wall_s"),
)
"""Columns of a sweep's rows that sections show."""
Row = dict[str, Any]


def swept(name: str) -> list[Row]:
    """Fold what is missing of a sweep; return all rows of this version of the planner."""
    fold_missing(name)
    return current_rows(name)


def fold_missing(name: str) -> None:
    """Fold what is missing of a sweep."""
    write_shapes()
    spec = SweepSpec.from_toml(SPECS / f"{name}.toml")
    with SweepState.opened(spec, OUT / name) as sweep:
        for row in sweep.compute(Place()):
            print(*(row.get(name) for name in ("shape", "method", "seed", "verdict")), flush=True)


def current_rows(name: str) -> list[Row]:
    """Return the rows of a sweep by this version of the planner."""
    rows = Rows(OUT / name).read().values()
    return [row for row in rows if row["planner_digest"] == planner_digest()]


def section_of(name: str, rows: list[Row]) -> Section:
    """Return a section that shows rows, without figures."""
    shown = [{column: row.get(column) for column in COLUMNS} for row in rows]
    return Section(name=name, rows=shown)


def add_verified(section: Section, label: str, rows: list[Row], bar: int | None = None) -> None:
    """Add the number of verified folds; the bar is a number, or all."""
    count = sum(row["verified"] for row in rows)
    section.add(
        label,
        f"{count} of {len(rows)}",
        "all" if bar is None else f"≥ {bar}",
        count >= (len(rows) if bar is None else bar),
    )


def add_verified_at_once(section: Section, label: str, rows: list[Row]) -> None:
    """Add the number of folds that are verified at the first attempt."""
    at_once = sum(row["verified"] and row.get("attempts") == 1 for row in rows)
    share = at_once / len(rows)
    section.add(
        label,
        f"{at_once} of {len(rows)} ({100 * share:.1f} %)",
        f"at least {100 * MIN_VERIFIED_AT_ONCE:.0f} %",
        share >= MIN_VERIFIED_AT_ONCE,
    )


def add_times(section: Section, label: str, rows: list[Row], column: str) -> None:
    """Add the median and the longest of some times, which lost folds do not have."""
    times_s = sorted(row[column] for row in rows if column in row)
    text = f"{times_s[len(times_s) // 2]:.1f} s, {times_s[-1]:.1f} s"
    section.add(f"{label}, median and most", text, "reported")


def gallery(reference_seconds: float) -> Section:
    """Fold every shape of the gallery; retry with other seeds where the first one fails."""
    del reference_seconds
    return gallery_section(swept("gallery"))


def gallery_section(rows: list[Row]) -> Section:
    """Return the figures of the gallery's folds, of which the last seed of each shape counts."""
    by_seed = sorted(rows, key=lambda row: row["seed"])
    last = list({row["shape"]: row for row in by_seed}.values())
    section = section_of("gallery", last)
    add_verified_at_once(section, "verified at once", [row for row in rows if row["seed"] == 0])
    add_verified(section, "verified with retries", last)
    add_times(section, "wall", rows, "wall_s")
    return section


def seeds(reference_seconds: float) -> Section:
    """Fold every shape of the gallery, and ten meshes, with five seeds."""
    del reference_seconds
    return seeds_section(swept("seeds"))


def seeds_section(rows: list[Row]) -> Section:
    """Return the figures of all rows, and the rows not verified at the first attempt."""
    section = section_of(
        "seeds", [row for row in rows if row.get("attempts") != 1 or not row["verified"]]
    )
    for group in dict.fromkeys(row["group"] for row in rows):
        of_group = [row for row in rows if row["group"] == group]
        add_verified_at_once(section, f"{group}: verified at once", of_group)
        add_verified(section, f"{group}: verified with the portfolio", of_group)
        add_times(section, f"{group}: processor", of_group, "cpu_s")
    return section


def published(reference_seconds: float) -> Section:
    """Fold random paths and shapes of the paper by the published method."""
    del reference_seconds
    section = section_of("published", rows := swept("published"))
    add_verified(section, "verified with the published recipe", rows, MIN_PUBLISHED)
    return section


def baselines(reference_seconds: float) -> Section:
    """Fold shapes by direct servoing, which usually fails, and by the published method."""
    del reference_seconds
    section = section_of("baselines", rows := swept("baselines"))
    for method in ("direct", "paper"):
        of_method = [row for row in rows if row["method"] == method]
        verified = sum(row["verified"] for row in of_method)
        section.add(f"verified with {method}", f"{verified} of {len(of_method)}", "reported")
    section.add("published, 160 modules", f"about {PAPER_STEPS} steps")
    return section
