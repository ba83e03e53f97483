"""Figures of plans as plain JSON values, as files, rows and answers have them.

Units are those of the dataclasses named.
"""

from __future__ import annotations

from typing import Any, Final, Required, TypedDict

from foldback.planner.motion.failure_schemas import StuckFigures
from foldback.planner.reasons import ReasonFigures

SIMULATED: Final = "verified (simulated)"
"""Verdict of a verified plan whose playback was simulated."""
KINEMATICS_ONLY: Final = "verified (kinematics only)"
"""Verdict of a verified plan whose playback follows it by kinematics."""


class PlaceFigures(TypedDict):
    """``planner.clearance.exempt_pairs.Place``."""

    frame: float
    modules: list[int] | None


class ExemptFigures(TypedDict):
    """``planner.clearance.exempt_pairs.ExemptPairs``."""

    rule: str
    apart: int
    count: int
    worst_overlap: float | None
    worst_overlap_at: PlaceFigures | None
    worst_overlap_bound: float | None
    relief_radius: float | None
    relief_share: float


class RobotFigures(TypedDict):
    """Figures of one robot with model errors that folded a plan in simulation.

    Its largest joint error at a frame, the RMS distance of its modules from the folded shape at the
    end (after alignment), the least clearance found and the one that is proved.
    """

    max_angle_error_rad: float
    rms_position_error: float
    min_clearance: float
    clearance_bound: float


class MarginFigures(TypedDict):
    """``planner.clearance.margins.Margin``."""

    value: float
    limited_by: PlaceFigures


class MarginsFigures(TypedDict):
    """``planner.clearance.margins.Margins``."""

    module_size: MarginFigures
    one_hinge_rad: MarginFigures
    independent_rad: MarginFigures
    failure_probability: float


class CertificateFigures(TypedDict, total=False):
    """``planner.certificate.certificate.Certificate``."""

    verified: bool
    reason: ReasonFigures | None
    verdict: str
    table: dict[str, Any]
    simulated: bool | None
    module_size: float
    exempt_pairs: ExemptFigures | None
    min_clearance: float | None
    min_clearance_at: PlaceFigures | None
    clearance_bound: float | None
    robots: list[RobotFigures] | None
    min_clearance_playback: float | None
    min_clearance_playback_at: PlaceFigures | None
    min_clearance_record: float | None
    min_clearance_record_at: PlaceFigures | None
    in_betweens: int
    frames: int | None
    plan_end_error_rad: float | None
    rms_position_error: float | None
    max_position_error: float | None
    max_angle_error_rad: float | None
    max_angle_rad: float | None
    max_angle_record_rad: float | None
    max_joint_step_rad: float | None
    joint_speed_limit_rad_s: float
    fold_time_s: float | None
    hinges_moving_mean: float | None
    hinges_moving_most: int | None
    travel_ratio: float | None
    reversals_mean: float | None
    detours: int | None
    largest_detour_rad: float | None
    peak_torque_nm: float | None
    rms_torque_nm: float | None
    torque_source: str | None
    torque_frames: int | None
    gravity_torque_folded_nm: float
    gravity_torque_straight_nm: float
    seconds: float
    margins: MarginsFigures | None


class ExplosionFigures(TypedDict, total=False):
    """``planner.motion.record.Record.summary``."""

    status: str
    reason: str
    strategy: str
    steps: int
    frames: int
    seconds: float


class PlaybackFigures(TypedDict, total=False):
    """``planner.playback.playback.Playback.summary``."""

    kind: str
    status: str
    reason: str
    steps: int
    seconds: float
    rms_position_error: float | None
    max_angle_error_rad: float | None
    peak_torque: float | None
    rms_torque: float | None
    torque_frames: int | None
    robots: int | None


class SmoothingFigures(TypedDict):
    """``planner.robot.smoothed_plan.before_and_after``."""

    way: str
    seconds: float
    before: dict[str, float]
    after: dict[str, float] | None


class ComparedFigures(TypedDict):
    """``planner.pipeline.preference.PlanFigures``."""

    fold_time_s: float | None
    peak_torque_nm: float | None
    clearance_bound: float | None
    frames: int
    seconds: float
    one_hinge_rad: float | None
    travel_ratio: float | None
    hinges_moving_mean: float | None
    reversals_mean: float | None


class AttemptFigures(TypedDict, total=False):
    """``planner.pipeline.attempt.Attempt``."""

    candidate: Required[int]
    seed: Required[int]
    strategy: Required[str]
    other_end: bool
    gentle: bool
    plain: bool
    roomy: bool
    smooths: int
    status: Required[str]
    reason: str
    steps: Required[int]
    frames: int
    seconds: float
    diagnosis: StuckFigures | None
    finer: int
    patience: int
    off_straight: bool
    verified: bool
    refusal: ReasonFigures | None
    between: bool
    figures: ComparedFigures
    chosen: bool


class IncludedFigures(TypedDict):
    """Origin of a fold that came with the package: the version that made it."""

    version: str


class LikenessFigures(TypedDict):
    """``planner.shapes.likeness.Likeness``."""

    iou: float
    missing: float
    added: float


class FoldSummary(TypedDict, total=False):
    """``planner.plan.plan.Plan.summary``, or what is known of a fold without a plan."""

    status: str
    reason: str | None
    name: str
    module: str
    modules: int
    joints: int
    hinges: int
    preset: str
    seed: int
    refold: dict[str, Any] | None
    smoothing: SmoothingFigures | None
    likeness: LikenessFigures | None
    stuck: StuckFigures | None
    attempts: int
    explosion: ExplosionFigures | None
    playback: PlaybackFigures | None
    certificate: CertificateFigures | None
    included: IncludedFigures


class Fault(TypedDict, total=False):
    """Reason why a fold could not be computed."""

    code: str
    detail: str
    where: str | None
