"""Properties: the rows of values on a fold's page, the most important ones first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypedDict, cast
from zipfile import ZipFile

from foldback.planner.certificate.figures import (
    CertificateFigures,
    ExplosionFigures,
    FoldSummary,
    PlaybackFigures,
)
from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, MODULE_NAMES, module_of
from foldback.planner.chain.module import Module
from foldback.planner.errors import UNREADABLE, TimelineError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.parameters.explosion import (
    ExplosionParameters,
    PeelingParameters,
    TableParameters,
)
from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.pipeline.fold_layout import plan_values, result_path
from foldback.planner.pipeline.preference import COMPUTING, preference_named
from foldback.planner.storage.array_files import HEAD
from foldback.planner.storage.file_names import CHAIN, PLAN, TIMELINE
from foldback.planner.storage.files import json_of
from foldback.planner.verification.integrity import damaged_among
from foldback.words import certificate as certificate_words
from foldback.words.failures import timeline_reader
from foldback.words.fold import RUNNING_STATUSES, ShownFold
from foldback.words.likeness import likeness_words
from foldback.words.plan_choice import PREFERENCE_WORDS
from foldback.words.quantities import (
    PRESET_LABELS,
    STRATEGY_LABELS,
    length_m,
    quantity,
    sentence,
)
from foldback.words.quantities import parameters as parameters_in_words
from foldback.words.settings import changed

VERSIONS: Final = {"python": "Python", "mujoco": "MuJoCo", "numpy": "NumPy", "scipy": "SciPy"}
PLAN_MEMBER: Final = "plan.npy"
"""Member of the archive plan.npz that holds everything of a plan but its frames, as JSON text."""
SUMMARY_HEADING: Final = "In short"
"""Heading of the first group of a fold's properties; only its group is open when the page loads."""
TRACKING_PARAMETERS: Final = (
    "spacing_rad",
    "distance_weight",
    "steps_per_rad",
    "step_s",
    "simulated_modules",
)
"""Names of the playback parameters that all controllers share which follow the smooth curve through
the recorded joint angles; a fold's page lists them."""
SERVO_PARAMETERS: Final = (
    "step_s",
    "friction",
    "damping",
    "motor_gain",
    "stiffness",
    "motor_max_force",
)
"""Names of the playback parameters that all simulated servos without feed-forward share; a fold's
page lists them."""
CONTROLLER_PARAMETERS: Final[dict[str, tuple[str, ...]]] = {
    "robot": (*TRACKING_PARAMETERS, "paced_by"),
    "computed-torque": (
        *TRACKING_PARAMETERS,
        "paced_by",
        "bandwidth",
        "friction",
        "damping",
    ),
    "paper": (*SERVO_PARAMETERS, "threshold", "steps_per_snapshot", "simulated_modules"),
    "direct": (*SERVO_PARAMETERS, "direct_steps", "simulated_modules"),
}
"""Names of the playback parameters that a fold's page lists, by the controller of the simulated
joints."""
EXPLOSION_STRATEGIES: Final = ("simultaneous", "blocks")
"""Explosion strategies (ways to unfold the folded chain in simulation) whose parameters a fold's
page lists as those of the explosion; the strategy ``peel`` has its own."""
Rows = list[tuple[str, object]]
Values = Mapping[str, Any]


class Property(TypedDict):
    """One value in words."""

    label: str
    value: str


