"""Figures and texts of a fold's page."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path as CellPath
from planner.motion.timeline import TimelineWriter
from planner.parameters.explosion import ExplosionParameters
from planner.parameters.parameters import PRESETS, preset
from planner.parameters.playback import PlaybackParameters, RobotParameters
from planner.parameters.published import PaperExplosionParameters
from server.api.schemas import Fold
from server.jobs.remaining import EtaEstimator
from server.pages.facts import fold_facts
from server.settings import Settings
from server.store.folds import Store
from server.store.leases import Leases
from server.store.shown import Found
from server.store.worker_identity import WorkerIdentities
from tests.server.rows import SOMEBODY, a_fold
from tests.server.service import SNAKE, Service
from tests.web.conftest import unfolding
from words import quantities
from words.fold import ShownFold
from words.properties import used_parameters
from words.quantities import length_m, number, parameters, quantity


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0038234123412, "0.00382"),
        (0.95, "0.95"),
        (1.0, "1"),
        (18.53, "18.5"),
        (1234.5678, "1235"),
        (30000, "30000"),
        (1e7, "1×10⁷"),
        (1.2804542754824243e-12, "1.28×10⁻¹²"),
        (-0.02, "−0.02"),
        (0.0, "0"),
    ],
)
def test_numbers_have_the_digits_that_matter(value: float, text: str) -> None:
    assert number(value) == text


def test_quantities_have_units() -> None:
    assert quantity((0.004, 0.1), "s") == "0.004 to 0.1 s"
    assert quantity(None, "s") is None
    assert quantity("servo") == "servo"
    assert quantity(True) == "yes"
    assert (length_m(0.01), length_m(2.5), length_m(None)) == ("10 mm", "2.5 m", None)


def test_every_parameter_has_words_of_its_own() -> None:
    kinds = (ExplosionParameters, PaperExplosionParameters, PlaybackParameters, RobotParameters)
    for kind in kinds:
        names = [field.name for field in dataclasses.fields(kind) if field.name != "robot"]
        assert set(names) <= set(quantities.PARAMETER_WORDS)
        labels = [label for label, _ in parameters(dict.fromkeys(names, 1.5))]
        assert len(set(labels)) == len(labels)
        assert not [label for label in labels if "_" in label]
    controllers = {preset(name).playback.controller for name in PRESETS}
    assert controllers <= set(quantities.CONTROLLER_LABELS)
    assert set(quantities.PRESET_LABELS) == set(PRESETS)


def test_a_parameter_without_words_shows_its_unit() -> None:
    assert parameters({"new_cap_rad": 0.25}) == [("New cap", "250 mrad")]
    assert parameters({"other_speed_rad_s": 2}) == [("Other speed", "2 rad/s")]


@pytest.mark.parametrize(
    ("changes", "strategy", "simulated", "headings", "row", "absent"),
    [
        ({}, "simultaneous", True, ["Explosion", "Playback", "Simulated"], "paced_by", "gain"),
        ({}, "peel", False, ["Peeling", "Playback"], "steps_per_rad", "controller"),
        ({}, "smoothed", True, ["Playback", "Simulated"], "step_s", "bandwidth"),
        ({"world": "table"}, "peel", True, ["Table"], "refusals", "gain"),
        ({"preset": "direct"}, "direct", True, ["Playback"], "direct_steps", "threshold_rad2"),
    ],
)
def test_parameters_that_a_fold_has_not_used_are_left_out(
    changes: dict[str, str],
    strategy: str,
    simulated: bool,
    headings: list[str],
    row: str,
    absent: str,
) -> None:
    values = preset(changes.get("preset", "default")).as_dict() | changes
    groups = used_parameters(values, strategy=strategy, simulated=simulated)
    assert [heading.partition(" ")[0].rstrip(",") for heading, _ in groups] == headings
    shown = groups[-1 if strategy == "peel" else headings.index("Playback")][1]
    assert row in shown
    assert absent not in shown


def found(directory: Path, frames: int, **values: Any) -> Found:
    """A fold that failed with these frames of explosion."""
    if frames:
        chain = Chain.from_path(CellPath.from_cells(SNAKE))
        with TimelineWriter.create(directory / "timeline.zarr", chain) as writer:
            writer.append(unfolding(chain, frames))
    row = {
        "id": "f" * 20,
        "name": "Claw hammer",
        "status": "failed",
        "modules": 16,
        "preset": "default",
        "settings": "",
        "seed": 0,
        "module_size": None,
        "strategy": "auto",
        "stage": "certify",
        "summary": {},
        "error": None,
        **values,
    }
    return Found(ShownFold(**row), directory)


def test_what_a_page_says_is_read_from_something_small(
    service: Service, finished: dict[str, Any], tmp_path: Path
) -> None:
    shutil.copyfile(service.directory(finished["id"]) / "plan.npz", tmp_path / "plan.npz")
    (tmp_path / "plan.json").write_text("not for pages: its frames may take a hundred megabytes")
    summary = {"explosion": {"strategy": "simultaneous"}}
    facts = fold_facts(found(tmp_path, 0, status="verified", summary=summary))
    groups = {group["heading"]: group["rows"] for group in facts["properties"]}
    assert {"Python", "MuJoCo"} <= {row["label"] for row in groups["Versions"]}
    assert groups["Explosion parameters"]


REASON = (
    "in the plan, modules 3 and 7 overlap by 0.02 pitch at module size 0.95, 40 % into the fold "
    "(frame 12.5 of the plan)"
)


def test_a_reason_counts_frames_as_the_page_does(tmp_path: Path) -> None:
    verdict = {"verdict": f"failed: {REASON}"}
    summary = {"reason": REASON, "certificate": verdict, "explosion": {"frames": 211}}
    error = {"code": "not-verified", "detail": REASON, "where": None}
    facts = fold_facts(found(tmp_path, 5, summary=summary, error=error))
    said = facts["problem"]["text"]
    assert said.startswith("In the plan, modules 4 and 8 overlap")
    assert "40 % into the fold (frame 225)" in said  # 211 + 12.5 rounds up, and 1 is the first
    for text in (said, facts["verdict"]["text"], json.dumps(facts["properties"])):
        assert "of the plan" not in text
        assert "(frame 225)" in text


def test_a_reason_says_percent_alone_where_the_frame_is_not_known(tmp_path: Path) -> None:
    error = {"code": "not-verified", "detail": REASON, "where": None}
    facts = fold_facts(found(tmp_path, 5, summary={"reason": REASON}, error=error))
    assert facts["problem"]["text"].endswith("40 % into the fold")


def test_a_failed_fold_tells_whether_there_is_something_to_see(tmp_path: Path) -> None:
    assert fold_facts(found(tmp_path, 5))["frames"] == 5
    assert fold_facts(found(tmp_path / "nothing", 0))["frames"] == 0


def test_a_fold_of_an_earlier_version_is_told_by_what_it_bears_out(tmp_path: Path) -> None:
    certificate = {
        "verdict": "verified",
        "min_clearance": 0.041,
        "min_clearance_playback": 0.041,
        "clearance_bound": 0.0017,
        "rms_position_error": 0.0,
        "max_angle_error_rad": 0.0,
        "peak_torque_nm": 0.009,
    }
    summary = {
        "certificate": certificate,
        "playback": {"kind": "kinematic", "rms_position_error": 0.0, "max_angle_error_rad": 0.0},
        "explosion": {"strategy": "one-by-one"},
    }
    settings = Settings(data_dir=tmp_path)
    with closing(Store(settings)) as store:
        store.add(a_fold("earlier", summary=summary), SOMEBODY)
        leases = Leases(store, WorkerIdentities(settings), 1.0)
        state = Fold.of(store.fold("earlier"), store, EtaEstimator(store, leases)).summary
    assert state["certificate"]["verdict"] == "verified (kinematics only)"
    assert state["certificate"]["rms_position_error"] is None
    assert state["playback"] == {
        "kind": "kinematic",
        "rms_position_error": None,
        "max_angle_error_rad": None,
    }
    facts = fold_facts(found(tmp_path, 0, status="verified", summary=summary))
    assert facts["verdict"]["text"] == (
        "Verified (kinematics only): modules stay at least 0.1 % of a module width apart · one "
        "joint at a time (a baseline) · 16 modules"
    )
    values = {row["label"]: row["value"] for group in facts["properties"] for row in group["rows"]}
    assert values["Verdict"] == "Verified (kinematics only)"
    for label in (
        "Least clearance, simulated robots",
        "Final position error (RMS)",
        "Largest joint error",
    ):
        assert values[label] == "not simulated"
    assert values["Largest torque seen"] == "9 mN·m, number of frames checked is unknown"
    assert "Peak torque" not in values


def test_what_may_be_tried_again_is_offered(tmp_path: Path) -> None:
    cases = (
        ({"status": "cancelled", "preset": "paper", "seed": 3}, "Fold again", "paper", 3),
        ({"preset": "direct"}, "Try with the default preset", "default", 0),
        ({"seed": 2**32 - 1}, "Try another seed", "default", 0),
    )
    for values, text, name, seed in cases:
        again = fold_facts(found(tmp_path, 0, **values))["again"]
        assert again["text"] == text
        assert again["form"] == {"fold": "f" * 20, "preset": name, "seed": seed}
    for values in ({"status": "verified"}, {"status": "running"}, {"stage": "read"}):
        assert fold_facts(found(tmp_path, 0, **values))["again"] is None


SETTINGS = "damping=0.05,radial_gain=0.2"


def test_changed_settings_are_told_and_kept(tmp_path: Path) -> None:
    row = {"preset": "paper", "settings": SETTINGS}
    facts = fold_facts(found(tmp_path, 0, status="cancelled", **row))
    assert facts["preset"] == "Published parameters, Radial force gain λ 0.2, Damping 0.05"
    groups = {group["heading"]: group["rows"] for group in facts["properties"]}
    assert groups["Changed settings"] == [
        {"label": "Radial force gain λ", "value": "0.2 dyn, instead of 0.1"},
        {"label": "Damping", "value": "0.05 of the speed per step, instead of 0.1"},
    ]
    assert facts["again"]["form"] == {"fold": "f" * 20, "seed": 0, **row}
    assert facts["refold"] == row
    forms = {way["text"]: way["form"] for way in facts["compare"]}
    assert forms["Another seed"] == {"fold": "f" * 20, "seed": 1, **row}
    assert forms["Published method"] == {"fold": "f" * 20, "seed": 0, "preset": "paper"}
    plain = fold_facts(found(tmp_path, 0, status="verified", preset="paper"))["compare"]
    settable = {way["text"]: way["settable"] for way in plain if "settable" in way}
    assert settable == {"Published method, changed": "must"}
    failed = fold_facts(found(tmp_path, 0, **row))
    assert failed["again"]["form"] == {"fold": "f" * 20, "preset": "default", "seed": 0}
    usual = fold_facts(found(tmp_path, 0, status="verified"))
    assert usual["refold"] == {}
    assert "Changed settings" not in {group["heading"] for group in usual["properties"]}


@pytest.mark.parametrize(
    ("modules", "hint"), [(16, "less than a minute"), (160, "about a minute"), (500, "about 5 min")]
)
def test_how_long_the_published_method_takes_is_told(
    tmp_path: Path, modules: int, hint: str
) -> None:
    facts = fold_facts(found(tmp_path, 0, status="verified", modules=modules))
    (published,) = [way for way in facts["compare"] if way["text"] == "Published method"]
    assert published["hint"].startswith(f"Takes {hint}")


def test_what_went_wrong_is_a_sentence(tmp_path: Path) -> None:
    error = {"code": "not-adjacent", "detail": "got a gap.", "where": "cells 1 and 2"}
    assert fold_facts(found(tmp_path, 0, error=error))["problem"]["text"] == (
        "Cells 2 and 3: Found a gap."
    )


def test_properties_of_a_real_fold_are_fit_to_read(
    service: Service, finished: dict[str, Any]
) -> None:
    facts = service.http.get(f"/folds/{finished['id']}/facts").json()
    rows = [row for group in facts["properties"] for row in group["rows"]]
    values = {
        f"{group['heading']}: {row['label']}": row["value"]
        for group in facts["properties"]
        for row in group["rows"]
    }
    assert values["In short: Preset"] == "Default"
    assert values["Explosion parameters: Time step"] == "0.004 to 0.1 s"
    assert values["Playback parameters: Controller"] == "Servos with feed-forward"
    assert values["Simulated robots (torques relative to the largest planned): Robots"] == "3"
    assert values["Certificate: Robots"].startswith("3 imperfect robots")
    assert re.fullmatch(r"[\d.]+ [nµm]?N·m, simulated motors", values["In short: Peak torque"])
    assert 8 <= len(facts["properties"][0]["rows"]) <= 12
    assert not [key for key in values if re.match("(Peeling|Table) parameters", key)]
    assert "Playback parameters: Servo stiffness" not in values
    for row in rows:
        assert "_" not in row["label"]
        assert row["label"][0].isupper()
        if row["label"] not in ("Verdict", "Linked modules"):
            assert not re.search(r"\d\.\d{7}|e[-+]\d|[\[(]", row["value"]), row


def test_facts_of_a_running_fold_tell_the_verdict_of_a_checked_plan(tmp_path: Path) -> None:
    checked = {"verdict": "verified (simulated)", "simulated": True, "robots": []}
    (tmp_path / "certificate.json").write_text(json.dumps(checked))
    told = {
        stage: fold_facts(found(tmp_path, 0, status="running", stage=stage))["verdict"]
        for stage in ("certify", "export")
    }
    assert told["certify"] == {"tone": "busy", "text": "Computing · 16 modules"}
    assert told["export"] == {"tone": "good", "text": "Verified (simulated) · 16 modules"}
    (tmp_path / "certificate.json").write_text('{"verdict": "failed: modules overlap"}')
    refused = fold_facts(found(tmp_path, 0, status="running", stage="export"))
    assert refused["verdict"]["tone"] == "busy"
