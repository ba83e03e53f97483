"""Packages: imports in one direction only, and complete installation."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from docs.make_licences import installed
from foldback.server.cli.command_line import SERVICE_PACKAGES

ROOT = Path(__file__).parents[3]
TYPES = ".d.ts"
"""File type of types for the pages' scripts, which only the type checker reads."""


def test_packages_import_no_tests_and_rooms_below_http_no_http() -> None:
    """tests/test_architecture.py checks that all imports point to lower layers."""
    low = [f"server/{room}" for room in ("limits", "store", "files", "processes", "jobs")]
    folders = ["planner", "web", "words", "cli", "server", "client"]
    for places, forbidden in (
        (folders, r"tests|examples|\."),
        (["foldback", "tests", "bench", "examples", "docs", *folders], rf"({'|'.join(folders)})\b"),
        (low, r"foldback\.server\.(http|api|pages)|fastapi|starlette"),
    ):
        wrong = re.compile(rf"^\s*(from|import) ({forbidden})", re.MULTILINE)
        files = [path for place in places for path in (ROOT / place).rglob("*.py")]
        assert files
        assert not [path for path in files if wrong.search(path.read_text())]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of the built wheel."""
    place = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(place)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (built,) = place.glob("*.whl")
    return built


def test_wheel_carries_data_and_types(wheel: Path) -> None:
    carried = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"foldback/{path.relative_to(ROOT)}"
        for package in ("planner", "web", "words", "cli", "server", "client")
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.endswith(TYPES)
    }
    shapes = {
        f"foldback/planner/examples/{p.name}" for p in (ROOT / "examples" / "shapes").glob("*.json")
    }
    assert len(shapes) >= 7
    wanted |= {"foldback/py.typed", "foldback/foldback_check.py", "foldback/viewer.py", *shapes}
    assert wanted <= carried, sorted(wanted - carried)
    assert {name.partition("/")[0] for name in carried} == {"foldback", "foldback-0.1.0.dist-info"}
    assert not [name for name in carried if name.endswith((TYPES, "package.json"))]


def import_names_of_extras() -> set[str]:
    """Return what Python imports of packages that only extras install."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    of_extras = {Requirement(line).name for lines in extras for line in lines} - {"foldback"}
    of_planner = {Requirement(line).name for line in project["dependencies"]}
    only_extras = set(map(canonicalize_name, of_extras)).difference(*map(installed, of_planner))
    return {
        name
        for name, owners in packages_distributions().items()
        if only_extras & set(map(canonicalize_name, owners))
    }


def test_planner_and_its_commands_need_no_extra(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path)
    extras = import_names_of_extras()
    assert {"fastapi", "viser"} <= extras
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
for name in {sorted(extras)}:
    sys.modules[name] = None  # whoever imports it fails
import foldback
assert not {{"numpy", "mujoco", "numba"}} & set(sys.modules), "they are for who uses them"
for name in foldback.__all__:
    getattr(foldback, name)
from importlib import import_module
from pkgutil import walk_packages
for package in map(import_module, ("foldback.planner", "foldback.words", "foldback.cli")):
    for module in walk_packages(package.__path__, f"{{package.__name__}}."):
        import_module(module.name)
from foldback.planner.readers.gallery import gallery
print(foldback.__file__, *(shape.name for shape in gallery()))

from typer.testing import CliRunner
from foldback.server.cli.command_line import SERVICE_PACKAGES, application
for command in SERVICE_PACKAGES:
    done = CliRunner().invoke(application(), [command, "--help"])
    print(done.exit_code, done.output, end="")
for name in ("viewer", "client"):
    try:
        import_module(f"foldback.{{name}}")
    except ImportError as error:
        print(error)
"""
    library = [sys.executable, "-P", "-c", code]
    done = subprocess.run(library, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, *refusals = done.stdout.splitlines()
    where, *names = first.split()
    assert Path(where).is_relative_to(tmp_path)
    assert sorted(names) == sorted(p.stem for p in (ROOT / "examples" / "shapes").glob("*.json"))
    assert refusals == [
        *(
            f"2 foldback {command} needs the service: pip install 'foldback[service]'"
            for command in SERVICE_PACKAGES
        ),
        "foldback.viewer needs viser: pip install 'foldback[viewer]'",
        "foldback.client needs httpx: pip install 'foldback[client]'",
    ]
