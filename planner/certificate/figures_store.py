"""Figures store: figures of every frame of a timeline, on disk.

``planner.certificate.frame_figures`` computes them. They are an array folder beside the timeline,
with the curves in one file, and the figures of modules and hinges in files of consecutive frames.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from foldback.planner.errors import UNREADABLE, DamagedError, TimelineError
from foldback.planner.storage.array_files import read_arrays, read_head, save_npz, write_head
from foldback.planner.storage.files import temporary_path
from foldback.planner.storage.plain_values import from_plain, to_plain

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]
FIGURES_FORMAT: Final = "foldback-figures/2"
CLEARANCE_REACH_PITCH: Final = 1.0
"""Largest distance from a module to the nearest other one that is stored for plots, in pitches;
larger distances are stored as this one."""
CURVES_FILE: Final = "curves.npz"


@dataclass(frozen=True, slots=True)
class _Head:
    """Values in the head of figures.

    Attributes:
        format: ``FIGURES_FORMAT``.
        reach: ``CLEARANCE_REACH_PITCH``.
        ends: Number of frames up to the end of each file of figures of modules and hinges; none if
            there are only curves.
        files: Checksums by name of the file.
    """

    format: str
    reach: float
    ends: tuple[int, ...]
    files: dict[str, int]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curves:
    """One figure for each of F frames.

    Attributes:
        max_error_rad: (F,) largest joint error; NaN if none is recorded.
        min_clearance: (F,) least of all modules' clearances, pitches.
        hinges_moving: (F,) number of hinges that move on the way to the frame, by the
            certificate's rule.
        peak_torque_nm: (F,) largest hinge torque; NaN in the explosion.
    """

    max_error_rad: Floats
    min_clearance: Floats
    hinges_moving: Integers
    peak_torque_nm: Floats

    def __len__(self) -> int:
        return len(self.min_clearance)

    @classmethod
    def load(cls, path: str | FilePath, start: int = 0, stop: int | None = None) -> Self:
        """Read frames ``start`` to ``stop`` (to the end if None) of figures on disk.

        Raises:
            TimelineError: There are no figures, or the range is not in them.
            DamagedError: The figures are damaged.
        """
        folder = FilePath(path)
        try:
            head = from_plain(read_head(folder), _Head)
        except (OSError, ValueError) as error:
            raise TimelineError(f"no readable figures at {path}: {error}") from error
        if head.format != FIGURES_FORMAT:
            raise TimelineError(
                f"got the format {head.format!r} at {path}, expected {FIGURES_FORMAT!r}."
            )
        try:
            curves = read_arrays(folder / CURVES_FILE, head.files[CURVES_FILE])
            frames = len(curves["min_clearance"])
            end = frames if stop is None else stop
            if not 0 <= start <= end <= frames:
                raise TimelineError(
                    f"got frames {start} to {end}, expected a range within the fold's {frames} "
                    "frames."
                )
            return cls(
                **{field.name: curves[field.name][start:end] for field in fields(Curves)},
                **cls._of_modules(folder, head, start, end),
            )
        except UNREADABLE as error:
            raise DamagedError(path, f"{type(error).__name__}: {error}") from error

    @classmethod
    def _of_modules(cls, folder: FilePath, head: _Head, start: int, end: int) -> dict[str, Any]:
        """Return the arrays of modules and hinges."""
        return {}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures(Curves):
    """All figures of F frames of a chain of N modules and J hinges.

    Attributes:
        clearance: (F, N) distance of each module from the nearest other one that it may not touch,
            pitches, as in the certificate: a lower bound if they are apart, exactly minus the depth
            if they overlap; ``CLEARANCE_REACH_PITCH`` at most. NaN if the angles are not finite.
        nearest: (F, N) index of that nearest module; −1 if none is within that reach.
        torque_nm: (F, J) torque that every hinge needs for the recorded motion, floating, without
            gravity or contacts, in the fold time and the unit of the certificate; NaN in the
            explosion, whose forces no robot has.
    """

    clearance: Floats
    nearest: Integers
    torque_nm: Floats

    @classmethod
    def _of_modules(cls, folder: FilePath, head: _Head, start: int, end: int) -> dict[str, Any]:
        if not head.ends:
            raise TimelineError(f"there are no figures of single modules at {folder}.")
        first = bisect_right(head.ends[:-1], start)
        last = bisect_left(head.ends[:-1], end, lo=first)
        parts = [
            read_arrays(folder / _file(k), head.files[_file(k)]) for k in range(first, last + 1)
        ]
        before = head.ends[first - 1] if first else 0
        return {
            name: np.concatenate([part[name] for part in parts])[start - before : end - before]
            for name in _BY_MODULE
        }


def write(parts: Iterable[Curves], path: str | FilePath) -> None:
    """Write figures, or curves alone, in parts.

    The path then holds all of them, or, after an error, its former content.
    """
    target = FilePath(path)
    temporary = temporary_path(target)
    try:
        temporary.mkdir(parents=True)
        files: dict[str, int] = {}
        curves: list[Curves] = []
        ends: list[int] = []
        for part in parts:
            curves.append(part)
            if isinstance(part, Figures):
                name = _file(len(ends))
                files[name] = save_npz(
                    temporary / name, {name: getattr(part, name) for name in _BY_MODULE}
                )
                ends.append(sum(map(len, curves)))
        joined = {
            field.name: np.concatenate([getattr(part, field.name) for part in curves])
            for field in fields(Curves)
        }
        files[CURVES_FILE] = save_npz(temporary / CURVES_FILE, joined)
        write_head(
            temporary, to_plain(_Head(FIGURES_FORMAT, CLEARANCE_REACH_PITCH, tuple(ends), files))
        )
        rmtree(target, ignore_errors=True)
        temporary.rename(target)
    finally:
        rmtree(temporary, ignore_errors=True)


def _file(number: int) -> str:
    return f"{number:06}.npz"


_BY_MODULE: Final = ("clearance", "nearest", "torque_nm")
