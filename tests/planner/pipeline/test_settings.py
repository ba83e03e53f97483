import re
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import pytest

from foldback.planner.chain.module import DEFAULT_DENSITY_KG_M3, DEFAULT_MODULE_SIZE
from foldback.planner.errors import InputError
from foldback.planner.parameters.option import options_of
from foldback.planner.parameters.parameters import preset
from foldback.planner.parameters.setting import Description, Setting, descriptions
from foldback.planner.parameters.settings_text import (
    ALL_SETTINGS,
    MAX_TEXT_CHARS,
    PARTS,
    ROBOT_SETTINGS,
    SETTINGS,
    TABLE_SETTINGS,
    read_settings,
    settings_text,
    value_of,
    with_settings,
)
from foldback.planner.pipeline.request import FoldRequest
from tests.case import case
from tests.refusal import refused

ROOT: Final = FilePath(__file__).parents[3]
PAPER = preset("paper")


def flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested values by their paths."""
    by_path: dict[str, Any] = {}
    for name, value in values.items():
        by_path |= (
            flat(value, f"{prefix}{name}.")
            if isinstance(value, dict)
            else {f"{prefix}{name}": value}
        )
    return by_path


def test_each_setting_changes_its_parameter_alone() -> None:
    table = replace(preset("default"), world="table")
    for settings, parameters in (
        (SETTINGS, PAPER),
        (ROBOT_SETTINGS, preset("default")),
        (TABLE_SETTINGS, table),
    ):
        for setting in settings:
            with case(setting.name):
                usual = value_of(setting, parameters)
                value = next(v for v in setting.words or setting.range if v != usual)
                values = read_settings(f"{setting.name}={value}")
                changed = with_settings(parameters, values)
                assert value_of(setting, changed) == value != usual
                if setting.name == "robots":  # none of them: the controller of an ideal robot
                    continue
                before, after = (flat(values.as_dict()) for values in (parameters, changed))
                differing = {name for name, value in after.items() if before[name] != value}
                assert {name.rpartition(".")[2] for name in differing} == {setting.name}


def test_each_setting_has_a_name_of_its_own_and_a_range_or_words() -> None:
    of_name: dict[str, Description] = {}
    for kind in PARTS.values():
        for name, described in descriptions(kind).items():
            if isinstance(described, Setting):
                assert of_name.setdefault(name, described) == described, name
    for setting in ALL_SETTINGS:
        with case(setting.name):
            minimum, maximum = setting.range
            assert setting.label and setting.help
            assert bool(setting.words) != (minimum < maximum)


def test_all_settings_of_a_method_fit_into_a_text() -> None:
    for settings in (SETTINGS, ROBOT_SETTINGS, TABLE_SETTINGS):
        values = (setting.words[0] if setting.words else "0.123456789012" for setting in settings)
        text = ",".join(f"{s.name}={value}" for s, value in zip(settings, values, strict=True))
        assert len(text) <= MAX_TEXT_CHARS


def test_default_module_size_and_density_stand_once() -> None:
    """Searches code and texts of options for the numbers, next to a name of their quantity."""
    written = re.compile(
        rf"size\w*(: \w+)? ?= ?{DEFAULT_MODULE_SIZE}\b|Default: {DEFAULT_MODULE_SIZE}\b"
        rf"|(density|kg_m3)\w*(: \w+)? ?= ?{DEFAULT_DENSITY_KG_M3}\b",
        re.IGNORECASE,
    )
    names = [
        path.name
        for folder in ("planner", "server", "web", "words", "cli", "client", "foldback")
        for path in (ROOT / folder).rglob("*.py")
        for _ in written.finditer(path.read_text(encoding="utf-8"))
    ]
    assert names == ["module.py", "module.py"]
    assert FoldRequest().parameters().module_size == DEFAULT_MODULE_SIZE
    assert f"Default: {DEFAULT_MODULE_SIZE};" in options_of(FoldRequest)["module_size"].meaning


def test_settings_text_is_canonical() -> None:
    text = " step_s = 0.0050, motor_max_force=none,damping=.05 , "
    assert settings_text(text) == "damping=0.05,motor_max_force=none,step_s=0.005"
    assert settings_text("") == ""
    text = settings_text("damping=0.1000000000000004", PAPER)
    assert text == settings_text(text, PAPER) == ""


def test_settings_reach_their_parameters_of_each_preset() -> None:
    assert with_settings(preset("direct"), {"friction": 0.3}).playback.friction == 0.3
    for name in ("default", "paper"):
        changed = with_settings(preset(name), read_settings("simulated_modules=5000"))
        assert changed.playback.simulated_modules == 5000
    (step,) = (s for s in SETTINGS if s.name == "step_s")
    assert value_of(step, PAPER) == 0.01
    direct = replace(preset("direct").playback, step_s=0.005)
    assert value_of(step, replace(preset("direct"), playback=direct)) == 0.005


def test_read_settings_refuses_other_names_and_values() -> None:
    for text, words in (
        ("speed=1", "got 'speed=1', expected NAME=VALUE with one of these names: radial_gain"),
        ("damping", "got 'damping', expected NAME=VALUE"),
        ("damping=", "got Damping (damping) = '', expected a number from 0 to 0.9"),
        ("damping=nan", "expected a number from 0 to 0.9"),
        ("damping=1", "expected a number from 0 to 0.9"),
        ("damping=1_0e-2", "expected a number from 0 to 0.9"),
        ("damping=none", "expected a number from 0 to 0.9"),
        ("motor_max_force=0", "expected a number from 0.001 to 1e+08, or none"),
        ("steps_per_snapshot=1.5", "expected a whole number from 0 to 1000"),
        ("snapshot_interval=1e999", "expected a whole number from 1 to 1000"),
        ("simulated_modules=1e9", "expected a whole number from 2 to 20000"),
        ("table_base=held", "got Base (table_base) = 'held', expected clamped or free"),
        ("table_base=1", "got Base (table_base) = '1', expected clamped or free"),
        ("table_base=", "got Base (table_base) = '', expected clamped or free"),
        ("damping=0.1,damping=0.2", "got two values for damping, expected one"),
        ("a" * 501, "got 501 characters of settings, expected at most 500"),
    ):
        with case((text, words)):
            with pytest.raises(InputError) as refused:
                read_settings(text)
            assert refused.value.code == "bad-settings"
            assert words in refused.value.detail


def test_preset_refuses_settings_that_it_does_not_use_or_that_do_not_fit() -> None:
    for text in ("radial_gain=0.2", "threshold=0.1", "steps_per_snapshot=7", "spring=2"):
        words = f"{text.partition('=')[0]} for the preset direct, which does not use"
        with pytest.raises(InputError, match=words):
            with_settings(preset("direct"), read_settings(text))
    # Servos may not move past their target.
    with pytest.raises(InputError, match="motor_gain · step_s = 2, expected at most 1"):
        with_settings(PAPER, read_settings("motor_gain=100,step_s=0.02"))


def test_settings_equal_to_the_preset_do_not_change_the_request() -> None:
    for name, arguments, stored_options in (
        ("paper", "damping=.10, step_s=0.005, radial_gain=0.1", "step_s=0.005"),
        ("paper", "motor_max_force=none", ""),
        ("direct", "step_s=0.005,damping=0.1", "step_s=0.005"),
    ):
        request = FoldRequest(preset=name, settings=arguments)
        assert request.canonical() == FoldRequest(preset=name, settings=stored_options)


def test_request_out_of_range_is_refused() -> None:
    for values, code in (
        ({"preset": "ours"}, "unknown-preset"),
        ({"strategy": "fastest"}, "unknown-strategy"),
        ({"seed": -1}, "bad-seed"),
        ({"seed": 2**63}, "bad-seed"),
        ({"module_size": 0.01}, "bad-module-size"),
        ({"module_size": 1.01}, "bad-module-size"),
        ({"module_size": float("nan")}, "bad-module-size"),
        ({"world": "moon"}, "unknown-world"),
        ({"world": "table", "preset": "paper"}, "unsuited-world"),
        ({"world": "table", "module": "tetrahedron"}, "unsuited-world"),
        ({"world": "table", "strategy": "blocks"}, "unsuited-world"),
        ({"world": "table", "refold": True}, "unsuited-world"),
        ({"world": "table", "prefer": "time"}, "unsuited-world"),
        ({"world": "table", "method": "exact"}, "unsuited-world"),
        ({"world": "table", "ends": "surface"}, "unsuited-world"),
        ({"world": "table", "start": (0, 0, 0)}, "unsuited-world"),
        ({"settings": "table_torque=4"}, "bad-settings"),
        ({"settings": "table_base=free"}, "bad-settings"),
    ):
        with case((values, code)), refused(code):
            FoldRequest(**values).check()
