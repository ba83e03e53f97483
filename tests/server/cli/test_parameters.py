"""Parameters over HTTP and on the command line: one check, the same messages."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from planner.parameters.parameters import PRESETS, STRATEGY_CHOICES
from planner.parameters.settings import MAX_TEXT_CHARS, SETTINGS
from planner.pathfinding import PATH_ENDS, PATH_METHODS
from planner.pathfinding.options import MODULE_COUNTS
from planner.pipeline.preference import PREFERENCES
from planner.pipeline.request import MAX_SEED, MODULE_SIZE_RANGE
from server.cli.command_line import application
from tests.server.service import SPIRAL, Service

BAD = [
    ("preset", "hasty", "unknown-preset"),
    ("seed", "-1", "bad-seed"),
    ("seed", str(MAX_SEED + 1), "bad-seed"),
    ("seed", "seven", "bad-seed"),
    ("seed", "1.5", "bad-seed"),
    ("module_size", "1.5", "bad-module-size"),
    ("module_size", "0.05", "bad-module-size"),
    ("module_size", "nan", "bad-module-size"),
    ("module_size", "large", "bad-module-size"),
    ("modules", "2", "bad-modules"),
    ("modules", "100000", "bad-modules"),
    ("modules", "many", "bad-modules"),
    ("method", "magic", "unknown-method"),
    ("ends", "inside", "unknown-ends"),
    ("start", "here", "bad-start"),
    ("prefer", "speed", "unknown-prefer"),
]


@pytest.mark.parametrize(("name", "value", "code"), BAD)
def test_http_and_the_command_line_refuse_in_the_same_words(
    desk: Service, tmp_path: Path, name: str, value: str, code: str
) -> None:
    option = f"--{name.replace('_', '-')}={value}"
    command = ["fold", "mallet-64", "--out", str(tmp_path / "out"), option, "--json"]
    told = CliRunner().invoke(application(), command)
    assert told.exit_code == 2, told.output
    typed = json.loads(told.output)
    assert typed["status"] == "invalid"
    assert (typed["error"]["code"], typed["error"]["where"]) == (code, name)
    assert value.partition(".")[0] in typed["error"]["detail"]
    assert not (tmp_path / "out").exists()

    answer = desk.http.post("/api/folds", data={"shape": "mallet-64", name: value})
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    assert {key: answer.json()[key] for key in ("code", "detail", "where")} == typed["error"]


@pytest.mark.parametrize(
    ("preset", "settings"),
    [
        ("paper", "speed=1"),
        ("paper", "damping=2"),
        ("paper", "d" * 501),
        ("default", "damping=0.2"),
    ],
)
def test_settings_are_refused_in_the_same_words(
    desk: Service, tmp_path: Path, preset: str, settings: str
) -> None:
    command = ["fold", "mallet-64", "--out", str(tmp_path / "out"), "--preset", preset, "--json"]
    told = CliRunner().invoke(application(), [*command, "--set", settings])
    assert told.exit_code == 2, told.output
    error = json.loads(told.output)["error"]
    assert (error["code"], error["where"]) == ("bad-settings", "settings")
    form = {"shape": "mallet-64", "preset": preset, "settings": settings}
    status, problem = desk.refused(**form)
    assert (status, {key: problem[key] for key in error}) == (422, error)


def test_what_a_shape_is_asked_for_reads_the_same(tmp_path: Path) -> None:
    for option, code in (("--modules=many", "bad-modules"), ("--seed=-1", "bad-seed")):
        out = str(tmp_path / "path.json")
        told = CliRunner().invoke(
            application(), ["shape", "mallet-64", "--out", out, option, "--json"]
        )
        assert (told.exit_code, json.loads(told.output)["error"]["code"]) == (2, code)


def test_the_api_says_what_the_planner_takes(desk: Service) -> None:
    schemas = desk.http.get("/api/openapi.json").json()["components"]["schemas"]
    (form,) = [
        schema["properties"]
        for name, schema in schemas.items()
        if name.startswith("Body_post_fold")
    ]

    def of(name: str) -> dict[str, Any]:
        one = form[name]
        return next((s for s in one.get("anyOf", [one]) if s.get("type") != "null"), one)

    assert tuple(of("preset")["enum"]) == PRESETS
    assert of("strategy")["enum"] == list(STRATEGY_CHOICES)
    assert of("prefer")["enum"] == list(PREFERENCES)
    assert of("method")["enum"] == list(PATH_METHODS)
    assert of("ends")["enum"] == list(PATH_ENDS)
    assert of("settings")["maxLength"] == MAX_TEXT_CHARS
    assert all(f"`{setting.name}`" in of("settings")["description"] for setting in SETTINGS)
    for name, limits in (
        ("seed", (0, MAX_SEED)),
        ("modules", MODULE_COUNTS),
        ("module_size", MODULE_SIZE_RANGE),
    ):
        assert (of(name)["minimum"], of(name)["maximum"]) == limits


def test_direct_servoing_can_be_asked_for_and_is_judged(service: Service) -> None:
    fold_id = service.fold(SPIRAL, preset="direct")["id"]
    state = service.wait_over(fold_id)
    assert state["preset"] == "direct"
    assert state["status"] == "failed"  # it is the baseline
    assert state["summary"]["explosion"]["steps"] == 0
    assert state["summary"]["playback"]["steps"] > 0
    assert service.http.get(f"/folds/{fold_id}/facts").json()["frames"] > 0


def test_both_pages_offer_every_preset(desk: Service) -> None:
    preview = desk.http.post("/api/shapes/preview", data={"shape": "mallet-64"}).json()
    for page in ("/", preview["links"]["page"]):
        text = desk.http.get(page).text
        for preset in PRESETS:
            assert f'<option value="{preset}">' in text


def test_the_version_is_told() -> None:
    from importlib.metadata import version

    told = CliRunner().invoke(application(), ["--version"])
    assert (told.exit_code, told.output.strip()) == (0, f"foldback {version('foldback')}")
