"""Fixture of an empty service with Chromium to open its pages."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.browser.conftest import FLAGS
from tests.server.service_process import Service
from tests.tools import CHROMIUM


@contextmanager
def service_and_browser(**settings: object) -> Generator[tuple[Service, Browser, Path]]:
    """Yield a warm service, a browser, and a folder for files; end and delete them afterwards."""
    with (
        tempfile.TemporaryDirectory(prefix="foldback-bench-") as folder,
        sync_playwright() as playwright,
    ):
        service = Service(Path(folder) / "data", **{"prewarm": True, **settings}).start()
        browser = playwright.chromium.launch(executable_path=CHROMIUM.get(), args=FLAGS)
        try:
            yield service, browser, Path(folder)
        finally:
            browser.close()
            service.stop()
