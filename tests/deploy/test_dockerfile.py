import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path

from foldback.server.processes.movie_task import NO_GL
from tests.deploy.files import DEPLOY

ROOT = DEPLOY.parent
DOCKERFILE = DEPLOY / "Dockerfile"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def findings(path: Path) -> str:
    beside = Path(sys.executable).parent
    hadolint = shutil.which("hadolint", path=f"{beside}{os.pathsep}{os.environ['PATH']}")
    assert hadolint, "hadolint is not there; it comes with the extra 'dev'"
    done = subprocess.run([hadolint, str(path)], capture_output=True, text=True, check=False)
    return f"{done.stdout}{done.stderr}" + ("failed" if done.returncode else "")


def test_hadolint_finds_nothing_unless_something_is_wrong(tmp_path: Path) -> None:
    assert findings(DOCKERFILE) == findings(DEPLOY / "sweep.Dockerfile") == ""
    path = tmp_path / "Dockerfile"
    path.write_text(DOCKERFILE.read_text().replace("USER 10001:10001", "USER root"))
    assert findings(path)


def copied_sources(text: str) -> set[str]:
    """Return the paths, relative to the build context, that COPY lines of a Dockerfile name."""
    lines = re.findall(r"^COPY (?!--from)(.*) \S+$", text, re.M)
    return {source for sources in lines for source in sources.split()}


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
    """Return the paths of a checkout's files below ``root``, without files that its tools made."""
    return {
        path.relative_to(ROOT).as_posix()
        for path in (root.rglob("*") if root.is_dir() else [root])
        if path.is_file() and not re.search(r"/(__pycache__|\.)", path.as_posix()[len(str(ROOT)) :])
    }


def test_everything_installed_is_copied_and_passes_dockerignore() -> None:
    lines = (ROOT / ".dockerignore").read_text().split("\n")
    patterns = [line for line in lines if line[:1] not in ("", "#")]
    copied = copied_sources(DOCKERFILE.read_text())
    about = PROJECT["project"]
    assert {"pyproject.toml", about["readme"], *about["license-files"]} <= copied
    assert {
        "CMakeLists.txt",
        "build_backend.py",
        "examples",
        *PROJECT["tool"]["scikit-build"]["wheel"]["packages"],
    } <= copied
    for source in copied:
        files = files_below(ROOT / source)
        assert files and all(allowed_through(name, patterns) for name in files), source


def test_compiler_is_in_the_build_stage_alone() -> None:
    build, _, image = DOCKERFILE.read_text().rpartition("\nFROM ")
    assert "g++" in build
    assert not re.search(r"g\+\+|gcc|clang|cmake|build-essential", image)


def test_requirements_layer_lists_the_dependencies() -> None:
    command = re.search(r"^RUN (python3 -c .*) > requirements.txt", DOCKERFILE.read_text(), re.M)
    done = subprocess.run(
        ["sh", "-c", command[1].replace("python3", shlex.quote(sys.executable), 1)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    extras = PROJECT["project"]["optional-dependencies"]
    own_extras, *of_service = extras["service"]
    assert own_extras == "foldback[viewer,exports,pictures]"
    installed = [*PROJECT["project"]["dependencies"]]
    for extra in ("viewer", "exports", "pictures"):
        installed += extras[extra]
    assert done.stdout.splitlines() == [*installed, *of_service, *extras["storage"]]


def test_image_runs_as_an_unprivileged_user() -> None:
    last = DOCKERFILE.read_text().rpartition("FROM ")[2]
    users = re.findall(r"^USER (\d+):(\d+)$", last, re.M)
    assert users == [("10001", "10001")]
    assert f"--uid {users[0][0]}" in last
    # No command follows, and the program belongs to root.
    assert "RUN" not in last.partition("USER ")[2]
    assert "--chown" not in last


def test_image_has_the_packages_that_movies_need() -> None:
    named = re.search(r"apt-get install ([\w -]+)'", NO_GL)
    assert set(named[1].split()) <= set(DOCKERFILE.read_text().split())
