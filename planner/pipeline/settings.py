"""Settings: numbers of the published method, of robots and of tables that a plan of ours is for.

They are written as one text, ``damping=0.05, radial_gain=0.2``, on the command line, in the API and
on the page. ``SETTINGS`` are what the paper names, what it gives, and what is read into it
(docs/decisions/0002); ``ROBOT_SETTINGS`` what robots are like (docs/decisions/0001),
``TABLE_SETTINGS`` what tables are (docs/decisions/0026).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

from planner.errors import InputError
from planner.simulation.parameters import Base, PaperExplosionParameters, Parameters

LONGEST: Final = 500
"""Characters of a text of settings."""
NO_LIMIT: Final = "none"
NUMBER: Final = re.compile(
    r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?|[+-]?\.[0-9]+([eE][+-]?[0-9]+)?"
)
MOST_TURNED: Final = 1.0
"""Share of what is left that a motor may turn in one step."""
Source = Literal["published", "named", "ours"]
Value = float | str | None
"""Of a setting: a number, one of its words, or no limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One number of a method, or one of a few words.

    Attributes:
        name: As written in a text of settings.
        label: For people, with the paper's letter.
        unit: Empty for a plain number.
        source: ``published`` with this value, only ``named`` in the paper, or ``ours``.
        meaning: In a line.
        least, most: Its range.
        words: What it may be, where it is no number.
        whole: Whether it is a whole number.
        explosion: The field of ``PaperExplosionParameters`` that it sets, if any.
        playback: The field of ``PlaybackParameters`` that it sets, if any.
        robot: The field of ``RobotParameters`` that it sets, if any.
        table: The field of ``TableParameters`` that it sets, if any.
        optional: Whether it may be ``none``.
        direct: Whether servoing straight to the shape uses it too.
    """

    name: str
    label: str
    unit: str
    source: Source
    meaning: str
    least: float = 0.0
    most: float = 0.0
    words: tuple[str, ...] = ()
    whole: bool = False
    explosion: str | None = None
    playback: str | None = None
    robot: str | None = None
    table: str | None = None
    optional: bool = False
    direct: bool = False

    def default(self, parameters: Parameters) -> Value:
        """What it is in the parameters of a preset that uses it."""
        explosion = parameters.explosion
        if self.table is not None:
            return getattr(parameters.table, self.table)
        if self.robot is not None:
            return getattr(parameters.playback.robot, self.robot)
        if self.explosion is not None and isinstance(explosion, PaperExplosionParameters):
            return getattr(explosion, self.explosion)
        assert self.playback is not None, f"{parameters.preset} does not use {self.name}"
        return getattr(parameters.playback, self.playback)


SETTINGS: Final = (
    Setting(
        name="radial_gain",
        label="Radial force gain λ",
        unit="dyn",
        source="published",
        meaning="λ in equation 1 of the paper. We take its d as the diameter of one module.",
        least=0.0,
        most=1e3,
        explosion="radial_gain",
    ),
    Setting(
        name="repulsion_gain",
        label="Repulsion force gain γ",
        unit="dyn·cm²",
        source="published",
        meaning="γ in equation 3 of the paper, for modules that are not linked.",
        least=0.0,
        most=1e3,
        explosion="repulsion_gain",
    ),
    Setting(
        name="threshold",
        label="Maximum squared error",
        unit="rad²",
        source="published",
        meaning="The motors go on to the next snapshot when every hinge's squared error is "
        "smaller.",
        least=1e-6,
        most=10.0,
        playback="threshold_rad2",
    ),
    Setting(
        name="damping",
        label="Damping",
        unit="of the speed per step",
        source="published",
        meaning="Fraction of its velocity that the chain loses in each step, also in playback.",
        least=0.0,
        most=0.9,
        explosion="damping",
        playback="damping",
        direct=True,
    ),
    Setting(
        name="friction",
        label="Friction",
        unit="",
        source="published",
        meaning="Coulomb friction between modules.",
        least=0.0,
        most=2.0,
        explosion="friction",
        playback="friction",
        direct=True,
    ),
    Setting(
        name="motor_max_force",
        label="Joint motor maximum force",
        unit="module mass · pitch²/s²",
        source="named",
        meaning="Maximum torque of a hinge's motor in playback; `none` means no limit.",
        least=1e-3,
        most=1e8,
        playback="torque_limit",
        optional=True,
        direct=True,
    ),
    Setting(
        name="step_s",
        label="Step size",
        unit="s",
        source="published",
        meaning="Time step of both simulations.",
        least=1e-4,
        most=0.02,
        explosion="step_s",
        playback="step_s",
        direct=True,
    ),
    Setting(
        name="pitch_cm",
        label="Module diameter",
        unit="cm",
        source="published",
        meaning="Length of a module for which the gains are given.",
        least=0.1,
        most=100.0,
        explosion="pitch_cm",
    ),
    Setting(
        name="density_kg_m3",
        label="Density",
        unit="kg/m³",
        source="published",
        meaning="Density of a module for which the gains are given.",
        least=1.0,
        most=1e5,
        explosion="density_kg_m3",
        direct=True,
    ),
    Setting(
        name="snapshot_interval",
        label="Snapshot interval",
        unit="steps",
        source="named",
        meaning="Number of explosion steps between two snapshots.",
        least=1,
        most=1000,
        whole=True,
        explosion="snapshot_interval",
    ),
    Setting(
        name="steps_per_snapshot",
        label="Steps for each snapshot",
        unit="steps",
        source="ours",
        meaning="Minimum number of motor steps for each snapshot. With 0, only the threshold "
        "decides, except for the first snapshot.",
        least=0,
        most=1000,
        whole=True,
        playback="least_steps",
    ),
    Setting(
        name="motor_gain",
        label="Servo gain",
        unit="1/s",
        source="named",
        meaning="Speed of a motor per radian of error.",
        least=0.01,
        most=100.0,
        playback="gain",
        direct=True,
    ),
    Setting(
        name="repulsion_cutoff",
        label="Repulsion cutoff",
        unit="pitches",
        source="named",
        meaning="Modules at a larger distance do not repel each other.",
        least=1.0,
        most=10.0,
        explosion="repulsion_cutoff",
    ),
    Setting(
        name="spring",
        label="Hinge spring",
        unit="g·cm²/s²",
        source="ours",
        meaning="Straightens the hinges. Under tension it is up to a hundred times stronger.",
        least=0.0,
        most=1e3,
        explosion="spring",
    ),
    Setting(
        name="stop_deg",
        label="Hinge stops",
        unit="°",
        source="ours",
        meaning="Largest angle of a hinge in the explosion, in both directions.",
        least=90.0,
        most=92.0,
        explosion="stop_deg",
    ),
)
ROBOT_SETTINGS: Final = (
    Setting(
        name="robots",
        label="Robots",
        unit="",
        source="ours",
        meaning="Number of simulated robots with model errors; 0 means one ideal robot.",
        least=0,
        most=20,
        whole=True,
        robot="runs",
    ),
    Setting(
        name="mass_error",
        label="Mass error",
        unit="of the mean",
        source="ours",
        meaning="Relative standard deviation of the modules' masses and inertias.",
        least=0.0,
        most=0.2,
        robot="mass_error",
    ),
    Setting(
        name="joint_friction",
        label="Joint friction",
        unit="of the plan's largest torque",
        source="ours",
        meaning="Mean dry friction of the joints; each joint has 0.5 to 1.5 times this value.",
        least=0.0,
        most=0.5,
        robot="friction",
    ),
    Setting(
        name="motor_limit",
        label="Motor torque limit",
        unit="of the plan's largest torque",
        source="ours",
        meaning="Maximum torque of a motor.",
        least=0.1,
        most=100.0,
        robot="torque_limit",
    ),
    Setting(
        name="servo_give",
        label="Servo yield",
        unit="rad",
        source="ours",
        meaning="Error of a hinge at rest whose motor is at its torque limit.",
        least=1e-4,
        most=0.5,
        robot="give_rad",
    ),
    Setting(
        name="encoder_step",
        label="Encoder step",
        unit="rad",
        source="ours",
        meaning="Smallest angle that an encoder can measure. Default: 18 bits per turn.",
        least=0.0,
        most=0.1,
        robot="encoder_rad",
    ),
    Setting(
        name="encoder_noise",
        label="Encoder noise",
        unit="rad",
        source="ours",
        meaning="Standard deviation of a measured angle.",
        least=0.0,
        most=0.01,
        robot="noise_rad",
    ),
    Setting(
        name="simulated_modules",
        label="Longest simulated chain",
        unit="modules",
        source="ours",
        meaning="Longer chains are played back by kinematics only.",
        least=2,
        most=20_000,
        whole=True,
        playback="dynamic_up_to",
    ),
)
TABLE_SETTINGS: Final = (
    Setting(
        name="table_torque",
        label="Largest torque on a table",
        unit="w·p",
        source="ours",
        meaning="Maximum static torque of a hinge, in w·p (module weight × pitch).",
        least=0.1,
        most=1000.0,
        table="most_torque",
    ),
    Setting(
        name="table_friction",
        label="Friction of the table",
        unit="",
        source="ours",
        meaning="Coefficient of friction μ between modules and table.",
        least=0.0,
        most=2.0,
        table="friction",
    ),
    Setting(
        name="table_base",
        label="Base",
        unit="",
        source="ours",
        meaning="`free`: the chain lies on the table and may drift. `clamped`: its first module is "
        "fixed to the table. With friction, this needs several times the torque.",
        words=get_args(Base),
        table="base",
    ),
)
"""What a fold on a table may ask."""
IDEAL: Final = "robots=0"
"""Settings of an ideal robot, whose encoders' steps are all that is off."""
_BY_NAME: Final = {
    setting.name: setting for setting in (*SETTINGS, *ROBOT_SETTINGS, *TABLE_SETTINGS)
}


