"""Frames: snapshots of a chain with all its angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.rotations import motion_in_plane, wxyz_from_matrix

Array = NDArray[np.float64]
PHASES: Final = ("explosion", "playback", "unfolding")
Phase = Literal["explosion", "playback", "unfolding"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frames:
    """F snapshots in the order of time.

    Attributes:
        time_s: (F,) simulated time, rising through all phases.
        phase: (F,) uint8 index into ``PHASES``.
        joint_angles_rad: (F, J) hinge angles.
        root_position: (F, 3) centre of the root module in pitches.
        root_wxyz: (F, 4) orientation of the root module.
        joint_error_rad: (F, J) distance of each hinge from its reference; NaN where there is none.
    """

    time_s: Array
    phase: NDArray[np.uint8]
    joint_angles_rad: Array
    root_position: Array
    root_wxyz: Array
    joint_error_rad: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, index: slice | NDArray[np.integer[Any]]) -> Frames:
        return Frames(**{f.name: getattr(self, f.name)[index] for f in fields(self)})

    def dense(self, chain: Chain, start: int = 0, stop: int | None = None) -> Frames:
        """Return the snapshots ``start`` to ``stop``, like ``Windows.dense``."""
        del chain
        return self[start:stop]

    @property
    def largest_errors(self) -> Array:
        """(F,) largest joint error of each snapshot, NaN if none is recorded."""
        return self.joint_error_rad.max(axis=1)

    def angles(self, chain: Chain, start: int = 0, stop: int | None = None) -> NDArray[np.float64]:
        """Return all (f, J) angles of the snapshots ``start`` to ``stop``, rad."""
        del chain
        return self.joint_angles_rad[start:stop]

    def clamped(self, chain: Chain) -> Frames:
        """Return the frames with the chain's first module at its folded pose."""
        poses = forward_kinematics(
            chain.module,
            self.joint_angles_rad,
            root=0,
            root_position=chain.folded_position,
            root_wxyz=chain.folded_wxyz,
        )
        return replace(
            self,
            root_position=poses.positions[:, chain.root],
            root_wxyz=wxyz_from_matrix(poses.rotations[:, chain.root]),
        )

    def planned(self, chain: Chain, angles_rad: Array, *, clamped: bool) -> Frames:
        """Return the frames with planned angles, at the expected pose on a table.

        Args:
            chain: The chain; folded, it stands on the table.
            angles_rad: (F, J) planned angles.
            clamped: True if the first module has its folded pose. A chain that lies free drifts:
                turned about the vertical and shifted along the table, its modules then lie as
                closely as they can to those of these frames.
        """
        wanted = replace(self, joint_angles_rad=angles_rad).clamped(chain)
        if clamped:
            return wanted
        poses = chain.poses(wanted.joint_angles_rad, wanted.root_position, wanted.root_wxyz)
        here = chain.poses(self.joint_angles_rad, self.root_position, self.root_wxyz)
        turns, shifts = motion_in_plane(poses.positions, here.positions)
        roots = turns @ wanted.root_position[:, :, None]
        return replace(
            wanted,
            root_position=roots[..., 0] + shifts,
            root_wxyz=wxyz_from_matrix(turns @ poses.rotations[:, chain.root]),
        )

    @classmethod
    def none(cls, joints: int) -> Frames:
        """Return no frames, of a chain with ``joints`` hinges."""
        return cls(
            time_s=np.zeros(0),
            phase=np.zeros(0, dtype=np.uint8),
            joint_angles_rad=np.zeros((0, joints)),
            root_position=np.zeros((0, 3)),
            root_wxyz=np.zeros((0, 4)),
            joint_error_rad=np.zeros((0, joints)),
        )

    @classmethod
    def of_phase(
        cls,
        phase: Phase,
        *,
        time_s: Array,
        joint_angles_rad: Array,
        root_position: Array,
        root_wxyz: Array,
        joint_error_rad: Array | None = None,
    ) -> Frames:
        """Build frames of one phase; no errors are recorded if they are None."""
        if joint_error_rad is None:
            joint_error_rad = np.full_like(joint_angles_rad, np.nan)
        return cls(
            time_s=time_s,
            phase=np.full(len(time_s), PHASES.index(phase), dtype=np.uint8),
            joint_angles_rad=joint_angles_rad,
            root_position=root_position,
            root_wxyz=root_wxyz,
            joint_error_rad=joint_error_rad,
        )

    @classmethod
    def joined(cls, parts: Sequence[Frames]) -> Frames:
        """Concatenate frames."""
        return cls(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)}
        )
