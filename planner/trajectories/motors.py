"""Motors: the hinge torques of a retimed plan, and a comparison with given motors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.reasons import PROGRAMS, Reader
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import Tree
from foldback.planner.trajectories.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """Masses, lengths and support of a robot's chain.

    Attributes:
        module_mass_kg: Mass of a module with its motors, spread evenly over its hull.
        pitch_m: Distance of neighbouring modules.
        gravity_m_s2: Gravity, in each hinge's worst direction; 0 for none.
        held: True if the root module is held still. Otherwise the chain floats, without gravity.
    """

    module_mass_kg: float
    pitch_m: float
    gravity_m_s2: float = GRAVITY_M_S2
    held: bool = True

    def check(self) -> None:
        """Check all values.

        Raises:
            InputError: ``bad-build``.
        """
        for name, unit, value, min_value, max_value in (
            ("module_mass", "kg", self.module_mass_kg, 1e-9, 1e6),
            ("pitch", "m", self.pitch_m, 1e-9, 1e3),
            ("gravity", "m/s²", self.gravity_m_s2, 0.0, 1e3),
        ):
            if not min_value <= value <= max_value:
                raise InputError(
                    "bad-build",
                    f"got a {name.replace('_', ' ')} of {value:g} {unit}, expected {min_value:g} "
                    f"to {max_value:g} {unit}.",
                    where=name,
                )
        if not self.held and self.gravity_m_s2 > 0.0:
            raise InputError(
                "bad-build",
                f"got a gravity of {self.gravity_m_s2:g} m/s² for a floating chain, which would "
                "fall; set the gravity to 0, or hold the middle module.",
                where="gravity",
            )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorRequirements:
    """Torques of every hinge over a trajectory.

    Attributes:
        build: Masses, lengths and support of the chain.
        joint_names: (J,) names of the hinges.
        peak_torque_nm: (J,) largest torque.
        peak_time_s: (J,) time of the largest torque.
        peak_frame: (J,) frame number of the largest torque in the plan.
        rms_torque_nm: (J,) root mean square over time, which determines the motor's heat.
        motor_torque_nm: Torque of every motor; None if not given.
    """

    build: Build
    joint_names: tuple[str, ...]
    peak_torque_nm: Array
    peak_time_s: Array
    peak_frame: Array
    rms_torque_nm: Array
    motor_torque_nm: float | None

    @property
    def neediest(self) -> int:
        """Number of the hinge with the largest torque."""
        return int(np.argmax(self.peak_torque_nm))

    @property
    def would_do(self) -> bool | None:
        """True if the motors are strong enough for every hinge; None without a motor torque."""
        if self.motor_torque_nm is None:
            return None
        return bool(self.peak_torque_nm.max() <= self.motor_torque_nm)

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the comparison as a sentence."""
        k = self.neediest
        need = (
            f"{self.joint_names[k]} needs the largest torque, {self.peak_torque_nm[k]:.3g} N·m at "
            f"frame {reader.frame(float(self.peak_frame[k]))}"
        )
        if self.motor_torque_nm is None:
            return need
        motor = f"a motor torque of {self.motor_torque_nm:g} N·m"
        if self.would_do:
            return f"Yes, {motor} is enough: {need}"
        short = int((self.peak_torque_nm > self.motor_torque_nm).sum())
        return f"No, {motor} is not enough for {short} of {len(self.joint_names)} hinges: {need}"

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values; ``margin`` is motor torque over peak, None without load."""
        return {
            "verdict": self.text(),
            "would_do": self.would_do,
            "motor_torque_nm": self.motor_torque_nm,
            "module_mass_kg": self.build.module_mass_kg,
            "pitch_m": self.build.pitch_m,
            "gravity_m_s2": self.build.gravity_m_s2,
            "root": "held" if self.build.held else "floating",
            "joints": [self._row(k) for k in range(len(self.joint_names))],
        }

    def as_csv(self) -> str:
        """Return CSV text: a line with the names of the columns, then one for each hinge."""
        rows = [self._row(k) for k in range(len(self.joint_names))]
        lines = [",".join(rows[0])]
        for row in rows:
            lines.append(",".join("" if value is None else str(value) for value in row.values()))
        return "\n".join(lines) + "\n"

    def _row(self, k: int) -> dict[str, Any]:
        peak, motor = float(self.peak_torque_nm[k]), self.motor_torque_nm
        return {
            "name": self.joint_names[k],
            "peak_torque_nm": _short(peak),
            "peak_time_s": _short(float(self.peak_time_s[k])),
            "peak_frame": round(float(self.peak_frame[k]), 2),
            "rms_torque_nm": _short(float(self.rms_torque_nm[k])),
            "margin": None if motor is None or peak <= 0.0 else _short(motor / peak),
            "would_do": None if motor is None else peak <= motor,
        }


def motor_requirements(
    chain: Chain, trajectory: Trajectory, build: Build, *, motor_torque_nm: float | None = None
) -> MotorRequirements:
    """Compute the torques of a motion, by inverse dynamics of the chain as one tree.

    A held chain's torque is that of the motion alone plus that of gravity in the direction which
    is worst for the hinge at that moment: such motors are enough however the robot is held.
    Friction, motor inertia and contacts are left out.

    Args:
        chain: The chain.
        trajectory: Trajectory of this chain.
        build: Masses, lengths and support.
        motor_torque_nm: Torque of every motor; None if not given.

    Raises:
        InputError: ``bad-build``.
    """
    build.check()
    if motor_torque_nm is not None and not 0.0 < motor_torque_nm < np.inf:
        raise InputError(
            "bad-build",
            f"got a motor torque of {motor_torque_nm:g} N·m, expected a finite value above 0.",
            where="motor_torque",
        )
    starts, ends = _stretches(trajectory, len(chain))
    tree = Tree(chain, Material(), step_s=0.01)
    joints = len(trajectory.joint_names)
    peak = np.full(joints, -1.0)
    peak_time = np.zeros(joints)
    square = np.zeros(joints)
    # Accelerations jump from one stretch to the next, so each is looked at from its inside.
    inside = 1e-9 * (ends - starts)
    for start_s, end, nudge in zip(starts, ends, inside, strict=True):
        times = np.array([start_s + nudge, end - nudge])
        angles, rates, accelerations = trajectory.at(times)
        for k in range(2):
            torque = _torque(tree, build, angles[k], rates[k], accelerations[k])
            square += 0.5 * (end - start_s) * torque**2
            higher = torque > peak
            peak[higher], peak_time[higher] = torque[higher], times[k]
    return MotorRequirements(
        build=build,
        joint_names=trajectory.joint_names,
        peak_torque_nm=peak,
        peak_time_s=peak_time,
        peak_frame=trajectory.frame_at(peak_time),
        rms_torque_nm=np.sqrt(square / trajectory.duration_s),
        motor_torque_nm=motor_torque_nm,
    )


def _stretches(trajectory: Trajectory, modules: int) -> tuple[Array, Array]:
    """Return starts and ends, s, of the intervals: every n-th cell of the trajectory."""
    knots = trajectory.knot_times_s
    max_knots = min(
        4 * len(trajectory.path.lengths),
        max(64, 1_000_000 // modules),
    )
    stride = max(1, round((len(knots) - 1) / max_knots))
    rows = np.unique(np.append(np.arange(0, len(knots), stride), len(knots) - 1))
    return knots[rows[:-1]], knots[rows[1:]]


def _torque(tree: Tree, build: Build, angles: Array, rates: Array, accelerations: Array) -> Array:
    """Return the (J,) magnitudes of the hinge torques, N·m."""
    unit = build.module_mass_kg * build.pitch_m**2
    if not build.held:
        tree.evaluate(angles, rates)
        return unit * np.abs(tree.torques_for(accelerations))
    moved = unit * np.abs(tree.held_torques(angles, rates, accelerations))
    if build.gravity_m_s2 == 0.0:
        return moved
    weight = build.module_mass_kg * build.pitch_m * build.gravity_m_s2
    return moved + weight * tree.gravity_torques()


def _short(value: float) -> float:
    """Return a number rounded to six significant digits."""
    return float(f"{value:.6g}")
