"""*Check this plan*: plans that the page of a fold proves in one worker of Chromium."""

from __future__ import annotations

from typing import Any, Final

from playwright.sync_api import Browser, ViewportSize

from bench.scaling import CASES
from bench.sections import Section
from bench.service.browsing import service_and_browser
from tests.server.service_process import Service

MAX_PROOF_S: Final = {"wrench-160": 1.0, "simultaneous-512": 30.0, "ball-1000": 15.0}
"""Maximum seconds, as the page reports them, to prove the plan of each case."""
PROOFS_PER_PLAN: Final = 3
"""Number of times that the page proves each plan free of collisions, each in a new web worker; the
median time counts."""
PROOF_TIMEOUT_MS: Final = 300_000
"""Maximum time of each step in the browser, such as the proof that a plan is free of collisions, in
ms; beyond it the benchmark ends with an error."""
SIZE: Final[ViewportSize] = {"width": 1366, "height": 768}
"""Size of the browser window, CSS pixels."""
COMPLETE: Final = "() => window.foldback?.timeline.complete"
"""Condition that is true once the page has all frames."""
PAUSED: Final = "foldback.player.send({ do: 'pause' })"
"""Pauses the playback."""


def browser_check(reference_seconds: float) -> Section:
    """Fold each case in a service, then check the plan in the fold's page."""
    section = Section(name="checked")
    with service_and_browser(max_modules=1000) as (service, browser, _):
        folds = {name: _folded(service, name) for name in MAX_PROOF_S}
        for name, fold in folds.items():
            row = _checked(browser, f"{service.http.base_url}/folds/{fold}")
            section.rows.append({"plan": name, **row})
            seconds = sorted(row["s"] or [float("inf")])[len(row["s"]) // 2]
            section.add(
                f"{name}: checked in the page",
                f"{row['verdict']}, {seconds:.2f} s = {seconds / reference_seconds:.1f} references",
                f"≤ {MAX_PROOF_S[name]:g} s",
                row["verdict"] == "proved" and seconds <= MAX_PROOF_S[name],
            )
    return section


def _folded(service: Service, name: str) -> str:
    """Fold a case in the service; return the id of its fold."""
    case = CASES[name]
    options = {
        option.removeprefix("--"): value
        for option, value in zip(case.options[::2], case.options[1::2], strict=True)
    }
    if case.data is None:
        fold = service.fold(shape=case.shape, **options)["id"]
    else:
        sent = {"file": (case.shape, case.data())}
        fold = service.http.post("/api/folds", files=sent, data=options).json()["id"]
    assert service.wait_over(fold)["status"] == "verified", name
    return fold


def _checked(browser: Browser, address: str) -> dict[str, Any]:
    """Prove a plan in its page; return the verdict and the seconds of each proof."""
    context = browser.new_context(viewport=SIZE)
    context.set_default_timeout(PROOF_TIMEOUT_MS)
    page = context.new_page()
    page.goto(address)
    page.wait_for_function(COMPLETE)
    page.evaluate(PAUSED)
    page.locator("#details").click()
    check = page.get_by_role("button", name="Check this plan")
    answer = page.locator("#check-said")
    seconds: list[float] = []
    for _ in range(PROOFS_PER_PLAN):
        page.wait_for_timeout(1000)
        answer.evaluate("answer => delete answer.dataset.outcome")
        check.click()
        page.locator("#check-said[data-outcome]").wait_for()
        if answer.get_attribute("data-outcome") != "proved":
            break
        seconds.append(float(answer.get_attribute("data-seconds") or "nan"))
    verdict = "proved" if len(seconds) == PROOFS_PER_PLAN else answer.inner_text()
    context.close()
    return {"verdict": verdict, "s": seconds}
