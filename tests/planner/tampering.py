"""Random changes of a value in all files of a fold, digests included, undone afterwards."""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from foldback.planner.pipeline.manifest import write_manifest
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.array_files import read_head, save_npz, write_head

SMALLEST = 1e-6
"""Minimum relative change of a number; it exceeds every tolerance."""
Random = np.random.Generator


def edit_folder(folder: FilePath, edit: Callable[[dict[str, Any]], None]) -> None:
    """Change the arrays of each file in an array folder, with new checksums."""
    head = read_head(folder)
    for name in head["files"]:
        with np.load(folder / name, allow_pickle=False) as file:
            arrays = dict(file)
        edit(arrays)
        head["files"][name] = save_npz(folder / name, arrays)
    write_head(folder, head)


@dataclass(frozen=True)
class Change:
    """Description of a change.

    Attributes:
        kind: Kind of the change.
        files: Names of the changed files.
        where: Position of the value in them.
    """

    kind: str
    files: tuple[str, ...]
    where: str

    def is_named_in(self, problems: list[str]) -> bool:
        """Return True if one of the problems names a changed file."""
        return any(name in problem for problem in problems for name in self.files)


@dataclass
class Tampered:
    """Directory of a fold whose files are changed and restored."""

    place: FilePath
    whole: dict[FilePath, bytes] = field(default_factory=dict[FilePath, bytes])

    def __post_init__(self) -> None:
        self.whole = {p: p.read_bytes() for p in self.place.rglob("*") if p.is_file()}

    @contextmanager
    def changed(self, random: Random) -> Iterator[Change | None]:
        """Make a random change, with new digests; yield None if there was nothing to change."""
        change = KINDS[random.integers(len(KINDS))](self.place, random)
        if change is not None:
            write_manifest(self.place)
        try:
            yield change
        finally:
            self.restore()

    def restore(self) -> None:
        """Restore all files."""
        for path, data in self.whole.items():
            if not path.exists() or path.read_bytes() != data:
                path.write_bytes(data)
        for path in self.place.rglob("*"):
            if path.is_file() and path not in self.whole:
                path.unlink()


