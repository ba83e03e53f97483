"""Metrics store: figures of every frame of a timeline, on disk.

``planner.certificate.frame_figures`` computes them. They are a zarr group beside the timeline; any
range of frames can be read.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path as FilePath
from shutil import rmtree
from typing import TYPE_CHECKING, Any, Final, Self, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.errors import UNREADABLE, DamagedError, TimelineError
from foldback.planner.storage.checked_zarr import (
    checksums_of,
    create_array,
    create_group,
    read_group,
    sealed,
)
from foldback.planner.storage.files import temporary_path, zarr_metadata

if TYPE_CHECKING:
    import zarr

Floats = NDArray[np.float32]
Integers = NDArray[np.int32]
FIGURES_FORMAT: Final = "foldback-figures/1"
CLEARANCE_REACH_PITCH: Final = 1.0
"""Largest distance from a module to the nearest other one that is stored for plots, in pitches;
larger distances are stored as this one."""
FIGURE_FRAMES_PER_CHUNK: Final = 128
"""Number of frames in one zarr chunk of figures with a value for each module or hinge."""


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
        try:
            group = read_group(path)
            attributes = group.attrs.asdict()
            with zarr_metadata():
                arrays = {f.name: cast("zarr.Array[Any]", group[f.name]) for f in fields(cls)}
        except (OSError, ValueError, KeyError) as error:
            raise TimelineError(f"no readable figures at {path}: {error}") from error
        if attributes.get("format") != FIGURES_FORMAT:
            raise TimelineError(
                f"got the format {attributes.get('format')!r} at {path}, "
                f"expected {FIGURES_FORMAT!r}."
            )
        frames = min(array.shape[0] for array in arrays.values())
        end = frames if stop is None else stop
        if not 0 <= start <= end <= frames:
            raise TimelineError(
                f"got frames {start} to {end}, expected a range within the fold's {frames} frames."
            )
        try:
            columns: dict[str, Any] = {name: array[start:end] for name, array in arrays.items()}
        except DamagedError:
            raise
        except UNREADABLE as error:
            raise DamagedError(path, f"{type(error).__name__}: {error}") from error
        return cls(**columns)


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


def write(parts: Iterable[Curves], frames: int, path: str) -> None:
    """Write figures, or curves alone, in parts, ``frames`` frames in all.

    The path then holds a complete zarr group, or, after an error, its former content.
    """
    target = FilePath(path)
    temporary = temporary_path(target)
    rmtree(temporary, ignore_errors=True)
    try:
        group = create_group(temporary)
        arrays: dict[str, zarr.Array[Any]] = {}
        curves: list[Curves] = []
        start = 0
        for part in parts:
            for name in _BY_MODULE if isinstance(part, Figures) else ():
                values = getattr(part, name)
                if name not in arrays:
                    arrays[name] = _array(group, name, frames, values, FIGURE_FRAMES_PER_CHUNK)
                arrays[name][start : start + len(part)] = values
            curves.append(part)
            start += len(part)
        for field in fields(Curves):
            values = np.concatenate([getattr(part, field.name) for part in curves])
            arrays[field.name] = _array(group, field.name, frames, values, 8192)
            arrays[field.name][:] = values
        checksums = checksums_of(temporary, arrays)
        group.attrs.put(
            sealed({"format": FIGURES_FORMAT, "reach": CLEARANCE_REACH_PITCH}, checksums)
        )
        rmtree(target, ignore_errors=True)
        temporary.rename(target)
    finally:
        rmtree(temporary, ignore_errors=True)


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
