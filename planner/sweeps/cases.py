"""Cases of a sweep: the folds of its specification."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.metadata import version
from itertools import product
from math import prod
from pathlib import Path
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.parameters.option import OPTIONS_KEY_CHARS
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES
from foldback.planner.pipeline.expected_cost import expected_cost
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.sweeps.case import Case, Limits, Row, Value
from foldback.planner.sweeps.fold_task import FoldTask
from foldback.planner.sweeps.planner_digest import planner_digest
from foldback.planner.sweeps.shapes import ShapeSource, find_shapes
from foldback.planner.sweeps.spec import REQUEST_FIELDS, SweepSpec, Values, seeds_of

COLUMN_OF: Final = {
    "method": "path_method",
    "module": "module_requested",
    "modules": "modules_requested",
    "strategy": "strategy_requested",
    "module_size": "module_size_pitch",
}
"""Columns of fields of the request whose names are those of other columns, or lack a unit."""
MAX_FOLDS: Final = 1_000_000
"""Maximum number of folds of a sweep, whose command has the rows of all in memory: about 4 kB of
each, with Dask and the tables."""


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
    seeds: Sequence[int]
    limits: Limits
    identity: str
    expected_s: float

    def key(self, seed: int) -> str:
        """Return the key of a fold."""
        return hashlib.sha256(f"{self.identity}{seed}".encode()).hexdigest()[:OPTIONS_KEY_CHARS]

    def case(self, seed: int, keep: str, plans: Path) -> Case:
        """Return the case of a fold.

        Args:
            seed: Its seed.
            keep: Folds whose plans are kept: ``none``, ``failed`` or ``all``.
            plans: Directory of the kept plans.
        """
        request, key = replace(self.request, seed=seed), self.key(seed)
        return Case(
            key=key,
            columns={**self.columns, "seed": seed},
            task=FoldTask(data=self.shape.data(), request=request, keep=keep),
            limits=self.limits,
            planner_digest=planner_digest(),
            files_dir=None if keep == "none" else plans / key,
        )


def series_of(spec: SweepSpec) -> list[FoldSeries]:
    """Return the folds of all groups, methods and values of the grid, the cheapest first.

    Raises:
        InputError: If a request is invalid, a pattern matches no shape, or there are no folds or
            too many.
    """
    parts = (*spec.shapes.values(), *spec.methods.values())
    stated = {name for part in parts for name in part.request} | spec.grid.keys()
    varying = [name for name in REQUEST_FIELDS if name in stated]
    shapes = [
        (group, shape, *shape.digest_and_modules())
        for group, part in spec.shapes.items()
        for shape in find_shapes(part.files, Path(spec.base))
    ]
    _check_number(len(shapes) * len(spec.methods) * prod(map(len, spec.grid.values())))
    cost = cache(expected_cost)
    series: dict[str, FoldSeries] = {}  # by identity: a grid may have a value twice
    for (group, shape, digest, modules), (name, method), values in product(
        shapes, spec.methods.items(), product(*spec.grid.values())
    ):
        part = spec.shapes[group]
        if not (part.includes(shape.name) and method.includes(shape.name)):
            continue
        fields = part.request | dict(zip(spec.grid, values, strict=True)) | method.request
        request = _request(shape.filename, name, fields)
        seeds = next(seeds for seeds in (method.seeds, part.seeds, spec.seeds) if seeds is not None)
        limits = spec.limits(part, method)
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
        identity = json.dumps([names, digest, request.to_json(), asdict(limits), planner_digest()])
        expected_modules = modules or request.modules or DEFAULT_MODULES
        series[identity] = FoldSeries(
            shape=shape,
            columns=columns,
            request=request,
            seeds=seeds_of(seeds, shape.name),
            limits=limits,
            identity=identity,
            expected_s=cost(expected_modules, request).expected_s,
        )
    _check_number(sum(len(folds.seeds) for folds in series.values()))
    return sorted(series.values(), key=lambda folds: folds.expected_s)


def _check_number(folds: int) -> None:
    """Refuse a specification of no folds, or of too many."""
    if folds == 0:
        raise InputError(
            "no-folds", "got a spec of 0 folds, expected some; correct its grid, or 'only'."
        )
    if folds > MAX_FOLDS:
        raise InputError(
            "too-many-folds",
            f"got a spec of {folds} folds, expected at most {MAX_FOLDS}; split it into several "
            "sweeps.",
        )


def _request(filename: str, method: str, values: Values) -> FoldRequest:
    """Return the request of a fold, checked."""
    try:
        request = FoldRequest.of(filename=filename, **values)
        request = FoldRequest.from_json(request.to_json())  # checks types
        request.check()
    except (InputError, ValueError, RecursionError) as error:
        raise InputError(
            "bad-spec", f"got a request that no fold can have: {error}", where=f"methods.{method}"
        ) from error
    return request


def _value(value: Value | tuple[int, ...]) -> Value:
    """Return a field of a request as a value of a table."""
    return ",".join(map(str, value)) if isinstance(value, tuple) else value