def leaves(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the key paths of all plain values in nested ones."""
    if isinstance(value, dict) and value:
        for key, part in value.items():
            yield from leaves(part, (*at, key))
    elif isinstance(value, list) and value:
        for k, part in enumerate(value):
            yield from leaves(part, (*at, k))
    else:
        yield at


def other_value(value: Any, random: Random) -> Any:
    """Return a plain value that differs from the given one."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + int(random.choice([-7, -1, 1, 2, 1000]))
    if isinstance(value, float):
        if not np.isfinite(value):
            return 0.5
        by = SMALLEST * 10.0 ** random.uniform(0.3, 7)
        return value + float(random.choice([-1.0, 1.0])) * by * max(abs(value), 1.0)
    if isinstance(value, str):
        k = int(random.integers(len(value) + 1))
        return value[:k] + "x" + value[k:]
    return 1.5 if value is None else [value]


def set_leaf(values: Any, at: tuple[Any, ...], value: Any) -> None:
    """Set a value in nested ones."""
    for key in at[:-1]:
        values = values[key]
    values[at[-1]] = value


def get_leaf(values: Any, at: tuple[Any, ...]) -> Any:
    """Return a value in nested ones."""
    for key in at:
        values = values[key]
    return values


def one_leaf(values: Any, random: Random) -> tuple[Any, ...]:
    """Return a random key path: first a random field, then a random value in it."""
    fields = list(values) if isinstance(values, dict) else [*range(len(values))]
    key = fields[random.integers(len(fields))]
    places = [*leaves(values[key], (key,))]
    return places[random.integers(len(places))]


def changed_array(array: Any, random: Random) -> Any:
    """Return an array with one element changed."""
    array = np.array(array)
    place = tuple(int(random.integers(n)) for n in array.shape)
    if array.dtype.kind == "U":
        text = other_value(str(array[place]), random)
        array = array.astype(f"<U{max(array.dtype.itemsize // 4, len(text))}")
        array[place] = text
        return array
    value = array[place].item()
    if array.dtype.itemsize == 4 and isinstance(value, float):
        array[place] = np.float32(value + 0.01) if np.isfinite(value) else 0.5
    elif array.dtype.kind in "iu":
        array[place] = value + 1 if value < 255 else 0
    else:
        array[place] = other_value(value, random)
    return array


def edit_npz(path: FilePath, edit: Callable[[dict[str, Any], dict[str, Any]], None]) -> None:
    """Change the arrays of a file, and the metadata of a plan."""
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    plan_values = json.loads(str(arrays["plan"])) if "plan" in arrays else {}
    edit(arrays, plan_values)
    if "plan" in arrays:
        arrays["plan"] = np.array(json.dumps(plan_values))
    np.savez_compressed(path, **arrays)


def stage_array(place: FilePath, random: Random) -> Change:
    """Change a number in the arrays of one stage."""
    # The record of a refold or a smoothed plan has no copy.
    derived = any((place / name).exists() for name in ("start.npz", "recorded.npz"))
    names = ["playback.npz"] if derived else ["playback.npz", "record.npz"]
    names = [name for name in names if (place / name).exists()]
    name = names[random.integers(len(names))]
    hit = ""

    def edit(arrays: dict[str, Any], plan_values: dict[str, Any]) -> None:
        nonlocal hit
        keys = [key for key, array in arrays.items() if array.size]
        hit = keys[random.integers(len(keys))]
        arrays[hit] = changed_array(arrays[hit], random)

    edit_npz(place / name, edit)
    return Change("value in npz", (name,), hit)


def timeline_array(place: FilePath, random: Random) -> Change:
    files = read_head(place / "timeline")["files"]
    chosen, seen, hit = random.integers(len(files)), iter(range(len(files))), ""

    def edit(arrays: dict[str, Any]) -> None:
        nonlocal hit
        if next(seen) == chosen:
            keys = [key for key, array in arrays.items() if array.size]
            hit = keys[random.integers(len(keys))]
            arrays[hit] = changed_array(arrays[hit], random)

    edit_folder(place / "timeline", edit)
    return Change("value in timeline", ("timeline",), hit)


def timeline_attribute(place: FilePath, random: Random) -> Change | None:
    values = read_head(place / "timeline")
    at = one_leaf(values, random)
    if at == ("id",):  # random, so that pages detect another timeline
        return None
    set_leaf(values, at, other_value(get_leaf(values, at), random))
    write_head(place / "timeline", values)
    return Change("head of timeline", ("timeline",), str(at))


NUMBER = re.compile(r'(?<=[" ])-?\d+(?:\.\d+)?(?:e-?\d+)?(?=[" ])')
NAME = re.compile(r'(?<=")(?:module|joint|root|at|straight|folded)_?[\w]*(?=")')


def model(place: FilePath, random: Random) -> Change | None:
    path = place / "model.xml"
    text = path.read_text()
    choice = random.integers(3)
    if choice == 0:
        numbers = [*NUMBER.finditer(text)]
        hit = numbers[random.integers(len(numbers))]
        number = other_value(float(hit.group()), random)
        new = f"{number:.12g}"
    elif choice == 1:
        numbers = [*NAME.finditer(text)]
        hit = numbers[random.integers(len(numbers))]
        new = other_value(hit.group(), random)
    else:
        numbers = [*re.finditer(r"<(?:exclude|site|geom|key|joint)[^>]*/>", text)]
        hit = numbers[random.integers(len(numbers))]
        new = ""
    path.write_text(text[: hit.start()] + new + text[hit.end() :])
    before = text[: hit.start()]
    element = before.rpartition("<")[2].partition(" ")[0]
    attribute = before.rpartition('="')[0].rpartition(" ")[2] if choice < 2 else ""
    place_in = before.rpartition('"')[2].count(" ") if choice == 0 else 0
    return Change(
        ("number", "name", "element gone")[choice] + " in model.xml",
        ("model.xml",),
        f"{element}.{attribute}[{place_in}] {hit.group()[:80]}",
    )


def may_be_ignored(change: Change) -> bool:
    """Return True if a change may be of a number in a model that MuJoCo ignores.

    MuJoCo normalises axes and quaternions, and reads inertias from the body, not from its geom.
    """
    array_name = change.where.partition(" ")[0]
    base = array_name in {f"key.qpos[{k}]" for k in range(3, 7)}
    return base or array_name.startswith(("geom.mass", "joint.axis")) or ".quat[" in array_name


UNCHECKED_FIELDS = ("versions", "smoothing")
"""Fields of a plan that have no copy and cannot be recomputed."""
INEXACT_FIGURES = ("in_betweens", "clearance_bound", "seconds")
"""Figures of a certificate that may differ slightly on another processor, as may the places that
are closest. ``test_verify`` checks these."""


def change_all_copies(place: FilePath, random: Random) -> Change | None:
    """Change all copies of a value, as an attacker would who knows of them."""
    text = Plan.load(place / "plan.npz").as_dict()
    fields = [key for key in text if key not in UNCHECKED_FIELDS]
    key = fields[random.integers(len(fields))]
    at = one_leaf({key: text[key]}, random)
    if key == "certificate" and (
        at[1] in INEXACT_FIGURES or (at[1].startswith("min_clearance_") and "_at" in at[1])
    ):
        return None
    old = get_leaf(text, at)
    new = other_value(old, random)
    if "angles" in key and isinstance(old, float):
        new = float(np.float32(old + 0.01))
    set_leaf(text, at, new)

    def edit(arrays: dict[str, Any], plan_values: dict[str, Any]) -> None:
        if key in plan_values:
            plan_values[key] = text[key]
        elif old is None or isinstance(new, type(old)):
            kind = None if isinstance(old, str) else arrays[key].dtype
            arrays[key] = np.array(text[key], dtype=kind)

    edit_npz(place / "plan.npz", edit)
    for field_name, name in (("certificate", "certificate.json"), ("chain", "chain.json")):
        if key == field_name:
            (place / name).write_text(json.dumps(text[key]))
    return Change("all copies of a value", ("plan.npz",), str(at))


def remove_field(place: FilePath, random: Random) -> Change | None:
    """Remove a field from all files that hold it."""
    text = Plan.load(place / "plan.npz").as_dict()
    within = ("", "certificate", "playback", "explosion")[random.integers(4)]
    kept_text = text[within] if within else text
    if kept_text is None:
        return None
    keys = sorted(set(kept_text) - {"format"})
    key = keys[random.integers(len(keys))]
    del kept_text[key]

    def edit(arrays: dict[str, Any], plan_values: dict[str, Any]) -> None:
        if within:
            plan_values[within] = kept_text
        else:
            plan_values.pop(key, None)
            arrays.pop(key, None)

    edit_npz(place / "plan.npz", edit)
    (place / "certificate.json").write_text(json.dumps(text.get("certificate")))
    return Change("field gone everywhere", ("plan.npz",), f"{within}.{key}")


Kind = Callable[[FilePath, Random], Change | None]
KINDS: tuple[Kind, ...] = (
    *(change_all_copies, change_all_copies, remove_field),
    *(timeline_array, timeline_attribute, stage_array, model),
)
"""Random changes. figures is not among them, as only digests protect it."""
