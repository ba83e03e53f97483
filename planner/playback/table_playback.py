"""Table playback: a chain is folded on a table, simulated with gravity, contacts and weak motors.

The straight chain lies on the table, its first module clamped there or free, and follows the
record of its explosion back. Gravity, the table and the modules' contacts are MuJoCo's; motors
never exceed their limit. Modules are smaller than a pitch: contacts that the statics assume may be
open, and the chain then yields until they close.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import aligned_distances
from foldback.planner.errors import InputError, SimulationError
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.playback import TablePlaybackParameters
from foldback.planner.playback.chain_run import GOAL_TOLERANCE_PITCH, PlaybackRun, PlaybackStatus
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.reference_trajectory import TRACKING_LOST_RAD
from foldback.planner.playback.table_trajectory import TableTrajectory
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.reasons import Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.simulation.table_body import TableBody

TABLE_CHUNK_STEPS: Final = 512
"""Maximum number of simulation steps of a fold on a table whose target angles and torques are
computed at once."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TablePlayback:
    """Result of a playback on a table. Lengths in pitches, torques in w·p.

    Attributes:
        status: ``folded``, or the kind of failure.
        reason: Reason why it is not folded; None if it is.
        frames: F frames with their joint errors; times are seconds at the chain's pitch. The pose
            of the root is that of the simulation.
        reference_rad: (F, J) planned hinge angles at those frames, rad.
        torques: (F, J) largest magnitude of the motor torques since the frame before.
        position_errors: (F,) RMS over the modules of their position error: relative to a clamped
            first module; for a chain that lies free, which drifts, after the best shift and turn in
            the plane of the table, frame by frame. Heights are never shifted.
        aligned_error: RMS distance from the folded shape at the end, after alignment.
        largest_error_rad: Largest joint error of all steps.
        largest_torque: Largest torque of all motors and steps.
        steps: Number of steps of the simulation.
        seconds: Wall time, s.
    """

    status: PlaybackStatus
    reason: Reason | None
    frames: Motion
    reference_rad: Array
    torques: Array
    position_errors: Array
    aligned_error: float
    largest_error_rad: float
    largest_torque: float
    steps: int
    seconds: float

    def as_playback(self, pitch_m: float) -> Playback:
        """Convert to a general playback; its times are seconds at a pitch, m."""
        unit = GRAVITY_M_S2 / pitch_m  # 1 w·p in module masses · pitch² / s²
        largest = self.torques.max(axis=1, initial=0.0)
        return Playback(
            status=self.status,
            reason=self.reason,
            frames=self.frames,
            reference_rad=self.reference_rad,
            steps=self.steps,
            seconds=self.seconds,
            rms_position_error=self.aligned_error,
            max_angle_error_rad=self.largest_error_rad,
            peak_torque=unit * self.largest_torque,
            rms_torque=unit * float(np.sqrt((largest**2).mean())),
        )


def time_unit_s(chain: Chain) -> float:
    """Return √(pitch / gravity), s."""
    return math.sqrt(chain.pitch_m / GRAVITY_M_S2)