def read_settings(text: str) -> dict[str, Value]:
    """The values of a text such as ``damping=0.05, radial_gain=0.2``.

    Raises:
        InputError: ``bad-settings``.
    """
    found: dict[str, Value] = {}
    if len(text) > LONGEST:
        raise _bad(f"got {len(text)} characters of settings, expected at most {LONGEST}.")
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = (word.strip() for word in part.partition("="))
        setting = _BY_NAME.get(name)
        if setting is None or not equals:
            raise _bad(
                f"got {part[:40]!r}, expected NAME=VALUE with one of: {', '.join(_BY_NAME)}."
            )
        if name in found:
            raise _bad(f"got {name} twice, expected only one value for it.")
        found[name] = _value(setting, value)
    return found


def settings_text(text: str, parameters: Parameters | None = None) -> str:
    """The same settings, written in the one way that is compared: sorted, without spaces.

    Args:
        text: As it was typed.
        parameters: Of the preset; settings that leave them as they are go.

    Raises:
        InputError: ``bad-settings``.
    """
    found = read_settings(text)
    if parameters is not None:
        found = {
            name: value
            for name, value in found.items()
            if with_settings(parameters, {name: value}) != parameters
        }
    return ",".join(f"{name}={value_text(found[name])}" for name in sorted(found))


