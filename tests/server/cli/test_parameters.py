"""Parameters over HTTP and on the command line: one check, the same messages."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from planner.pipeline.request import MAX_SEED
from server.cli.command_line import application
from tests.server.service import SPIRAL, Service

BAD = [
    ("preset", "hasty", "unknown-preset"),
    ("seed", "-1", "bad-seed"),
    ("seed", str(MAX_SEED + 1), "bad-seed"),
    ("seed", "seven", "bad-seed"),
    ("module_size", "1.5", "bad-module-size"),
    ("module_size", "nan", "bad-module-size"),
    ("modules", "2", "bad-modules"),
    ("modules", "many", "bad-modules"),
    ("method", "magic", "unknown-method"),
    ("ends", "inside", "unknown-ends"),
    ("start", "here", "bad-start"),
    ("prefer", "speed", "unknown-prefer"),
    ("settings", "speed=1", "bad-settings"),
    ("settings", "damping=2", "bad-settings"),
    ("settings", "d" * 501, "bad-settings"),
    ("settings", "damping=0.2", "bad-settings"),
]
OPTIONS = {"settings": "set", "module_size": "module-size"}
"""Names of options on the command line, where they differ."""


@pytest.mark.parametrize(("name", "value", "code"), BAD)
def test_api_and_command_line_refuse_with_the_same_message(
    desk: Service, tmp_path: Path, name: str, value: str, code: str
) -> None:
    form = {"shape": "mallet-64", name: value}
    if code == "bad-settings":
        form["preset"] = "default" if value == "damping=0.2" else "paper"
    options = [f"--{OPTIONS.get(key, key)}={each}" for key, each in form.items() if key != "shape"]
    command = ["fold", "mallet-64", "--out", str(tmp_path / "out"), *options, "--json"]
    told = CliRunner().invoke(application(), command)
    assert told.exit_code == 2, told.output
    typed = json.loads(told.output)
    assert typed["status"] == "invalid"
    assert (typed["error"]["code"], typed["error"]["where"]) == (code, name)
    assert code == "bad-settings" or value.partition(".")[0] in typed["error"]["detail"]
    assert not (tmp_path / "out").exists()
    status, problem = desk.refused(**form)
    assert (status, {key: problem[key] for key in ("code", "detail", "where")}) == (
        422,
        typed["error"],
    )


def test_direct_servoing_is_requested_and_judged(service: Service) -> None:
    fold_id = service.fold(SPIRAL, preset="direct")["id"]
    state = service.wait_over(fold_id)
    assert state["preset"] == "direct"
    assert state["status"] == "failed"  # it is the baseline
    assert state["summary"]["explosion"]["steps"] == 0
    assert state["summary"]["playback"]["steps"] > 0
    assert service.http.get(f"/folds/{fold_id}/facts").json()["frames"] > 0
