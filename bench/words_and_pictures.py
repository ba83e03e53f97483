"""Words and pictures: time of their preview, and verified folds at the first attempt."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from bench.command import fold
from bench.drawn_pictures import PICTURES
from bench.sections import Section
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare_in_any_order

WORDS: Final = (
    *("A", "Jo", "Mia", "Anna", "Peter", "Zoë 7", "Robots", "foldback", "I♥Robots"),
    *("Björn", "Françoise", "Łukasz", "Christopher", "Alexandrines"),
    *("Юля", "Мария", "Анастасия", "Σοφία", "Κωνσταντίνος", "שלום"),
)
"""Words of one to twelve letters in Latin, Cyrillic, Greek and Hebrew."""
MAX_PREVIEW_S: Final = 2.0
"""Bar for the longest preview, in s."""
MIN_VERIFIED: Final = 38
"""Bar for the inputs that are verified at the first attempt, of forty."""


def words_and_pictures(reference_seconds: float) -> Section:
    """Preview and fold each word and each picture with the default options."""
    del reference_seconds
    section = Section(name="words-and-pictures")
    with TemporaryDirectory(prefix="foldback-bench-") as directory:
        inputs = [(word, f"word:{word}".encode(), f"word:{word}") for word in WORDS]
        for name, draw in PICTURES.items():
            path = Path(directory) / name
            path.write_bytes(draw())
            inputs.append((name, path.read_bytes(), str(path)))
        for argument, data, _ in (inputs[0], inputs[-1]):  # imports do not count
            prepare_in_any_order(data, argument, PathOptions())
        for each in inputs:
            section.rows.append(_row(*each))
            print(section.rows[-1], flush=True)
    rows = section.rows
    previews = sorted(row["preview s"] for row in rows)
    first = sum(row["attempts"] == 1 and row["verified"] for row in rows)
    verified = sum(row["verified"] for row in rows)
    section.add(
        "longest preview, in the process",
        f"{previews[-1]:.2f} s, median {previews[len(previews) // 2]:.2f} s",
        f"≤ {MAX_PREVIEW_S:g} s",
        previews[-1] <= MAX_PREVIEW_S,
    )
    section.add(
        "verified at the first attempt",
        f"{first} of {len(rows)}, {verified} in all",
        f"≥ {MIN_VERIFIED}",
        first >= MIN_VERIFIED,
    )
    for name in ("preview processor s", "processor s", "wall s"):
        used = sorted(row[name] for row in rows)
        section.add(name, f"median {used[len(used) // 2]:.2f}, longest {used[-1]:.2f}")
    return section


def _row(name: str, data: bytes, argument: str) -> dict[str, Any]:
    """Return the figures of one word or picture."""
    start_s, used_s = time.perf_counter(), time.process_time()
    try:
        preparation = prepare_in_any_order(data, argument, PathOptions())
    except InputError as error:
        print(f"{name} is refused: {error.detail}", flush=True)
        preparation = None
    preview_s, preview_used_s = time.perf_counter() - start_s, time.process_time() - used_s
    run = fold(argument)
    likeness = None if preparation is None else preparation.likeness
    certificate = run.summary.get("certificate") or {}
    return {
        "input": name,
        "modules": 0 if preparation is None else len(preparation.cells),
        "likeness": "" if likeness is None else f"{likeness.iou:.2f}",
        "preview s": preview_s,
        "preview processor s": preview_used_s,
        "verified": run.code == 0,
        "attempts": run.summary.get("attempts", 0),
        "verdict": certificate.get("verdict", run.summary.get("status", "")),
        "processor s": run.processor_s,
        "wall s": run.wall_s,
    }
