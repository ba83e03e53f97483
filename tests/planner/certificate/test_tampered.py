"""Whatever is changed in a fold's directory is told, by the name of the file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from planner.errors import InputError, TimelineError
from planner.pipeline.fold import refold, smooth_plan
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain
from planner.verification import verify
from tests.planner.folds import made
from tests.planner.peels import snake
from tests.planner.tampering import Tampered, says_nothing

pytestmark = pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
"""zarr leaves out an array whose description is damaged, and warns; its digest is then missing."""
RING = b"- - - + - - - + - - -"


def folded(place: FilePath, shape: Chain | bytes, **options: Any) -> FilePath:
    """Return the directory of a fold of a chain, or of tetrahedra by their signs."""
    data = shape if isinstance(shape, bytes) else write_chain(shape)
    made(place, data, **options)
    return place


def told(directory: FilePath) -> list[str]:
    try:
        return list(verify.verify(directory).problems)
    except (InputError, TimelineError) as error:
        return [str(error)]
    except Exception as error:  # so that it is shown with the change that it came of
        return [f"broke off: {error!r}"]


def not_told(folds: list[Tampered], numbers: Iterable[int], seed: int) -> list[object]:
    """Changes that matter and were not told by the name of their file, by their numbers."""
    missed: list[object] = []
    for number in numbers:
        random = np.random.default_rng((seed, number))
        found = None
        while found is None:  # there may be nothing to change
            fold = folds[random.integers(len(folds))]
            with fold.changed(random) as change:
                found = change and (change, told(fold.place))
        change, problems = found
        harmless = not problems and says_nothing(change)
        if not (harmless or change.told_in(problems)):
            missed.append((number, change, problems))
            print(missed[-1], flush=True)
    return missed


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> list[Tampered]:
    """A peeled box of 8 cubes, and a simulated ring of 12 tetrahedra."""
    place = tmp_path_factory.mktemp("few")
    folds = [
        folded(place / "peeled", snake((2, 2, 2)), strategy="peel"),
        folded(place / "ring", RING, module="tetrahedron"),
    ]
    for fold in folds:
        assert told(fold) == [], fold
    return [Tampered(fold) for fold in folds]


@pytest.mark.slow
def test_damaged_files_are_named(few: list[Tampered]) -> None:
    fold = few[0]
    damaged: dict[str, FilePath] = {}
    for entry in sorted(fold.place.iterdir()):
        files = [path for path in (entry, *entry.rglob("*")) if path.is_file()]
        path = max(files, key=lambda path: path.stat().st_size)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        damaged[entry.name] = path
        path.write_bytes(data)
    # The first damage that ends a verification is told alone; what is told is put back.
    while damaged:
        problems = "\n".join(told(fold.place))
        named = [name for name in damaged if name in problems]
        assert named, (damaged, problems)
        for path in map(damaged.pop, named):
            path.write_bytes(fold.whole[path])
    assert told(fold.place) == []


@pytest.mark.slow
def test_changes_with_new_digests_are_found(few: list[Tampered]) -> None:
    assert not_told(few, range(4), seed=2) == []


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory, few: list[Tampered]) -> list[Tampered]:
    """With a simulated box, a smoothed plan and a refold."""
    place = tmp_path_factory.mktemp("several")
    places = [
        folded(place / "simulated", snake((2, 2, 2)), strategy="simultaneous"),
        place / "smoothed",
        place / "refold",
    ]
    smooth_plan(Plan.load(few[1].place / "plan.npz"), directory=place / "smoothed")
    start = Plan.load(place / "simulated" / "plan.npz")
    other = Path.from_cells([(k, 0, 0) for k in range(6)] + [(5, 1, 0), (4, 1, 0)], name="hook-8")
    refold(start, other, directory=place / "refold")
    for fold in places:
        assert told(fold) == [], fold
    return [*few, *(Tampered(fold) for fold in places)]


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_thousands_of_changes_with_new_digests_are_found(several: list[Tampered]) -> None:
    assert not_told(several, range(2000), 4) == []
