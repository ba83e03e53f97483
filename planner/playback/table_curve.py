"""Table curve: a smooth curve through the record of an explosion on a table, kept on the table.

A long tail goes far for a small turn: halfway between two frames, and where a smooth curve leaves
them, its modules would lie in the table, or hang over it where the record has them stand. The
curve's control points are moved by the least that puts them back.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import FRAMES_AT_ONCE, Array, Ints
from foldback.planner.chain.cantilever_statics import hinge_frames
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.corners import lowest_corners
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.core import torque_columns
from foldback.planner.core.structures import Hinges
from foldback.planner.motion.motion import Motion
from foldback.planner.playback.window_trajectory import WindowCurve
from foldback.planner.statics.contacts import FLOOR_GAP, MAX_TABLE_PENETRATION_PITCH

LIFTED_DEPTH_SHARE: Final = 0.5
"""Depth to which modules are lifted if the planned curve of a fold on a table lets them sink too
deep into it, as a fraction of the permitted depth (0.01 pitches)."""
MAX_CORRECTION_RAD: Final = 0.01
"""Maximum turn of a hinge, rad, in one round of correcting the curve of a fold on a table, as the
correction is linearised."""


class TableCurve(WindowCurve):
    """Uniform cubic B-spline through windows, kept on the table.

    Args:
        chain: The chain; folded, it stands on the table with its lowest modules, z up.
        windows: Snapshots in the order of the playback, the first module at its folded pose.
        spacing_rad: Turn of the fastest hinge from one control point to the next, rad.
    """

    def __init__(self, chain: Chain, windows: Motion, spacing_rad: float) -> None:
        super().__init__(chain, windows, spacing_rad)
        self._every = slice(0, len(chain.folded_rad))
        drawn = super()._point
        self._points = np.stack([drawn(k, self._every) for k in range(len(self._after))])
        self._before = chain.module_before(np.arange(len(chain.folded_rad)))
        self._recorded = self._recorded_heights()
        wrong = np.arange(2, len(self._points) - 2)
        for _ in range(8):
            wrong = self._put_back(wrong)

    def _point(self, k: int, hinges: slice) -> Array:
        return self._points[k, hinges]

    def _recorded_heights(self) -> Array:
        """Return (P, n) heights of modules of the record at control points; NaN: not standing."""
        heights = np.full((len(self._points), len(self.chain)), np.nan)
        for start in range(0, len(heights), FRAMES_AT_ONCE):
            after = self._after[start : start + FRAMES_AT_ONCE]
            part = self._part[start : start + FRAMES_AT_ONCE, None]
            before, next_heights = (
                self._heights(np.stack([self._angles(int(k), self._every) for k in frames]))
                for frames in (after - 1, after)
            )
            between = np.maximum(
                before + part * (next_heights - before),
                -LIFTED_DEPTH_SHARE * MAX_TABLE_PENETRATION_PITCH,
            )
            heights[start : start + FRAMES_AT_ONCE] = np.where(
                between <= FLOOR_GAP, between, np.nan
            )
        return heights

    def _heights(self, angles: Array) -> Array:
        """Return the (F, n) height of the lowest corner of each module, pitches."""
        poses = self._poses(angles)
        return lowest_corners(self.chain.module, poses.positions, poses.rotations)

    def _put_back(self, points: Ints) -> Ints:
        """Move control points with height errors; return those that may have errors now."""
        turns: dict[int, Array] = {}
        for start in range(0, len(points), FRAMES_AT_ONCE):
            part = points[start : start + FRAMES_AT_ONCE]
            angles = self.at(part.astype(np.float64) - 1.0, self._every)
            poses = self._poses(angles)
            heights = lowest_corners(self.chain.module, poses.positions, poses.rotations)
            off = self._recorded[part] - heights
            deep = heights < -MAX_TABLE_PENETRATION_PITCH
            wrong = deep | (np.abs(off) > 0.005)  # pitches
            targets = np.where(
                deep & np.isnan(off),
                -LIFTED_DEPTH_SHARE * MAX_TABLE_PENETRATION_PITCH - heights,
                off,
            )
            for i in np.flatnonzero(wrong.any(axis=1)):
                frame_poses = Poses(positions=poses.positions[i], rotations=poses.rotations[i])
                turns[int(part[i])] = self._turn(int(part[i]), angles[i], frame_poses, targets[i])
        for k, turn in turns.items():
            self._points[k] = np.clip(self._points[k] + turn, *self._stops.T)
        around = np.unique(np.array([*turns], dtype=np.int64)[:, None] + np.arange(-1, 2))
        return around[(around >= 2) & (around < len(self._points) - 2)]

    def _poses(self, angles: Array) -> Poses:
        """Return the poses of (F, J) angles, above a table at z = 0."""
        chain = self.chain
        return forward_kinematics(
            chain.module,
            angles,
            root=0,
            root_position=chain.folded_position - np.array([0.0, 0.0, chain.table_height]),
            root_wxyz=chain.folded_wxyz,
        )

    def _lowest_corner(self, index: int, rotation: Array) -> Array:
        """Return the way from the centre of a module to its lowest corner, pitches."""
        corners = rotation @ self.chain.module.piece(index).corners.T
        return corners[:, corners[2].argmin()]

    def _turn(self, point: int, angles: Array, poses: Poses, target_heights: Array) -> Array:
        """Return the (J,) least turn of a window's hinges that moves modules up or down.

        Args:
            point: The control point.
            angles: (J,) angles there, rad.
            poses: Poses of the modules there.
            target_heights: (n,) wanted rise of each module, pitches; NaN for any.
        """
        lifted = np.flatnonzero(~np.isnan(target_heights))
        lowest = np.array([self._lowest_corner(i, poses.rotations[i]) for i in lifted.tolist()])
        axes, anchors = hinge_frames(self.chain, angles, poses)
        hinges = Hinges(
            axes=np.ascontiguousarray(axes.reshape(-1, 3)),
            anchors=np.repeat(anchors, axes.shape[1], axis=0),
            before=self._before,
        )
        up = np.tile([0.0, 0.0, 1.0], (len(lifted), 1))
        nothing = np.full(len(lifted), -1)
        starts, rows, values = torque_columns(
            hinges, 0, True, lifted, nothing, poses.positions[lifted] + lowest, up
        )
        # A hinge holds against what a turn would follow: a lever is the opposite of its torque.
        levers = np.zeros((len(lifted), len(angles)))
        levers[np.repeat(np.arange(len(lifted)), np.diff(starts)), rows] = -values
        levers[:, : self.first[point]] = levers[:, self.last[point] :] = 0.0
        # damped: hinges that raise a module by less hardly turn
        square = levers @ levers.T + 0.03**2 * np.eye(len(lifted))
        turn = levers.T @ np.linalg.solve(square, target_heights[lifted])
        return np.asarray(np.clip(turn, -MAX_CORRECTION_RAD, MAX_CORRECTION_RAD))
