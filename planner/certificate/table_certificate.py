"""Table certificate: proof that a motion rests on a table in every frame, and its largest torque.

Only kinematics and statics go in: every frame is balanced by itself on the plane z = 0
(``planner.statics``). Frames that do not stand there, as those of plans that float, are each laid
into the resting pose of least torque; the result is the torque that they would need, and no motion
on a table.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.chain.module import DEFAULT_DENSITY_KG_M3
from foldback.planner.cpu_cores import cores
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.explosion import Base
from foldback.planner.reasons import Reason, ReasonValues
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.statics.balance import MIN_TORQUE_WP, Balance, Standing
from foldback.planner.statics.contacts import FLOOR_GAP, MODULE_GAP, floor_clearances
from foldback.planner.statics.friction import CONE_SIDES, DIRECTION_SPREADS_RAD, Friction
from foldback.planner.statics.stable_poses import resting_poses

MAX_TABLE_ENTRY_PITCH: Final = 0.02
"""Maximum depth, in pitches, to which modules may sink below the table's surface in a plan that is
verified for folding on a table: as far as they may stand above it."""
ON_TABLE_TOLERANCE_PITCH: Final = 0.1
"""Maximum distance, in pitches, of every frame's lowest corner from the table, for which a motion
counts as made on the table; other motions are laid down on it frame by frame."""
BALANCE_CHUNK_FRAMES: Final = 32
"""Number of consecutive frames whose equilibrium on the table one thread computes, each starting
from the solution of the frame before."""


def table_certificate(
    chain: Chain,
    frames: Motion,
    *,
    friction: float = 0.0,
    base: Base = "clamped",
    module_kg: float | None = None,
    pitch_m: float | None = None,
    density_kg_m3: float = DEFAULT_DENSITY_KG_M3,
    module_size: float = 1.0,
    bound: float | None = None,
    on_table: bool | None = None,
    height: float = 0.0,
    progress: Callable[[float], None] | None = None,
    sink: Callable[[TableForces], object] | None = None,
) -> TableCertificate:
    """Balance every frame of a motion on a table.

    Args:
        chain: The chain.
        frames: F frames, in the order of the playback: that is the direction of friction.
        friction: μ between modules and table.
        base: ``clamped`` if the first module is clamped to the table, else ``free``. Frames that
            are each laid into a resting pose lie free.
        module_kg: Mass of a module; a full one of ``density_kg_m3`` when None.
        pitch_m: Distance of neighbouring modules; the chain's when None.
        density_kg_m3: Density of the material of a module.
        module_size: Size of the modules at their corners, as a fraction of the pitch.
        bound: Maximum allowed torque, w·p.
        on_table: True if the frames stand on the table as they are; determined when None.
        height: Height of the table along z, pitches.
        progress: Receives the fraction of frames that are done, after each chunk.
        sink: Receives the forces of all frames.

    Raises:
        InputError: ``bad-table`` for numbers out of range.
    """
    began_s = time.perf_counter()
    pitch = chain.pitch_m if pitch_m is None else pitch_m
    mass = density_kg_m3 * chain.module.volume * pitch**3 if module_kg is None else module_kg
    _check(len(frames), friction, base, mass, pitch, module_size, bound)
    clearances = _clearances_above_table(chain, frames, height, module_size)
    stands = _are_on_table(clearances) if on_table is None else on_table
    task = _BalanceTask(
        chain=chain,
        frames=frames,
        friction=friction,
        clamped=0 if base == "clamped" and stands else None,
        size=module_size,
        laid=not stands,
        height=height,
    )
    balanced = task.all_frames(progress, sink)
    torques = np.array([frame.torque for frame in balanced])
    worst, low = _worst_frame(torques), int(np.argmin(clearances))
    largest = None if worst is None else float(torques[worst])
    unit = mass * GRAVITY_M_S2 * pitch
    certificate = TableCertificate(
        reason=None,
        name=chain.name,
        modules=len(chain),
        on_table=stands,
        friction=friction,
        base=base if stands else "free",
        module_size=module_size,
        module_kg=mass,
        pitch_m=pitch,
        unit_nm=unit,
        bound=bound,
        torque=largest,
        torque_nm=None if largest is None else largest * unit,
        frame=worst,
        unbalanced=tuple(np.flatnonzero(~np.isfinite(torques)).tolist()),
        clearance=float(clearances[low]),
        clearance_frame=low,
        torques=tuple(float(t) if np.isfinite(t) else None for t in torques),
        standing=tuple(frame.standing for frame in balanced),
        assumptions=_assumptions(friction, base if stands else "free", stands, module_size),
        seconds=time.perf_counter() - began_s,
    )
    return replace(certificate, reason=_reason(certificate))


@dataclass(frozen=True, slots=True, kw_only=True)
class _BalanceTask:
    """Problem that is solved for every frame."""

    chain: Chain
    frames: Motion
    friction: float
    clamped: int | None
    size: float
    laid: bool
    height: float

    def all_frames(
        self,
        progress: Callable[[float], None] | None,
        sink: Callable[[TableForces], object] | None,
    ) -> list[_Balanced]:
        """Balance all frames, some chunks of them at once; ``sink`` receives the forces of all."""
        balanced: list[_Balanced] = []
        starts = range(0, len(self.frames), BALANCE_CHUNK_FRAMES)
        with ThreadPoolExecutor(min(cores(), len(starts))) as pool:
            for part in pool.map(self.part, starts):
                balanced += part
                if progress is not None:
                    progress(len(balanced) / len(self.frames))
        if sink is not None:
            sink(_forces(balanced))
        return balanced

    def part(self, start: int) -> list[_Balanced]:
        """Balance the chunk of frames from ``start`` on."""
        stop = min(start + BALANCE_CHUNK_FRAMES, len(self.frames))
        around = self.frames.dense(self.chain, max(start - 1, 0), min(stop + 1, len(self.frames)))
        poses = _placed(self.chain, around, self.height)
        balance = Balance(self.chain, module_size=self.size)
        first = min(start, 1)
        return [
            self._frame(balance, poses, around.joint_angles_rad[k], k)
            for k in range(first, first + stop - start)
        ]

    def _frame(self, balance: Balance, poses: Poses, angles: Array, k: int) -> _Balanced:
        pose_now = poses.positions[k], poses.rotations[k]
        after = _moment_later(poses, k) if self.friction else None
        if not self.laid:
            return _Balanced.of(self._solved(balance, pose_now, after, angles), len(self.chain))
        best: Standing | None = None
        for pose in resting_poses(self.chain.module, *pose_now):
            then = None if after is None else pose.of(*after)
            standing = self._solved(balance, pose.of(*pose_now), then, angles)
            if best is None or standing.torque < best.torque:
                best = standing
        if best is None:
            return _Balanced.none(len(self.chain), len(angles))
        return _Balanced.of(best, len(self.chain))

    def _solved(
        self,
        balance: Balance,
        pose_now: tuple[Array, Array],
        after: tuple[Array, Array] | None,
        angles: Array,
    ) -> Standing:
        rubbing = None
        if after is not None:
            rubbing = Friction(coefficient=self.friction, positions=after[0], rotations=after[1])
        return balance.solve(*pose_now, angles, friction=rubbing, clamped=self.clamped)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Balanced:
    """Result of one frame, see ``TableForces``."""

    torque: float
    torques: NDArray[np.float32]
    pressed: NDArray[np.float32]
    standing: tuple[int, ...]

    @classmethod
    def of(cls, standing: Standing, modules: int) -> _Balanced:
        """Build the result from a solution for a chain of ``modules`` modules."""
        on_floor, _, forces = standing.floor
        pressed = np.bincount(on_floor, forces[:, 2], minlength=modules)
        if not standing.balances:
            pressed = np.full(modules, np.nan)
        return cls(
            torque=standing.torque,
            torques=standing.torques.astype(np.float32),
            pressed=pressed.astype(np.float32),
            standing=tuple(standing.contacts.standing.tolist()),
        )

    @classmethod
    def none(cls, modules: int, hinges: int) -> _Balanced:
        """Build the result of a frame that has no resting pose."""
        nothing = np.full(hinges, np.nan, np.float32), np.full(modules, np.nan, np.float32)
        return cls(torque=np.inf, torques=nothing[0], pressed=nothing[1], standing=())


def _moment_later(poses: Poses, k: int) -> tuple[Array, Array]:
    """Return the poses of the next frame; after the last one the motion is extrapolated."""
    positions, rotations = poses.positions, poses.rotations
    if k + 1 < len(positions):
        return positions[k + 1], rotations[k + 1]
    if k == 0:
        return positions[k], rotations[k]
    turned = rotations[k] @ np.swapaxes(rotations[k - 1], 1, 2)
    return 2.0 * positions[k] - positions[k - 1], turned @ rotations[k]


def _are_on_table(clearances: Array) -> bool:
    """Return True if the lowest corner of every frame is at the table."""
    return bool(np.abs(clearances).max() <= ON_TABLE_TOLERANCE_PITCH)


def _worst_frame(torques: Array) -> int | None:
    """Return the frame with the largest torque; None if no frame has an equilibrium."""
    balanced = np.isfinite(torques)
    worst = int(np.argmax(np.where(balanced, torques, -1.0)))
    return worst if balanced.any() else None


def _forces(frames: list[_Balanced]) -> TableForces:
    """Return the forces of all frames; NaN in those without an equilibrium."""
    torques = np.array([frame.torque for frame in frames])
    return TableForces(
        torques=np.array([frame.torques for frame in frames]),
        pressed=np.array([frame.pressed for frame in frames]),
        torque=np.where(np.isfinite(torques), torques, np.nan).astype(np.float32),
    )


def _clearances_above_table(
    chain: Chain, frames: Motion, height: float, module_size: float
) -> Array:
    """Return the (F,) height of the lowest corner of each frame, pitches.

    Raises:
        InputError: ``bad-table`` if it is no number.
    """
    clearances: list[Array] = []
    for start in range(0, len(frames), BALANCE_CHUNK_FRAMES):
        part = frames.dense(chain, start, min(start + BALANCE_CHUNK_FRAMES, len(frames)))
        poses = _placed(chain, part, height)
        clearances.append(
            floor_clearances(
                chain.module, poses.positions, poses.rotations, module_size=module_size
            )
        )
    all_clearances = np.concatenate(clearances)
    if not np.isfinite(all_clearances).all():
        raise InputError(
            "bad-table",
            "got frames with infinite or undefined positions, expected finite numbers.",
        )
    return all_clearances


def _placed(chain: Chain, frames: Motion, height: float) -> Poses:
    """Return the poses of frames above a table at z = 0."""
    above = frames.root_position - np.array([0.0, 0.0, height])
    return chain.poses(frames.joint_angles_rad, above, frames.root_wxyz)


def _check(
    frames: int,
    friction: float,
    base: str,
    module_kg: float,
    pitch_m: float,
    module_size: float,
    bound: float | None,
) -> None:
    for name, value, min_value, max_value in (
        ("frames", frames, 1, np.inf),
        ("friction", friction, 0.0, 2.0),
        ("pitch_m", pitch_m, 1e-9, 1e3),
        ("module_kg", module_kg, 1e-9, 1e6),
        ("module_size", module_size, 0.5, 1.0),
        ("bound", MIN_TORQUE_WP if bound is None else bound, MIN_TORQUE_WP, np.inf),
    ):
        if not min_value <= value <= max_value:
            raise InputError(
                "bad-table", f"got {value:g}, expected {min_value:g} to {max_value:g}.", where=name
            )
    if base not in ("clamped", "free"):
        raise InputError(
            "bad-table", f"got the base {base!r}, expected clamped or free.", where="base"
        )


def _reason(certificate: TableCertificate) -> Reason | None:
    """Return the first condition that a motion on a table fails; None if it rests."""
    base: ReasonValues = {
        "friction": certificate.friction,
        "clamped": certificate.base == "clamped",
    }
    if certificate.unbalanced:
        return Reason.of(
            Code.TIPS_OVER,
            base,
            count=len(certificate.unbalanced),
            frames=len(certificate.torques),
            frame=certificate.unbalanced[0],
        )
    if not certificate.on_table:
        return Reason.of(Code.NO_TABLE, base, torque=certificate.torque, frame=certificate.frame)
    if certificate.clearance < -MAX_TABLE_ENTRY_PITCH:
        return Reason.of(
            Code.SINKS_INTO_TABLE,
            depth=-certificate.clearance,
            frame=certificate.clearance_frame,
            limit=MAX_TABLE_ENTRY_PITCH,
        )
    if certificate.bound is not None and (certificate.torque or 0.0) > certificate.bound:
        return Reason.of(
            Code.TORQUE_LIMIT,
            base,
            torque=certificate.torque,
            frame=certificate.frame,
            limit_torque=certificate.bound,
        )
    return None


def _assumptions(
    friction: float, base: Base, on_table: bool, module_size: float
) -> tuple[str, ...]:
    """Return the assumptions of the figures."""
    assumptions = [
        "The contact forces are distributed so that the largest joint torque of a frame is as "
        "small as possible. This lower bound of the torque is exact for motors that yield at their "
        "limit. Servos that hold their position stiffly need more.",
        "Statics only: accelerating the modules needs additional torque.",
        f"Corners up to {FLOOR_GAP:g} pitch above the table count as standing on it. Full-size "
        f"modules up to {MODULE_GAP:g} pitch apart count as touching and push each other without "
        "friction. The parts of linked cubes that would touch are treated as cut away.",
        f"Modules are rigid, have the same weight and are {module_size:g} pitch wide at contacts. "
        "Joints bear any force, and any moment perpendicular to their hinge axes.",
        f"Torques up to {MIN_TORQUE_WP:g} w·p count as zero.",
        "Every frame is checked, but not the motion between frames.",
    ]
    if friction == 0.0:
        assumptions.append("No friction: the table exerts no forces along its plane.")
    else:
        assumptions.append(
            f"Coulomb friction with the table (coefficient {friction:g}) opposes the motion that "
            "leads to the next frame. At corners that do not slip, the friction cone is replaced "
            f"by an inscribed pyramid with {CONE_SIDES} sides."
        )
    if base == "clamped":
        assumptions.append(
            "The first module is clamped to the table, which bears any force and moment."
        )
    elif friction == 0.0:
        assumptions.append("The chain lies on the table and is not clamped.")
    else:
        assumptions.append(
            "The chain lies on the table and is not clamped. The chain drifts so that friction "
            "does the least work. The drift is computed with the contact forces that the chain "
            "would have on a table without friction. Friction forces may "
            f"deviate from the slip direction by {DIRECTION_SPREADS_RAD[0]:g} rad, or by "
            f"{DIRECTION_SPREADS_RAD[1]:g} rad if the forces cannot balance otherwise."
        )
    if not on_table:
        assumptions.append(
            "The plan was not made for a table. For this check, the chain of each frame was laid "
            "on the table in the resting pose that needs the least torque. The motion from one "
            "resting pose to the next is not checked."
        )
    return tuple(assumptions)
