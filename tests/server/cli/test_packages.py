"""Packages: imports in one direction only, and complete installation."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

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


def test_library_needs_no_service_no_viewer_and_no_checkout(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path)
    unwanted = ("fastapi", "starlette", "uvicorn", "viser", "sqlalchemy", "typer")
    code = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
for name in {unwanted}:
    sys.modules[name] = None  # whoever imports it fails
import foldback
assert not {{"numpy", "mujoco", "numba"}} & set(sys.modules), "they are for who uses them"
for name in foldback.__all__:
    getattr(foldback, name)
from foldback.viewer import Show, show
assert isinstance(show, Show)
from foldback.planner.readers.gallery import gallery
print(foldback.__file__, *(shape.name for shape in gallery()))
"""
    library = [sys.executable, "-P", "-c", code]
    done = subprocess.run(library, cwd=tmp_path, check=True, capture_output=True, text=True)
    where, *names = done.stdout.split()
    assert Path(where).is_relative_to(tmp_path)
    assert sorted(names) == sorted(p.stem for p in (ROOT / "examples" / "shapes").glob("*.json"))
