"""Parameters over HTTP and on the command line: one check, the same messages."""

import json
from pathlib import Path

import pytest

from foldback.planner.pipeline.request import MAX_SEED
from tests.server.cli.test_command_line import foldback
from tests.server.service_process import Service

BAD = {
    "preset": ("hasty", "unknown-preset"),
    "seed": (str(MAX_SEED + 1), "bad-seed"),
    "module_size": ("nan", "bad-module-size"),
    "modules": ("2", "bad-modules"),
    "method": ("magic", "unknown-method"),
    "ends": ("inside", "unknown-ends"),
    "start": ("here", "bad-start"),
    "prefer": ("speed", "unknown-prefer"),
    "settings": ("speed=1", "bad-settings"),
}
OPTIONS = {"settings": "set", "module_size": "module-size"}
"""Names of options on the command line, where they differ."""


@pytest.mark.parametrize("name", BAD)
def test_api_and_command_line_refuse_with_the_same_message(
    idle: Service, tmp_path: Path, name: str
) -> None:
    value, code = BAD[name]
    option = f"--{OPTIONS.get(name, name)}={value}"
    result = foldback("fold", "mallet-64", "--out", tmp_path / "out", option, "--json")
    assert result.returncode == 2, result.stderr
    typed = json.loads(result.stdout)
    assert typed["status"] == "invalid"
    assert (typed["error"]["code"], typed["error"]["where"]) == (code, name)
    assert value.partition("=")[0] in typed["error"]["detail"]
    assert not (tmp_path / "out").exists()
    status, problem = idle.refusal(shape="mallet-64", **{name: value})
    told_there = {key: problem[key] for key in ("code", "values", "detail", "where")}
    assert (status, told_there) == (422, typed["error"])
