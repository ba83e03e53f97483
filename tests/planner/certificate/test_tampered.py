"""Whatever is changed in a fold's directory is told, by the name of the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.module import Module
from planner.chain.path import Path
from planner.errors import InputError, TimelineError
from planner.pipeline.fold import refold, smooth_plan
from planner.plan.plan import Plan
from planner.plan.shape_files import write_chain
from planner.verification import verify
from tests.case import case
from tests.planner.folds import made
from tests.planner.peels import snake
from tests.planner.tampering import Change, Random, Tampered, says_nothing

pytestmark = pytest.mark.filterwarnings("ignore::zarr.errors.ZarrUserWarning")
"""zarr leaves out an array whose description is damaged, and warns; its digest is then missing."""
RING = b"- - - + - - - + - - -"


def folded(place: FilePath, shape: Chain | bytes, **options: Any) -> FilePath:
    """Return the directory of a fold of a chain, or of tetrahedra by their signs."""
    data = shape if isinstance(shape, bytes) else write_chain(shape)
    made(place, data, **options)
    return place


@pytest.fixture(autouse=True, scope="module")
def once() -> Iterator[None]:
    """What is worked out of the same numbers is worked out once: most changes are elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("certify", "replay"):
            patch.setattr(verify, name, remembered(getattr(verify, name)))
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
        return list(verify.verify(directory).problems)
    except (InputError, TimelineError) as error:
        return [str(error)]
    except Exception as error:  # so that it is shown with the change that it came of
        return [f"broke off: {error!r}"]


@dataclass(frozen=True)
class Missed:
    """A change that matters and was not told by the name of its file.

    Attributes:
        number: Of the change; ``not_told`` looks at it again, given the same folds and seed.
        change: What it was.
        told: What was told instead.
    """

    number: int
    change: Change
    told: list[str]


def not_told(
    folds: list[Tampered], numbers: Iterable[int], seed: int
) -> tuple[list[Missed], Counter[str]]:
    """What was missed of the changes with these numbers; how many there were of each kind."""
    missed: list[Missed] = []
    kinds: Counter[str] = Counter()
    for count, number in enumerate(numbers, 1):
        random = np.random.default_rng((seed, number))
        found = None
        while found is None:  # there may be nothing to change
            found = looked_at(folds, random)
        change, problems = found
        kinds[change.kind] += 1
        harmless = not problems and says_nothing(change)
        if not (harmless or change.told_in(problems)):
            missed.append(Missed(number, change, problems))
        if count % 500 == 0:
            print(count, dict(kinds), missed, flush=True)
    return missed, kinds


def looked_at(folds: list[Tampered], random: Random) -> tuple[Change, list[str]] | None:
    """A change and what was told of it; None without any."""
    fold = folds[random.integers(len(folds))]
    with fold.changed(random) as change:
        return None if change is None else (change, told(fold.place))


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
    for entry in sorted(fold.place.iterdir()):
        files = [path for path in (entry, *entry.rglob("*")) if path.is_file()]
        path = max(files, key=lambda path: path.stat().st_size)
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        with case(path):
            # Another digest in the manifest is told by the name of its file.
            problems = "\n".join(told(fold.place))
            assert problems and (entry.name in problems or entry.name == "manifest.json")
        fold.restore()
    assert told(fold.place) == []


@pytest.mark.slow
def test_changes_with_new_digests_are_found(few: list[Tampered]) -> None:
    missed, _ = not_told(few, range(4), seed=2)
    assert missed == []


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
    missed, kinds = not_told(several, range(2000), 4)
    print(f"\n{dict(kinds)}")
    assert missed == []
