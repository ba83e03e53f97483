from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import zipfile
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from tests.deploy.files import DEPLOY

ROOT = DEPLOY.parent
DOCKERFILE = DEPLOY / "Dockerfile"


def findings(path: Path) -> str:
    beside = Path(sys.executable).parent
    hadolint = shutil.which("hadolint", path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    assert hadolint, "hadolint is not there; it comes with the extra 'dev'"
    done = subprocess.run([hadolint, str(path)], capture_output=True, text=True, check=False)
    return f"{done.stdout}{done.stderr}" + ("failed" if done.returncode else "")


def test_hadolint_finds_nothing_unless_something_is_wrong(tmp_path: Path) -> None:
    assert findings(DOCKERFILE) == ""
    for line, instead in (
        ("USER 10001:10001", "USER root"),
        ("python:3.11-slim-bookworm AS", "python AS"),
        ("EXPOSE 8000", "EXPOSE x"),
    ):
        path = tmp_path / "Dockerfile"
        path.write_text(DOCKERFILE.read_text().replace(line, instead))
        assert findings(path), instead


def copied_sources(text: str) -> list[str]:
    """Return the paths, relative to the build context, that COPY lines of a Dockerfile name."""
    lines = re.findall(r"^COPY (?!--from)(.*) \S+$", text, re.M)
    return [source for sources in lines for source in sources.split()]


def allowed_through(path: str, patterns: list[str]) -> bool:
    """Return True if .dockerignore lets a file of the context through: the last match decides."""
    allowed = True
    for pattern in patterns:
        name = pattern.removeprefix("!").removeprefix("**/")
        anywhere = "**/" in pattern
        parts = path.split("/")
        ends = range(1, len(parts) + 1)
        heads = parts if anywhere else ["/".join(parts[:end]) for end in ends]
        if any(fnmatchcase(head, name) for head in heads):
            allowed = pattern.startswith("!")
    return allowed


def files_below(root: Path) -> set[str]:
    """Return the paths of a checkout's files below ``root``, without what only its tools made."""
    return {
        path.relative_to(ROOT).as_posix()
        for path in (root.rglob("*") if root.is_dir() else [root])
        if path.is_file() and "__pycache__" not in path.parts
    }


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with exactly the files that the Dockerfile copies."""
    directory = tmp_path_factory.mktemp("context")
    patterns = [
        line
        for line in (ROOT / ".dockerignore").read_text().split("\n")
        if line[:1] not in ("", "#")
    ]
    for source in copied_sources(DOCKERFILE.read_text()):
        assert (ROOT / source).exists(), source
        for name in filter(
            lambda each: allowed_through(each, patterns), files_below(ROOT / source)
        ):
            (directory / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, directory / name)
    return directory


def test_dockerignore_passes_all_copied_files(context: Path) -> None:
    for source in copied_sources(DOCKERFILE.read_text()):
        missing = {
            name
            for name in files_below(ROOT / source)
            if not (context / name).exists() and not re.search(r"(^|/)\.", name)
        }
        assert not missing, source


def test_requirements_layer_lists_the_dependencies(context: Path) -> None:
    command = re.search(r"^RUN (python3 -c .*) > requirements.txt", DOCKERFILE.read_text(), re.M)
    done = subprocess.run(
        ["sh", "-c", command[1].replace("python3", shlex.quote(sys.executable), 1)],
        cwd=context,
        capture_output=True,
        text=True,
        check=True,
    )
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    storage = project["optional-dependencies"]["storage"]
    assert done.stdout.splitlines() == [*project["dependencies"], *storage]


@pytest.mark.slow
def test_wheel_built_from_the_copied_files_has_everything(context: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=context, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    wheel = zipfile.ZipFile(next(tmp_path.glob("*.whl")))
    needed = {
        name
        for package in ("planner", "web", "server", "foldback_client")
        for name in files_below(ROOT / package)
        if not name.endswith(".d.ts") and not re.search(r"(^|/)\.", name)
    }
    shapes = {
        name.replace("examples/shapes", "planner/examples")
        for name in files_below(ROOT / "examples/shapes")
    }
    needed |= shapes | {"planner/table_results.json"}
    assert needed <= set(wheel.namelist())
    wheel.extractall(tmp_path / "installed")
    loaded = subprocess.run(
        [sys.executable, "-P", "-c", GALLERY],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "installed")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert loaded.stdout.split() == [str(len(shapes)), "True", "True"]


GALLERY = """
import server
from planner.readers.gallery import gallery
print(len(gallery()), any(shape.rests_within for shape in gallery()))
print("installed" in server.__file__)
"""


def test_image_runs_as_an_unprivileged_user() -> None:
    last = DOCKERFILE.read_text().rpartition("FROM ")[2]
    users = re.findall(r"^USER (\d+):(\d+)$", last, re.M)
    assert users == [("10001", "10001")]
    assert f"--uid {users[0][0]}" in last
    # Nothing is run after that, and the program belongs to root.
    assert "RUN" not in last.partition("USER ")[2]
    assert "--chown" not in last


def test_image_has_the_packages_that_movies_need() -> None:
    from server.processes.movie_task import NO_GL

    named = re.search(r"apt-get install ([\w -]+)'", NO_GL)
    assert set(named[1].split()) <= set(DOCKERFILE.read_text().split())
