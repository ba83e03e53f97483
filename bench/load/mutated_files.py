"""Mutated files: thousands of broken files sent to previews and folds."""

from __future__ import annotations

import asyncio
import json
import random
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import httpx
import psutil

from bench.load.loopback import serving
from bench.load.mutations import Upload, made, valid
from bench.sections import Section
from tests.server.service_process import Service

OUT: Final = Path("out/load/mutated")
"""Directory of the files that caused an error, and of the log."""
CONCURRENT_UPLOADS: Final = 4
"""Number of damaged files that are uploaded at the same time."""
UPLOAD_TIMEOUT_S: Final = 60.0
"""Maximum time that the service may take to answer the upload of a damaged file, in s; beyond it
the upload counts as unanswered and the load test fails."""
MAX_MUTATED_GROWTH_MB: Final = 50.0
"""Maximum growth of the resident memory of any process of the service from the first 1000 damaged
uploads to the last one, in MB; above it the load test fails, as the process leaks memory."""
FORMS: Final[tuple[dict[str, str], ...]] = (
    *({}, {}, {}, {"modules": "40"}, {"module": "tetrahedron"}, {"method": "blocks"}),
    *({"method": "exact", "modules": "24"}, {"as_voxels": "true"}, {"repair": "true"}),
    *({"start": "0,0,0"}, {"modules": "999999999"}, {"seed": "-1"}, {"module_size": "nan"}),
)
"""Form fields that are sent with a file, one of them at random."""


def mutated_uploads(short: bool = False, *, first: int = 0) -> Section:
    """Count the answers to the uploads of a range of seeds, and measure the memory of readers."""
    section = Section(name="mutated")
    count = 150 if short else 10_000
    answers: Counter[str] = Counter()
    wrong: list[str] = []
    with serving(
        workers=0, largest_queue=10**6, largest_queue_of_visitor=10**6, previews_bytes=64 * 2**20
    ) as service:
        sender = _Sender(str(service.http.base_url), answers, wrong)
        warm = count // 3 if short else 1000
        start_s = time.monotonic()
        asyncio.run(sender.send(range(first, first + warm)))
        before = _resident_mb(service)
        asyncio.run(sender.send(range(first + warm, first + count)))
        took_s = time.monotonic() - start_s
        after = _resident_mb(service)
        alive = service.http.get("/health").status_code == 200
        log = service.log.read_text()
    for name, mb in before.items():
        section.rows.append({"process": name, "before, MB": mb, "after, MB": after.get(name, 0.0)})
    section.add(
        f"{count} mutated uploads from seed {first} on, in {took_s:.0f} s",
        json.dumps(dict(sorted(answers.items()))),
    )
    bad = [text for text in wrong if " answered 5" in text]
    hung = [text for text in wrong if text not in bad]
    section.add("answers of 500 and above", str(len(bad)), "0", not bad)
    section.add("no answer", str(len(hung)), "0", not hung)
    section.add("alive at the end", str(alive), "True", alive)
    tracebacks = log.count("Traceback")
    section.add("tracebacks in the log", str(tracebacks), "0", tracebacks == 0)
    grown = max(after.get(name, 0.0) - mb for name, mb in before.items())
    section.add(
        f"memory after {count}, against that after {warm}",
        f"{grown:+.0f} MB",
        f"≤ {MAX_MUTATED_GROWTH_MB:.0f} MB",
        grown <= MAX_MUTATED_GROWTH_MB,
    )
    for text in wrong[:20]:
        section.add("what went wrong", text, "", False)
    if tracebacks:
        OUT.mkdir(parents=True, exist_ok=True)
        (OUT / "service.log").write_text(log)
    return section


class _Sender:
    """Sender of mutated files that counts the answers."""

    def __init__(self, address: str, answers: Counter[str], wrong: list[str]) -> None:
        self._address = address
        self._answers = answers
        self._wrong = wrong
        self._files = valid()

    async def send(self, seeds: range) -> None:
        """Send the uploads of the seeds, a few at the same time."""
        remaining = iter(seeds)

        async def send_next() -> None:
            for seed in remaining:
                await self._send_one(http, seed)

        async with httpx.AsyncClient(base_url=self._address, timeout=UPLOAD_TIMEOUT_S) as http:
            await asyncio.gather(*(send_next() for _ in range(CONCURRENT_UPLOADS)))

    async def _send_one(self, http: httpx.AsyncClient, seed: int) -> None:
        upload = made(seed, self._files)
        rng = random.Random(-seed)
        route = "/api/folds" if rng.random() < 0.5 else "/api/shapes/preview"
        form = rng.choice(FORMS)
        try:
            answer = await http.post(
                route,
                data=form,
                files={"file": (upload.filename, upload.data, upload.media_type)},
            )
        except httpx.HTTPError as error:
            self._keep(seed, upload, f"{route} {form}: no answer, {type(error).__name__}")
            return
        code = _code(answer)
        self._answers[f"{answer.status_code} {code}".strip()] += 1
        if answer.status_code >= 500:
            self._keep(seed, upload, f"{route} {form} answered {answer.status_code} {code}")

    def _keep(self, seed: int, upload: Upload, outcome: str) -> None:
        OUT.mkdir(parents=True, exist_ok=True)
        (OUT / f"{seed}.bin").write_bytes(upload.data)
        (OUT / f"{seed}.txt").write_text(f"{outcome}\n{upload.filename!r} {upload.media_type!r}\n")
        self._wrong.append(f"seed {seed}: {upload.filename!r} to {outcome}")


def _code(answer: httpx.Response) -> str:
    with suppress(ValueError, KeyError, TypeError):
        body: Any = answer.json()
        return str(body["code"])
    return ""


def _resident_mb(service: Service) -> dict[str, float]:
    """Return the resident memory of the web process and of the reading children, MB."""
    assert service.process is not None
    memory_mb = {"web": psutil.Process(service.process.pid).memory_info().rss / 1e6}
    for kind in ("reader", "preparer"):
        for child in service.children():
            if kind in child.cmdline():
                memory_mb[kind] = child.memory_info().rss / 1e6
    return memory_mb
