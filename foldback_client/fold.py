"""Fold: one fold of the service, to follow and to download."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Unpack

import httpx

from foldback_client.frames import Frames
from foldback_client.problem import Problem
from foldback_client.progress import OVER, Progress, lines_of
from foldback_client.retries import TRY_AGAIN
from foldback_client.upload import MovieOptions

if TYPE_CHECKING:
    from foldback_client.client import Client
    from foldback_client.downloads import Place

SILENCE_S: Final = 45.0
"""The service says something every 15 seconds; a stream that is silent for longer is gone."""
FILES: Final = frozenset({"plan.json", "plan.npz", "model.xml", "certificate.json"})


class Fold:
    """A fold, as the service last told it.

    Args:
        client: Who asks.
        fold_id: Its id.
        token: The owner token, which cancel and delete ask for; None for another's fold.
        existing: Whether the same had been asked for before.
        state: What the service has told of it.
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
        self._here = f"/api/folds/{fold_id}"
        self._state = state
        self.id = fold_id
        self.token = token
        self.existing = existing

    def __repr__(self) -> str:
        return f"Fold({self.id!r}, {self._state['status'] if self._state else 'state unknown'})"

    @property
    def state(self) -> dict[str, Any]:
        """All that the service tells of it; asked for once, and again by ``refresh``."""
        return self._state if self._state is not None else self.refresh().state

    @property
    def status(self) -> str:
        """``queued``, ``running``, ``verified``, ``failed`` or ``cancelled``."""
        return self.state["status"]

    @property
    def over(self) -> bool:
        """Whether it has ended."""
        return self.status in OVER

    @property
    def verified(self) -> bool:
        """Whether it ended as a plan that passed its certificate."""
        return self.status == "verified"

    @property
    def summary(self) -> dict[str, Any]:
        """Figures of the plan; empty until it is over."""
        return self.state["summary"]

    @property
    def page(self) -> str:
        """The address of its page."""
        return f"{self._client.base_url}/folds/{self.id}"

    def refresh(self) -> Fold:
        """Asks how it is now."""
        self._state = self._client.ask("GET", self._here)
        return self

    def wait(
        self,
        timeout_s: float | None = None,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> Fold:
        """Follows it to its end, whatever happens to the connection meanwhile.

        Raises:
            TimeoutError: When it is not over after ``timeout_s``; it goes on.
            Problem: When it is deleted.
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
                if problem.status not in TRY_AGAIN:
                    raise
            # Without a stream, this goes on by asking now and then.
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
        """Frames that are there, a page after the other.

        Args:
            start: The first.
            stop: Past the last; all there are if not given.
            stride: Every so many-th.
            poses: Also where every module is.

        Raises:
            Problem: When there is no such stretch, or no timeline (yet).
        """
        asked = {"from": start, "to": stop, "stride": stride, "poses": "true" if poses else None}
        told = {name: value for name, value in asked.items() if value is not None}
        path: str | None = f"{self._here}/frames?{httpx.QueryParams(told)}"
        while path is not None:
            page = self._client.ask("GET", path)
            yield Frames.of(page)
            path = page["next"]

    def exports(self) -> list[dict[str, Any]]:
        """The formats that a finished fold can be downloaded in, by ``name``.

        Raises:
            Problem: When it is not finished.
        """
        return self._client.ask("GET", f"{self._here}/exports")["exports"]

    def download(self, name: str, to: Place) -> Path:
        """Takes ``plan.json``, ``plan.npz``, ``model.xml``, ``certificate.json`` or an export.

        Args:
            name: The file, or the name of an export, such as ``urdf``.
            to: The file to write, or a directory that is there. It never holds half a file.

        Raises:
            Problem: When the service does not have it (yet).
            OSError: When it cannot be written.
        """
        if name in FILES:
            return self._client.save(f"{self._here}/{name}", Path(to), name)
        filename = name
        if Path(to).is_dir():
            filename = next((e["filename"] for e in self.exports() if e["name"] == name), name)
        return self._client.save(f"{self._here}/exports/{name}", Path(to), filename)

    def movie(
        self,
        to: Place,
        *,
        timeout_s: float | None = None,
        on_progress: Callable[[int, int], None] | None = None,
        **options: Unpack[MovieOptions],
    ) -> Path:
        """Has a movie made and takes it.

        Args:
            to: The file to write; its ending says the format unless ``format`` does.
            timeout_s: How long it may take.
            on_progress: Told how many pictures are drawn, of how many.
            options: What it is to be.

        Raises:
            Problem: When it cannot be made.
            TimeoutError: When it takes longer; it goes on being made.
        """
        deadline = time.monotonic() + (float("inf") if timeout_s is None else timeout_s)
        if Path(to).suffix.lower() == ".gif":
            options.setdefault("format", "gif")
        movie = self._client.ask("POST", f"{self._here}/movies", json=options, token=self.token)
        here = f"{self._here}/movies/{movie['id']}"
        while movie["status"] in ("queued", "running"):
            if on_progress is not None:
                on_progress(movie["frames_done"], movie["frames_total"])
            if time.monotonic() >= deadline:
                raise TimeoutError(f"The movie is still {movie['status']} after {timeout_s} s.")
            time.sleep(max(0.0, min(0.5, deadline - time.monotonic())))
            movie = self._client.ask("GET", here)
        if movie["status"] == "failed":
            told = movie["problem"] or {}
            detail = told.get("detail", "the service gave no reason.")
            raise Problem(told.get("code", "failed"), detail, where=told.get("where"))
        return self._client.save(f"{here}/file", Path(to), f"{self.id}.{movie['format']}")

    def cancel(self) -> Fold:
        """Stops it.

        Raises:
            Problem: When the token is not its owner's, or others asked for the same shape of the
                gallery.
        """
        self._client.ask("POST", f"{self._here}/cancel", token=self.token, again={403})
        return self.refresh()

    def rename(self, name: str) -> Fold:
        """Calls it otherwise: on pages, in lists and in names of files.

        Args:
            name: 1 to 200 characters.

        Raises:
            Problem: When the token is not its owner's, or it belongs to the gallery.
        """
        self._state = self._client.ask("PATCH", self._here, json={"name": name}, token=self.token)
        return self

    def delete(self) -> None:
        """Deletes it for good.

        Raises:
            Problem: When the token is not its owner's, or it belongs to the gallery.
        """
        self._client.ask("DELETE", self._here, token=self.token, again={403, 404})

    def _events(self, deadline: float) -> Iterator[Progress]:
        silence_s = max(0.001, min(SILENCE_S, deadline - time.monotonic()))
        with self._client.opened(f"{self._here}/events", silence_s=silence_s) as answer:
            for event in lines_of(answer):
                if event is not None and event[0] == "progress":
                    progress = Progress.of(json.loads(event[1]))
                    if progress.status in OVER:  # what follows is its end, told by ``wait``
                        return
                    yield progress
                if time.monotonic() >= deadline:
                    return
