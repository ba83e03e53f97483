"""Progress of a run on several processes: a line for each tenth, and failures immediately."""

import time

import pytest

STEP = 10
"""Interval between two lines, in per cent of the tests."""


class Progress:
    """Plugin that replaces the dots of ``pytest -n``."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._start_s = time.monotonic()
        self._over = 0
        self._reported_share = 0
        self._failed = 0

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, str] | None:
        """Print no letter for a test, but count it."""
        if report.failed:
            return "failed" if report.when == "call" else "error", "", ""
        return ("passed", "", "") if report.passed and report.when == "call" else None

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count a finished test and print failures and progress."""
        terminal = self._config.pluginmanager.get_plugin("terminalreporter")
        if report.failed:
            self._failed += 1
            terminal.ensure_newline()
            terminal.write_line(f"  failed: {report.nodeid}", red=True)
            terminal.flush()
        if report.when != "teardown":
            return
        self._over += 1
        every = terminal._session.testscollected
        share = STEP * (100 * self._over // every // STEP)
        if share > self._reported_share:
            self._reported_share = share
            seconds = time.monotonic() - self._start_s
            failed = f", {self._failed} failed" if self._failed else ""
            terminal.ensure_newline()
            terminal.write_line(
                f"  {share:3d} %  {self._over} of {every} tests{failed}, "
                f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
            )
            terminal.flush()  # also if the output is a file


def add_to(config: pytest.Config) -> None:
    """Report progress if tests run on several processes; other runs keep pytest's output."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(config), "progress")
