"""Window trajectory: the reference of the playback of a peeled chain, stretch by stretch.

The record of a peeling, in reverse, drawn as a uniform cubic B-spline through its windows, at a
speed that the fastest hinge keeps about evenly. Its steps are cut into stretches: of each one joint
after another moves, and all the rest is rigid (``planner.simulation.window_robot``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import Floating, floating_torques, path_torques
from foldback.planner.clearance.sweep import sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.playback import PlaybackParameters
from foldback.planner.playback.reference_curve import (
    JOINT_LIMIT_MARGIN_RAD,
    REFERENCE_CLEARANCE_PITCH,
    frames_around,
)
from foldback.planner.playback.setpoints import SETTLE_STEPS
from foldback.planner.playback.time_scaling import (
    MIN_PLAYBACK_STEPS,
    TimeScaling,
    frames_kept,
    scaling_from_profile,
    torque_bounded_profile,
)
from foldback.planner.simulation.window_robot import RigidEnds

FRAME_RAD: Final = 0.04
"""Turn of the fastest hinge, rad, between two stored frames of a kinematic playback, or of a
windowed one (a short section of the chain moves at a time)."""
MODEL_JOINTS_MULTIPLE: Final = 16
"""Multiple to which the number of simulated joints is rounded up in a windowed playback, which
simulates only the section of the chain that moves, so that MuJoCo's model is seldom recompiled."""
SUPPORT_POINTS: Final = 4
"""Number of consecutive control points that a point of a uniform cubic B-spline depends on: the
degree plus one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Steps in which the same joints may move.

    Attributes:
        first: Index of the first joint in the chain.
        joints: Number of joints.
        start, stop: First step, and the step after the last one.
    """

    first: int
    joints: int
    start: int
    stop: int

    def hinges(self, chain: Chain) -> slice:
        """Return the slice of its hinges in the chain."""
        k = chain.module.hinges_per_joint
        return slice(k * self.first, k * (self.first + self.joints))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Targets:
    """Targets of the hinges of a stretch.

    Attributes:
        angles: (S + 1, H) angles at its steps and at its end, rad.
        rates: (S + 1, H) mean rates of the step that leads to each, rad/s.
    """

    angles: Array
    rates: Array


class WindowCurve:
    """Uniform cubic B-spline through windows.

    Args:
        chain: The chain.
        windows: Snapshots in the order of the playback.
        spacing_rad: Turn of the fastest hinge from one control point to the next, rad.
    """

    def __init__(self, chain: Chain, windows: Motion, spacing_rad: float) -> None:
        largest, _ = windows.steps(chain)
        lengths = np.concatenate([[0.0], np.cumsum(largest)])
        self.chain = chain
        self.length_rad = float(lengths[-1])
        count = max(SUPPORT_POINTS, int(np.ceil(self.length_rad / spacing_rad)) + 1)
        positions = np.linspace(0.0, self.length_rad, count)
        after, part = frames_around(lengths, positions)
        self._windows = windows
        # Twice again at both ends, where the curve is to begin and to end.
        ends = np.clip(np.arange(-2, count + 2), 0, count - 1)
        self._after, self._part = after[ends], part[ends]
        before = self._after - 1
        self.first = np.minimum(windows.first[before], windows.first[self._after])
        self.last = np.maximum(windows.last[before], windows.last[self._after])
        self._stops = chain.stops_rad(JOINT_LIMIT_MARGIN_RAD)

    @property
    def end(self) -> float:
        """Last parameter of the curve, which runs about evenly by the turn of its fastest hinge."""
        return float(len(self._after) - SUPPORT_POINTS + 1)

    def piece(self, u: Array) -> Ints:
        """Return the (U,) first control point that each parameter depends on."""
        return np.clip(u.astype(np.int64), 0, len(self._after) - SUPPORT_POINTS)

    def at(self, u: Array, hinges: slice, derivative: int = 0) -> Array:
        """Return the (U, H) angles of some hinges at (U,) parameters, or their derivatives by u.

        Args:
            u: Parameters from 0 to ``end``.
            hinges: Hinges, among them all that move there.
            derivative: Order of the derivative: 0, 1 or 2.
        """
        piece = self.piece(u)
        low, high = int(piece.min()), int(piece.max()) + SUPPORT_POINTS
        points = np.stack([self._point(k, hinges) for k in range(low, high)])
        weights = _weights(u - piece, derivative)
        parts = (weights[i][:, None] * points[piece - low + i] for i in range(SUPPORT_POINTS))
        return np.asarray(sum(parts))

    def _point(self, k: int, hinges: slice) -> Array:
        after, part = int(self._after[k]), float(self._part[k])
        before = self._angles(after - 1, hinges)
        angles = before + part * (self._angles(after, hinges) - before)
        return np.clip(angles, *self._stops[hinges].T)

    def _angles(self, frame: int, hinges: slice) -> Array:
        """Return the (H,) angles of one window, folded before it and straight behind, rad."""
        windows, start, stop = self._windows, hinges.start, hinges.stop
        first, last = int(windows.first[frame]), int(windows.last[frame])
        angles = np.zeros(stop - start)
        folded = max(start, min(first, stop))
        angles[: folded - start] = self.chain.folded_rad[start:folded]
        low, high = max(first, start), min(last, stop)
        if high > low:
            at = int(windows.offsets[frame]) - first
            angles[low - start : high - start] = windows.angles_rad[at + low : at + high]
        return angles


