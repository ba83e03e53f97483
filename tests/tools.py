"""Programs that tests need besides Python: they are located or installed.

``python -m tests.tools`` installs missing ones, and reports in one line those that it could not
install. As root on a Debian it installs packages; Chromium may also be Playwright's own download.
``FOLDBACK_CHROMIUM`` names another Chromium, ``FOLDBACK_POSTGRES`` another directory of
PostgreSQL's programs. Tests whose program is missing fail; they are never skipped.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CHROMIUMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
POSTGRES_PROGRAMS = ("initdb", "postgres")
POSTGRES_OF_DEBIAN = Path("/usr/lib/postgresql")
GL_BACKENDS = ("egl", "osmesa")


class MissingToolError(RuntimeError):
    """Error of a program that is missing and could not be installed."""


@dataclass(frozen=True, slots=True)
class Tool:
    """One program, or a library that counts as one.

    Args:
        name: Name for people.
        packages: Debian packages that contain it.
        find: Function that returns its path, or None.
        download: Function that installs it without root.
    """

    name: str
    packages: tuple[str, ...]
    find: Callable[[], str | None]
    download: Callable[[], None] | None = None

    def get(self) -> str:
        """Return the path of the program; install it first if it is missing.

        Raises:
            MissingToolError: If it cannot be installed; the error names the command to do so.
        """
        if program := self.find() or _install([self]).get(self.name):
            return program
        raise MissingToolError(_words([self]))


def _starts_chromium(path: str) -> bool:
    try:
        answer = subprocess.run(
            [path, "--version"], capture_output=True, text=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return answer.returncode == 0 and "Chrom" in answer.stdout


def _find_chromium() -> str | None:
    named = os.environ.get("FOLDBACK_CHROMIUM")
    programs = [named] if named else [path for name in CHROMIUMS if (path := shutil.which(name))]
    if not (named or programs):
        from playwright.sync_api import sync_playwright

        with sync_playwright() as playwright:
            programs = [playwright.chromium.executable_path]
    return next((path for path in programs if _starts_chromium(path)), None)


def _download_chromium() -> None:
    subprocess.run(
        [sys.executable, "-m", "playwright", "install", "chromium"],
        stdout=subprocess.DEVNULL,
        check=False,
    )


def _find_postgres() -> str | None:
    """Return the directory with PostgreSQL's programs, the newest version first."""
    named, on_path = os.environ.get("FOLDBACK_POSTGRES"), shutil.which("postgres")
    of_debian = [p for p in POSTGRES_OF_DEBIAN.glob("*") if p.name.isdecimal()]
    places = [
        *([Path(on_path).resolve().parent] if on_path else []),
        *(p / "bin" for p in sorted(of_debian, key=lambda p: -int(p.name))),
    ]
    for place in [Path(named)] if named else places:
        if all(os.access(place / program, os.X_OK) for program in POSTGRES_PROGRAMS):
            return str(place)
    return None


def _find_headers() -> str | None:
    """Return the directory with the numbers of system calls."""
    place = Path("/usr/include")
    return str(place) if (place / "asm-generic" / "unistd.h").is_file() else None


def _draws(backend: str) -> bool:
    """Return True if a process of its own can open a window with a backend."""
    code = f"from mujoco.{backend} import GLContext; GLContext(64, 64).make_current()"
    answer = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        timeout=120,
        check=False,
    )
    return answer.returncode == 0


CHROMIUM = Tool("Chromium", ("chromium",), _find_chromium, _download_chromium)
FIREFOX = Tool(
    "Firefox",
    ("firefox-esr",),
    lambda: next(filter(None, map(shutil.which, ("firefox-esr", "firefox"))), None),
)
XVFB = Tool("Xvfb", ("xvfb",), lambda: shutil.which("Xvfb"))
POSTGRES = Tool("PostgreSQL", ("postgresql",), _find_postgres)
CADDY = Tool("Caddy", ("caddy",), lambda: shutil.which("caddy"))
# For the long tests alone, so that it is not in TOOLS.
SLURM = Tool(
    "SLURM",
    ("slurmctld", "slurmd", "slurm-client", "munge"),
    lambda: shutil.which("slurmctld", path=f"{os.environ['PATH']}{os.pathsep}/usr/sbin"),
)
SYSTEMD = Tool("systemd-analyze", ("systemd",), lambda: shutil.which("systemd-analyze"))
LINUX_HEADERS = Tool("headers of the Linux kernel", ("linux-libc-dev",), _find_headers)
OPENGL = Tool(
    "OpenGL without a screen",
    ("libegl1", "libgl1", "libgl1-mesa-dri"),
    lambda: next((backend for backend in GL_BACKENDS if _draws(backend)), None),
)
TOOLS = (CHROMIUM, FIREFOX, XVFB, POSTGRES, CADDY, SYSTEMD, LINUX_HEADERS, OPENGL)


def _install(missing: list[Tool]) -> dict[str, str]:
    """Try to install tools; return the paths of those that now exist."""
    packages = [package for tool in missing for package in tool.packages]
    if os.geteuid() == 0 and shutil.which("apt-get"):
        print(f"Installing {', '.join(packages)}, once …", file=sys.stderr)
        environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        for command in (
            ["apt-get", "update", "-qq"],
            ["apt-get", "install", "-qq", "--yes", "--no-install-recommends", *packages],
        ):
            subprocess.run(command, env=environment, stdout=subprocess.DEVNULL, check=False)
    for tool in missing:
        if tool.download and not tool.find():
            print(f"Downloading {tool.name}, once …", file=sys.stderr)
            tool.download()
    return {tool.name: program for tool in missing if (program := tool.find())}


def _words(missing: list[Tool]) -> str:
    packages = " ".join(package for tool in missing for package in tool.packages)
    return (
        f"Missing for the tests: {', '.join(tool.name for tool in missing)}. Run `sudo apt-get "
        f"install {packages}`; all that needs none of them is run by `make test-fast`."
    )


def main() -> None:
    """Install missing programs."""
    missing = [tool for tool in TOOLS if not tool.find()]
    if missing:
        installed = _install(missing)
        if missing := [tool for tool in missing if tool.name not in installed]:
            sys.exit(_words(missing))


if __name__ == "__main__":
    main()
