"""Witness: a thread that watches folds and detects lost, incomplete and repeated ones."""

from __future__ import annotations

import hashlib
import io
import json
import random
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, Final

import httpx
import numpy as np

from tests.server.service_process import over

FOLDS_POLL_S: Final = 0.05
"""Time between two checks of all folds by the thread that looks for lost, incomplete or changed
ones, in s."""
FILES: Final = ("plan.json", "plan.npz", "certificate.json", "model.xml")
"""Files of a verified fold that are compared."""


@dataclass(slots=True, kw_only=True)
class Seen:
    """Observations of one acknowledged fold.

    Attributes:
        id: Id of the fold.
        faults: Faults that occurred before it ended.
        statuses: Its statuses in order, without repetitions.
        end: Status, summary and error at its end; None until then.
        digest: Digest of its files; None until they were checked.
    """

    id: str
    faults: set[str] = field(default_factory=set)
    statuses: list[str] = field(default_factory=list)
    end: dict[str, Any] | None = None
    digest: str | None = None


class Witness:
    """Thread that polls acknowledged folds.

    Attributes:
        folds: Observations by id.
        problems: Descriptions of the contradictions found.
        errors: Answers of 500 and above, by status and condition.
        condition: Current fault, which excuses such answers; empty if there is none.
        looks: Number of requests for folds.
    """

    def __init__(self, address: Any) -> None:
        self._address = address
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._rng = random.Random(0)
        self.folds: dict[str, Seen] = {}
        self.problems: list[str] = []
        self.errors: Counter[str] = Counter()
        self.condition = ""
        self.looks = 0
        self._thread = threading.Thread(target=self._watch, name="witness", daemon=True)
        self._thread.start()

    def acknowledged(self, fold_id: str) -> None:
        """Add an accepted fold, which must exist from now on."""
        with self._lock:
            self.folds.setdefault(fold_id, Seen(id=fold_id))

    def happens(self, fault: str) -> None:
        """Record a fault for all folds that have not ended."""
        with self._lock:
            for fold in self.folds.values():
                if fold.end is None:
                    fold.faults.add(fault)

    def waiting(self) -> list[Seen]:
        """Return the folds whose end has not been seen and checked yet."""
        with self._lock:
            return [fold for fold in self.folds.values() if fold.digest is None]

    def close(self) -> None:
        """Stop the thread."""
        self._stopping.set()
        self._thread.join()

    def look_again(self) -> None:
        """Check all folds and their files once more."""
        with httpx.Client(base_url=self._address(), timeout=60.0) as http:
            for fold in list(self.folds.values()):
                self._look(http, fold)
                before, fold.digest = fold.digest, None
                if fold.end is not None:
                    self._look_into(http, fold)
                if before is not None and fold.digest != before:
                    self._tell(fold, "its plan has changed after its end")

    def _watch(self) -> None:
        http: httpx.Client | None = None
        address = ""
        while not self._stopping.wait(FOLDS_POLL_S):
            now = self._address()
            if now != address or http is None:
                if http is not None:
                    http.close()
                http, address = httpx.Client(base_url=now, timeout=30.0), now
            looked_at = self.waiting()
            with self._lock:
                ended = [fold for fold in self.folds.values() if fold.digest is not None]
            looked_at += self._rng.sample(ended, min(2, len(ended)))
            for fold in looked_at:
                try:
                    self._look(http, fold)
                    if fold.end is not None and fold.digest is None:
                        self._look_into(http, fold)
                except (httpx.HTTPError, httpx.InvalidURL):
                    time.sleep(FOLDS_POLL_S)  # the service was killed, or its port has changed
                    break
        if http is not None:
            http.close()

    def _look(self, http: httpx.Client, fold: Seen) -> None:
        answer = http.get(f"/api/folds/{fold.id}")
        self.looks += 1
        if answer.status_code >= 500:
            self._failed(fold, answer)
            return
        if answer.status_code != 200:
            self._tell(fold, f"was acknowledged and is lost: {answer.text[:200]}")
            return
        state = answer.json()
        status = state["status"]
        if not fold.statuses or fold.statuses[-1] != status:
            fold.statuses.append(status)
        if not over(state):
            if fold.end is not None:
                self._tell(fold, f"was over and goes on: {' → '.join(fold.statuses)}")
            return
        end = {key: state[key] for key in ("status", "summary", "error")}
        if fold.end is None:
            fold.end = end
        elif end != fold.end:
            self._tell(fold, f"ended twice, as {_short(fold.end)} and as {_short(end)}")

    def _look_into(self, http: httpx.Client, fold: Seen) -> None:
        """Fetch the page and the files of a fold that has ended, and check them."""
        assert fold.end is not None
        page = http.get(f"/folds/{fold.id}")
        if self._excused(fold, page):
            return
        if page.status_code != 200:
            self._tell(fold, f"its page is answered with {page.status_code}")
        if fold.end["status"] != "verified":
            fold.digest = "none"
            return
        digest = hashlib.sha256()
        files: dict[str, bytes] = {}
        for name in FILES:
            answer = http.get(f"/api/folds/{fold.id}/{name}")
            if self._excused(fold, answer):
                return
            if answer.status_code != 200:
                self._tell(fold, f"is verified, and {name} is answered with {answer.text[:200]}")
                fold.digest = "none"
                return
            files[name] = answer.content
            digest.update(answer.content)
        frames = http.get(f"/api/folds/{fold.id}/frames")
        batch = http.get(f"/folds/{fold.id}/batch")
        for answer in (frames, batch):
            if self._excused(fold, answer):
                return
        try:
            if problem := _disagreement(files, frames, batch):
                self._tell(fold, problem)
        except (ValueError, KeyError, IndexError, OSError, EOFError) as error:
            self._tell(fold, f"is verified, and a part of it can't be read: {error!r}")
        fold.digest = digest.hexdigest()

    def _excused(self, fold: Seen, answer: httpx.Response) -> bool:
        """Count an error response; return True if the current condition excuses it."""
        if answer.status_code < 500 or not self.condition:
            return False
        self._failed(fold, answer)
        return True

    def _failed(self, fold: Seen, answer: httpx.Response) -> None:
        self.errors[f"{answer.status_code} {self.condition}".strip()] += 1
        if not self.condition:
            self._tell(fold, f"is answered with {answer.status_code}: {answer.text[:200]}")

    def _tell(self, fold: Seen, problem: str) -> None:
        event = f"{fold.id} ({', '.join(sorted(fold.faults)) or 'nothing'} happened): {problem}"
        if event not in self.problems:
            self.problems.append(event)


