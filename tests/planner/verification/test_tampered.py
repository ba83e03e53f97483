"""Changes in a fold's directory: each is reported with the name of the file."""

from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.pipeline.fold import refold, smooth_plan
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.verification import verify
from tests.planner.folds import run_fold
from tests.planner.peels import snake
from tests.planner.tampering import Tampered, may_be_ignored

CHAIN = b"- - - + - -"


def fold_into(place: FilePath, shape: Chain | bytes, **options: Any) -> FilePath:
    """Return the directory of a fold of a chain, or of tetrahedra by their signs."""
    data = shape if isinstance(shape, bytes) else write_chain(shape)
    run_fold(place, data, **options)
    return place


def problems_of(directory: FilePath) -> list[str]:
    try:
        return list(verify.verify(directory).problems)
    except (InputError, TimelineError) as error:
        return [str(error)]
    except Exception as error:  # reported together with the change that caused it
        return [f"broke off: {error!r}"]


def unreported_changes(folds: list[Tampered], numbers: Iterable[int], seed: int) -> list[object]:
    """Return the changes that matter but were not reported with the name of their file."""
    missed: list[object] = []
    for number in numbers:
        random = np.random.default_rng((seed, number))
        changes = None
        while changes is None:  # a file may have nothing to change
            fold = folds[random.integers(len(folds))]
            with fold.changed(random) as change:
                changes = change and (change, problems_of(fold.place))
        change, problems = changes
        harmless = not problems and may_be_ignored(change)
        if not (harmless or change.is_named_in(problems)):
            missed.append((number, change, problems))
            print(missed[-1], flush=True)
    return missed


@pytest.fixture(scope="module")
def tampered_folds(tmp_path_factory: pytest.TempPathFactory) -> list[Tampered]:
    """Folds of a peeled box of 8 cubes and of a simulated chain of 7 tetrahedra."""
    place = tmp_path_factory.mktemp("few")
    folds = [
        fold_into(place / "peeled", snake((2, 2, 2)), strategy="peel"),
        fold_into(place / "chain", CHAIN, module="tetrahedron"),
    ]
    for fold in folds:
        assert problems_of(fold) == [], fold
    return [Tampered(fold) for fold in folds]


@pytest.mark.slow
def test_damaged_files_are_named(tampered_folds: list[Tampered]) -> None:
    fold = tampered_folds[0]
    damaged: dict[str, FilePath] = {}
    for entry in sorted(fold.place.iterdir()):
        files = [path for path in (entry, *entry.rglob("*")) if path.is_file()]
        path = max(files, key=lambda path: path.stat().st_size)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0x80  # no digit that a float rounds away
        damaged[entry.name] = path
        path.write_bytes(data)
    # A verification may end at the first damage, so that reported files are restored one by one.
    while damaged:
        problems = "\n".join(problems_of(fold.place))
        named = [name for name in damaged if name in problems]
        assert named, (damaged, problems)
        for path in map(damaged.pop, named):
            path.write_bytes(fold.whole[path])


@pytest.mark.slow
def test_changes_with_new_digests_are_found(tampered_folds: list[Tampered]) -> None:
    assert unreported_changes(tampered_folds, range(4), seed=2) == []


@pytest.fixture(scope="module")
def several(
    tmp_path_factory: pytest.TempPathFactory, tampered_folds: list[Tampered]
) -> list[Tampered]:
    """The few folds, and a simulated box, a smoothed plan and a refold."""
    place = tmp_path_factory.mktemp("several")
    places = [
        fold_into(place / "simulated", snake((2, 2, 2)), strategy="simultaneous"),
        place / "smoothed",
        place / "refold",
    ]
    smooth_plan(Plan.load(tampered_folds[1].place / "plan.npz"), directory=place / "smoothed")
    start = Plan.load(place / "simulated" / "plan.npz")
    other_path = Path.from_cells(
        [(k, 0, 0) for k in range(6)] + [(5, 1, 0), (4, 1, 0)], name="hook-8"
    )
    refold(start, other_path, directory=place / "refold")
    for fold in places:
        assert problems_of(fold) == [], fold
    return [*tampered_folds, *(Tampered(fold) for fold in places)]


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_thousands_of_changes_with_new_digests_are_found(several: list[Tampered]) -> None:
    assert unreported_changes(several, range(2000), 4) == []
