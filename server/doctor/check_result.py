"""Check result: finding and remedy of a check of ``foldback doctor``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from foldback.server.settings import Settings

Verdict = Literal["ok", "warning", "problem"]
Check = Callable[[Settings], "CheckResult"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """Result of one check.

    Attributes:
        name: Name of the check, which ``examine`` adds.
        verdict: ``ok``; ``warning``; ``problem`` if the service cannot work.
        finding: Short description of the finding.
        remedy: Advice for solving it; None if there is no problem.
    """

    name: str = ""
    verdict: Verdict
    finding: str
    remedy: str | None = None

    @property
    def line(self) -> str:
        """Finding and remedy in one line."""
        words = f"{self.verdict:<8} {self.name}: {self.finding}"
        return words if self.remedy is None else f"{words}. {self.remedy}"


def ok(text: str) -> CheckResult:
    """Return the result of a successful check."""
    return CheckResult(verdict="ok", finding=text)


def warning(text: str, remedy: str) -> CheckResult:
    """Return the result of a failed check without which the service still works."""
    return CheckResult(verdict="warning", finding=text, remedy=remedy)


def problem(text: str, remedy: str) -> CheckResult:
    """Return the result of a failed check without which the service cannot work."""
    return CheckResult(verdict="problem", finding=text, remedy=remedy)


def examine(checks: Sequence[tuple[str, Check]], settings: Settings) -> list[CheckResult]:
    """Run checks; one that raises an error is a problem and does not stop the others."""
    results: list[CheckResult] = []
    for name, check in checks:
        try:
            finding = check(settings)
        except Exception as error:
            words = f"the check itself failed ({type(error).__name__}: {error})"
            finding = problem(words, "Please report this error.")
        results.append(replace(finding, name=name))
    return results
