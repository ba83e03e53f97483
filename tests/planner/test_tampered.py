"""Whatever is changed in a fold's directory is told, by the name of the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner import verification
from planner.errors import InputError, TimelineError
from planner.fold_files import write_request
from planner.formats import write_path
from planner.manifest import digests_of
from planner.modules import Module
from planner.pathfinding.assembly import layered_snake
from planner.paths import Path
from planner.plan import Plan
from planner.refold import refold
from planner.request import Request
from planner.smooth_plan import smooth_plan
from planner.stages import run_stages
from tests.planner.tampering import Change, Tampered, says_nothing

pytestmark = pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
"""zarr leaves out an array whose description is damaged, and warns; its digest is then missing."""
RING = b"- - - + - - - + - - -"
TWISTED = b"- + - + + - + - - + -"


def box(*sides: int) -> bytes:
    cells = [tuple(cell) for cell in layered_snake(sides).tolist()]
    return write_path(Path.from_cells(cells, name=f"box-{len(cells)}"))


def made(place: FilePath, data: bytes, **wishes: Any) -> FilePath:
    place.mkdir(parents=True)
    write_request(place, Request(filename="typed.txt", **wishes), data)
    run_stages(place)
    return place


@pytest.fixture(autouse=True, scope="module")
def once() -> Iterator[None]:
    """What is worked out of the same numbers is worked out once: most changes are elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("certify", "replay"):
            patch.setattr(verification, name, remembered(getattr(verification, name)))
        yield


def remembered(work: Callable[..., Any]) -> Callable[..., Any]:
    kept: dict[bytes, Any] = {}

    def found(*values: Any, progress: Any = None, **named: Any) -> Any:
        key = sha256(repr([*digestible((values, named))]).encode()).digest()
        if key not in kept:
            kept[key] = work(*values, **named)
        return kept[key]

    return found


def digestible(value: Any) -> Iterator[object]:
    """Everything in nested values."""
    if isinstance(value, np.ndarray):
        yield value.shape, value.dtype, sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
    elif isinstance(value, Module):
        yield value.name
    elif is_dataclass(value):
        for part in fields(value):
            yield from digestible(getattr(value, part.name))
    elif isinstance(value, dict):
        for key, part in value.items():
            yield key
            yield from digestible(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from digestible(part)
    else:
        yield value


def told(directory: FilePath) -> list[str]:
    try:
        return list(verification.verify(directory).problems)
    except (InputError, TimelineError) as error:
        return [str(error)]
    except Exception as error:  # so that it is shown with the change that it came of
        return [f"broke off: {error!r}"]


def not_told(
    folds: list[Tampered], count: int, seed: int, *, sealed: bool = False
) -> tuple[list[tuple[Change, list[str]]], Counter[str]]:
    """Changes that matter and were not told by the name of their file; how many of each kind."""
    random = np.random.default_rng(seed)
    digests = [digests_of(fold.place) for fold in folds]
    missed: list[tuple[Change, list[str]]] = []
    kinds: Counter[str] = Counter()
    while kinds.total() < count:
        number = int(random.integers(len(folds)))
        with folds[number].changed(random, sealed=sealed) as change:
            if change is None:
                continue
            problems = told(folds[number].place)
            kinds[change.kind] += 1
            if kinds.total() % 500 == 0:
                print(kinds.total(), dict(kinds), missed, flush=True)
            if change.told_in(problems):
                continue
            # A byte of a file's packing, its dates for instance, says nothing.
            if change.kind == "byte" and digests_of(folds[number].place) == digests[number]:
                kinds["… of which say nothing"] += not problems
                kinds[change.kind] -= not problems
                continue
            if sealed and not problems and says_nothing(change):
                kinds["… of which say nothing"] += 1
                kinds[change.kind] -= 1
                continue
            missed.append((change, problems))
    return missed, kinds


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> list[Tampered]:
    """A peeled box of 8 cubes, and a simulated ring of 12 tetrahedra."""
    place = tmp_path_factory.mktemp("few")
    folds = [
        made(place / "peeled", box(2, 2, 2), strategy="peel"),
        made(place / "ring", RING, module="tetrahedron"),
    ]
    for fold in folds:
        assert told(fold) == [], fold
    return [Tampered(fold) for fold in folds]


@pytest.mark.slow
def test_a_change_is_told_by_the_name_of_its_file(few: list[Tampered]) -> None:
    missed, _ = not_told(few, 160, seed=1)
    assert missed == []


@pytest.mark.slow
def test_who_works_the_digests_out_anew_is_found_all_the_same(few: list[Tampered]) -> None:
    missed, _ = not_told(few, 40, seed=2, sealed=True)
    assert missed == []


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_ten_thousand_changes_are_told(tmp_path: FilePath, few: list[Tampered]) -> None:
    """To ten plans: simulated and kinematic, cubes and tetrahedra, a refold and a smoothed one."""
    eight = box(2, 2, 2)
    places = [
        made(tmp_path / "rows", box(2, 2, 3), strategy="one-by-one"),
        made(tmp_path / "larger", box(3, 3, 2), strategy="peel"),
        made(tmp_path / "simulated", eight, strategy="simultaneous"),
        made(tmp_path / "flat", box(3, 3, 1)),
        made(tmp_path / "twisted", TWISTED, module="tetrahedron"),
        made(tmp_path / "direct", box(2, 2, 1), preset="direct"),
    ]
    ring = Plan.load(few[1].place / "plan.npz")
    smooth_plan(ring, directory=tmp_path / "smoothed")
    start = Plan.load(tmp_path / "simulated" / "plan.npz")
    other = Path.from_cells([(k, 0, 0) for k in range(6)] + [(5, 1, 0), (4, 1, 0)], name="hook-8")
    refold(start, other, directory=tmp_path / "refold")
    folds = [
        *few,
        *(Tampered(place) for place in [*places, tmp_path / "smoothed", tmp_path / "refold"]),
    ]
    for fold in folds:
        assert told(fold.place) == [], fold.place
    missed, kinds = not_told(folds, 8000, seed=3)
    sealed, counts = not_told(folds, 2000, seed=4, sealed=True)
    print(f"\n{dict(kinds)}\nwith digests worked out anew: {dict(counts)}")
    assert missed == [] and sealed == []
