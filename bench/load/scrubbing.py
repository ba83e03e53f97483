"""Scrubbing: many visitors of one finished fold, and a few of others, while two folds compute."""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import psutil

from bench.load.loopback import serving
from bench.load.visitors import Visits, percentile_ms
from bench.sections import Section
from tests.server.service_process import SNAKE, Service

SHAPE = "wrench-160"
"""Shape of the gallery whose fold most visitors view."""
MAX_PAGE_DURING_SCRUBS_MS = 100
"""Target for the 95th percentile of the time of page loads and API requests while 120 visitors move
their sliders, in ms; at or above it the load test fails."""
MAX_SCRUB_MS = 150
"""Target for the 95th percentile of the time to fetch the frames at a slider's new position while
120 visitors move their sliders, in ms; at or above it the load test fails."""


def scrubbing(short: bool = False) -> Section:
    """Measure pages, API and scrubs; in short, with fewer visitors for a few seconds."""
    section = Section(name="scrubbing")
    together, apart, seconds = (15, 3, 2.0) if short else (100, 20, 45.0)
    with serving(
        workers=1 if short else 2, niceness=19, largest_queue_of_visitor=apart + 5
    ) as service:
        main = service.fold(shape="wrench-24" if short else SHAPE)["id"]
        count = 2 if short else apart
        other_ids = [service.fold(SNAKE, seed=str(k))["id"] for k in range(count)]
        for fold in (main, *other_ids):
            assert service.wait_over(fold)["status"] == "verified"
        for name, computing in (("nothing", 0), ("two folds", 2)):
            if short and not computing:
                continue
            stopping = threading.Event()
            threads = [
                threading.Thread(target=_compute, args=(service, k, stopping))
                for k in range(computing)
            ]
            for thread in threads:
                thread.start()
            web = _cpu_s(service)
            visits = Visits(
                address=str(service.http.base_url),
                folds=[main] * together + [other_ids[k % count] for k in range(apart)],
                seconds=seconds,
                streams=together,
            )
            measured = visits.run()
            web = _cpu_s(service) - web
            stopping.set()
            for thread in threads:
                thread.join()
            label = f"{together} + {apart} visitors, {name} computed"
            _tell(section, label, measured, web, judged=not short)
    return section


def _tell(
    section: Section, label: str, figures: dict[str, Any], web_cpu_s: float, *, judged: bool
) -> None:
    for phase in ("arriving", "times"):
        for kind, values in sorted(figures[f"{phase}_s"].items()):
            section.rows.append(
                {
                    "what": label,
                    "kind": f"{kind}, as all come within 3 s" if phase == "arriving" else kind,
                    "requests": len(values),
                    "p50, ms": percentile_ms(values, 50),
                    "p95, ms": percentile_ms(values, 95),
                    "p99, ms": percentile_ms(values, 99),
                    "most, ms": percentile_ms(values, 100),
                }
            )
    times = figures["times_s"]
    pages = percentile_ms(times.get("page", []) + times.get("API", []), 95)
    scrubs = percentile_ms(times.get("scrub", []) + times.get("batch", []), 95)
    for name, measured, bar in (
        ("page and API", pages, MAX_PAGE_DURING_SCRUBS_MS),
        ("scrub", scrubs, MAX_SCRUB_MS),
    ):
        is_met = measured < bar if judged else None
        section.add(f"{name} p95, {label}", f"{measured:.0f} ms", f"< {bar} ms", is_met)
    section.add(f"errors, {label}", json.dumps(figures["errors"]), "none", not figures["errors"])
    section.add(
        f"cores, {label}",
        f"web {web_cpu_s / figures['wall_s']:.2f}, the visitors themselves "
        f"{figures['cpu_s'] / figures['wall_s']:.2f}",
    )


def _cpu_s(service: Service) -> float:
    assert service.process is not None
    times = psutil.Process(service.process.pid).cpu_times()
    return times.user + times.system


def _compute(service: Service, number: int, stopping: threading.Event) -> None:
    """Keep the service computing folds until the event is set."""
    seed = 1000 * (number + 1)
    while not stopping.is_set():
        seed += 1
        fold = service.fold(shape=SHAPE, seed=str(seed))
        while not stopping.is_set():
            if service.state(fold["id"])["status"] in ("verified", "failed", "cancelled"):
                break
            time.sleep(0.5)
        else:
            token = {"Authorization": f"Bearer {fold['owner_token']}"}
            service.http.post(f"/api/folds/{fold['id']}/cancel", headers=token)
