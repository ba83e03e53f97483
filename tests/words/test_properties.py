"""Properties of a fold in words: numbers with units, and the parameters that were used."""

import dataclasses

from foldback.planner.parameters.explosion import (
    ExplosionParameters,
    PeelingParameters,
    TableParameters,
)
from foldback.planner.parameters.parameters import PRESETS, preset
from foldback.planner.parameters.playback import PlaybackParameters, RobotParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.parameters.setting import Setting, descriptions
from foldback.planner.parameters.settings_text import ALL_SETTINGS, read_settings, with_settings
from foldback.words import quantities
from foldback.words.properties import used_parameters
from foldback.words.quantities import length_m, number, parameters, quantity
from tests.case import case


def test_numbers_have_significant_digits_and_units() -> None:
    texts = {0.0038234123412: "0.00382", 0.95: "0.95", 1.0: "1", 18.53: "18.5", 0.0: "0"}
    texts |= {1234.5678: "1235", 30000: "30000", 1e7: "1×10⁷", 1.2804e-12: "1.28×10⁻¹²"}
    for value, text in (texts | {-0.02: "−0.02"}).items():
        assert number(value) == text
    assert quantity((0.004, 0.1), "s") == "0.004 to 0.1 s"
    assert (quantity(None, "s"), quantity("servo"), quantity(True)) == (None, "servo", "yes")
    assert (length_m(0.01), length_m(2.5), length_m(None)) == ("10 mm", "2.5 m", None)
    assert parameters({"servo_give": 0.25}, RobotParameters) == [("Servo yield", "250 mrad")]
    assert parameters({"other_cap": 2}, RobotParameters) == [("Other cap", "2")]


def test_every_parameter_has_a_label_of_its_own() -> None:
    kinds = (ExplosionParameters, PaperExplosionParameters, PeelingParameters, TableParameters)
    settings: dict[str, Setting] = {}
    for kind in (*kinds, PlaybackParameters, RobotParameters):
        names = [field.name for field in dataclasses.fields(kind) if field.name != "robot"]
        described = descriptions(kind)
        assert names == list(described), "describe the field by `described` or `setting`"
        settings |= {n: setting for n, setting in described.items() if isinstance(setting, Setting)}
        labels = [label for label, _ in parameters(dict.fromkeys(names, 1.5), kind)]
        assert len(set(labels)) == len(labels)
        assert not [label for label in labels if "_" in label]
    assert settings == {all_setting.name: all_setting for all_setting in ALL_SETTINGS}, (
        "add the class to PARTS of planner/parameters/settings_text.py"
    )
    controllers = {preset(name).playback.controller for name in PRESETS}
    assert controllers <= set(quantities.CONTROLLER_LABELS)
    assert set(quantities.PRESET_LABELS) == set(PRESETS)


def test_unused_parameters_are_left_out() -> None:
    for changes, strategy, simulated, headings, row, absent in (
        (
            {},
            "simultaneous",
            True,
            ["Explosion", "Playback", "Simulated"],
            "paced_by",
            "motor_gain",
        ),
        ({}, "peel", False, ["Peeling", "Playback"], "steps_per_rad", "controller"),
        ({}, "smoothed", True, ["Playback", "Simulated"], "step_s", "bandwidth"),
        ({"world": "table"}, "peel", True, ["Table"], "refusals", "motor_gain"),
        ({"preset": "direct"}, "direct", True, ["Playback"], "direct_steps", "threshold"),
    ):
        with case(strategy):
            values = preset(changes.get("preset", "default")).as_dict() | changes
            groups = used_parameters(values, strategy=strategy, simulated=simulated)
            assert [heading.partition(" ")[0].rstrip(",") for heading, *_ in groups] == headings
            shown_fact = groups[-1 if strategy == "peel" else headings.index("Playback")][-1]
            assert row in shown_fact and absent not in shown_fact


def test_ideal_robot_is_described_by_its_encoders_alone() -> None:
    ideal = with_settings(preset("default"), read_settings("robots=0,encoder_step=0.01"))
    groups = used_parameters(ideal.as_dict(), strategy="smoothed", simulated=True)
    assert groups[-1] == ("Simulated robot", RobotParameters, {"encoder_step": 0.01})


def test_heading_says_who_simulates_the_robots() -> None:
    by_mujoco = with_settings(preset("default"), read_settings("engine=mujoco"))
    groups = used_parameters(by_mujoco.as_dict(), strategy="simultaneous", simulated=True)
    assert groups[-1][:2] == ("Robots simulated by MuJoCo", RobotParameters)
