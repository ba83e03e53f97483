"""Metrics: what can be said of every frame of a timeline, as ``planner.certificate.measure`` does.

On disk they are a zarr group beside the timeline, of which any range of frames can be read.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path as FilePath
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Final, Self, cast

import numpy as np
from numpy.typing import NDArray

from planner.checked_zarr import checksums_of, create_array, read_group, sealed
from planner.errors import UNREADABLE, DamagedError, TimelineError
from planner.files import temporary_path, zarr_group

if TYPE_CHECKING:
    import zarr

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]
FORMAT: Final = "foldback-figures/1"
REACH: Final = 1.0
"""Pitches; clearances from here on are told as this."""
FRAMES_A_CHUNK: Final = 128
"""Frames in a chunk of the figures of modules and hinges."""
FRAMES_A_CURVE: Final = 8192
"""Frames in a chunk of the curves, which have one number a frame."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curves:
    """One figure for each of F frames.

    Attributes:
        max_error_rad: (F,) the largest joint error; NaN where none is recorded.
        min_clearance: (F,) the least of all modules' clearances, in pitches.
        hinges_moving: (F,) hinges that move, by the certificate's rule, on the way to the frame.
        peak_torque_nm: (F,) the largest hinge torque; NaN in the explosion.
    """

    max_error_rad: Floats
    min_clearance: Floats
    hinges_moving: Integers
    peak_torque_nm: Floats

    def __len__(self) -> int:
        return len(self.min_clearance)

    @classmethod
    def load(cls, path: str | FilePath, start: int = 0, stop: int | None = None) -> Self:
        """Frames ``start`` to ``stop`` (all there are when None) of what ``write`` wrote.

        Raises:
            TimelineError: If there are no figures, or the range is not in them.
            DamagedError: If they are damaged.
        """
        try:
            group = read_group(path)
            attributes = group.attrs.asdict()
            arrays = {f.name: cast("zarr.Array[Any]", group[f.name]) for f in fields(cls)}
        except (OSError, ValueError, KeyError) as error:
            raise TimelineError(f"no figures at {path}: {error}") from error
        if attributes.get("format") != FORMAT:
            raise TimelineError(
                f"got the format {attributes.get('format')!r} at {path}, expected {FORMAT!r}."
            )
        frames = min(array.shape[0] for array in arrays.values())
        end = frames if stop is None else stop
        if not 0 <= start <= end <= frames:
            raise TimelineError(
                f"got frames {start} to {end}, expected a range within the fold's {frames} frames."
            )
        try:
            found: dict[str, Any] = {name: array[start:end] for name, array in arrays.items()}
        except DamagedError:
            raise
        except UNREADABLE as error:
            raise DamagedError(path, f"{type(error).__name__}: {error}") from error
        return cls(**found)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Figures(Curves):
    """All figures of F frames of a chain of N modules and J hinges.

    Attributes:
        clearance: (F, N) each module's distance in pitches from the nearest other one that it may
            not touch, as the certificate measures it: a lower bound when they are apart, exactly
            minus the depth when they overlap; never more than ``REACH``. NaN where the
            configuration is no number.
        nearest: (F, N) which module that is; −1 when none is within ``REACH``.
        torque_nm: (F, J) torque that every hinge needs for the recorded motion, floating, without
            gravity or contacts, in the fold time and the unit of the certificate; NaN in the
            explosion, whose forces are none that a robot has.
    """

    clearance: Floats
    nearest: Integers
    torque_nm: Floats


def write(parts: Iterable[Curves], frames: int, path: str) -> None:
    """Writes figures, or curves alone, in parts, ``frames`` frames in all.

    What is there in the end is a whole zarr group, or what was there before.
    """
    whole = FilePath(path)
    aside = temporary_path(whole)
    rmtree(aside, ignore_errors=True)
    try:
        group = zarr_group(aside, "w")
        arrays: dict[str, zarr.Array[Any]] = {}
        curves: list[Curves] = []
        start = 0
        for part in parts:
            for name in _BY_MODULE if isinstance(part, Figures) else ():
                values = getattr(part, name)
                if name not in arrays:
                    arrays[name] = _array(group, name, frames, values, FRAMES_A_CHUNK)
                arrays[name][start : start + len(part)] = values
            curves.append(part)
            start += len(part)
        for field in fields(Curves):
            values = np.concatenate([getattr(part, field.name) for part in curves])
            arrays[field.name] = _array(group, field.name, frames, values, FRAMES_A_CURVE)
            arrays[field.name][:] = values
        checksums = checksums_of(aside, arrays)
        group.attrs.put(sealed({"format": FORMAT, "reach": REACH}, checksums))
        rmtree(whole, ignore_errors=True)
        aside.rename(whole)
    finally:
        rmtree(aside, ignore_errors=True)


def _array(
    group: zarr.Group, name: str, frames: int, values: NDArray[Any], chunk: int
) -> zarr.Array[Any]:
    tail = values.shape[1:]
    return create_array(
        group,
        name,
        shape=(frames, *tail),
        chunks=(chunk, *(max(1, size) for size in tail)),
        dtype=values.dtype,
    )


_BY_MODULE: Final = ("clearance", "nearest", "torque_nm")
