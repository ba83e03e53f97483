"""Settings of the published method: how they are listed, entered and described."""

from foldback.planner.parameters.settings_text import SETTINGS
from foldback.words.settings import PAPER_ROWS, SOURCE_LABELS, changed, in_a_line
from tests.server.cli.test_command_line import foldback, foldback_json


def test_changed_settings_are_listed_with_their_defaults() -> None:
    settings = "damping=0.05,motor_max_force=12.5,radial_gain=0.2"
    assert changed("paper", settings) == [
        ("Radial force gain λ", "0.2 dyn, instead of 0.1"),
        ("Damping", "0.05 of the speed per step, instead of 0.1"),
        ("Joint motor maximum force", "12.5 module mass · pitch²/s², instead of no limit"),
    ]
    assert changed("direct", "step_s=0.02") == [("Step size", "0.02 s, instead of 0.01")]
    assert in_a_line("damping=0.05,radial_gain=0.2") == ", Radial force gain λ 0.2, Damping 0.05"
    assert (changed("default", ""), in_a_line("")) == ([], "")


def test_command_line_lists_the_settings() -> None:
    text = foldback("settings").stdout
    for setting in SETTINGS:
        assert f"{setting.name} " in text
    assert set(SOURCE_LABELS) == {row.source for row in PAPER_ROWS}
    assert all(f"{source}: {meaning}" in text for source, meaning in SOURCE_LABELS.items())
    rows = {row["name"]: row for row in foldback_json("settings")}
    assert rows["damping"]["default"] == "0.1"
    assert rows["motor_max_force"]["default"] == "none"
    assert rows["threshold"]["unit"] == "rad²"
