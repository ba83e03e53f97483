"""Figures and texts of a fold's page."""

import json
import shutil
from pathlib import Path
from typing import Any

from foldback.planner.motion.timeline import TimelineWriter
from foldback.server.pages.facts import fold_facts
from foldback.server.store.estimates import Estimates
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.folds import Store
from foldback.words.fold import ShownFold
from tests.planner.chains import chain_of
from tests.server.service_process import SNAKE, FinishedFold
from tests.web.conftest import unfolding


def failed_fold(directory: Path, frames: int, **values: Any) -> LocatedFold:
    """Return a failed fold with the given frames of explosion."""
    if frames:
        chain = chain_of(SNAKE)
        with TimelineWriter.create(directory / "timeline", chain) as writer:
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
    assert (
        again_command["text"] == "Try another random start" and again_command["form"]["seed"] == 0
    )
    again_command = fold_facts(failed_fold(tmp_path, 0, strategy="turns"))["again"]
    assert (
        again_command["text"] == "Try to unfold all hinges at once"
        and "strategy" not in again_command["form"]
    )
    plain = fold_facts(failed_fold(tmp_path, 0, status="verified", preset="paper"))["compare"]
    settable = {way["text"]: way["settable"] for way in plain if "settable" in way}
    assert settable == {"As in the paper, changed": "must"}


def test_fold_in_turns_may_be_compared_with_an_explosion(tmp_path: Path) -> None:
    def offered(summary: dict[str, Any]) -> list[Any]:
        offers = fold_facts(failed_fold(tmp_path, 0, status="verified", summary=summary))["compare"]
        return [offer["form"] for offer in offers if offer["text"] == "All hinges at once"]

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
    offers = fold_facts(facts, expected=Estimates(store).total_s)["compare"]
    assert "Takes less than a minute" in {offer.get("hint", "") for offer in offers}


def test_fold_has_no_verdict_while_its_files_are_written(tmp_path: Path) -> None:
    checked = {"verified": True, "reason": None, "simulated": True, "robots": []}
    (tmp_path / "certificate.json").write_text(json.dumps(checked))
    facts = {
        stage: fold_facts(failed_fold(tmp_path, 0, status="running", stage=stage))["verdict"]
        for stage in ("certify", "export")
    }
    assert facts["certify"] == {"tone": "busy", "text": "Computing · 16\N{NO-BREAK SPACE}cubes"}
    text = "Writing the files … · 16\N{NO-BREAK SPACE}cubes"
    assert facts["export"] == {"tone": "busy", "text": text}


def test_verified_fold_offers_to_fold_for_real_servos(tmp_path: Path) -> None:
    margin = {"value": 1e-4, "limited_by": {"frame": 1.0, "modules": [0, 2]}}
    margins: dict[str, Any] = dict.fromkeys(
        ("module_size", "one_hinge_rad", "independent_rad"), margin
    )
    margins["failure_probability"] = 0.05
    certificate: dict[str, Any] = {"verified": True, "module_size": 0.95, "margins": margins}

    def build(modules: int = 16) -> Any:
        summary = {"certificate": certificate}
        row = failed_fold(tmp_path, 0, status="verified", summary=summary, modules=modules)
        return fold_facts(row)["build"]

    assert build()["again"] is None
    certificate["joint_errors"] = {
        "error_rad": 0.0052359877,
        "module_size": 0.84,
        "tolerated_rad": 1e-3,
        "robots": 300,
        "touching_at_size": 1,
        "touching_with_error": 8,
    }
    again = build()["again"]
    assert again["text"] == "Fold again with modules of 84\N{NO-BREAK SPACE}%"
    assert (again["form"]["joint_error"], again["form"]["module_size"]) == ("0.3deg", 0.84)
    assert "joint_error" not in build(modules=401)["again"]["form"]
    certificate["joint_errors"]["module_size"] = None
    assert build()["again"] is None
    assert fold_facts(failed_fold(tmp_path, 0))["build"] is None
