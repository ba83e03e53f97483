"""Packages: imports in one direction only, and complete installation."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import packages_distributions
from pathlib import Path

import httpx
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from docs.make_licences import installed
from foldback.planner.chain.built_in_modules import CUBE
from foldback.server.cli.command_line import COMMANDS, SERVICE_PACKAGES

ROOT = Path(__file__).parents[3]
TEN_LINES = re.compile(r"^## Ten lines of Python\n\n```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PLANNER_COMMANDS = (
    "fold wrench-24 --out wrench",
    "verify wrench",
    "export wrench --out files",
    "smooth wrench --out quiet",
    "tour wrench",
    "retime wrench --max-speed 1 --max-acceleration 2 --out trajectory.csv",
    "table wrench --module-kg 0.05 --pitch-mm 40",
    "shape mallet-24 --out path.json",
    "refold wrench path.json --out both",
    "servos --torque 3 --pitch-mm 40 --material pla",
    "module module.json",
    "settings",
    "solve 3,2,2,3,2,3,2,2,3,3,2,2,2,3,3,3,3",
    "verdict lightsabre --file proof.json",
)
"""Commands that need no extra, with arguments; each runs in the directory of the one before."""
NOT_INSTALLED = (".d.ts", ".cpp", ".hpp", "CMakeLists.txt")
"""File types of sources of the compiled core, and of types for the pages' scripts, which only the
type checker reads."""


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
    wheel = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*wheel, "-w", str(place), "."], cwd=ROOT, check=True, capture_output=True)
    (built,) = place.glob("*.whl")
    return built


def test_wheel_carries_data_and_types(wheel: Path) -> None:
    carried = set(zipfile.ZipFile(wheel).namelist())
    expected = {
        f"foldback/{path.relative_to(ROOT)}"
        for package in ("planner", "web", "words", "cli", "server", "client")
        for path in (ROOT / package).rglob("*")
        if path.is_file()
        and "__pycache__" not in path.parts
        and not path.name.endswith(NOT_INSTALLED)
    }
    shapes = {
        f"foldback/planner/examples/{p.name}" for p in (ROOT / "examples" / "shapes").glob("*.json")
    }
    assert len(shapes) >= 7
    expected |= {
        "foldback/py.typed",
        "foldback/foldback_check.py",
        "foldback/viewer.py",
        "foldback/sweeps.py",
    }
    expected |= shapes
    assert expected <= carried, sorted(expected - carried)
    assert {name.partition("/")[0] for name in carried} == {"foldback", "foldback-0.1.0.dist-info"}
    assert not [name for name in carried if name.endswith((*NOT_INSTALLED, "package.json"))]
    compiled = "foldback/planner/core/_core" + sysconfig.get_config_var("EXT_SUFFIX")
    assert {compiled, "foldback/planner/core/_core.abi3.so"} & carried


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
sys.meta_path[:] = [f for f in sys.meta_path if not type(f).__name__.startswith("Scikit")]
sys.path.insert(0, {str(tmp_path)!r})
for name in {sorted(extras)}:
    sys.modules[name] = None  # whoever imports it fails
import foldback
assert not {{"numpy", "mujoco"}} & set(sys.modules), "they are for who uses them"
for name in foldback.__all__:
    getattr(foldback, name)
from importlib import import_module
from pkgutil import walk_packages
for package in map(import_module, ("foldback.planner", "foldback.words", "foldback.cli")):
    for module in walk_packages(package.__path__, f"{{package.__name__}}."):
        if module.name.rpartition(".")[2] not in ("leaflet_pdf", "mcap_log"):
            import_module(module.name)
from foldback.planner.readers.gallery import gallery
print(foldback.__file__, *(shape.name for shape in gallery()))

from typer.testing import CliRunner
from foldback.server.cli.command_line import SERVICE_PACKAGES, application
for command in SERVICE_PACKAGES:
    rest = ["--shape", "wrench-24"] if command == "sweep" else ["--help"]
    done = CliRunner().invoke(application(), [command, *rest])
    print(done.exit_code, done.output, end="")
for name in ("viewer", "client", "sweeps"):
    try:
        import_module(f"foldback.{{name}}")
    except ImportError as error:
        print(error)
"""
    library = [sys.executable, "-P", "-c", code]
    done = subprocess.run(library, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    first, *refusals = done.stdout.splitlines()
    package_place, *names = first.split()
    assert Path(package_place).is_relative_to(tmp_path)
    assert sorted(names) == sorted(p.stem for p in (ROOT / "examples" / "shapes").glob("*.json"))
    assert refusals == [
        *(
            "2 foldback sweep needs Dask: pip install 'foldback[sweep]'"
            if command == "sweep"
            else f"2 foldback {command} needs the service: pip install 'foldback[service]'"
            for command in SERVICE_PACKAGES
        ),
        "foldback.viewer needs viser: pip install 'foldback[viewer]'",
        "foldback.client needs httpx: pip install 'foldback[client]'",
        "foldback.sweeps needs Dask and Arrow: pip install 'foldback[sweep]'",
    ]


Run = Callable[..., subprocess.CompletedProcess[str]]


@contextmanager
def installation(wheel: Path, extra: str, place: Path) -> Iterator[Run]:
    """Install the wheel in an empty environment; yield a function that runs its programs.

    No compiler is in reach of either.
    """
    venv = place / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(venv)], check=True)
    pip = [sys.executable, "-m", "pip", "--python", str(venv), "install", "--no-compile", "--quiet"]
    constraints = ["--constraint", str(ROOT / "constraints.txt")]
    package = f"foldback{extra} @ {wheel.as_uri()}"
    (place / "examples").symlink_to(ROOT / "examples")
    setting_prefixes = ("FOLDBACK_", "PYTHON")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(setting_prefixes)}
    environment["PATH"] = str(venv / "bin")
    subprocess.run([*pip, *constraints, package], env=environment, check=True)

    def run(program: str, *arguments: str, status: int = 0) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            [str(venv / "bin" / program), *arguments],
            cwd=place,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == status, (arguments, done.stdout, done.stderr)
        return done

    try:
        yield run
    finally:
        shutil.rmtree(venv)  # more than half a GB