def _disagreement(
    files: dict[str, bytes], frames: httpx.Response, batch: httpx.Response
) -> str | None:
    """Describe how the parts of a verified fold contradict each other; None if they agree."""
    if frames.status_code != 200 or batch.status_code != 200:
        return f"is verified, and its timeline is answered with {frames.text[:200]}"
    body, plan = frames.json(), json.loads(files["plan.json"])
    if body["status"] != "complete":
        return f"is verified, and its timeline is {body['status']}"
    with np.load(io.BytesIO(files["plan.npz"]), allow_pickle=False) as arrays:
        angles = arrays["joint_angles_rad"]
        lengths = {len(arrays[name]) for name in ("time_s", "root_position", "root_wxyz")}
    view = [k for k, phase in enumerate(body["phase"]) if body["phases"][phase] == "playback"]
    if lengths != {len(angles)} or len(plan["time_s"]) != len(angles):
        return f"plan.json has {len(plan['time_s'])} frames, plan.npz {len(angles)} and {lengths}"
    if len(body["phase"]) == body["total"] and len(view) != len(angles):
        return f"its plan has {len(angles)} frames and its timeline {len(view)}"
    if view and not np.allclose(body["joint_angles_rad"][view[-1]], angles[-1], atol=1e-3):
        return "its timeline ends elsewhere than its plan"
    if not json.loads(files["certificate.json"])["verified"]:
        return "is verified, and its certificate is not"
    return None


def _short(end: dict[str, Any]) -> str:
    return f"{end['status']} {json.dumps(end['error'] or end['summary'])[:300]}"
