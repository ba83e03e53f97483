"""Finds a Chromium for the browser tests, or gets one; prints where it is.

One that is there is taken (``FOLDBACK_CHROMIUM`` names one); else Debian's package when this is
root on a Debian; else Playwright's own download. When nothing works it says so and fails: browser
tests are never skipped.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.debian import install

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


class NoChromiumError(RuntimeError):
    """There is no Chromium, and none could be got."""


def starts(path: str) -> bool:
    """Whether the program at ``path`` answers as a Chromium does."""
    try:
        answer = subprocess.run(
            [path, "--version"], capture_output=True, text=True, timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return answer.returncode == 0 and "Chrom" in answer.stdout


def find() -> str | None:
    """The path of a Chromium that starts, or None."""
    named = os.environ.get("FOLDBACK_CHROMIUM")
    found = [named] if named else [p for n in NAMES if (p := shutil.which(n))]
    if not named:
        found.extend(_downloaded())
    return next((path for path in found if starts(path)), None)


def _downloaded() -> list[str]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        path = playwright.chromium.executable_path
    return [path] if Path(path).exists() else []


def ensure() -> str:
    """The path of a Chromium, got first when there is none.

    Raises:
        NoChromiumError: Saying what was tried and what to do.
    """
    tried: list[str] = []
    for name, get in (("nothing", None), ("apt-get", _by_apt), ("playwright", _by_playwright)):
        if get is not None and not get():
            continue
        tried.append(name)
        if path := find():
            return path
    raise NoChromiumError(
        "The browser tests need a Chromium; found none that starts, and could not get one "
        f"(tried {', '.join(tried[1:]) or 'no installer: none can be used here'}). Install the "
        "package 'chromium', or name one in FOLDBACK_CHROMIUM."
    )


def _by_apt() -> bool:
    return install("chromium")


def _by_playwright() -> bool:
    """Lets Playwright download its own."""
    subprocess.run(
        [sys.executable, "-m", "playwright", "install", "chromium"], stdout=sys.stderr, check=False
    )
    return True


if __name__ == "__main__":
    try:
        print(f"Chromium for the browser tests: {ensure()}")
    except NoChromiumError as error:
        sys.exit(str(error))
