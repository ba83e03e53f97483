"""Figures of plans as plain JSON values, as files, rows and answers have them.

Units are those of the dataclasses named.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    NotRequired,
    Required,
    TypedDict,
    get_args,
    get_type_hints,
)

from foldback.planner.motion.failure_schemas import StuckFigures
from foldback.planner.parameters.setting import Description
from foldback.planner.reasons import ReasonFigures

SIMULATED: Final = "verified (simulated)"
"""Verdict of a verified plan whose playback was simulated."""
KINEMATICS_ONLY: Final = "verified (kinematics only)"
"""Verdict of a verified plan whose playback follows it by kinematics."""


def verdict_text(failure: str | None, *, simulated: bool | None) -> str:
    """Return the verdict on a plan; ``failure`` is the text of the reason, None if verified."""
    if failure is not None:
        return f"failed: {failure}"
    return SIMULATED if simulated else KINEMATICS_ONLY


Source = Literal["motion", "simulation", "record", "request", "chain"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure(Description):
    """Description of a figure: pages, the terminal and docs/certificate.md take texts from here.

    Attributes:
        help: One line that explains it.
        source: What it is computed from: the ``motion`` of the plan, the ``simulation`` of its
            playback, the ``record`` of the explosion, the ``request``, or the ``chain`` alone.
    """

    help: str
    source: Source = "motion"


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


class MujocoRobotFigures(RobotFigures):
    """Figures of a robot that MuJoCo itself simulated, with the model errors of another one.

    ``robot`` is the index of that one, and ``max_difference_rad`` the largest difference of an
    angle between both at a frame.
    """

    robot: int
    max_difference_rad: float


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


class JointErrorFigures(TypedDict):
    """``planner.clearance.joint_errors.JointErrors``."""

    error_rad: float
    module_size: float | None
    tolerated_rad: float
    robots: int
    touching_at_size: int
    touching_with_error: int
    swept: bool


class CertificateFigures(TypedDict, total=False):
    """``planner.certificate.certificate.Certificate``, with the one description of each figure.

    Lengths are in pitches, except where the name states a unit.
    """

    verified: Annotated[bool, Figure("Verified", help="True if the plan is verified.")]
    verdict: Annotated[
        str,
        Figure(
            "Verdict",
            help="`verified (simulated)`, `verified (kinematics only)`, or `failed: ` with the "
            "reason as text.",
        ),
    ]
    reason: Annotated[
        ReasonFigures | None,
        Figure(
            "Reason of the refusal",
            help="First condition that the plan fails, as `code` and `values`; null if it is "
            "verified.",
        ),
    ]
    simulated: Annotated[
        bool | None,
        Figure(
            "Simulated",
            help="True if the playback was simulated; null if there is none.",
            source="simulation",
        ),
    ]
    module_size: Annotated[
        float,
        Figure(
            "Module size in the clearance check",
            "pitch",
            help="Edge length of a module in the clearance check.",
            source="request",
        ),
    ]
    exempt_pairs: Annotated[
        ExemptFigures | None,
        Figure(
            "Linked modules",
            help="Pairs of modules that are not checked, and their overlap; null if it was not "
            "computed.",
        ),
    ]
    min_clearance: Annotated[
        float | None,
        Figure(
            "Smallest clearance in the plan",
            "pitch",
            help="Smallest clearance found in the plan, at its frames and in-betweens.",
        ),
    ]
    min_clearance_at: Annotated[
        PlaceFigures | None,
        Figure(
            "Place of the smallest clearance in the plan",
            help="Frame and modules of `min_clearance`.",
        ),
    ]
    clearance_bound: Annotated[
        float | None,
        Figure(
            "Proved clearance",
            "pitch",
            help="Proved lower bound of the clearance everywhere in the plan, and in the simulated "
            "playback of every robot.",
        ),
    ]
    robots: Annotated[
        list[RobotFigures] | None,
        Figure(
            "Simulated robots",
            help="Figures of each robot with model errors that folded the plan in simulation, the "
            "one shown first; null if there was none.",
            source="simulation",
        ),
    ]
    mujoco_robot: Annotated[
        MujocoRobotFigures | None,
        Figure(
            "Robot in MuJoCo",
            help="Figures of a simulated robot that MuJoCo itself simulated once more, with the "
            "same model errors; missing if there is none.",
            source="simulation",
        ),
    ]
    min_clearance_playback: Annotated[
        float | None,
        Figure(
            "Smallest clearance of the simulated robots",
            "pitch",
            help="Smallest clearance found in the simulated playback that is shown.",
            source="simulation",
        ),
    ]
    min_clearance_playback_at: Annotated[
        PlaceFigures | None,
        Figure(
            "Place of the smallest clearance of the simulated robots",
            help="Frame and modules of `min_clearance_playback`.",
            source="simulation",
        ),
    ]
    min_clearance_record: Annotated[
        float | None,
        Figure(
            "Smallest clearance while unfolding",
            "pitch",
            help="Smallest clearance at the frames of the record. No robot follows the record, so "
            "the verdict does not depend on it.",
            source="record",
        ),
    ]
    min_clearance_record_at: Annotated[
        PlaceFigures | None,
        Figure(
            "Place of the smallest clearance while unfolding",
            help="Frame and modules of `min_clearance_record`.",
            source="record",
        ),
    ]
    in_betweens: Annotated[
        int,
        Figure("In-betweens", help="Number of configurations that were checked between frames."),
    ]
    frames: Annotated[int | None, Figure("Frames", help="Number of frames of the plan.")]
    plan_end_error_rad: Annotated[
        float | None,
        Figure(
            "Error of the last frame",
            "rad",
            help="Largest difference of a hinge between the plan's last frame and the folded "
            "shape.",
        ),
    ]
    rms_position_error: Annotated[
        float | None,
        Figure(
            "Average position error at the end (root mean square)",
            "pitch",
            help="RMS position error of the modules at the end of the simulated playback, after "
            "alignment.",
            source="simulation",
        ),
    ]
    max_position_error: Annotated[
        float | None,
        Figure(
            "Largest position error at the end",
            "pitch",
            help="Largest position error of a module there, after alignment.",
            source="simulation",
        ),
    ]
    max_angle_error_rad: Annotated[
        float | None,
        Figure(
            "Largest joint error",
            "rad",
            help="Largest joint error of the simulated playback.",
            source="simulation",
        ),
    ]
    max_angle_rad: Annotated[
        float | None,
        Figure(
            "Largest hinge angle",
            "rad",
            help="Largest angle of a hinge in the plan and the simulated playback.",
        ),
    ]
    max_angle_record_rad: Annotated[
        float | None,
        Figure(
            "Largest hinge angle while unfolding",
            "rad",
            help="Largest angle of a hinge in the record.",
            source="record",
        ),
    ]
    max_joint_step_rad: Annotated[
        float | None,
        Figure(
            "Largest joint rotation per frame",
            "rad",
            help="Largest step of a hinge between two frames of the plan.",
        ),
    ]
    joint_speed_limit_rad_s: Annotated[
        float,
        Figure(
            "Speed limit of the hinges",
            "rad/s",
            help="Speed limit of the hinges of a robot.",
            source="request",
        ),
    ]
    fold_time_s: Annotated[
        float | None,
        Figure(
            "Folding time",
            "s",
            help="Duration of the fold if the hinges turn at up to `joint_speed_limit_rad_s`.",
        ),
    ]
    hinges_moving_mean: Annotated[
        float | None,
        Figure(
            "Average number of hinges moving at once",
            help="Mean number of hinges that move at the same time.",
        ),
    ]
    hinges_moving_most: Annotated[
        int | None,
        Figure(
            "Largest number of hinges moving at once",
            help="Maximum number of hinges that move at the same time.",
        ),
    ]
    travel_ratio: Annotated[
        float | None,
        Figure(
            "Travel of all hinges",
            help="Sum of all motions of the hinges, divided by the least possible; null for very "
            "long plans.",
        ),
    ]
    reversals_mean: Annotated[
        float | None,
        Figure(
            "Average number of reversals of a hinge",
            help="Mean number of changes of direction of a hinge, counted when it has gone back by "
            "one degree; null for very long plans.",
        ),
    ]
    detours: Annotated[
        int | None,
        Figure(
            "Hinges that move and return to where they began",
            help="Number of hinges that move by more than one degree although they end where they "
            "began; null for very long plans.",
        ),
    ]
    largest_detour_rad: Annotated[
        float | None,
        Figure(
            "Largest detour",
            "rad",
            help="Largest distance of such a hinge from where it began, in `detours`.",
        ),
    ]
    peak_torque_nm: Annotated[
        float | None,
        Figure(
            "Peak torque",
            "N·m",
            help="Largest torque of a fold in `fold_time_s`, floating, without gravity, at the "
            "frames of `torque_source`: other frames may need more.",
        ),
    ]
    rms_torque_nm: Annotated[
        float | None,
        Figure("RMS torque", "N·m", help="RMS torque in the same fold, at the same frames."),
    ]
    torque_source: Annotated[
        str | None,
        Figure(
            "Source of the torques",
            help="`simulation, every step` or `inverse dynamics at N of F frames, accelerations "
            "smoothed`; null if unknown.",
        ),
    ]
    torque_frames: Annotated[
        int | None,
        Figure(
            "Frames with torques",
            help="N in `torque_source`; null for every step of a simulation.",
        ),
    ]
    gravity_torque_folded_nm: Annotated[
        float,
        Figure(
            "Holding torque of the folded shape",
            "N·m",
            help="Largest static torque of the folded chain in gravity when held at the root "
            "without support.",
            source="chain",
        ),
    ]
    gravity_torque_straight_nm: Annotated[
        float,
        Figure(
            "Holding torque of the straight chain",
            "N·m",
            help="The same for the straight chain.",
            source="chain",
        ),
    ]
    seconds: Annotated[float, Figure("Computing time", "s", help="Wall time of the verification.")]
    table: Annotated[
        dict[str, Any],
        Figure(
            "Holding torque on a table",
            help="Certificate of the motion on a table; missing for a plan that floats.",
        ),
    ]
    margins: Annotated[
        MarginsFigures | None,
        Figure(
            "Margins",
            help="Errors of modules and hinges that the plan tolerates; null for a plan that is "
            "not verified, and for very long chains.",
        ),
    ]
    joint_errors: Annotated[
        JointErrorFigures,
        Figure(
            "Sampled robots with joint errors",
            help="Module size and hinge errors at which few enough of 300 sampled robots touch "
            "themselves; an estimate from the folded shape unless the request names a joint error. "
            "Missing for a plan that is not verified, and for very long chains.",
        ),
    ]


@cache
def figures_of_certificates() -> dict[str, Figure]:
    """Return the descriptions of a certificate's figures by name."""
    hints = get_type_hints(CertificateFigures, include_extras=True)
    return {name: get_args(hint)[1] for name, hint in hints.items()}


class ExplosionFigures(TypedDict, total=False):
    """``planner.motion.record.Record.summary``."""

    status: str
    reason: ReasonFigures | None
    strategy: str
    steps: int
    frames: int
    seconds: float


class PlaybackFigures(TypedDict, total=False):
    """``planner.playback.playback.Playback.summary``."""

    kind: str
    status: str
    reason: ReasonFigures | None
    steps: int
    seconds: float
    rms_position_error: float | None
    max_angle_error_rad: float | None
    peak_torque: float | None
    rms_torque: float | None
    torque_frames: int | None
    robots: int | None


class SmoothingFigures(TypedDict):
    """``planner.smoothing.smoothed_plan.before_and_after``."""

    way: str
    seconds: float
    before: dict[str, float | None]
    after: dict[str, float | None] | None


class ComparedFigures(TypedDict):
    """``planner.pipeline.preference.PlanFigures``."""

    size_with_errors: NotRequired[float]
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
    reason: ReasonFigures | None
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


class ShippedFigures(TypedDict):
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
    module_words: dict[str, str] | None
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
    shipped: ShippedFigures


class Fault(TypedDict, total=False):
    """Reason why a fold could not be computed."""

    code: str
    values: dict[str, Any]
    detail: str
    message: str
    where: str | None
