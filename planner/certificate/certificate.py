"""Certificate: verified properties of a plan, by exact kinematics apart from the simulation.

Nothing here runs a simulation or trusts one: configurations go in, poses come from forward
kinematics, collisions from separating axes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import cast

import numpy as np

from foldback.planner.certificate.figures import (
    CertificateFigures,
    MujocoRobotFigures,
    RobotFigures,
    verdict_text,
)
from foldback.planner.certificate.plan_figures import (
    largest_angle,
    mujoco_figures,
    plan_figures,
    robot_figures,
)
from foldback.planner.certificate.swept_motions import Sweeper, followed
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.certificate.verdict import find_reason
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.exempt_pairs import ExemptPairs, Place, exempt_pairs
from foldback.planner.clearance.joint_errors import JointErrors, joint_errors
from foldback.planner.clearance.margins import Margins, margins
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.playback.playback import Playback
from foldback.planner.progress import MARGINS_MESSAGE, Cancelled, Progress, Report, never, silent
from foldback.planner.reasons import MotionName, Reason
from foldback.planner.reasons import ReasonCode as Code
from foldback.planner.storage.plain_values import from_plain


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """Verified properties of a plan. Lengths in pitches, except where the name states a unit.

    Figures of a simulated playback are None if there was none: chains that are too long to be
    simulated as a whole, or that were recorded piece by piece, follow their plan by kinematics.

    All clearances are None if no check came to its end. ``CertificateFigures`` describes each
    figure; docs/certificate.md lists the descriptions.
    """

    reason: Reason | None
    simulated: bool | None
    module_size: float
    exempt_pairs: ExemptPairs | None
    min_clearance: float | None
    min_clearance_at: Place | None
    clearance_bound: float | None
    robots: tuple[RobotFigures, ...] | None
    min_clearance_playback: float | None
    min_clearance_playback_at: Place | None
    min_clearance_record: float | None
    min_clearance_record_at: Place | None
    in_betweens: int
    frames: int | None = None
    plan_end_error_rad: float | None = None
    rms_position_error: float | None = None
    max_position_error: float | None = None
    max_angle_error_rad: float | None = None
    max_angle_rad: float | None = None
    max_angle_record_rad: float | None
    max_joint_step_rad: float | None = None
    joint_speed_limit_rad_s: float
    fold_time_s: float | None = None
    hinges_moving_mean: float | None = None
    hinges_moving_most: int | None = None
    travel_ratio: float | None = None
    reversals_mean: float | None = None
    detours: int | None = None
    largest_detour_rad: float | None = None
    peak_torque_nm: float | None = None
    rms_torque_nm: float | None = None
    torque_source: str | None = None
    torque_frames: int | None = None
    gravity_torque_folded_nm: float
    gravity_torque_straight_nm: float
    seconds: float
    mujoco_robot: MujocoRobotFigures | None = None
    table: TableCertificate | None = None
    margins: Margins | None = None
    joint_errors: JointErrors | None = None

    @property
    def verified(self) -> bool:
        """True if the plan is verified."""
        return self.reason is None

    @property
    def verdict(self) -> str:
        """Verdict as text: ``verified (simulated)``, ``verified (kinematics only)``, ``failed: …``.

        Modules and frames count from 0.
        """
        return verdict_text(self.reason and self.reason.text(), simulated=self.simulated)

    def as_dict(self) -> CertificateFigures:
        """Return plain JSON values."""
        robots = None if self.robots is None else list(self.robots)
        reason = self.reason and self.reason.as_dict()
        judgement = {"verified": self.verified, "verdict": self.verdict}
        values = {**judgement, **asdict(self), "robots": robots, "reason": reason}
        del values["table"]
        for name in ("mujoco_robot", "joint_errors"):
            if values[name] is None:
                del values[name]
        if self.table is not None:
            values["table"] = self.table.as_dict()
        return cast(CertificateFigures, values)

    @classmethod
    def from_dict(cls, values: CertificateFigures) -> Certificate:
        """Build a certificate from ``as_dict``.

        Raises:
            ValueError: A figure is missing, unknown, or of another type.
            KeyError: The reason lacks a value.
            InputError: ``wrong-format``, of a table's certificate.
        """
        figures = {*cls.__dataclass_fields__, "verified", "verdict"}
        if unknown := values.keys() - figures:
            names = ", ".join(sorted(unknown))
            raise ValueError(
                f"got unknown figures ({names}), expected only figures of a certificate"
            )
        if missing := figures - {"table", "mujoco_robot", "joint_errors"} - values.keys():
            names = ", ".join(sorted(missing))
            raise ValueError(f"got a certificate without {names}, expected all of its figures")
        table = values.get("table")
        checked = None if table is None else TableCertificate.from_dict(table)
        certificate = replace(from_plain(values, cls), table=checked)
        if values.get("verified") is not certificate.verified:
            raise ValueError("got a certificate whose verified and reason contradict each other")
        _ = certificate.verdict  # whose text names all values of the reason
        return certificate


def certify(
    chain: Chain,
    record: Record | None,
    playback: Playback | None,
    parameters: Parameters,
    *,
    start: Chain | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
    forces: Callable[[TableForces], object] | None = None,
    with_margins: bool = True,
) -> Certificate:
    """Verify a plan: the reference of a playback, and the playback and record themselves.

    Args:
        chain: The chain.
        record: The explosion, or None for direct servoing.
        playback: The playback, or None if there is nothing to play.
        parameters: Parameters of the fold: module size and physical units.
        start: The chain as it is folded at the beginning of a refold; None if it is straight.
        progress: Receives the motion that is being swept.
        cancelled: Returns True to stop; the verdict then is a failure, and all clearances are
            None.
        forces: Receives torques and forces at each of the plan's frames, for a plan on a table.
        with_margins: Compute the margins of a verified plan, and those of sampled robots.

    Raises:
        InputError: ``bad-module-size``.
    """
    began_s = time.perf_counter()
    size = _module_size(parameters)
    unusable = _unusable(chain, record, playback, start)
    if unusable is not None:
        record = playback = None
    if record is not None and playback is not None:
        # As the timeline has them, which holds one layout: a table's record is windowed.
        record = replace(record, frames=record.frames.in_layout_of(playback.frames, chain))
    sweeper = Sweeper(chain=chain, size=size, progress=progress, cancelled=cancelled)
    with ThreadPoolExecutor(1) as beside:
        motions = () if playback is None else followed(playback)
        exempt = beside.submit(exempt_pairs, chain, motions, module_size=size)
        sweeps = sweeper.sweep_all(record, playback)
        figures = plan_figures(chain, playback, parameters)
        robots = robot_figures(chain, playback, sweeps)
        in_mujoco = mujoco_figures(chain, playback, sweeps)
    if unusable is not None:
        reason = unusable
    elif sweeper.is_cancelled:
        reason = Reason.of(Code.CANCELLED)
    else:
        reason = find_reason(chain, start, record, playback, sweeps, figures, size)
    on_table = None
    if parameters.world == "table" and playback is not None and not sweeper.is_cancelled:
        progress(
            Progress(stage="certify", fraction=0.9, message="computing the torques on the table")
        )
        on_table = _on_table(chain, playback, parameters, forces)
        reason = reason or on_table.reason
    proved_margins = sampled_margins = None
    if with_margins and sweeps.plan is not None and reason is None:
        assert playback is not None
        progress(Progress(stage="certify", fraction=0.95, message=MARGINS_MESSAGE))
        proved_margins = margins(
            chain, playback.reference, sweeps.plan, module_size=size, cancelled=cancelled
        )
        sampled_margins = joint_errors(
            chain,
            playback.reference,
            module_size=size,
            clearances=sweeps.plan.per_frame,
            error_rad=parameters.joint_error_rad,
            cancelled=cancelled,
        )
    return Certificate(
        reason=reason,
        table=on_table,
        margins=proved_margins,
        joint_errors=sampled_margins,
        simulated=None if playback is None else playback.simulated,
        module_size=size,
        exempt_pairs=exempt.result(),
        robots=robots,
        mujoco_robot=in_mujoco,
        max_angle_record_rad=None if record is None else largest_angle(record.frames),
        joint_speed_limit_rad_s=parameters.joint_speed_limit_rad_s,
        seconds=time.perf_counter() - began_s,
        **sweeps.figures(),
        **figures,
    )


def _module_size(parameters: Parameters) -> float:
    """Return the module size as a fraction of the pitch.

    Raises:
        InputError: ``bad-module-size``.
    """
    size = parameters.module_size
    if not 0.0 < size < np.inf:
        raise InputError(
            "bad-module-size", f"got a module size of {size}, expected a number above 0."
        )
    return size


def _on_table(
    chain: Chain,
    playback: Playback,
    parameters: Parameters,
    forces: Callable[[TableForces], object] | None,
) -> TableCertificate:
    """Certify the plan on the table that it was made for."""
    # Late: most folds are not on a table.
    from foldback.planner.certificate.table_certificate import table_certificate

    table = parameters.table
    frames = playback.frames.planned(chain, playback.reference, clamped=table.held)
    return table_certificate(
        chain,
        frames,
        friction=table.table_friction,
        base=table.table_base,
        density_kg_m3=parameters.density_kg_m3,
        bound=table.table_torque,
        on_table=True,
        height=chain.table_height,
        sink=forces,
    )


def _unusable(
    chain: Chain, record: Record | None, playback: Playback | None, start: Chain | None
) -> Reason | None:
    """Return the reason why nothing can be checked; None if all can.

    A number that is none compares with nothing, so it would pass every test that follows.
    """
    joints = len(chain.folded_rad)
    if start is not None and (start.module.name, len(start)) != (chain.module.name, len(chain)):
        return Reason.of(Code.DIFFERENT_MODULES, start=start.name, chain=chain.name)
    motions: dict[MotionName, Motion] = {}
    if record is not None:
        motions["record"] = record.frames
    if playback is not None:
        motions["simulated playback" if playback.simulated else "playback"] = playback.frames
        if unusable := _unusable_angles(playback, joints):
            return unusable
    for name, frames in motions.items():
        if unusable := _unusable_frames(chain, name, frames):
            return unusable
    return None


def _unusable_frames(chain: Chain, name: MotionName, frames: Motion) -> Reason | None:
    """Return the reason why the frames of a motion cannot be checked; None if they can."""
    joints = len(chain.folded_rad)
    if not len(frames):
        return Reason.of(Code.NO_FRAMES, motion=name)
    if frames.is_windowed:
        try:
            frames.check(chain)
        except InputError as error:
            return Reason.of(Code.UNREADABLE_MOTION, motion=name, detail=error.detail)
    elif (len(frames.first), frames.hinges) != (len(frames), joints):
        return Reason.of(Code.ANGLE_COUNT, motion=name, joints=joints)
    numbers = (frames.time_s, frames.angles_rad, frames.anchor_position, frames.anchor_wxyz)
    if not all(np.isfinite(values).all() for values in numbers):
        return Reason.of(Code.NOT_FINITE, motion=name)
    if (np.diff(frames.time_s) < 0.0).any():
        return Reason.of(Code.TIME_ORDER, motion=name)
    return None


def _unusable_angles(playback: Playback, joints: int) -> Reason | None:
    """Return the reason why the plan or other robots cannot be checked; None if they can.

    The frames of the playback itself are checked elsewhere.
    """
    frames, reference, others_rad = playback.frames, playback.reference_rad, playback.others_rad
    expected = frames.angles_rad.shape if frames.is_windowed else (len(frames), joints)
    if reference is None:  # the plan of windows may be the playback itself
        return None if frames.is_windowed else Reason.of(Code.NO_PLAN)
    if reference.shape != expected:
        return Reason.of(
            Code.PLAN_SHAPE,
            shape=list(reference.shape),
            expected=list(expected),
        )
    if not np.isfinite(reference).all():
        return Reason.of(Code.NOT_FINITE, motion="plan")
    if others_rad is not None and (
        others_rad.shape[1:] != expected or not np.isfinite(others_rad).all()
    ):
        return Reason.of(Code.OTHER_ROBOTS)
    mujoco_rad = playback.mujoco_rad
    if mujoco_rad is not None and (
        mujoco_rad.shape != expected
        or not np.isfinite(mujoco_rad).all()
        or playback.mujoco_robot not in range(playback.robots or 1)
    ):
        return Reason.of(Code.OTHER_ROBOTS)
    return None
