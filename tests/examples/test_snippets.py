"""Snippets: the code blocks of README and docs run word for word."""

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
import trimesh

from foldback.planner.exports.formats import export_named
from foldback.planner.motion.angle_encoding import quantised
from foldback.planner.plan import plan as plan_module
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.gallery import Gallery
from foldback.server.admin.migration import run_migration
from foldback.server.cli.command_line import COMMANDS, imported
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.owner import Owner
from tests.case import case
from tests.planner.folds import run_fold
from tests.run_python import ROOT
from tests.server.rows import a_fold
from tests.server.service_process import FinishedFold

pytestmark = pytest.mark.slow

README: Final = ROOT / "README.md"
PAGES: Final = (README, *sorted((ROOT / "docs").glob("*.md")))
BLOCK: Final = re.compile(r"^```(python|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE: Final = re.compile(r"`(?:[\w./]*/)?foldback ([a-z][^`]*)`")
SERVICE_ADDRESS: Final = "http://127.0.0.1:8000"
SIGNATURES: Final = ROOT / "docs" / "how-a-fold-is-computed.md"
"""Page whose blocks are signatures, which tests/test_computing_page.py compares."""
SYSTEM_PROGRAMS: Final = {"apt", "docker", "install", "systemctl", "systemd-run"}
"""Programs that change the machine; ``make deploy-check`` and ``make compose-check`` run what these
commands do."""
NOT_ACHIEVED: Final = ("foldback table ", "--motor-torque 3")
"""Parts of the commands that, as the pages say, exit with 3: their example needs stronger motors,
or was not made for a table."""


def blocks(page: Path, language: str) -> list[str]:
    """Return the blocks of a page in a language."""
    block = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [text for named, text in block if named == language]


def commands(page: Path) -> list[str]:
    """Return the lines of a page's shell blocks; a line that ends with ``\\`` continues."""
    text = "".join(blocks(page, "sh")).replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip()]


def run_python_blocks(texts: list[str]) -> dict[str, Any]:
    """Run blocks one after another, as a reader would, and return their names."""
    names: dict[str, Any] = {}
    for text in texts:
        exec(compile(text, "snippet", "exec"), names)
    return names


def shell(line: str, place: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a line of a page in a directory with an environment like that of a checkout."""
    if not (place / ".venv").exists():
        (place / ".venv").symlink_to(sys.prefix)
        (place / "foldback_check.py").symlink_to(ROOT / "foldback" / "foldback_check.py")
        trimesh.creation.box((3, 4, 5)).export(place / "part.stl")
    path = f"{Path(sys.prefix) / 'bin'}:{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "-c", line],
        cwd=place,
        env={**os.environ, "PATH": path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@contextmanager
def until_interrupted(arguments: list[str], place: Path, says: str) -> Generator[None]:
    """Start a program, wait until it prints an address, and end it as Ctrl-C does."""
    with subprocess.Popen(arguments, cwd=place, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert any(says in line for line in program.stdout)
        yield
        program.send_signal(signal.SIGINT)


@pytest.fixture(scope="module")
def folded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory with a fold named ``wrench``, and its exports."""
    place = tmp_path_factory.mktemp("folded")
    shape = Gallery().shape("wrench-24")
    assert shape is not None
    plan = run_fold(place / "wrench", shape.data, filename=shape.filename)
    for name in ("urdf", "srdf"):
        (place / f"model.{name}").write_bytes(export_named(name).write(plan))
    return place


def test_readme_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    (block,) = blocks(README, "python")
    plan = run_python_blocks([block])["plan"]
    assert plan.verified


def test_api_page_in_shell(finished: FinishedFold, tmp_path: Path) -> None:
    """Its Python runs in tests/server/api/test_client.py."""
    page, address = ROOT / "docs" / "api.md", str(finished.http.base_url).rstrip("/")
    script = "set -e\n" + "".join(blocks(page, "sh")).replace(SERVICE_ADDRESS, address)
    done = shell(script, tmp_path)
    assert done.returncode == 0, done.stderr
    assert Plan.load(tmp_path / next(tmp_path.glob("*plan.npz"))).verified


def test_robot_page_in_python(
    folded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoding, models, bullet = blocks(ROOT / "docs" / "robot.md", "python")
    monkeypatch.setattr(plan_module, "MAX_PLAIN_ANGLES", 0)
    monkeypatch.chdir(tmp_path)
    path = Gallery().shape("wrench-24")
    assert path is not None
    for strategy in ("simultaneous", "peel"):
        with case(strategy):
            run_fold(tmp_path / strategy, path.data, strategy=strategy)
            plan = Plan.load(tmp_path / strategy / "plan.npz")
            if plan.motion.is_windowed:  # small ones are not rounded to whole steps
                whole_quantised = quantised(plan.motion.angles_rad).astype(np.float32)
                plan = replace(plan, motion=replace(plan.motion, angles_rad=whole_quantised))
            plan.save_npz(tmp_path / "plan.npz")
            angles = run_python_blocks([decoding])["angles"]
            np.testing.assert_allclose(angles, plan.whole().joint_angles_rad, atol=1e-6)
            assert plan.motion.is_windowed == (strategy == "peel")
    monkeypatch.chdir(folded)
    names = run_python_blocks([models])
    assert names["model"].nexclude == len(names["pairs"]) > 0
    assert "setCollisionFilterPair" in bullet  # tests/foreign runs it


@pytest.mark.long
def test_python_page(folded: Path) -> None:
    page = ROOT / "docs" / "python.md"
    (folded / "examples").symlink_to(ROOT / "examples")
    script = "import sys\nsys.stdout.reconfigure(line_buffering=True)\n"
    with until_interrupted(
        [sys.executable, "-c", script + "\n".join(blocks(page, "python"))], folded, "http://"
    ):
        pass


@pytest.mark.long
@pytest.mark.parametrize("page", ["README.md", "docs/robot.md", "docs/deploy.md"])
def test_commands_of_a_page(page: str, tmp_path: Path) -> None:
    if ROOT / page != README:
        done = shell("foldback fold wrench-24 --out wrench && cp -r wrench out", tmp_path)
        assert done.returncode == 0, done.stderr
    lines = [line for line in commands(ROOT / page) if re.match(r"(\S*/)?(foldback|python) ", line)]
    assert lines
    for line in lines:
        with case(line):
            words = shlex.split(line, comments=True)
            if words[1] == "play":
                with until_interrupted([*words, "--port", "0"], tmp_path, "http://"):
                    continue
            done = shell(line, tmp_path)
            expected = 3 if any(part in line for part in NOT_ACHIEVED) else 0
            assert done.returncode == expected, done.stderr[-2000:]


@pytest.mark.long
def test_commands_of_the_operations_page(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    settings.make_directories()
    run_migration(settings)
    with closing(Store(settings)) as store:
        store.add(a_fold("failed", status="failed"), Owner.from_token("a" * 24))
    (settings.folds_dir / "failed").mkdir()
    for name in ("input", "request.json"):
        (settings.folds_dir / "failed" / name).write_text("{}")
    variables = {"FOLDBACK_DATA_DIR": str(settings.root), "ID": "failed", "DIR": "backup"}
    for line in commands(ROOT / "docs" / "operations.md"):
        if line.startswith("foldback "):
            with case(line):
                done = shell(line.replace("/backup/", f"{tmp_path}/"), tmp_path, **variables)
                assert done.returncode == 0, done.stderr[-2000:]


def test_commands_that_pages_name_exist() -> None:
    """Commands in sentences, and those that change the machine: their names and options."""
    texts = [
        *(text for page in PAGES for text in INLINE.findall(page.read_text(encoding="utf-8"))),
        *(
            line.partition("foldback ")[2]
            for page in PAGES
            for line in commands(page)
            if re.match(r"([\w./]+/)?foldback ", line)
        ),
    ]
    assert len(texts) > 30
    for text in texts:
        with case(text):
            name, *words = shlex.split(text, comments=True)
            assert name in COMMANDS
            command = imported(name)
            while (group := getattr(command, "commands", None)) and words:
                command = group[words.pop(0)]
            options = {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
            assert {word for word in words if word.startswith("--")} <= options | {"--help"}


def test_system_commands_name_files_of_the_checkout() -> None:
    lines = [line for page in PAGES if page != SIGNATURES for line in commands(page)]
    system = [line for line in lines if shlex.split(line, comments=True)[0] in SYSTEM_PROGRAMS]
    assert len(system) >= 5
    for line in lines:
        for name in re.findall(r"(?<![\w/])deploy/[\w./*-]+", line):
            with case(line):
                created = name == "deploy/.env"
                assert created or list(ROOT.glob(name))
