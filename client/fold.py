"""Fold of the service: state, results and changes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

import httpx

from foldback.client.frames import Frames
from foldback.client.problem import Problem
from foldback.client.progress import FINAL_STATUSES, Progress, lines_of
from foldback.client.retries import RETRIED_STATUSES
from foldback.client.upload import MovieOptions

if TYPE_CHECKING:
    from foldback.client.client import Client
    from foldback.client.downloads import Place

DIRECT_FILES: Final = frozenset({"plan.json", "plan.npz", "model.xml", "certificate.json"})
"""Files of a fold that the client downloads from ``/api/folds/{id}/{name}``; all others are
exports, which have another address."""


class Fold:
    """A fold, as last reported by the service.

    Args:
        client: Client that requests it.
        fold_id: Id of the fold.
        token: Owner token, which cancel and delete need; None for a fold of another owner.
        existing: True if the same fold had been requested before.
        state: Last reported state.
    """

    def __init__(
        self,
        client: Client,
        fold_id: str,
        *,
        token: str | None,
        existing: bool = True,
        state: dict[str, Any] | None = None,
    ) -> None:
        self._client = client
        self._path = f"/api/folds/{fold_id}"
        self._state = state
        self.id = fold_id
        self.token = token
        self.existing = existing

    def __repr__(self) -> str:
        return f"Fold({self.id!r}, {self._state['status'] if self._state else 'state unknown'})"

    @property
    def state(self) -> dict[str, Any]:
        """State that the service reports; requested once, and again by ``refresh``."""
        return self._state if self._state is not None else self.refresh().state

    @property
    def status(self) -> str:
        """``queued``, ``running``, ``verified``, ``failed`` or ``cancelled``."""
        return self.state["status"]

    @property
    def over(self) -> bool:
        """True if the fold has ended."""
        return self.status in FINAL_STATUSES

    @property
    def verified(self) -> bool:
        """True if the fold ended as a plan that passed its certificate."""
        return self.status == "verified"

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the plan; empty until the fold has ended."""
        return self.state["summary"]

    @property
    def page(self) -> str:
        """Address of the fold's page."""
        return f"{self._client.base_url}/folds/{self.id}"

    def refresh(self) -> Fold:
        """Request the current state and return this fold."""
        self._state = self._client.ask("GET", self._path)
        return self

    def wait(
        self,
        timeout_s: float | None = None,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> Fold:
        """Wait until the fold has ended; reconnect as often as necessary.

        Raises:
            TimeoutError: If the fold has not ended after ``timeout_s``; it continues.
            Problem: If it was deleted.
        """
        deadline = time.monotonic() + (float("inf") if timeout_s is None else timeout_s)
        attempt = 0
        while not self.refresh().over:
            try:
                for progress in self._events(deadline):
                    attempt = 0
                    if on_progress is not None:
                        on_progress(progress)
            except ConnectionError:
                pass
            except Problem as problem:
                if problem.status not in RETRIED_STATUSES:
                    raise
            # Without a stream the state is polled.
            attempt += 1
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 and not self.refresh().over:
                raise TimeoutError(
                    f"The fold {self.id} is still {self.status} after {timeout_s} s."
                )
            if not self.over:
                time.sleep(max(0.0, min(self._client.retries.spread_s(attempt), 5.0, left_s)))
        if on_progress is not None:
            on_progress(Progress.of(self.state["progress"]))
        return self

    def frames(
        self, start: int = 0, stop: int | None = None, stride: int = 1, *, poses: bool = False
    ) -> Iterator[Frames]:
        """Yield the available frames, page by page.

        Args:
            start: Number of the first frame.
            stop: Number after the last frame; all available frames if None.
            stride: Step between frame numbers.
            poses: True to include the poses of all modules.

        Raises:
            Problem: If there are no such frames, or there is no timeline (yet).
        """
        options = {"from": start, "to": stop, "stride": stride, "poses": "true" if poses else None}
        query = {name: value for name, value in options.items() if value is not None}
        path: str | None = f"{self._path}/frames?{httpx.QueryParams(query)}"
        while path is not None:
            page = self._client.ask("GET", path)
            yield Frames.of(page)
            path = page["next"]

    def exports(self) -> list[dict[str, Any]]:
        """Return the formats in which a finished fold can be downloaded, by ``name``.

        Raises:
            Problem: If the fold has not finished.
        """
        return self._client.ask("GET", f"{self._path}/exports")["exports"]

    def download(self, name: str, to: Place) -> Path:
        """Download ``plan.json``, ``plan.npz``, ``model.xml``, ``certificate.json`` or an export.

        Args:
            name: Name of the file or of an export, such as ``urdf``.
            to: The file to write, or an existing directory. Incomplete files never appear there.

        Raises:
            Problem: If the service does not have it (yet).
            OSError: If it cannot be written.
        """
        if name in DIRECT_FILES:
            return self._client.save(f"{self._path}/{name}", Path(to), name)
        filename = name
        if Path(to).is_dir():
            filename = next((e["filename"] for e in self.exports() if e["name"] == name), name)
        return self._client.save(f"{self._path}/exports/{name}", Path(to), filename)

    def movie(
        self,
        to: Place,
        *,
        timeout_s: float | None = None,
        on_progress: Callable[[int, int], None] | None = None,
        **options: Unpack[MovieOptions],
    ) -> Path:
        """Request a movie and download it.

        Args:
            to: The file to write; its ending determines the format unless ``format`` does.
            timeout_s: Maximum time to wait, in s.
            on_progress: Called with the numbers of drawn pictures and of all pictures.
            options: Options of the movie.

        Raises:
            Problem: If the movie cannot be created.
            TimeoutError: If it takes longer; the service continues to create it.
        """
        deadline = time.monotonic() + (float("inf") if timeout_s is None else timeout_s)
        if Path(to).suffix.lower() == ".gif":
            options.setdefault("format", "gif")
        movie = self._client.ask("POST", f"{self._path}/movies", json=options, token=self.token)
        movie_path = f"{self._path}/movies/{movie['id']}"
        while movie["status"] in ("queued", "running"):
            if on_progress is not None:
                on_progress(movie["frames_done"], movie["frames_total"])
            if time.monotonic() >= deadline:
                raise TimeoutError(f"The movie is still {movie['status']} after {timeout_s} s.")
            time.sleep(max(0.0, min(0.5, deadline - time.monotonic())))
            movie = self._client.ask("GET", movie_path)
        if movie["status"] == "failed":
            problem = movie["problem"] or {}
            detail = problem.get("detail", "the service gave no reason.")
            raise Problem(
                problem.get("code", "failed"),
                detail,
                where=problem.get("where"),
                values=problem.get("values"),
            )
        return self._client.save(f"{movie_path}/file", Path(to), f"{self.id}.{movie['format']}")

    def cancel(self) -> Fold:
        """Cancel the fold.

        Raises:
            Problem: If the token is not its owner's, or others have requested the same gallery
                shape.
        """
        self._client.ask("POST", f"{self._path}/cancel", token=self.token, retried_statuses={403})
        return self.refresh()

    def rename(self, name: str) -> Fold:
        """Change the name of the fold on pages, in lists and in file names.

        Args:
            name: 1 to 200 characters.

        Raises:
            Problem: If the token is not its owner's, or it belongs to the gallery.
        """
        self._state = self._client.ask("PATCH", self._path, json={"name": name}, token=self.token)
        return self

    def delete(self) -> None:
        """Delete the fold permanently.

        Raises:
            Problem: If the token is not its owner's, or it belongs to the gallery.
        """
        self._client.ask("DELETE", self._path, token=self.token, retried_statuses={403, 404})

    def _events(self, deadline: float) -> Iterator[Progress]:
        # the service sends an event at least every 15 s
        silence_s = max(0.001, min(45.0, deadline - time.monotonic()))
        with self._client.opened(f"{self._path}/events", silence_s=silence_s) as answer:
            for event in lines_of(answer):
                if event is not None and event[0] == "progress":
                    progress = Progress.of(json.loads(event[1]))
                    if progress.status in FINAL_STATUSES:  # ``wait`` reports the end
                        return
                    yield progress
                if time.monotonic() >= deadline:
                    return
