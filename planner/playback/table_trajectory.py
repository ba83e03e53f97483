"""Table trajectory: reference and speed of a chain that is folded on a table.

The record of an explosion in reverse, drawn as a smooth curve. The speed along it is the largest
that keeps the torques of speeding up and slowing down within a share of the motors' limit, which
leaves the rest for weights.
"""

from __future__ import annotations

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.playback import TablePlaybackParameters
from foldback.planner.playback.table_curve import TableCurve
from foldback.planner.playback.time_scaling import (
    MIN_PLAYBACK_STEPS,
    bounded_profile,
    duration,
    frames_kept,
    scaling_from_profile,
)
from foldback.planner.simulation.table_body import TableBody


class TableTrajectory:
    """Angles at every step, from straight to folded.

    Args:
        chain: The chain.
        record: Windowed motion of its explosion on the table, from folded on.
        parameters: Parameters of the playback.
        body: Body that computes torques of inertia; its pose changes.
        torque_limit: Torque limit of the motors, w·p.
    """

    def __init__(
        self,
        chain: Chain,
        record: Motion,
        parameters: TablePlaybackParameters,
        body: TableBody,
        torque_limit: float,
    ) -> None:
        self.chain = chain
        self.parameters = parameters
        self.curve = TableCurve(chain, record[::-1], parameters.spacing_rad)
        self._all = slice(0, len(chain.folded_rad))
        share, profile = self._profile(body, parameters.inertial_share * torque_limit)
        steps = max(MIN_PLAYBACK_STEPS, int(np.ceil(duration(share, profile) / parameters.step)))
        scaling = scaling_from_profile(share, profile, steps, parameters.step)
        self._u = self.curve.end * scaling.u
        self.is_kept = frames_kept(scaling.u * self.curve.length_rad / parameters.frame_rad)
        """(S + 1,) True if a frame is kept at a step."""

    def __len__(self) -> int:
        """Return the number of steps S."""
        return len(self._u) - 1

    def angles(self, start: int, stop: int) -> Array:
        """Return the (stop − start, J) hinge angles of some of the S + 1 samples, rad."""
        return self.curve.at(self._u[start:stop], self._all)

    def torques(self, body: TableBody, start: int, stop: int) -> Array:
        """Return the (stop − start, J) torques of inertia in some of the S steps."""
        steps = np.clip(np.arange(start - 1, stop + 1), 0, len(self))
        angles = self.curve.at(self._u[steps], self._all)
        rates = np.diff(angles, axis=0) / self.parameters.step
        accelerations = np.diff(rates, axis=0) / self.parameters.step
        return np.array(
            [
                body.inertial_torques(*arguments)
                for arguments in zip(angles[1:-1], rates[:-1], accelerations, strict=True)
            ]
        )

    def _profile(self, body: TableBody, budget: float) -> tuple[Array, Array]:
        """Return (U,) parameters from 0 to 1 and the (U,) square of the speed there."""
        count = int(np.clip(300 * self.curve.length_rad, 128, 2**16))
        share = np.linspace(0.0, 1.0, count)
        end = self.curve.end
        angles, first, second = (
            end**k * self.curve.at(end * share, self._all, k) for k in range(3)
        )
        still = np.zeros(angles.shape[1])
        a, b = np.empty_like(angles), np.empty_like(angles)
        for k in range(count):
            a[k] = body.inertial_torques(angles[k], still, first[k])
            b[k] = body.inertial_torques(angles[k], first[k], second[k])
        fastest = np.maximum(np.abs(first).max(axis=1), 1e-9)
        ceiling = (self.parameters.fastest / fastest) ** 2
        return share, bounded_profile(share, a / budget, b / budget, ceiling)