class Properties(TypedDict):
    """A group of rows; pages collapse all groups but the first."""

    heading: str
    rows: list[Property]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fold:
    """Data of a fold from which its properties are derived."""

    row: ShownFold
    summary: FoldSummary
    certificate: CertificateFigures
    directory: Path

    @property
    def explosion(self) -> ExplosionFigures:
        return self.summary.get("explosion") or ExplosionFigures()

    @property
    def playback(self) -> PlaybackFigures:
        return self.summary.get("playback") or PlaybackFigures()

    @property
    def chain(self) -> Values:
        over = self.row.status not in RUNNING_STATUSES
        damaged = over and damaged_among(self.directory, [CHAIN])
        return {} if damaged else json_of(result_path(self.directory, CHAIN))

    @property
    def module(self) -> Module:
        """The module of the chain; the default one until the chain of an unknown one is read."""
        name = self.row.module if self.row.module in MODULE_NAMES else DEFAULT_MODULE
        return module_of(self.chain.get("module", name))

    @property
    def plan(self) -> dict[str, dict[str, Any]]:
        over = self.row.status in ("verified", "failed")
        return settings_of(self.directory / PLAN) if over else {}

    @property
    def verdict(self) -> str:
        certificate = self.summary.get("certificate") or CertificateFigures()
        return certificate_words.verdict_words(certificate, timeline_reader(self.summary))

    def summary_rows(self) -> Rows:
        row = self.row
        return [
            ("Verdict", sentence(self.verdict)),
            *certificate_words.main_rows(self.certificate),
            ("Modules", row.modules or None),
            ("Likeness", likeness_words(self.summary.get("likeness"))),
            ("Spacing of the modules (1 pitch)", length_m(self.chain.get("pitch_m"))),
            ("Strategy", STRATEGY_LABELS.get(str(self.explosion.get("strategy")))),
            ("Method", PRESET_LABELS.get(row.preset, row.preset)),
            (
                "Environment",
                "In zero gravity" if row.world == FLOATING else "On a table, with gravity",
            ),
        ]

    def fold_rows(self) -> Rows:
        row = self.row
        preference_text = (
            None if row.prefer == COMPUTING else PREFERENCE_WORDS[preference_named(row.prefer)]
        )
        return [
            ("Name", row.called),
            ("Joints", self.module.joint_after(row.modules - 1) if row.modules else None),
            ("Chosen for", preference_text),
            ("Random start (seed)", self.summary.get("seed", row.seed)),
            ("Identifier", row.id),
        ]

    def certificate_rows(self) -> Rows:
        certificate = self.certificate
        limit_rad = self.module.largest_angle_rad
        return [
            *certificate_words.further_rows(certificate),
            (certificate_words.label_of("exempt_pairs"), certificate_words.linked(certificate)),
            ("Recording", certificate_words.record(certificate, limit_rad=limit_rad)),
        ]

    def computation_rows(self) -> Rows:
        explosion, playback = self.explosion, self.playback
        stage_title = "Smoothing" if self.summary.get("smoothing") else "Unfolding"
        kinematic = playback.get("kind") == "kinematic"
        not_simulated = certificate_words.NOT_SIMULATED if kinematic else None
        return [
            (f"{stage_title} steps", explosion.get("steps") or None),
            (f"{stage_title} frames", explosion.get("frames")),
            (f"Computing time: {stage_title.lower()}", quantity(explosion.get("seconds"), "s", 2)),
            ("Folding steps", playback.get("steps") or not_simulated),
            ("Computing time: folding", quantity(playback.get("seconds"), "s", 2)),
            ("Computing time: certificate", quantity(self.certificate.get("seconds"), "s", 2)),
            ("Simulated time", quantity(_simulated_s(self.directory), "s")),
        ]


def properties(
    row: ShownFold, summary: FoldSummary, certificate: CertificateFigures, directory: Path
) -> list[Properties]:
    """Return groups of labels and values, with the most important rows in the first."""
    fold = _Fold(row=row, summary=summary, certificate=certificate, directory=directory)
    plan = fold.plan
    versions = plan.get("versions", {})
    groups: list[tuple[str, Rows]] = [
        (SUMMARY_HEADING, fold.summary_rows()),
        ("Fold", fold.fold_rows()),
        ("Changed settings", [*changed(row.preset, row.settings)]),
        ("Motion", [*certificate_words.motion_rows(fold.certificate)]),
        ("Certificate", fold.certificate_rows()),
        ("Computation", fold.computation_rows()),
        *[
            (heading, [*parameters_in_words(values, kind)])
            for heading, kind, values in used_parameters(
                plan.get("parameters", {}),
                strategy=str(fold.explosion.get("strategy")),
                simulated=fold.playback.get("kind") != "kinematic",
            )
        ],
        ("Versions", [(VERSIONS.get(name, name), str(v)) for name, v in versions.items()]),
    ]
    nonempty = [(heading, _shown(rows)) for heading, rows in groups]
    return [{"heading": heading, "rows": rows} for heading, rows in nonempty if rows]


