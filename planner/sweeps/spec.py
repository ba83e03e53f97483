"""Specification of a sweep: which shapes are folded, how, how often, and within which limits."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from foldback.planner.errors import InputError
from foldback.planner.parameters.option import options_of
from foldback.planner.pipeline.request import MAX_SEED, FoldRequest
from foldback.planner.storage.plain_values import from_plain, to_plain
from foldback.planner.sweeps.case import Limits

Values = dict[str, Any]
"""Values as TOML has them."""
Seeds = int | str | list[int]

REQUEST_FIELDS: Final = tuple(name for name in options_of(FoldRequest) if name != "seed")
"""Fields of a fold's request that a spec may set; seeds have a key of their own."""
SEED_OF_NAME: Final = "name"
"""Value of ``seeds``: the seed is the number at the end of the shape's name."""
MEMORY_UNITS: Final = {"": 1, "k": 1000, "M": 1000**2, "G": 1000**3, "T": 1000**4} | {
    f"{prefix}i": 1024**power for power, prefix in enumerate("KMGT", 1)
}
"""Bytes of the units of memory, by their prefixes."""
MAX_BUDGET: Final = 1e15
"""Maximum of a limit in s or bytes; the kernel takes no times of more than 63 bits."""
Pattern = str | tuple[str, bytes]
"""Pattern of shapes' names, or the name and bytes of a shape in memory."""


class Table(msgspec.Struct, frozen=True, omit_defaults=True):
    """Table of a spec, which is written without the keys that it leaves out."""


class Budget(Table, frozen=True):
    """Limits of one fold, as a spec states them; None for those of the whole sweep.

    Attributes:
        cpu_s, wall_s: Processor time and wall time, s.
        memory: Resident memory, such as ``2 GiB``.
    """

    cpu_s: float | None = None
    wall_s: float | None = None
    memory: str | int | None = None


class Part(Table, frozen=True):
    """A method, or a group of shapes: what its folds have in common.

    Attributes:
        seeds: Its own seeds; None for those of the sweep.
        only: Globs of the names of the shapes that a method folds.
        budget: Its own limits.
        files: Shapes of a group: patterns, or pairs of a name and bytes.
        request: Fields of the request. In a spec, they stand in the table of the part itself.
    """

    seeds: Seeds | None = None
    only: list[str] | None = None
    budget: Budget = Budget()
    files: list[Pattern] = []
    request: Values = {}

    def includes(self, shape: str) -> bool:
        """Return True if it folds the shape of a name."""
        return self.only is None or any(fnmatchcase(shape, pattern) for pattern in self.only)


class Keep(Table, frozen=True):
    """Folds whose plans are kept."""

    plans: Literal["none", "failed", "all"] = "none"


class MapAxes(Table, frozen=True):
    """Columns of the table by which the map arranges folds; None for those that suit the shapes.

    Attributes:
        rows, columns: Columns of the table whose values are the rows and columns of a field.
        by: Column of the table with a field for each value.
    """

    rows: str | None = None
    columns: str | None = None
    by: str = "method"


KEYS: Final[dict[str, Collection[str]]] = {
    "budget": Budget.__struct_fields__,
    "keep": Keep.__struct_fields__,
    "map": MapAxes.__struct_fields__,
    "grid": REQUEST_FIELDS,
}
"""Keys of the tables in a spec, besides those of methods and groups."""