def _weights(t: Array, derivative: int) -> tuple[Array, Array, Array, Array]:
    """Return the weights of four control points of a uniform cubic B-spline, t from 0 to 1."""
    if derivative == 0:
        last = t**3 / 6.0
        third = (-3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0) / 6.0
        first = (1.0 - t) ** 3 / 6.0
        return first, 1.0 - first - third - last, third, last
    if derivative == 1:
        last, third, first = 0.5 * t**2, -1.5 * t**2 + t + 0.5, -0.5 * (1.0 - t) ** 2
        return first, -first - third - last, third, last
    return 1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t


class WindowTrajectory:
    """Reference and time scaling of a playback of windows, computed once for all robots.

    Args:
        chain: The chain.
        record: Windowed motion of the explosion, from folded on.
        parameters: Parameters of the playback.
        module_size: Size of the modules as a fraction of the pitch.
        finer: Factor of the number of steps and frames.
        start_s: Time of the first frame, s.
    """

    def __init__(
        self,
        chain: Chain,
        record: Motion,
        parameters: PlaybackParameters,
        module_size: float,
        finer: int,
        start_s: float = 0.0,
    ) -> None:
        self.chain = chain
        self.parameters = parameters
        self.module_size = module_size
        self._start_s = start_s
        self.robots = parameters.robot.robots
        self._backwards = record[::-1]
        self._ends = RigidEnds(chain, chain.module.masses(len(chain)))
        # Some room is left for the robots' joint errors.
        room = min(REFERENCE_CLEARANCE_PITCH, 0.25 * (1.0 - module_size))
        while True:
            self._draw(finer)
            swept = sweep(chain, self.reference, module_size=module_size, share=0.0)
            if swept.clearance > room or finer >= 8:
                break
            finer *= 2
        self._torques = self._all_torques()
        self.peak_torque = max(float(np.abs(torques).max()) for torques in self._torques)
        """Largest torque that a robot without model errors needs."""

    def _draw(self, finer: int) -> None:
        """Draw the curve, with ``finer`` times as many control points, steps and frames."""
        p, backwards = self.parameters, self._backwards
        self.step_s = p.step_s / finer
        self.curve = WindowCurve(self.chain, backwards, p.spacing_rad / finer)
        length = self.curve.length_rad
        steps = max(MIN_PLAYBACK_STEPS, int(finer * p.steps_per_rad * length))
        scaling = self._scaling(steps)
        self._u = self.curve.end * scaling.u
        self.is_kept = frames_kept(scaling.u * length * finer / FRAME_RAD)
        """(S + 1,) True if a frame is kept before a step."""
        self.stretches = tuple(_stretches(self.chain, self.curve, self._u))
        self.reference = self._reference()
        """Planned motion at the kept frames; the pose of module 0 is that at the beginning."""

    def _scaling(self, steps: int) -> TimeScaling:
        """Return the time scaling along the curve with about the smallest largest torque."""
        count = max(
            MIN_PLAYBACK_STEPS,
            min(2**15, int(25 * self.curve.length_rad)),
        )
        u = np.linspace(0.0, self.curve.end, count)
        stretches = tuple(_stretches(self.chain, self.curve, u))
        widest = max(stretch.joints for stretch in stretches) * self.chain.module.hinges_per_joint
        a, b = np.zeros((count, widest)), np.zeros((count, widest))
        for number, stretch in enumerate(stretches):
            stop = stretch.stop + (number == len(stretches) - 1)
            places, hinges = u[stretch.start : stop], stretch.hinges(self.chain)
            angles, first, second = (self.curve.at(places, hinges, k) for k in range(3))
            rows, width = slice(stretch.start, stop), angles.shape[1]
            a[rows, :width], b[rows, :width] = path_torques(
                self.chain.module, angles, first, second, self._between_ends(stretch)
            )
        share = u / self.curve.end
        return scaling_from_profile(share, torque_bounded_profile(share, a, b), steps, self.step_s)

    def _reference(self) -> Motion:
        first, angles = [], []
        for number, stretch in enumerate(self.stretches):
            hinges = stretch.hinges(self.chain)
            stop = stretch.stop + (number == len(self.stretches) - 1)
            kept_steps = np.flatnonzero(self.is_kept[stretch.start : stop])
            first += [hinges.start] * len(kept_steps)
            angles += list(self.curve.at(self._u[stretch.start + kept_steps], hinges))
        steps = np.flatnonzero(self.is_kept)
        steps[-1] += SETTLE_STEPS
        backwards = self._backwards
        return Motion.from_windows(
            time_s=self._start_s + self.step_s * steps.astype(np.float64),
            phase="playback",
            first=np.array(first, dtype=np.int64),
            offsets=np.concatenate([[0], np.cumsum([len(window) for window in angles])]),
            angles_rad=np.concatenate(angles).astype(np.float32),
            base_position=np.repeat(backwards.anchor_position[:1], len(steps), axis=0),
            base_wxyz=np.repeat(backwards.anchor_wxyz[:1], len(steps), axis=0),
        )

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self._u) - 1

    def _between_ends(self, stretch: Stretch) -> Floating:
        """Return a stretch with both ends: hinges before it are folded, those behind straight."""
        core = stretch.first + 1
        return Floating(first=core, lumps=self._ends.lumps(core, core + stretch.joints))

    def targets(self, number: int) -> Targets:
        """Return the targets of hinges in a stretch, step by step.

        Semi-implicit Euler goes from q to q + h (q̇ + h q̈). So q̇ is the last step divided by h,
        and q̈ the change of q̇ divided by h: finite differences of the angles, not derivatives.
        """
        stretch = self.stretches[number]
        # The time scaling rests before its first step and after its last one.
        steps = np.clip(np.arange(stretch.start - 1, stretch.stop + 1), 0, len(self))
        angles = self.curve.at(self._u[steps], stretch.hinges(self.chain))
        rates = np.diff(angles, axis=0) / self.step_s
        return Targets(angles=angles[1:], rates=rates)

    def torques(self, number: int) -> NDArray[np.float32]:
        """Return (S, H) torques that a robot without model errors needs in a stretch."""
        return self._torques[number]

    def _all_torques(self) -> list[NDArray[np.float32]]:
        """Return the (S, H) torques of each stretch for a robot without model errors."""
        all_torques: list[NDArray[np.float32]] = []
        for number, stretch in enumerate(self.stretches):
            targets = self.targets(number)
            accelerations = np.diff(targets.rates, axis=0) / self.step_s
            torques = floating_torques(
                self.chain.module,
                targets.angles[:-1],
                targets.rates[:-1],
                accelerations,
                self._between_ends(stretch),
            )
            all_torques.append(torques.astype(np.float32))
        return all_torques