def used_parameters(
    parameters: Values, *, strategy: str, simulated: bool
) -> list[tuple[str, type[Any], Values]]:
    """Return headings, classes and values of those parameters that a fold has used.

    Args:
        parameters: All parameters in a plan, nested as in ``Parameters.as_dict``.
        strategy: Strategy of the explosion from which the plan was made.
        simulated: False for a kinematic playback, which has no controller.
    """
    on_table = parameters.get("world") == "table"
    groups: list[tuple[str, type[Any], Values]] = []
    if strategy in EXPLOSION_STRATEGIES:
        published = parameters.get("preset") == "paper"
        kind = PaperExplosionParameters if published else ExplosionParameters
        groups.append(("Explosion parameters", kind, parameters.get("explosion") or {}))
    elif strategy == "peel":
        name, kind = ("table", TableParameters) if on_table else ("peeling", PeelingParameters)
        groups.append((f"{name.capitalize()} parameters", kind, parameters.get(name) or {}))
    playback = parameters.get("playback")
    if on_table or not playback:
        return groups
    controller = str(playback.get("controller"))
    used = TRACKING_PARAMETERS if not simulated else (CONTROLLER_PARAMETERS.get(controller, ()))
    if simulated:
        used = ("controller", *used, "max_steps")
        # A motor either has a stiffness or a limit: planner.playback.reference_trajectory.
        limited = playback.get("motor_max_force") is not None
        used = [name for name in used if name != ("stiffness" if limited else "motor_max_force")]
    values = {name: playback[name] for name in used if name in playback}
    groups.append(("Playback parameters", PlaybackParameters, values))
    robot = playback.get("robot")
    if simulated and robot and controller == "robot":
        by_mujoco = (parameters.get("explosion") or {}).get("engine") == "mujoco"
        title = "Robots simulated by MuJoCo" if by_mujoco else "Simulated robots"
        groups.append((title, RobotParameters, robot))
    elif simulated and robot and controller == "computed-torque":
        encoder = {name: robot[name] for name in ("encoder_step",) if name in robot}
        groups.append(("Simulated robot", RobotParameters, encoder))
    return groups


def _shown(rows: Rows) -> list[Property]:
    """Return rows that have a value, in words."""
    return [
        {"label": sentence(label), "value": str(value)}
        for label, value in rows
        if value is not None and value != ""
    ]


def settings_of(path: Path) -> dict[str, dict[str, Any]]:
    """Return parameters and versions of a plan without its frames, which may take 100 MB."""
    try:
        return _settings_at(path, path.stat().st_mtime_ns)
    except OSError:
        return {}


@lru_cache(maxsize=512)
def _settings_at(path: Path, changed_ns: int) -> dict[str, dict[str, Any]]:
    del changed_ns
    try:
        with ZipFile(path) as file:
            if file.getinfo(PLAN_MEMBER).file_size > 16 * 2**20:  # 12 000 modules have 3 MB
                return {}
    except UNREADABLE:
        return {}
    plan = plan_values(path)
    return {key: cast("dict[str, Any]", plan.get(key) or {}) for key in ("parameters", "versions")}


def _simulated_s(directory: Path) -> float | None:
    """Return the simulated time of a timeline, s; it is cached until the timeline changes."""
    try:
        timeline = result_path(directory, TIMELINE)
        changed_ns = (timeline / HEAD).stat().st_mtime_ns
    except OSError:
        return None
    return _simulated_at(timeline, changed_ns)


@lru_cache(maxsize=512)
def _simulated_at(path: Path, changed_ns: int) -> float | None:
    del changed_ns
    try:
        timeline = Timeline.open(path)
        if not len(timeline):
            return None
        return float(timeline.frames(len(timeline) - 1).time_s[-1])
    except (TimelineError, *UNREADABLE):
        return None
