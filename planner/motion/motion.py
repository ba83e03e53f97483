"""Motion: snapshots of a chain over time, with all of its angles or only those of a window.

In each snapshot the hinges before a window are folded, those after it are straight, and the motion
holds the angles in between. There are two layouts:

* A *dense* motion, of an explosion that moves everything at once: each window holds all hinges, in
  double precision, and the root module has a pose.
* A *windowed* motion, of what comes off piece by piece: its memory grows with the number of moving
  hinges. Its angles are single precision, and it is these very numbers that are verified. Module 0
  has a pose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Flags, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.rotations import motion_in_plane, wxyz_from_matrix
from foldback.planner.errors import InputError

Angles = NDArray[np.floating[Any]]
Phase = Literal["explosion", "playback", "unfolding"]
PHASES: Final = ("explosion", "playback", "unfolding")
EXPLOSION: Final = PHASES.index("explosion")


Columns = dict[str, tuple[tuple[int, ...], str]]
FRAME_COLUMNS: Final[Columns] = {
    "time_s": ((), "float64"),
    "phase": ((), "uint8"),
    "joint_angles_rad": ((-1,), "float64"),
    "root_position": ((3,), "float64"),
    "root_wxyz": ((4,), "float64"),
    "joint_error_rad": ((-1,), "float64"),
}
"""Columns of a motion in files that stores the angles of all hinges in each frame. For each column:
the shape of one frame's entry, where −1 stands for the number of hinges, and the data type."""
WINDOW_COLUMNS: Final[Columns] = {
    "time_s": ((), "float64"),
    "phase": ((), "uint8"),
    "first": ((), "int64"),
    "offsets": ((), "int64"),
    "angles_rad": ((), "float32"),
    "base_position": ((3,), "float64"),
    "base_wxyz": ((4,), "float64"),
    "errors_rad": ((), "float32"),
}
"""Columns of a motion in files that stores, for each frame, only the window of hinges between the
folded part of the chain and the straight one. ``first`` is the window's first hinge, ``offsets``
its start in ``angles_rad``. For each column: shape of one entry, and data type."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """F snapshots in the order of time; (V,) angles of all their windows together.

    Attributes:
        time_s: (F,) simulated time, rising through all phases.
        phase: (F,) uint8 index into ``PHASES``.
        first: (F,) hinge at which the window begins; all before it are folded.
        offsets: (F + 1,) start of each window in ``angles_rad``; all hinges after it are 0.
        angles_rad: (V,) hinge angles, float64 if dense, float32 if windowed.
        anchor_position: (F, 3) centre of the anchor module in pitches: the root module if dense,
            module 0 if windowed.
        anchor_wxyz: (F, 4) orientation of the anchor module.
        errors_rad: (V,) distance of each angle from its reference, NaN where there is none; the
            errors of hinges outside of windows are 0. None if no error is recorded.
        hinges: Number of hinges in each snapshot of a dense motion, J; None if it is windowed.
    """

    time_s: Array
    phase: NDArray[np.uint8]
    first: Ints
    offsets: Ints
    angles_rad: Angles
    anchor_position: Array
    anchor_wxyz: Array
    errors_rad: Angles | None = None
    hinges: int | None = None

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def nbytes(self) -> int:
        """Approximate memory of the motion, bytes."""
        errors = 0 if self.errors_rad is None else self.errors_rad.nbytes
        return self.angles_rad.nbytes + errors + 100 * len(self)

    @property
    def is_windowed(self) -> bool:
        """True if only the angles of windows are held, in single precision."""
        return self.hinges is None

    @property
    def layout(self) -> Literal["frames", "windows"]:
        """Name of the layout in files."""
        return "windows" if self.is_windowed else "frames"

    @classmethod
    def from_frames(
        cls,
        *,
        time_s: Array,
        phase: Phase | NDArray[np.uint8],
        joint_angles_rad: Array,
        root_position: Array,
        root_wxyz: Array,
        joint_error_rad: Array | None = None,
    ) -> Motion:
        """Build a dense motion of (F, J) angles; the arrays are not copied.

        Args:
            time_s: (F,) simulated time.
            phase: (F,) index into ``PHASES``, or the name of one phase for all frames.
            joint_angles_rad: (F, J) hinge angles.
            root_position: (F, 3) centre of the root module in pitches.
            root_wxyz: (F, 4) orientation of the root module.
            joint_error_rad: (F, J) joint errors; None if no error is recorded.
        """
        frames, hinges = joint_angles_rad.shape
        return cls(
            time_s=time_s,
            phase=_phases(phase, len(time_s)),
            first=np.zeros(frames, np.int64),
            offsets=hinges * np.arange(frames + 1, dtype=np.int64),
            angles_rad=joint_angles_rad.reshape(-1),
            anchor_position=root_position,
            anchor_wxyz=root_wxyz,
            errors_rad=None if joint_error_rad is None else joint_error_rad.reshape(-1),
            hinges=hinges,
        )

    @classmethod
    def from_windows(
        cls,
        *,
        time_s: Array,
        phase: Phase | NDArray[np.uint8],
        first: Ints,
        offsets: Ints,
        angles_rad: NDArray[np.float32],
        base_position: Array,
        base_wxyz: Array,
        errors_rad: NDArray[np.float32] | None = None,
    ) -> Motion:
        """Build a windowed motion; the base is module 0."""
        return cls(
            time_s=time_s,
            phase=_phases(phase, len(time_s)),
            first=first,
            offsets=offsets,
            angles_rad=angles_rad,
            anchor_position=base_position,
            anchor_wxyz=base_wxyz,
            errors_rad=errors_rad,
        )

    @classmethod
    def from_angles(
        cls, angles_rad: Angles, first: Ints | None = None, offsets: Ints | None = None
    ) -> Motion:
        """Build a motion of angles alone: a frame a second, its anchor at the origin.

        Args:
            angles_rad: (F, J) hinge angles; of windows (V,).
            first, offsets: Those of the windows; None for a dense motion.
        """
        if first is None or offsets is None:
            frames, hinges = len(angles_rad), int(angles_rad.shape[1])
            windows = (np.zeros(frames, np.int64), hinges * np.arange(frames + 1, dtype=np.int64))
        else:
            frames, hinges, windows = len(first), None, (first, offsets)
        return cls(
            time_s=np.arange(frames, dtype=np.float64),
            phase=_phases("playback", frames),
            first=windows[0],
            offsets=windows[1],
            angles_rad=angles_rad.reshape(-1),
            anchor_position=np.zeros((frames, 3)),
            anchor_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
            hinges=hinges,
        )

    @classmethod
    def empty(cls, hinges: int) -> Motion:
        """Return a dense motion without frames, of a chain with ``hinges`` hinges."""
        return cls.from_angles(np.zeros((0, hinges)))

    @classmethod
    def joined(cls, parts: Sequence[Motion]) -> Motion:
        """Concatenate motions of one layout.

        Raises:
            TypeError: They have two layouts, or different numbers of hinges.
        """
        hinges = {part.hinges for part in parts}
        if len(hinges) != 1:
            layouts = sorted(
                "windowed" if count is None else f"dense, {count} hinges" for count in hinges
            )
            raise TypeError(
                f"got motions with different layouts ({'; '.join(layouts)}), expected motions with "
                "the same layout"
                if layouts
                else "got no motions, expected at least one"
            )
        has_errors = any(part.errors_rad is not None for part in parts)
        lengths = np.concatenate([np.diff(part.offsets) for part in parts])
        plain = ("time_s", "phase", "first", "angles_rad", "anchor_position", "anchor_wxyz")
        return cls(
            offsets=np.concatenate([[0], np.cumsum(lengths)]),
            errors_rad=np.concatenate([part.errors for part in parts]) if has_errors else None,
            hinges=hinges.pop(),
            **{name: np.concatenate([getattr(p, name) for p in parts]) for name in plain},
        )

    @classmethod
    def from_columns(cls, columns: Mapping[str, Any]) -> Motion:
        """Build a motion from columns of either layout; other entries are ignored."""
        windowed = "offsets" in columns
        arguments = {
            name: columns[name]
            for name in (WINDOW_COLUMNS if windowed else FRAME_COLUMNS)
            if name in columns
        }
        return cls.from_windows(**arguments) if windowed else cls.from_frames(**arguments)

    def columns(self) -> dict[str, Any]:
        """Return the columns by the names that files have; errors only if there are any.

        A dense motion always has a column of errors, NaN where none is recorded.
        """
        names = WINDOW_COLUMNS if self.is_windowed else FRAME_COLUMNS
        values = {name: getattr(self, name.replace("base", "anchor")) for name in names}
        return {name: values for name, values in values.items() if values is not None}

    def with_columns(self, **columns: Any) -> Motion:
        """Return the motion with other columns, by the names that files have."""
        values = self.columns()
        if self.errors_rad is None:
            values.pop("joint_error_rad", None)
        return Motion.from_columns({**values, **columns})

    def with_angles(self, angles_rad: Angles) -> Motion:
        """Return the motion with other angles at the same hinges and times, without errors.

        Args:
            angles_rad: (F, J) angles if dense, else (V,) angles of the windows.
        """
        return replace(self, angles_rad=angles_rad.reshape(-1), errors_rad=None)

    @property
    def joint_angles_rad(self) -> Array:
        """(F, J) hinge angles of a dense motion, not copied.

        Raises:
            TypeError: The motion is windowed.
        """
        return self._rows(self.angles_rad)

    @property
    def stored_angles_rad(self) -> Angles:
        """Hinge angles in the shape that files have: (F, J) if dense, (V,) if windowed."""
        return self.angles_rad if self.is_windowed else self.joint_angles_rad

    @property
    def joint_error_rad(self) -> Array:
        """(F, J) joint errors of a dense motion, NaN where none is recorded."""
        if self.errors_rad is None:
            return np.broadcast_to(np.nan, self.joint_angles_rad.shape)
        return self._rows(self.errors_rad)

    @property
    def root_position(self) -> Array:
        """(F, 3) centre of the root module of a dense motion in pitches."""
        return self._root(self.anchor_position)

    @property
    def root_wxyz(self) -> Array:
        """(F, 4) orientation of the root module of a dense motion."""
        return self._root(self.anchor_wxyz)

    def _rows(self, values: Angles) -> Array:
        """Return (F, J) values of a dense motion."""
        return self._root(values).reshape(len(self.first), self.hinges or 0)

    def _root(self, values: Any) -> Array:
        if self.is_windowed:
            raise TypeError(
                "got a windowed motion, expected a dense motion; convert it with Motion.dense"
            )
        return values

    @property
    def last(self) -> Ints:
        """(F,) hinge behind each window: it and all that follow are straight."""
        return self.first + np.diff(self.offsets)

    def __getitem__(self, index: slice | NDArray[np.integer[Any]]) -> Motion:
        """Return some of the snapshots; a range of them is not copied."""
        rows, values = index, (self.angles_rad, self.errors_rad)
        if isinstance(index, slice) and index.step in (None, 1):
            start, stop, _ = index.indices(len(self))
            stop = max(start, stop)
            offsets = self.offsets[start : stop + 1]
            stretch = slice(int(offsets[0]), int(offsets[-1]))
            angles, errors = (None if v is None else v[stretch] for v in values)
            offsets = offsets - offsets[0]
        else:
            rows = np.arange(len(self))[index]
            offsets = np.concatenate([[0], np.cumsum(np.diff(self.offsets)[rows])])
            angles, errors = (None if v is None else self._of_windows(v, rows) for v in values)
        assert angles is not None
        return Motion(
            time_s=self.time_s[rows],
            phase=self.phase[rows],
            first=self.first[rows],
            offsets=offsets,
            angles_rad=angles,
            anchor_position=self.anchor_position[rows],
            anchor_wxyz=self.anchor_wxyz[rows],
            errors_rad=errors,
            hinges=self.hinges,
        )

    def _of_windows(self, values: Angles, numbers: NDArray[np.integer[Any]]) -> Angles:
        """Return those of (V,) values that belong to some snapshots."""
        parts = [values[self.offsets[k] : self.offsets[k + 1]] for k in numbers]
        return np.concatenate([values[:0], *parts])

    def check(self, chain: Chain) -> None:
        """Refuse windows that do not belong to a chain, and angles that are not finite.

        Raises:
            InputError: ``bad-windows``.
        """
        hinges, frames, widths = len(chain.folded_rad), len(self), np.diff(self.offsets)
        if (
            self.first.shape != (frames,)
            or self.offsets.shape != (frames + 1,)
            or (self.first < 0).any()
            or (widths < 0).any()
            or (self.first + widths > hinges).any()
            or int(self.offsets[0]) != 0
            or int(self.offsets[-1]) != len(self.angles_rad)
        ):
            raise InputError(
                "bad-windows",
                "got ranges of hinges (windows) that do not fit this chain, expected ranges within "
                f"its {hinges} hinges, with one angle for each hinge of a range.",
            )
        if not np.isfinite(self.angles_rad).all():
            raise InputError(
                "bad-windows", "got infinite or undefined angles, expected finite angles."
            )

    def passes_as(self, other: Motion) -> bool:
        """Return True if both pass exactly the same angles, at any times and poses."""
        return self.has_windows_of(other) and np.array_equal(self.angles_rad, other.angles_rad)

    def has_windows_of(self, other: Motion) -> bool:
        """Return True if both hold the same hinges in the same layout."""
        return (
            self.hinges == other.hinges
            and np.array_equal(self.first, other.first)
            and np.array_equal(self.offsets, other.offsets)
        )

    @property
    def errors(self) -> Angles:
        """(V,) joint errors of the windows, NaN where none is recorded."""
        if self.errors_rad is None:
            return np.full(len(self.angles_rad), np.nan, dtype=self.angles_rad.dtype)
        return self.errors_rad

    @property
    def recorded(self) -> Flags:
        """(F,) True if joint errors are recorded; an empty window counts, except in explosions."""
        recorded = np.zeros(len(self), dtype=bool)
        if self.errors_rad is not None:
            has_error = ~np.isnan(self.errors_rad)
            nonempty = np.diff(self.offsets) > 0
            recorded[nonempty] = np.logical_and.reduceat(has_error, self.offsets[:-1][nonempty])
            recorded[~nonempty] = self.phase[~nonempty] != EXPLOSION
        return recorded

    @property
    def largest_errors(self) -> Array:
        """(F,) largest joint error of each snapshot, NaN if none is recorded."""
        largest = np.where(self.recorded, 0.0, np.nan)
        nonempty = np.flatnonzero(np.diff(self.offsets))
        if self.errors_rad is not None and len(nonempty):
            largest[nonempty] = np.maximum.reduceat(self.errors_rad, self.offsets[nonempty])
        return largest

    def joint_errors(self, chain: Chain, start: int = 0, stop: int | None = None) -> Array:
        """Return (f, J) joint errors of the snapshots ``start`` to ``stop``, NaN if not recorded.

        If those of a window are recorded, the errors of the other hinges are 0.
        """
        stretch = self[start:stop]
        if not stretch.is_windowed:
            return stretch.joint_error_rad
        errors = np.full((len(stretch), len(chain.folded_rad)), np.nan)
        for k in np.flatnonzero(stretch.recorded):
            part = stretch.errors[stretch.offsets[k] : stretch.offsets[k + 1]]
            errors[k] = 0.0
            errors[k, stretch.first[k] : stretch.first[k] + len(part)] = part
        return errors

    def angles(self, chain: Chain, start: int = 0, stop: int | None = None) -> Array:
        """Return all (f, J) angles of the snapshots ``start`` to ``stop``, rad.

        Those of a dense motion are not copied.
        """
        if not self.is_windowed:
            return self.joint_angles_rad[start:stop]
        numbers = range(len(self))[start:stop]
        rows = np.zeros((len(numbers), len(chain.folded_rad)))
        for row, k in zip(rows, numbers, strict=True):
            a, b = int(self.first[k]), int(self.offsets[k + 1] - self.offsets[k])
            row[:a] = chain.folded_rad[:a]
            row[a : a + b] = self.angles_rad[self.offsets[k] : self.offsets[k + 1]]
        return rows

    def angles_at(self, chain: Chain, frame: int) -> Array:
        """Return the (J,) angles of one snapshot, rad; a negative number counts from the end."""
        frame %= len(self)
        return self.angles(chain, frame, frame + 1)[0]

    def dense(self, chain: Chain, start: int = 0, stop: int | None = None) -> Motion:
        """Return the snapshots ``start`` to ``stop`` as a dense motion."""
        part = self[start:stop]
        if not part.is_windowed:
            return part
        angles = part.angles(chain)
        poses = forward_kinematics(
            chain.module,
            angles,
            root=0,
            root_position=part.anchor_position,
            root_wxyz=part.anchor_wxyz,
        )
        return Motion.from_frames(
            time_s=part.time_s,
            phase=part.phase,
            joint_angles_rad=angles,
            root_position=poses.positions[:, chain.root],
            root_wxyz=wxyz_from_matrix(poses.rotations[:, chain.root]),
            joint_error_rad=part.joint_errors(chain),
        )

    def in_layout_of(self, other: Motion, chain: Chain) -> Motion:
        """Return the motion, dense if another one is."""
        return self if other.is_windowed else self.dense(chain)

    def poses(self, chain: Chain, start: int = 0, stop: int | None = None) -> Poses:
        """Return the poses of all modules in the snapshots ``start`` to ``stop``."""
        part = self.dense(chain, start, stop)
        return chain.poses(part.joint_angles_rad, part.anchor_position, part.anchor_wxyz)

    def windowed(self, chain: Chain) -> Motion:
        """Return the motion in the shortest windows, in single precision, without errors.

        Angles count as folded or straight when they are so in single precision.
        """
        if self.is_windowed:
            return self
        angles = self.joint_angles_rad.astype(np.float32)
        moved = angles != chain.folded_rad.astype(np.float32)
        first = np.where(moved.any(axis=1), moved.argmax(axis=1), angles.shape[1])
        bent = angles != 0.0
        last = np.where(bent.any(axis=1), angles.shape[1] - bent[:, ::-1].argmax(axis=1), 0)
        last = np.maximum(last, first)
        poses = chain.poses(angles.astype(np.float64), self.anchor_position, self.anchor_wxyz)
        return Motion.from_windows(
            time_s=self.time_s,
            phase=self.phase,
            first=first.astype(np.int64),
            offsets=np.concatenate([[0], np.cumsum(last - first)]).astype(np.int64),
            angles_rad=np.concatenate(
                [np.zeros(0, np.float32)]
                + [row[a:b] for row, a, b in zip(angles, first, last, strict=True)]
            ),
            base_position=poses.positions[:, 0],
            base_wxyz=poses.wxyzs[:, 0],
        )

    def steps(self, chain: Chain, *, fraction: float = 0.0) -> tuple[Array, Ints]:
        """Return the largest step, and the number of moving hinges, from snapshot to snapshot.

        Args:
            chain: The chain.
            fraction: Minimum step of a moving hinge as a fraction of the largest one.

        Returns:
            (F − 1,) largest steps, rad, and (F − 1,) numbers of moving hinges.
        """
        if not self.is_windowed:
            steps = np.abs(np.diff(self.joint_angles_rad, axis=0))
            largest = steps.max(axis=1)
            return largest, (steps > fraction * largest[:, None]).sum(axis=1)
        from foldback.planner.core import window_steps

        count = max(0, len(self) - 1)
        largest, moving = np.zeros(count), np.zeros(count, dtype=np.int64)
        window_steps(
            self.first,
            self.offsets,
            self.angles_rad,
            chain.folded_rad,
            fraction,
            largest,
            moving,
        )
        return largest, moving

    def clamped(self, chain: Chain) -> Motion:
        """Return the dense motion with the chain's first module at its folded pose."""
        poses = forward_kinematics(
            chain.module,
            self.joint_angles_rad,
            root=0,
            root_position=chain.folded_position,
            root_wxyz=chain.folded_wxyz,
        )
        return replace(
            self,
            anchor_position=poses.positions[:, chain.root],
            anchor_wxyz=wxyz_from_matrix(poses.rotations[:, chain.root]),
        )

    def planned(self, chain: Chain, plan: Motion, *, clamped: bool) -> Motion:
        """Return the motion with planned angles, at the expected pose on a table.

        The pose of a windowed motion is that of its first module, and stays.

        Args:
            chain: The chain; folded, it stands on the table.
            plan: Motion with the planned angles at the same frames.
            clamped: True if the first module has its folded pose. A chain that lies free drifts:
                turned about the vertical and shifted along the table, its modules then lie as
                closely as they can to those of this motion.
        """
        if self.is_windowed:
            return self.with_angles(plan.angles_rad)
        planned = self.with_angles(plan.angles_rad).clamped(chain)
        if clamped:
            return planned
        poses = planned.poses(chain)
        turns, shifts = motion_in_plane(poses.positions, self.poses(chain).positions)
        roots = turns @ planned.anchor_position[:, :, None]
        return replace(
            planned,
            anchor_position=roots[..., 0] + shifts,
            anchor_wxyz=wxyz_from_matrix(turns @ poses.rotations[:, chain.root]),
        )


def as_motion(motion: Motion | Array) -> Motion:
    """Return a motion; (F, J) angles alone become a dense one."""
    return motion if isinstance(motion, Motion) else Motion.from_angles(motion)


def _phases(phase: Phase | NDArray[np.uint8], frames: int) -> NDArray[np.uint8]:
    """Return a phase for each of F frames, as indices into ``PHASES``."""
    if isinstance(phase, str):
        return np.full(frames, PHASES.index(phase), dtype=np.uint8)
    return phase