class SweepSpec(Table, frozen=True):
    """Specification of a sweep; see docs/sweeps.md.

    Attributes:
        base: Directory to which files are relative.
        shapes: Groups of shapes by name; one without a name if they are a list.
        methods: Methods by name.
        seeds: Seeds of all folds: a number, a list, ``0-4``, or ``name``.
        until: ``verified`` if a later seed is tried only while no earlier one is verified.
        budget: Limits of each fold.
        grid: Values of fields of the request; their product is folded.
        keep: Folds whose plans are kept.
        map: Axes of the map.
    """

    base: str
    shapes: dict[str, Part]
    methods: dict[str, Part]
    seeds: Seeds = 0
    until: Literal["verified"] | None = None
    budget: Budget = Budget()
    grid: dict[str, list[Any]] = {}
    keep: Keep = Keep()
    map: MapAxes = MapAxes()

    @classmethod
    def of(cls, values: Mapping[str, Any], base: Path) -> SweepSpec:
        """Return the specification that a TOML document or a program gives.

        Args:
            values: Keys of the document; shapes may also be pairs of a name and bytes.
            base: Directory to which files are relative, unless the values state it.

        Raises:
            InputError: ``bad-spec``, naming the key.
        """
        _check_keys("", values, cls.__struct_fields__)
        shapes = values.get("shapes", [])
        parts = {
            "shapes": shapes if isinstance(shapes, Mapping) else {"": shapes},
            "methods": values.get("methods") or {"auto": {}},
        }
        plain = {"base": str(base), **values, "seeds": _seeds_text(values.get("seeds", 0))}
        for name, tables in parts.items():
            if not isinstance(tables, Mapping):
                kind = type(tables).__name__
                raise InputError("bad-spec", f"got {name} of type {kind}, expected a table.")
            plain[name] = {
                key: _part(f"{name}.{key}".strip("."), table) for key, table in tables.items()
            }
        try:
            spec = from_plain(plain, cls)
        except ValueError as error:
            raise InputError(
                "bad-spec", f"got a spec that cannot be used: {error}; correct the value."
            ) from error
        for name, group in spec.shapes.items():
            if not group.files:
                place = f"shapes.{name}".strip(".")
                raise InputError("no-shape", f"got no {place}, expected files, globs or examples.")
        for part in (*spec.shapes.values(), *spec.methods.values()):
            spec.limits(part)
        return spec

    @classmethod
    def from_toml(cls, path: Path) -> SweepSpec:
        """Return the specification in a file.

        Raises:
            InputError: If it cannot be read, or naming a key in it.
        """
        try:
            values = tomllib.loads(path.read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
            reason = "nested more deeply" if isinstance(error, RecursionError) else str(error)
            raise InputError(
                "bad-spec", f"got no TOML ({reason}), expected a spec of a sweep.", where=str(path)
            ) from error
        return cls.of(values, path.parent.resolve())

    def as_dict(self) -> Values:
        """Return the values for ``of``, as TOML has them: names of shapes without their bytes."""
        values = msgspec.to_builtins(self, builtin_types=(bytes,))
        for name in ("shapes", "methods"):
            values[name] = {
                key: part | part.pop("request", {}) for key, part in values[name].items()
            }
        for group in values["shapes"].values():
            group["files"] = [file if isinstance(file, str) else file[0] for file in group["files"]]
        if list(self.shapes) == [""]:
            values["shapes"] = values["shapes"][""]["files"]
        return values

    def map_axes(self) -> tuple[str, str, str]:
        """Return the columns of the table for the map's fields, rows and columns."""
        groups = len(self.shapes) > 1
        rows = self.map.rows or ("group" if groups else "shape")
        return self.map.by, rows, self.map.columns or ("modules" if groups else "seed")

    def limits(self, *parts: Part) -> Limits:
        """Return the limits of the folds of parts; those of later parts come first."""
        budgets = (self.budget, *(part.budget for part in parts))
        stated = {name: value for budget in budgets for name, value in to_plain(budget).items()}
        if "memory" in stated:
            stated["memory_bytes"] = bytes_of(stated.pop("memory"))
        if not all(0 < value <= MAX_BUDGET for value in stated.values()):
            raise InputError(
                "bad-spec",
                f"got the budget {stated}, expected more than 0 and at most {MAX_BUDGET:g} of "
                "each.",
            )
        return replace(Limits(), **stated)


def seeds_of(value: Seeds, shape: str) -> Sequence[int]:
    """Return seeds: a number, a list, ``0-4``, or ``name`` for the number at the end of a name.

    Raises:
        InputError: ``bad-seeds``.
    """
    text = value
    if value == SEED_OF_NAME:
        number = re.search(r"\d+$", shape)
        text = number[0] if number else f"{SEED_OF_NAME} of {shape}, without a number"
    match = re.fullmatch(r"(\d{1,10})(?:-(\d{1,10}))?", str(text))
    if match:
        first, last = int(match[1]), int(match[2] or match[1])
        if first <= last <= MAX_SEED:
            return range(first, last + 1)
    elif isinstance(value, list) and value and 0 <= min(value) <= max(value) <= MAX_SEED:
        return tuple(dict.fromkeys(value))
    raise InputError(
        "bad-seeds",
        f"got the seeds {text!r}, expected a number, a text such as '0-4', a list such as [1, 5], "
        f"or {SEED_OF_NAME!r} for the number at the end of a shape's name.",
    )


def bytes_of(text: str | int) -> int:
    """Return the bytes of a text such as ``2 GiB``, or of a number.

    Raises:
        InputError: ``bad-memory``.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?) *(?:([kKMGT]i?)?B)?", str(text).strip())
    if match is None or (match[2] or "") not in MEMORY_UNITS:
        raise InputError("bad-memory", f"got the memory {text!r}, expected a size such as '2 GiB'.")
    return int(float(match[1]) * MEMORY_UNITS[match[2] or ""])


def _part(place: str, table: Any) -> Values:
    """Return a part's table as its class has it; a list or glob is the files of a group."""
    if not isinstance(table, Mapping):
        table = {"files": table}
    own = [name for name in Part.__struct_fields__ if name != "request"]
    _check_keys(place, table, (*own, *REQUEST_FIELDS))
    values = {name: table[name] for name in own if name in table}
    for name in ("only", "files"):
        if isinstance(values.get(name), str):
            values[name] = [values[name]]
    if "seeds" in values:
        values["seeds"] = _seeds_text(values["seeds"])
    return values | {"request": {name: table[name] for name in REQUEST_FIELDS if name in table}}


def _seeds_text(seeds: Any) -> Any:
    """Return a range of seeds, which only a program can give, as a text; others as they are."""
    is_range = isinstance(seeds, range) and seeds and seeds.step == 1
    return f"{seeds.start}-{seeds.stop - 1}" if is_range else seeds


def _check_keys(place: str, values: Mapping[str, Any], known: Collection[str]) -> None:
    """Refuse unknown keys of a table and of those in it, naming the nearest known one."""
    for name, value in values.items():
        if name not in known:
            near = get_close_matches(str(name), known, n=1, cutoff=0.5)
            expected = near[0] if near else f"one of: {', '.join(known)}"
            raise InputError(
                "bad-spec",
                f"{place or 'spec'}: got the unknown key {name!r}, expected {expected}.",
            )
        if name in KEYS and isinstance(value, Mapping):
            _check_keys(f"{place}.{name}".strip("."), value, KEYS[name])
