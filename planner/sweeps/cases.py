"""Cases of a sweep: folds of its specification, the cheapest first."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.parameters.option import OPTIONS_KEY_CHARS
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES
from foldback.planner.pipeline.expected_cost import expected_cost
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.sweeps.case import Case, Limits, Row, Value
from foldback.planner.sweeps.fold_task import FoldTask
from foldback.planner.sweeps.shapes import ShapeSource, find_shapes
from foldback.planner.sweeps.spec import REQUEST_FIELDS, SweepSpec, Values, seeds_of

PLANS_DIR: Final = "plans"
"""Name of the directory, in that of a sweep, with the directories of kept folds."""
COLUMN_OF: Final = {
    "method": "path_method",
    "module": "module_requested",
    "modules": "modules_requested",
    "strategy": "strategy_requested",
    "module_size": "module_size_pitch",
}
"""Columns of fields of the request whose names are those of other columns, or lack a unit."""
PLANNER_SUFFIXES: Final = (".py", ".cpp", ".hpp", ".json")
"""Suffixes of the files of the planner that its digest covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldSeries:
    """Folds that differ only in their seeds.

    Attributes:
        shape: The shape.
        columns: Values of all rows.
        request: The request with any seed.
        seeds: The seeds, in the order in which they are tried.
        limits: Limits of each fold.
        identity: Text of everything that the keys depend on, besides the seed.
        expected_s: Expected processor time of one fold, s.
    """

    shape: ShapeSource
    columns: Row
    request: FoldRequest
    seeds: tuple[int, ...]
    limits: Limits
    identity: str
    expected_s: float

    def key(self, seed: int) -> str:
        """Return the key of a fold."""
        return hashlib.sha256(f"{self.identity}{seed}".encode()).hexdigest()[:OPTIONS_KEY_CHARS]


@cache
def planner_digest() -> str:
    """Return a digest of the planner's files and version, without those of sweeps."""
    planner = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(version("foldback").encode())
    for path in sorted(planner.rglob("*")):
        place = path.relative_to(planner)
        if path.suffix in PLANNER_SUFFIXES and place.parts[0] != Path(__file__).parent.name:
            digest.update(f"{place.as_posix()}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:OPTIONS_KEY_CHARS]


class SweepCases:
    """Cases of a sweep.

    Attributes:
        series: All folds, the cheapest first.
    """

    def __init__(self, spec: SweepSpec, directory: Path) -> None:
        self._spec = spec
        self._directory = directory
        self.series = sorted(_series_of(spec), key=lambda series: series.expected_s)
        self._begun: dict[str, tuple[FoldSeries, int]] = {}

    def __len__(self) -> int:
        return sum(len(series.seeds) for series in self.series)

    def left(self, rows: Mapping[str, Row]) -> int:
        """Return the number of folds without a row; seeds that may not be needed count, too."""
        return sum(
            len(series.seeds) - turn
            if self._spec.until
            else sum(series.key(seed) not in rows for seed in series.seeds)
            for series in self.series
            if (turn := self._untried(series, 0, rows)) is not None
        )

    def missing(self, rows: Mapping[str, Row]) -> Iterator[Case]:
        """Yield the cases without a row: the first seeds of all shapes before the second ones."""
        if self._spec.until:
            for series in self.series:
                if case := self._begin(series, 0, rows):
                    yield case
            return
        for turn in range(max((len(series.seeds) for series in self.series), default=0)):
            for series in self.series:
                if turn < len(series.seeds) and series.key(series.seeds[turn]) not in rows:
                    yield self._case(series, series.seeds[turn])

    def after(self, case: Case, row: Row, rows: Mapping[str, Row]) -> Case | None:
        """Return the case with the next seed if seeds are tried until one is verified."""
        if not self._spec.until or row.get("verified"):
            return None
        series, turn = self._begun.pop(case.key)
        return self._begin(series, turn + 1, rows)

    def _begin(self, series: FoldSeries, turn: int, rows: Mapping[str, Row]) -> Case | None:
        if (untried := self._untried(series, turn, rows)) is None:
            return None
        case = self._case(series, series.seeds[untried])
        self._begun[case.key] = series, untried
        return case

    def _untried(self, series: FoldSeries, turn: int, rows: Mapping[str, Row]) -> int | None:
        """Return the index of the first seed without a row, from one on.

        Return None if there is none, or if a seed before it is verified and no other is needed.
        """
        for index, seed in enumerate(series.seeds[turn:], turn):
            row = rows.get(series.key(seed))
            if row is None:
                return index
            if self._spec.until and row.get("verified"):
                return None
        return None

    def _case(self, series: FoldSeries, seed: int) -> Case:
        request, key = replace(series.request, seed=seed), series.key(seed)
        keep = self._spec.keep.plans
        return Case(
            key=key,
            columns={**series.columns, "seed": seed},
            task=FoldTask(data=series.shape.data(), request=request, keep=keep),
            limits=series.limits,
            keep=None if keep == "none" else self._directory / PLANS_DIR / key,
        )


def _series_of(spec: SweepSpec) -> Iterator[FoldSeries]:
    """Yield the folds of all groups, methods and values of the grid.

    Raises:
        InputError: If a request is invalid, or a pattern matches no shape.
    """
    parts = (*spec.shapes.values(), *spec.methods.values())
    stated = {name for part in parts for name in part.request} | spec.grid.keys()
    varying = [name for name in REQUEST_FIELDS if name in stated]
    cost = cache(expected_cost)
    for group, shapes in spec.shapes.items():
        for shape in find_shapes(shapes.files, Path(spec.base)):
            digest, modules = shape.digest_and_modules()
            for name, method in spec.methods.items():
                if not (shapes.folds(shape.name) and method.folds(shape.name)):
                    continue
                seeds = next(
                    value for value in (method.seeds, shapes.seeds, spec.seeds) if value is not None
                )
                limits = spec.limits(shapes, method)
                for values in product(*spec.grid.values()):
                    fields = {**shapes.request, **dict(zip(spec.grid, values, strict=True))}
                    request = _request(shape.filename, name, {**fields, **method.request})
                    columns: Row = {
                        "shape": shape.name,
                        "group": group,
                        "shape_digest": digest,
                        "modules": modules,
                        "method": name,
                        **{COLUMN_OF.get(f, f): _value(getattr(request, f)) for f in varying},
                        "verified": False,
                        "version": version("foldback"),
                        "planner_digest": planner_digest(),
                    }
                    names = (shape.name, group, name)
                    identity = [names, digest, request.to_json(), asdict(limits), planner_digest()]
                    expected_modules = modules or request.modules or DEFAULT_MODULES
                    yield FoldSeries(
                        shape=shape,
                        columns=columns,
                        request=request,
                        seeds=seeds_of(seeds, shape.name),
                        limits=limits,
                        identity=json.dumps(identity),
                        expected_s=cost(expected_modules, request).expected_s,
                    )


def _request(filename: str, method: str, values: Values) -> FoldRequest:
    """Return the request of a fold, checked."""
    try:
        request = FoldRequest.of(filename=filename, **values)
        request = FoldRequest.from_json(request.to_json())  # checks types
        request.check()
    except (InputError, ValueError) as error:
        raise InputError(
            "bad-spec", f"got a request that no fold can have: {error}", where=f"methods.{method}"
        ) from error
    return request


def _value(value: Value | tuple[int, ...]) -> Value:
    """Return a field of a request as a value of a table."""
    return ",".join(map(str, value)) if isinstance(value, tuple) else value
