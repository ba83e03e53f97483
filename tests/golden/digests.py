"""Digests of a fold's results: one for each named array and figure, and a readable summary.

Wall times and versions are left out, since they change from run to run or between releases.
"""

import json
from collections.abc import Iterator
from dataclasses import fields
from hashlib import sha256
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np

from foldback.planner.certificate.figures_store import Curves, Figures
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline
from foldback.planner.playback.playback import Playback
from foldback.planner.storage.array_files import read_head
from foldback.planner.storage.file_names import FIGURES, TIMELINE

RESULTS: Final = (
    *("chain.json", "attempts.json", "record.npz", "playback.npz", "certificate.json"),
    *("table.npz", "timeline", "plan.npz", "model.xml", "figures"),
)
"""Files of a fold's directory that hold results."""
DIGEST_LENGTH: Final = 12
"""Number of hexadecimal digits of a digest; 12 miss a change with probability 2⁻⁴⁸."""
WALL_TIME: Final = "seconds"
"""Name of a wall time in all files, except in ``DURATION_OF``."""
DURATION_OF: Final = "smoothing"
"""Part of a plan in which ``WALL_TIME`` names the duration of a motion."""
IGNORED_NAMES: Final = {"versions", "id", "chunks", "sha256"}
"""Names of parts that change without a change of results: random ids, checksums of packed data."""
Values = dict[str, Any]
Digests = dict[str, dict[str, str]]
"""Digests by file and by part of that file."""


def digests(directory: FilePath) -> Digests:
    """Return the digest of each part of each result, such as ``angles_rad`` of ``record.npz``."""
    return {name: dict(_parts(directory / name)) for name in RESULTS if (directory / name).exists()}


def changed_parts(stored: Digests, computed: Digests) -> list[str]:
    """Return the parts that differ or that only one side has, as ``record.npz: angles_rad``."""
    return [
        f"{name}: {part}"
        for name in dict.fromkeys((*stored, *computed))
        for part in dict.fromkeys((*stored.get(name, {}), *computed.get(name, {})))
        if stored.get(name, {}).get(part) != computed.get(name, {}).get(part)
    ]


def summary(directory: FilePath) -> Values:
    """Return the figures of a fold that are the same on every machine, or nearly so."""
    attempts = json.loads((directory / "attempts.json").read_bytes())
    certificate = json.loads((directory / "certificate.json").read_bytes())
    chain = json.loads((directory / "chain.json").read_bytes())
    with np.load(directory / "plan.npz", allow_pickle=False) as file:
        plan = json.loads(str(file["plan"]))
    explosion = plan["explosion"] or {}
    return {
        "verdict": (certificate["reason"] or {}).get("code") or certificate["verdict"],
        "status": explosion.get("status"),
        "hinges": len(chain["folded_rad"]),
        "attempts": [
            " ".join(
                (
                    attempt["strategy"],
                    attempt["status"],
                    (attempt.get("diagnosis") or {}).get("kind", ""),
                )
            ).strip()
            for attempt in attempts
        ],
        "steps": explosion.get("steps"),
        "frames": certificate["frames"],
        "min_clearance": _rounded(certificate["min_clearance"]),
        "fold_time_s": _rounded(certificate["fold_time_s"]),
        "max_angle_error_rad": _rounded(certificate["max_angle_error_rad"]),
    }


def _parts(path: FilePath) -> Iterator[tuple[str, str]]:
    if path.suffix == ".json":
        yield from _parts_of_values(json.loads(path.read_bytes()))
    elif path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            for name in file.files:
                if name == "plan":
                    for part, digest in _parts_of_values(json.loads(str(file[name]))):
                        yield f"plan.{part}", digest
                elif name != WALL_TIME:
                    yield name, _digest_of_array(file[name])
            if "status" in file and "time_s" not in file:
                for name, array in _frames_of(path).items():
                    yield name, _digest_of_array(array)
    elif path.name == TIMELINE:
        timeline = Timeline.open(path)
        yield from _parts_of_values({"chain": timeline.chain_data, "status": timeline.status})
        for name, array in timeline.motion().columns().items():
            yield name, _digest_of_array(array)
    elif path.name == FIGURES:
        kind = Figures if read_head(path)["ends"] else Curves
        figures = kind.load(path)
        for field in fields(kind):
            yield field.name, _digest_of_array(getattr(figures, field.name))
    else:
        yield "content", _digest(path.read_bytes())


def _frames_of(path: FilePath) -> dict[str, Any]:
    """Return the arrays of a record or playback that its file leaves out."""
    if path.name == "record.npz":
        return Record.load(path).frames.columns()
    playback = Playback.load(path)
    columns = playback.frames.columns()
    if playback.reference_rad is not None:
        name = "window_reference_rad" if playback.frames.is_windowed else "reference_rad"
        columns[name] = playback.reference_rad
    return columns


def _parts_of_values(values: Values | list[Values]) -> Iterator[tuple[str, str]]:
    """Yield the digests of a JSON object's values; for an array, those of each object in it."""
    if isinstance(values, list):
        for k, element in enumerate(values):
            for part, digest in _parts_of_values(element):
                yield f"{k}.{part}", digest
        return
    for name, value in _timeless(values).items():
        yield name, _digest(json.dumps(value, sort_keys=True).encode())


def _timeless(value: Any) -> Any:
    """Return the value without wall times and versions."""
    if isinstance(value, dict):
        return {
            name: element if name == DURATION_OF else _timeless(element)
            for name, element in cast("Values", value).items()
            if name != WALL_TIME and name not in IGNORED_NAMES
        }
    return [_timeless(element) for element in value] if isinstance(value, list) else value


def _digest_of_array(array: np.ndarray[Any, Any]) -> str:
    head = f"{array.dtype.str} {array.shape} ".encode()
    return _digest(head + np.ascontiguousarray(array).tobytes())


def _digest(data: bytes) -> str:
    return sha256(data).hexdigest()[:DIGEST_LENGTH]


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.3g}")