def with_settings(parameters: Parameters, settings: Mapping[str, Value]) -> Parameters:
    """The parameters with other numbers.

    Raises:
        InputError: ``bad-settings`` for what the preset does not use.
    """
    explosion, playback, density = parameters.explosion, parameters.playback, None
    table = parameters.table
    for name, value in settings.items():
        setting = _BY_NAME[name]
        number = int(value) if setting.whole and value is not None else value
        used = False
        if setting.explosion is not None and isinstance(explosion, PaperExplosionParameters):
            explosion, used = replace(explosion, **{setting.explosion: number}), True
        if setting.playback is not None:
            playback, used = replace(playback, **{setting.playback: number}), True
        if setting.robot is not None and playback.controller == "robot":
            robot = replace(playback.robot, **{setting.robot: number})
            playback, used = replace(playback, robot=robot), True
        elif setting in SETTINGS and not isinstance(explosion, PaperExplosionParameters | None):
            used = False  # the published method's, which ours has nothing of
        if setting.table is not None and parameters.world == "table":
            table, used = replace(table, **{setting.table: value}), True
        if name == "density_kg_m3":
            density, used = value, explosion is None or used
        if not used or (explosion is None and not setting.direct):
            where = f"the preset {parameters.preset}, which does"
            if setting.table is not None:
                where = "a fold that floats, which does"
            raise _bad(f"got {name} for {where} not use it.")
    if not playback.robot.runs:
        playback = replace(playback, controller="computed-torque")
    turned = playback.gain * playback.step_s
    if playback.controller not in ("robot", "computed-torque") and turned > MOST_TURNED:
        raise _bad(
            f"got motor_gain · step_s = {turned:g}, expected at most {MOST_TURNED:g}: above it a "
            "motor turns past its target in each step."
        )
    return replace(
        parameters,
        explosion=explosion,
        playback=playback,
        table=table,
        density_kg_m3=parameters.density_kg_m3 if density is None else density,
    )


def value_text(value: Value) -> str:
    """A value as it is written in a text of settings."""
    if isinstance(value, str):
        return value
    return NO_LIMIT if value is None else f"{value:.12g}"


def _value(setting: Setting, text: str) -> Value:
    if setting.words:
        if text not in setting.words:
            raise _bad(
                f"got {setting.name} = {text[:20]!r}, expected {' or '.join(setting.words)}."
            )
        return text
    if setting.optional and text == NO_LIMIT:
        return None
    value = float(f"{float(text):.12g}") if NUMBER.fullmatch(text) else math.nan
    if not setting.least <= value <= setting.most or (setting.whole and value != int(value)):
        kind = "a whole number" if setting.whole else "a number"
        none = f", or {NO_LIMIT}" if setting.optional else ""
        raise _bad(
            f"got {setting.name} = {text[:20]!r}, expected {kind} from {setting.least:g} to "
            f"{setting.most:g}{none}."
        )
    return value


def _bad(detail: str) -> InputError:
    return InputError("bad-settings", detail)
