from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.deploy.files import DEPLOY

ROOT = DEPLOY.parent
DOCKERFILE = DEPLOY / "Dockerfile"


def linted(path: Path) -> subprocess.CompletedProcess[str]:
    beside = Path(sys.executable).parent
    hadolint = shutil.which("hadolint", path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    assert hadolint, "hadolint is not there; it comes with the extra 'dev'"
    return subprocess.run([hadolint, str(path)], capture_output=True, text=True, check=False)


def test_hadolint_has_nothing_to_say() -> None:
    done = linted(DOCKERFILE)
    assert done.returncode == 0 and not done.stdout, done.stdout


@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("USER 10001:10001", "USER root"),
        ("python:3.11-slim-bookworm AS", "python AS"),
        ("EXPOSE 8000", "EXPOSE x"),
    ],
)
def test_hadolint_would_say_it(line: str, instead: str, tmp_path: Path) -> None:
    path = tmp_path / "Dockerfile"
    path.write_text(DOCKERFILE.read_text().replace(line, instead))
    assert linted(path).returncode != 0 or linted(path).stdout


def test_what_is_copied_is_there_and_let_through() -> None:
    allowed = {
        line.removeprefix("!")
        for line in (ROOT / ".dockerignore").read_text().splitlines()
        if line.startswith("!")
    }
    copied: set[str] = set()
    for sources in re.findall(r"^COPY (?!--from)(.*) \S+$", DOCKERFILE.read_text(), re.M):
        copied.update(sources.split())
    assert copied == allowed
    assert all((ROOT / name).exists() for name in copied)


def test_it_runs_as_nobody_special() -> None:
    last = DOCKERFILE.read_text().rpartition("FROM ")[2]
    users = re.findall(r"^USER (\d+):(\d+)$", last, re.M)
    assert users == [("10001", "10001")]
    assert f"--uid {users[0][0]}" in last
    # Nothing is run after that, and the program belongs to root.
    assert "RUN" not in last.partition("USER ")[2]
    assert "--chown" not in last


def test_it_has_what_movies_need() -> None:
    from server.processes.movie_task import NO_GL

    named = re.search(r"apt-get install ([\w -]+)'", NO_GL)
    assert named
    assert set(named[1].split()) <= set(DOCKERFILE.read_text().split())
