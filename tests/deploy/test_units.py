import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.deploy.files import DEPLOY
from tests.tools import SYSTEMD

UNITS = ("foldback-web.service", "foldback-worker@.service")
DROP_IN = "foldback-.service.d/common.conf"
"""Drop-in that both units share."""
MAX_EXPOSURE = 20
"""Maximum exposure according to systemd-analyze, in tenths; network and kernels cause 1.4."""


@pytest.fixture
def units(tmp_path: Path) -> list[Path]:
    """Return copies of the units with a program that exists on this machine."""
    paths: list[Path] = []
    (tmp_path / DROP_IN).parent.mkdir()
    shutil.copy(DEPLOY / "systemd" / DROP_IN, tmp_path / DROP_IN)
    for name in UNITS:
        path = tmp_path / name.replace("@", "@1")
        text = (DEPLOY / "systemd" / name).read_text()
        # A path in a unit has no spaces; the checkout's may have some.
        program = tmp_path.with_name(f"{tmp_path.name}-python")
        if not program.exists():
            program.symlink_to(sys.executable)
        path.write_text(text.replace("/opt/foldback/bin/foldback", str(program)))
        paths.append(path)
    return paths


def analyze(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [SYSTEMD.get(), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_systemd_accepts_the_units_and_finds_mistakes(units: list[Path]) -> None:
    done = analyze("verify", "--man=no", *units)
    assert done.returncode == 0 and not done.stderr, done.stderr
    drop_in = units[0].parent / DROP_IN
    drop_in.write_text(drop_in.read_text().replace("KillMode=mixed", "KilMode=mixed"))
    assert "KilMode" in analyze("verify", "--man=no", units[0]).stderr


def test_units_are_confined_by_their_drop_in(units: list[Path], tmp_path: Path) -> None:
    rated = ("security", "--offline=true", f"--threshold={MAX_EXPOSURE}")
    done = analyze(*rated, *units)
    assert done.returncode == 0, done.stdout[-400:]
    (tmp_path / DROP_IN).unlink()
    for unit in units:
        assert analyze(*rated, unit).returncode != 0


@pytest.mark.parametrize("name", UNITS)
def test_units_drain_before_they_are_killed(name: str) -> None:
    text = (DEPLOY / "systemd" / name).read_text()
    drain_s = re.search(r"FOLDBACK_DRAIN_S=(\d+)", text)
    stop_s = re.search(r"TimeoutStopSec=(\d+)", text)
    assert drain_s and stop_s and int(stop_s[1]) >= int(drain_s[1]) + 15


def test_units_repeat_nothing_of_their_drop_in() -> None:
    def lines(name: str) -> list[str]:
        computed_lines = (DEPLOY / "systemd" / name).read_text().splitlines()
        return [line for line in computed_lines if line and line[0] not in "#["]

    shared = lines(DROP_IN)
    assert len(shared) > 40 and len(shared) == len(set(shared))
    for name in UNITS:
        own_lines = set(lines(name))
        assert not own_lines & set(shared)
        # The drop-in would override settings of a unit.
        keys, wrapped_keys = (
            {line.partition("=")[0] for line in unit_lines} for unit_lines in (own_lines, shared)
        )
        assert keys & wrapped_keys <= {"Environment", "After"}


def test_computing_processes_may_confine_themselves() -> None:
    """The first system calls of their sandbox are among those that the unit permits."""
    text = (DEPLOY / "systemd" / DROP_IN).read_text()
    allowed: set[str] = set()
    for line in re.findall(r"^SystemCallFilter=(.*)$", text, re.MULTILINE):
        calls = {call for name in line.lstrip("~").split() for call in calls_of(name)}
        allowed = allowed - calls if line.startswith("~") else allowed | calls
    landlock = {"landlock_create_ruleset", "landlock_add_rule", "landlock_restrict_self"}
    assert landlock | {"seccomp", "prctl", "setpriority", "setrlimit", "prlimit64"} <= allowed
    assert "SystemCallErrorNumber=EPERM" in text


def calls_of(name: str) -> set[str]:
    """Return the system calls of one of systemd's groups, or the name itself if it is no group."""
    if not name.startswith("@"):
        return {name}
    lines = analyze("syscall-filter", name).stdout.splitlines()[1:]
    inside = {line.strip() for line in lines if line.strip() and not line.strip().startswith("#")}
    return {call for unit_lines in inside for call in calls_of(unit_lines)}


def test_sysusers_makes_the_user(tmp_path: Path) -> None:
    place = tmp_path / "usr" / "lib" / "sysusers.d"
    place.mkdir(parents=True)
    shutil.copy(DEPLOY / "systemd" / "foldback.sysusers", place / "foldback.conf")
    (tmp_path / "etc").mkdir()
    SYSTEMD.get()
    done = subprocess.run(
        ["systemd-sysusers", f"--root={tmp_path}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "foldback" in (tmp_path / "etc" / "passwd").read_text()
