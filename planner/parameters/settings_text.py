"""Settings: parameters of the published method, of robots and of tables, as one text.

``damping=0.05, radial_gain=0.2`` is how people write them on the command line, in the API and on
the page. Each setting is described where its field is defined: ``planner.parameters.setting``.
Decision 0002 says what the paper gives and what is read into it, decision 0001 where the values of
robots come from, decision 0026 those of tables.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, get_args

from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import ExplosionParameters, TableParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.parameters.setting import Setting, Source, Value, descriptions

MAX_TEXT_CHARS: Final = 500
"""Maximum length, in characters, of a request's text of settings (``name=value`` pairs); a longer
one is refused. All settings of a method fit, with twelve digits each."""
NO_LIMIT: Final = "none"
NUMBER: Final = re.compile(
    r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?|[+-]?\.[0-9]+([eE][+-]?[0-9]+)?"
)
MAX_TURN_PER_STEP: Final = 1.0
"""Maximum fraction of its remaining error by which a servo of the published method may turn in one
simulation step (gain × time step); settings with more are refused. Above 1 a servo overshoots its
target."""
PARTS: Final = {
    "explosion": PaperExplosionParameters,
    "playback": PlaybackParameters,
    "robot": RobotParameters,
    "table": TableParameters,
}
"""Classes of parameters that settings can change, by the part of ``Parameters`` that each
describes."""
IDEAL: Final = "robots=0"
"""Text of settings that simulates one ideal robot instead of several with random errors; only the
resolution of its encoders remains as an error."""


_OF_PARTS: Final = {
    part: {
        name: described
        for name, described in descriptions(kind).items()
        if isinstance(described, Setting)
    }
    for part, kind in PARTS.items()
}


def _settings(*parts: str) -> tuple[Setting, ...]:
    """Return the settings of parts, each once, in the order of their fields."""
    return tuple(
        {name: setting for part in parts for name, setting in _OF_PARTS[part].items()}.values()
    )


SETTINGS: Final = tuple(
    sorted(
        (setting for setting in _settings("explosion", "playback") if not setting.is_own),
        key=lambda setting: get_args(Source).index(setting.source),
    )
)
"""Settings of the published method, in the order in which pages and lists show them: first those of
which the paper gives the value."""
ROBOT_SETTINGS: Final = (
    *_settings("robot"),
    *(setting for setting in _settings("playback") if setting.is_own),
)
"""Settings of simulated robots, in the same order."""
TABLE_SETTINGS: Final = _settings("table")
"""Settings of tables, in the same order."""
ALL_SETTINGS: Final = (*SETTINGS, *ROBOT_SETTINGS, *TABLE_SETTINGS)
_BY_NAME: Final = {setting.name: setting for setting in ALL_SETTINGS}


def names_with_units(settings: tuple[Setting, ...]) -> str:
    """Return names of settings with their units or words, for descriptions of options."""
    about = {setting.name: setting.unit or " or ".join(setting.words) for setting in settings}
    about = {n: f"fraction {unit}" if unit.startswith("of ") else unit for n, unit in about.items()}
    return ", ".join(f"`{name}`{f' ({unit})' if unit else ''}" for name, unit in about.items())


def value_of(setting: Setting, parameters: Parameters) -> Value:
    """Return the value of a setting in the parameters of a preset that uses it."""
    parts = {
        "explosion": parameters.explosion,
        "playback": parameters.playback,
        "robot": parameters.playback.robot,
        "table": parameters.table,
    }
    for part, kind in PARTS.items():
        if setting.name in _OF_PARTS[part] and isinstance(parts[part], kind):
            return getattr(parts[part], setting.name)
    raise AssertionError(f"{parameters.preset} does not use {setting.name}")


def read_settings(text: str) -> dict[str, Value]:
    """Return the values of a text such as ``damping=0.05, radial_gain=0.2``.

    Raises:
        InputError: ``bad-settings``.
    """
    values: dict[str, Value] = {}
    if len(text) > MAX_TEXT_CHARS:
        raise _bad(
            "got {chars} characters of settings, expected at most {limit}.",
            chars=len(text),
            limit=MAX_TEXT_CHARS,
        )
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = (word.strip() for word in part.partition("="))
        setting = _BY_NAME.get(name)
        if setting is None or not equals:
            names = ", ".join(setting.name for setting in ALL_SETTINGS)
            expected = f"expected NAME=VALUE with one of these names: {names}."
            raise _bad(f"got {{part!r}}, {expected}", part=part[:40])
        if name in values:
            raise _bad("got two values for {setting}, expected one.", setting=name)
        values[name] = _value(setting, value)
    return values


def settings_text(text: str, parameters: Parameters | None = None) -> str:
    """Return the canonical form of a text of settings: sorted, without spaces.

    Args:
        text: Settings as they were typed.
        parameters: Parameters of the preset; settings that do not change them are left out.

    Raises:
        InputError: ``bad-settings``.
    """
    values = read_settings(text)
    if parameters is not None:
        values = {
            name: value
            for name, value in values.items()
            if with_settings(parameters, {name: value}) != parameters
        }
    return ",".join(f"{name}={value_text(values[name])}" for name in sorted(values))


def with_settings(parameters: Parameters, settings: Mapping[str, Value]) -> Parameters:
    """Return the parameters with other values.

    Raises:
        InputError: ``bad-settings`` for a setting that the preset does not use.
    """
    parts, density = _parts(parameters), parameters.density_kg_m3
    for name, value in settings.items():
        setting = _BY_NAME[name]
        used = [part for part in parts if name in _OF_PARTS[part]]
        if name == "density_kg_m3" and parameters.explosion is None:
            used.append("density")
        if not used or not _is_used(setting, parameters):
            user = f"the preset {parameters.preset}, which does"
            if setting in TABLE_SETTINGS:
                user = "a fold in the 'floating' world, which does"
            raise _bad(f"got {{setting}} for {user} not use it.", setting=name)
        number = int(value) if setting.is_whole and isinstance(value, float) else value
        for part in set(used) & set(parts):
            parts[part] = replace(parts[part], **{name: number})
        if name == "density_kg_m3" and isinstance(value, float):
            density = value
    playback: PlaybackParameters = parts["playback"]
    if "robot" in parts:
        playback = replace(playback, robot=parts["robot"])
    if not playback.robot.robots:
        playback = replace(playback, controller="computed-torque")
    turned = playback.motor_gain * playback.step_s
    if playback.controller not in ("robot", "computed-torque") and turned > MAX_TURN_PER_STEP:
        raise _bad(
            "got motor_gain · step_s = {turn:g}, expected at most {limit:g}; use a smaller "
            "motor_gain or step_s, because above this limit a motor turns past its target in each "
            "step.",
            turn=turned,
            limit=MAX_TURN_PER_STEP,
        )
    explosion = parts.get("explosion", parameters.explosion)
    if isinstance(explosion, ExplosionParameters):
        explosion = replace(explosion, engine=playback.robot.engine)
    return replace(
        parameters,
        explosion=explosion,
        playback=playback,
        table=parts.get("table", parameters.table),
        density_kg_m3=density,
    )


def value_text(value: Value) -> str:
    """Return a value as it is written in a text of settings."""
    if isinstance(value, str):
        return value
    return NO_LIMIT if value is None else f"{value:.12g}"


def _parts(parameters: Parameters) -> dict[str, Any]:
    """Return the parts of parameters that the preset and the world use."""
    parts: dict[str, Any] = {"playback": parameters.playback}
    if isinstance(parameters.explosion, PaperExplosionParameters):
        parts["explosion"] = parameters.explosion
    if parameters.playback.controller == "robot":
        parts["robot"] = parameters.playback.robot
    if parameters.world == "table":
        parts["table"] = parameters.table
    return parts


def _is_used(setting: Setting, parameters: Parameters) -> bool:
    """Return True if a preset uses a setting of which it has the field."""
    if parameters.explosion is None:
        return setting.direct
    return setting not in SETTINGS or isinstance(parameters.explosion, PaperExplosionParameters)


def _value(setting: Setting, text: str) -> Value:
    stated = {"setting": setting.name, "label": setting.label, "value": text[:20]}
    template = "got {label} ({setting}) = {value!r}, expected"
    if setting.words:
        if text not in setting.words:
            raise _bad(f"{template} {' or '.join(setting.words)}.", **stated)
        return text
    if setting.optional and text == NO_LIMIT:
        return None
    value = float(f"{float(text):.12g}") if NUMBER.fullmatch(text) else math.nan
    low, high = setting.range
    if not low <= value <= high or (setting.is_whole and value != int(value)):
        kind = "a whole number" if setting.is_whole else "a number"
        none = f", or {NO_LIMIT}" if setting.optional else ""
        expected = f"{kind} from {{low:g}} to {{high:g}}{none}."
        raise _bad(f"{template} {expected}", **stated, low=low, high=high)
    return value


def _bad(template: str, **values: Any) -> InputError:
    return InputError("bad-settings", template, **values)