def _stretches(chain: Chain, curve: WindowCurve, u: Array) -> Iterator[Stretch]:
    """Yield the stretches of the S steps between (S + 1,) parameters."""
    steps = len(u) - 1
    k = chain.module.hinges_per_joint
    max_joints = chain.joint_count
    piece = curve.piece(u)
    low = sliding_window_view(curve.first, SUPPORT_POINTS).min(axis=1)[piece] // k
    high = -(-sliding_window_view(curve.last, SUPPORT_POINTS).max(axis=1)[piece] // k)
    start = 0
    while start < steps:
        # The step before a stretch and the one behind it belong to its finite differences.
        first_step = max(0, start - 1)
        lows = np.minimum.accumulate(low[first_step:])
        highs = np.maximum.accumulate(high[first_step:])
        soon = min(start + 48, steps) - first_step
        needed = int(highs[soon] - lows[soon]) + 8
        joints = min(max_joints, MODEL_JOINTS_MULTIPLE * -(-needed // MODEL_JOINTS_MULTIPLE))
        fits = highs - lows <= joints
        last = first_step + (len(fits) if fits.all() else int(fits.argmin())) - 1
        stop = steps if last == steps else max(start + 1, last - 1)
        within = slice(first_step, min(stop + 1, steps) + 1)
        first = min(int(low[within].min()), max_joints - joints)
        yield Stretch(first=first, joints=joints, start=start, stop=stop)
        start = stop