def play_on_table(
    chain: Chain,
    record: Motion,
    *,
    torque_limit_wp: float,
    friction: float = 0.0,
    clamped: bool = True,
    parameters: TablePlaybackParameters | None = None,
    start_s: float = 0.0,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> TablePlayback:
    """Fold a straight chain on a table.

    Args:
        chain: The chain; folded, it stands on the table with its lowest modules, z up.
        record: Windowed motion of its explosion on the table, folded to straight.
        torque_limit_wp: Largest torque of every motor, w·p.
        friction: μ between modules and table.
        clamped: True if the first module is clamped to the table; else the chain lies free.
        parameters: Parameters of the simulation; the usual ones when None.
        start_s: Time of the first frame, s.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Raises:
        InputError: ``bad-table`` for numbers out of range, ``no-record`` without two frames.
    """
    if not (torque_limit_wp > 0.0 and math.isfinite(torque_limit_wp)):
        raise InputError(
            "bad-table",
            f"got a torque limit of {torque_limit_wp:g} w·p (module weight × pitch), expected a "
            "finite value above 0.",
            where="torque_limit_wp",
        )
    if not 0.0 <= friction <= 2.0:
        raise InputError("bad-table", f"got {friction:g}, expected 0 to 2.", where="friction")
    if len(record) < 2:
        raise InputError(
            "no-record",
            f"got a motion of {len(record)} frame{'' if len(record) == 1 else 's'}, expected at "
            "least 2 frames.",
        )
    p = TablePlaybackParameters.usual(clamped=clamped) if parameters is None else parameters
    run = _Run(chain, record, p, torque_limit_wp, friction, clamped)
    try:
        status, reason = run.simulate(progress, cancelled)
    except SimulationError as broken:
        status, reason = "diverged", Reason.of(Code.SIMULATION_FAILED, detail=str(broken))
    return run.result(status, reason, start_s)


class _RecordedFrame(NamedTuple):
    """Recorded frame, with the largest torque of each motor since the frame before."""

    time: float
    angles: Array
    target: Array
    torques: Array
    centres: Array
    wxyzs: Array


class _Run(PlaybackRun):
    """State and figures of one run."""

    def __init__(
        self,
        chain: Chain,
        record: Motion,
        p: TablePlaybackParameters,
        limit: float,
        friction: float,
        clamped: bool,
    ) -> None:
        super().__init__(chain, p.step)
        self._began_s = time.perf_counter()
        self.p, self.limit = p, limit
        self.clamped = clamped
        self.body = TableBody(
            chain,
            p,
            height=chain.table_height,
            torque_limit=limit,
            friction=friction,
            clamped=clamped,
        )
        self.trajectory = TableTrajectory(chain, record, p, self.body, limit)
        self._peak_torques = np.zeros(len(chain.folded_rad))
        self._frames: list[_RecordedFrame] = []

    def simulate(
        self, progress: Report, cancelled: Cancelled
    ) -> tuple[PlaybackStatus, Reason | None]:
        """Fold; return how that ended, and why.

        Raises:
            SimulationError: When the simulation diverges.
        """
        trajectory, body = self.trajectory, self.body
        body.place(trajectory.angles(0, 1)[0])
        for start in range(0, len(trajectory), TABLE_CHUNK_STEPS):
            stop = min(start + TABLE_CHUNK_STEPS, len(trajectory))
            targets, expected = (
                trajectory.angles(start, stop + 1),
                trajectory.torques(body, start, stop),
            )
            for current, following, torques in zip(targets, targets[1:], expected, strict=False):
                if trajectory.is_kept[self.steps]:
                    self._keep(current)
                self._step(current, following, torques)
                if self.largest_error > TRACKING_LOST_RAD:
                    self._keep(following)
                    return "missed", self._lost(following)
                fraction = self.steps / len(trajectory)
                if not self.check(progress, cancelled, fraction, "folding on the table"):
                    return "cancelled", Reason.of(Code.PLAYBACK_CANCELLED)
        end = trajectory.angles(len(trajectory), len(trajectory) + 1)[0]
        for _ in range(int(self.p.settle / self.p.step)):
            self._step(end, end, np.zeros_like(end))
        self._keep(end)
        return "folded", None

    def _step(self, current: Array, following: Array, expected: Array) -> None:
        p, body = self.p, self.body
        body.step((following - current) / p.step, current - body.angles, expected)
        np.maximum(self._peak_torques, np.abs(body.torques), out=self._peak_torques)
        self.largest_error = max(self.largest_error, float(np.abs(following - body.angles).max()))
        self.count_step(body.torques)

    def _keep(self, target: Array) -> None:
        time_now, body = self.steps * self.p.step, self.body
        self._frames.append(
            _RecordedFrame(time_now, body.angles, target, self._peak_torques.copy(), *body.poses)
        )
        self._peak_torques[:] = 0.0

    def _lost(self, target: Array) -> Reason:
        """Return the reason why a hinge has yielded."""
        off = np.abs(target - self.body.angles)
        worst = int(off.argmax())
        return Reason.of(
            Code.WEAK_MOTOR,
            joint=self.chain.joint_names[worst],
            limit_torque=float(self.limit),
            progress=self.steps / len(self.trajectory),
            error_rad=float(off[worst]),
        )

    def result(
        self, status: PlaybackStatus, reason: Reason | None, start_s: float
    ) -> TablePlayback:
        """Return the result of a run that ended so, with times from ``start_s`` on."""
        chain = self.chain
        times, angles, targets, torques, positions, wxyzs = map(
            np.array, zip(*self._frames, strict=True)
        )
        frames = Motion.from_frames(
            phase="playback",
            time_s=start_s + time_unit_s(chain) * times,
            joint_angles_rad=angles,
            root_position=positions[:, chain.root],
            root_wxyz=wxyzs[:, chain.root],
            joint_error_rad=np.abs(angles - targets),
        )
        if self.clamped:
            frames = frames.clamped(chain)
        meant = frames.planned(chain, frames.with_angles(targets), clamped=self.clamped)
        target_positions = meant.poses(chain).positions
        errors = np.sqrt(((positions - target_positions) ** 2).sum(axis=2).mean(axis=1))
        aligned = aligned_distances(positions[-1], chain.folded_poses.positions)
        if status == "folded" and errors[-1] > GOAL_TOLERANCE_PITCH:
            status = "missed"
            reason = Reason.of(Code.MISSED, error=float(errors[-1]))
        return TablePlayback(
            status=status,
            reason=reason,
            frames=frames,
            reference_rad=quantised(targets),
            torques=torques,
            position_errors=errors,
            aligned_error=float(np.sqrt((aligned**2).mean())),
            largest_error_rad=self.largest_error,
            largest_torque=self.peak_torque,
            steps=self.steps,
            seconds=time.perf_counter() - self._began_s,
        )