def ten_lines() -> str:
    """Return the program in the README."""
    (text,) = TEN_LINES.findall((ROOT / "README.md").read_text())
    return text


@pytest.mark.long
def test_installation_without_extras_runs_the_planner_and_its_commands(
    wheel: Path, tmp_path: Path
) -> None:
    assert {line.split()[0] for line in PLANNER_COMMANDS} == set(COMMANDS) - set(SERVICE_PACKAGES)
    with installation(wheel, "", tmp_path) as run:
        (tmp_path / "module.json").write_text(json.dumps(CUBE.document))
        assert run("python", "-c", ten_lines()).stdout.startswith("verified (simulated)\n")
        for line in PLANNER_COMMANDS:
            # The wrench is not made for a table.
            run("foldback", *line.split(), status=3 if line.startswith("table") else 0)
        exported = run("foldback", "export", "wrench", "--out", "all").stdout
        assert "Left out: leaflet, leaflet-letter, mcap." in exported
        assert run("foldback-check", "wrench/plan.npz").stdout.startswith("proved")
        refusal = "foldback serve needs the service: pip install 'foldback[service]'\n"
        assert run("foldback", "serve", status=2).stderr == refusal


@pytest.mark.long
def test_installation_with_the_viewer_shows_a_fold(wheel: Path, tmp_path: Path) -> None:
    code = f"""{ten_lines()}
from urllib.request import urlopen
from foldback.viewer import show
with show(plan, port=0) as shown:
    print(urlopen(shown.url).status)
"""
    with installation(wheel, "[viewer]", tmp_path) as run:
        assert run("python", "-c", code).stdout.endswith("\n200\n")
        run("foldback", *PLANNER_COMMANDS[0].split())
        run("foldback", "play", "wrench", status=2)


@pytest.mark.long
def test_installation_with_the_service_serves(wheel: Path, tmp_path: Path) -> None:
    with installation(wheel, "[service]", tmp_path) as run:
        run("python", "-c", ten_lines())
        run("foldback", *PLANNER_COMMANDS[0].split())
        serve = [str(tmp_path / "venv/bin/foldback"), "serve", "--port", "0", "--workers", "0"]
        with subprocess.Popen(
            [*serve, "--data-dir", str(tmp_path / "data")], stdout=subprocess.PIPE, text=True
        ) as serving:
            assert serving.stdout is not None
            address = serving.stdout.readline().split()[-1]
            assert httpx.get(f"{address}/health").status_code == 200
            serving.terminate()
        assert serving.returncode == 0
