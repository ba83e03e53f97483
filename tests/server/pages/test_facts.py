"""Figures and texts of a fold's page."""

import dataclasses
import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from foldback.planner.motion.timeline import TimelineWriter
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
from foldback.server.context import Context
from foldback.server.pages.facts import fold_facts
from foldback.server.pages.fold import takes
from foldback.server.store.estimates import Estimates
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.folds import Store
from foldback.words import quantities
from foldback.words.fold import ShownFold
from foldback.words.properties import used_parameters
from foldback.words.quantities import length_m, number, parameters, quantity
from tests.case import case
from tests.planner.chains import chain_of
from tests.server.service_process import SNAKE, FinishedFold
from tests.web.conftest import unfolding


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


def failed_fold(directory: Path, frames: int, **values: Any) -> LocatedFold:
    """Return a failed fold with the given frames of explosion."""
    if frames:
        chain = chain_of(SNAKE)
        with TimelineWriter.create(directory / "timeline.zarr", chain) as writer:
            writer.append(unfolding(chain, frames))
    usual: dict[str, Any] = {"status": "failed", "stage": "certify", "preset": "default", "seed": 0}
    row = {"id": "f" * 20, "name": "Claw hammer", "modules": 16, **usual, **values}
    return LocatedFold(ShownFold(**row), directory)


def test_facts_are_read_without_the_whole_plan(finished: FinishedFold, tmp_path: Path) -> None:
    shutil.copyfile(finished.directory / "plan.npz", tmp_path / "plan.npz")
    (tmp_path / "plan.json").write_text("not for pages: its frames may take a hundred megabytes")
    summary = {"explosion": {"strategy": "simultaneous"}}
    facts = fold_facts(failed_fold(tmp_path, 0, status="verified", summary=summary))
    groups = {group["heading"]: group["rows"] for group in facts["properties"]}
    assert {"Python", "MuJoCo"} <= {row["label"] for row in groups["Versions"]}
    assert groups["Explosion parameters"]


def test_failed_fold_shows_its_frame_count(tmp_path: Path) -> None:
    assert fold_facts(failed_fold(tmp_path, 5))["frames"] == 5
    assert fold_facts(failed_fold(tmp_path / "nothing", 0))["frames"] == 0


def test_failed_fold_offers_another_try(tmp_path: Path) -> None:
    """tests/server/contract checks the offers of other folds."""
    again_command = fold_facts(failed_fold(tmp_path, 0, seed=2**32 - 1))["again"]
    assert again_command["text"] == "Try another random seed" and again_command["form"]["seed"] == 0
    again_command = fold_facts(failed_fold(tmp_path, 0, strategy="turns"))["again"]
    assert again_command["text"] == "Try an explosion" and "strategy" not in again_command["form"]
    plain = fold_facts(failed_fold(tmp_path, 0, status="verified", preset="paper"))["compare"]
    settable = {way["text"]: way["settable"] for way in plain if "settable" in way}
    assert settable == {"Published method, modified": "must"}


def test_fold_in_turns_may_be_compared_with_an_explosion(tmp_path: Path) -> None:
    def offered(summary: dict[str, Any]) -> list[Any]:
        offers = fold_facts(failed_fold(tmp_path, 0, status="verified", summary=summary))["compare"]
        return [offer["form"] for offer in offers if offer["text"] == "By an explosion"]

    assert not offered({"explosion": {"strategy": "simultaneous"}, "playback": {}})
    (form,) = offered({"explosion": {"strategy": "turns"}, "playback": {"rest_frames": [0, 5, 9]}})
    assert form["strategy"] == "simultaneous"


def test_long_chain_is_not_offered_a_table_first(finished: FinishedFold, tmp_path: Path) -> None:
    """A chain of more than 96 modules usually gets stuck on a table."""
    shutil.copyfile(finished.directory / "chain.json", tmp_path / "chain.json")

    def offered(modules: int) -> list[str]:
        facts = failed_fold(tmp_path, 0, status="verified", modules=modules)
        return [offer["text"] for offer in fold_facts(facts)["compare"]]

    assert offered(96)[0] == "On a table"
    long = offered(97)
    assert set(long) == set(offered(96)) and "On a table" in long[-3:-1]


def test_offered_folds_name_their_times(tmp_path: Path, store: Store) -> None:
    facts = failed_fold(tmp_path, 0, status="verified")
    context = cast(Context, SimpleNamespace(estimates=Estimates(store)))
    offers = fold_facts(facts, takes=takes(context))["compare"]
    assert "Takes less than a minute" in {offer.get("hint", "") for offer in offers}


def test_fold_has_no_verdict_while_its_files_are_written(tmp_path: Path) -> None:
    checked = {"verified": True, "reason": None, "simulated": True, "robots": []}
    (tmp_path / "certificate.json").write_text(json.dumps(checked))
    facts = {
        stage: fold_facts(failed_fold(tmp_path, 0, status="running", stage=stage))["verdict"]
        for stage in ("certify", "export")
    }
    assert facts["certify"] == {"tone": "busy", "text": "Computing · 16\N{NO-BREAK SPACE}modules"}
    text = "Writing the files … · 16\N{NO-BREAK SPACE}modules"
    assert facts["export"] == {"tone": "busy", "text": text}
