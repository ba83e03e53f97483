"""The paper's experiments: run once, stored with pictures, and reported with their results."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.reproduction.__main__ import DOCUMENT, PAPER
from bench.reproduction.different import CHOSEN_SHAPES, different_shapes, measured
from bench.reproduction.document import document
from bench.reproduction.experiments import STATEMENTS, Experiment, experiments
from bench.reproduction.number_text import figure
from bench.reproduction.page_text import told
from bench.reproduction.reproduce import reproduce, tell
from bench.reproduction.runs import stored_runs
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.shape_writers import write_path
from foldback.web.palette import STALLED_RGB

pytestmark = pytest.mark.slow

SQUARE = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (0, 1, 0), (0, 2, 0), (1, 2, 0)]
SPIRAL = [(x, 0, 0) for x in range(4)] + [(3, 1, 0), (3, 2, 0)]
SPIRAL += [(x, 3, 0) for x in (3, 2, 1, 0)] + [(0, 2, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
SPIRAL += [(2, 2, 0), (1, 2, 0)]


@pytest.fixture
def tiny(tmp_path: Path) -> tuple[Experiment, ...]:
    """Experiments of a fold of eight cubes that works, and of one of sixteen that tangles."""
    for name, cells in (("tiny", SQUARE), ("spiral", SPIRAL)):
        file = tmp_path / f"{name}.json"
        file.write_bytes(write_path(CellPath.from_cells(cells, name=name)))
    return tuple(
        Experiment(
            id=name,
            statement="direct",
            shape=str(tmp_path / name),
            request=FoldRequest(preset="direct"),
            title=name,
            published="tangled",
            straight=name == "tiny",
            strip=name == "tiny",
        )
        for name in ("tiny", "spiral")
    )


@pytest.mark.long
def test_experiments_are_run_once_and_reported(
    tmp_path: Path, tiny: tuple[Experiment, ...]
) -> None:
    files, paper = tmp_path / "paper", tmp_path / "reproduction.md"
    reproduce(list(tiny), tiny, files)
    tell(tiny, files, paper)
    good, bad = (stored_runs(files / "runs.jsonl")[tiny_fold.id] for tiny_fold in tiny)
    assert good.verified and good.overlap is None and good.playback is not None
    assert good.playback.simulated_s == pytest.approx(0.01 * good.playback.steps, abs=0.1)
    assert not bad.verified and bad.overlap is not None and bad.stuck_frame is not None
    assert 0 <= bad.stuck_frame < bad.frames
    assert min(good.wall_s, good.processor_s, good.reference_s, good.folder_mb) > 0.0

    for name in ("batch", "chain.json", "still.webp", "straight.webp", "strip.webp"):
        assert (files / "tiny" / name).stat().st_size > 100
    marked = [orange(files / name / "still.webp") for name in ("tiny", "spiral")]
    assert marked[0] == 0 and marked[1] > 100

    cards = {card["id"]: card for card in page_of(files)["cards"]}
    assert [cards[tiny_fold.id]["verdict"] for tiny_fold in tiny] == [
        "verified (simulated)",
        "tangles",
    ]
    assert cards["spiral"]["stuck"] == list(bad.overlap.modules)
    assert "Verified here, tangled in the paper (direct servoing): tiny." in paper.read_text()
    (line,) = (o for o in page_data(files)["overview"] if o["id"] == "direct")
    assert (line["published"], line["here"]) == ("all tangle", "1 verified, 1 failed")
    assert f"overlap by {figure(bad.overlap.depth)} pitch" in paper.read_text()

    before = (files / "runs.jsonl").read_text()
    reproduce(list(tiny), tiny, files)
    assert (files / "runs.jsonl").read_text() == before
    # Runs of experiments that no longer exist are removed, with their pictures.
    reproduce([], tiny[:1], files)
    assert (files / "runs.jsonl").read_text() == before.splitlines(keepends=True)[0]
    tell(tiny[:1], files, paper)
    assert [path.name for path in files.iterdir() if path.is_dir()] == ["tiny"]
    assert page_of(files)["cards"][0]["verdict"] == "verified (simulated)"


def page_data(files: Path) -> dict:
    return json.loads((files / "page.json").read_bytes())


def page_of(files: Path) -> dict:
    return page_section(page_data(files), "direct")


def orange(path: Path) -> int:
    """Return the number of pixels in the colour of modules where a fold fails, in any light."""
    picture = np.asarray(Image.open(path).convert("RGBA")).astype(float)
    red, green, blue, alpha = np.moveaxis(picture, -1, 0)
    ratio = STALLED_RGB[1] / STALLED_RGB[0]
    return int(
        ((alpha > 250) & (blue < 60) & (red > 90) & (abs(green - ratio * red) < 0.1 * red)).sum()
    )


def test_page_and_document_match_the_stored_runs() -> None:
    """``make reproduction ARGS=--tell`` makes both from the stored runs."""
    page = told(stored_runs(PAPER / "runs.jsonl"), experiments())
    assert json.loads((PAPER / "page.json").read_bytes()) == json.loads(json.dumps(page))
    assert DOCUMENT.read_text(encoding="utf-8") == document(page)
    filmed = {card["id"] for s in page["sections"] for card in s["cards"] if card["film"]}
    assert {path.name for path in PAPER.iterdir() if path.is_dir()} == filmed
    for name in filmed:
        assert (PAPER / name / "batch").stat().st_size <= 300_000


def test_every_statement_has_experiments_and_every_experiment_one() -> None:
    every = experiments()
    assert len({fold.id for fold in every}) == len(every)
    assert {fold.statement for fold in every} == {statement.id for statement in STATEMENTS}
    ids = {fold.id for fold in every}
    assert {fold.start for fold in every if fold.start} <= ids
    assert {name for s in STATEMENTS for pair in s.pairs for name in pair} <= ids


def test_chosen_shapes_differ() -> None:
    names, rows = measured()
    scaled = (rows - rows.mean(axis=0)) / rows.std(axis=0)
    distance = np.linalg.norm(scaled[:, None] - scaled[None], axis=-1)
    np.fill_diagonal(distance, np.inf)
    indexes = [names.index(name) for name in different_shapes()]
    assert len(set(indexes)) == CHOSEN_SHAPES
    assert distance[np.ix_(indexes, indexes)].min() > np.median(distance.min(axis=0))


@pytest.mark.parametrize(
    ("verified", "words"),
    [
        (
            {24: True, 64: True, 80: False},
            "Folds work with up to 64 modules, and fail with 80 or more.",
        ),
        ({24: True, 64: False, 80: True}, "Folds work with 24 and 80 modules, and fail with 64."),
        ({24: False, 64: False, 80: False}, "Folds fail with 24, 64 and 80 modules."),
        ({}, ""),
    ],
)
def test_threshold_of_failing_sizes_is_reported(verified: dict[int, bool], words: str) -> None:
    every = [experiment for experiment in experiments() if experiment.statement == "threshold"]
    (stored,) = (run for run in stored_runs(PAPER / "runs.jsonl").values() if run.id == "wrench-24")
    runs = {
        fold.id: replace(stored, asked=fold.asked, modules=n, verified=verified[n])
        for fold in every
        if (n := int(fold.shape.rpartition("-")[2])) in verified
    }
    page = told(runs, tuple(every))
    assert page_section(page, "threshold")["found"] == words
    condition = "If only the hinge errors decide when the chain goes on to the next snapshot"
    assert [s for s in page["summary"] if s.startswith("If only")] == (
        [f"{condition} (stored state of the explosion), f{words[1:]}"] if words else []
    )


def page_section(page: dict, name: str) -> dict:
    return next(section for section in page["sections"] if section["id"] == name)


def test_figures_have_two_digits() -> None:
    words = {0.0: "0", 3e-16: "0", 0.00033: "0.00033", -0.0531: "−0.053", 0.05: "0.05"}
    words |= {1.0: "1", 12.34: "12", 160_000.0: "160\u202f000"}
    assert {value: figure(value) for value in words} == words
