"""Settings in words, as pages and the command line show them.

Their labels, units and help texts stand with their fields, in ``planner.parameters``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foldback.planner.errors import InputError
from foldback.planner.parameters.parameters import Parameters, preset
from foldback.planner.parameters.setting import Setting, Source, Value
from foldback.planner.parameters.settings_text import (
    ALL_SETTINGS,
    ROBOT_SETTINGS,
    SETTINGS,
    TABLE_SETTINGS,
    read_settings,
    value_of,
    value_text,
)
from foldback.words.quantities import quantity

PAPER_PRESET: Final = preset("paper")
SOURCE_LABELS: Final[dict[Source, str]] = {
    "published": "The paper gives this value.",
    "named": "The paper names this setting, but gives no value.",
    "ours": "The paper does not name this setting.",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingRow:
    """One setting, for a form or a table; ``default`` is written as in a text of settings."""

    name: str
    label: str
    unit: str
    default: str
    source: Source
    meaning: str
    words: tuple[str, ...]


def _rows(settings: tuple[Setting, ...], parameters: Parameters) -> tuple[SettingRow, ...]:
    return tuple(
        SettingRow(
            name=setting.name,
            label=setting.label,
            unit=setting.unit,
            default=value_text(value_of(setting, parameters)),
            source=setting.source,
            meaning=setting.help,
            words=setting.words,
        )
        for setting in settings
    )


PAPER_ROWS: Final = _rows(SETTINGS, PAPER_PRESET)
"""Rows of the form for the planner settings of the preset ``paper`` (the published method), with
their defaults."""
ROBOT_ROWS: Final = _rows(ROBOT_SETTINGS, preset("default"))
"""Rows of the form for the settings of the simulated robots with errors that a plan is tested on,
with their defaults."""
TABLE_ROWS: Final = _rows(TABLE_SETTINGS, preset("default"))
"""Rows of the form for the planner settings of a fold on a table under gravity, with their
defaults."""


def changed(preset_name: str, settings: str) -> list[tuple[str, str]]:
    """Return changed settings of a fold as labels and values: ``0.05, instead of 0.1``."""
    if not settings:
        return []
    try:
        changed_settings, usual = read_settings(settings), preset(preset_name)
    except InputError:  # settings that only an earlier version accepted
        return [("Settings", settings)]
    return [
        (
            setting.label,
            f"{_told(changed_settings[setting.name], setting.unit)}, instead of {default}",
        )
        for setting in ALL_SETTINGS
        if setting.name in changed_settings and (default := _told(value_of(setting, usual)))
    ]


def in_a_line(settings: str) -> str:
    """Return the changed settings for a heading: ``, Damping 0.05``."""
    try:
        changed_settings = read_settings(settings)
    except InputError:
        return f", {settings}"
    return "".join(
        f", {s.label} {_told(changed_settings[s.name])}"
        for s in ALL_SETTINGS
        if s.name in changed_settings
    )


def _told(value: Value, unit: str = "") -> str:
    if isinstance(value, str):
        return value
    return "no limit" if value is None else str(quantity(value, unit, 6))
