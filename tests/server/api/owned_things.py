"""Folds, movies and previews with an owner, and the actors that request their change."""

import base64
import time
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import sqlalchemy as sa

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.plan.module_values import VALUES_FORMAT
from foldback.planner.plan.tour import TOUR_FORMAT
from foldback.planner.storage.file_names import TIMELINE
from foldback.server.store.folds import Store, new_id
from foldback.server.store.owned_items import write_beside
from foldback.server.store.owner import Owner, new_token
from foldback.server.store.schema import FoldRow, MovieRow, PreviewRow, TourRow, ValuesRow
from tests.server.rows import a_fold, a_movie
from tests.server.service_process import bearer
from tests.server.service_thread import ServiceThread

ACTORS = ("none", "short", "stranger", "asker", "owner", "heir")
"""Holders of no token, of a token that is too short, and of a random one; the client that has
requested the same fold or a movie of it; the first client that has requested the fold; and the
client to which the fold or all things of its owner are transferred."""
MOVIE_ID = "movie"
TOUR: dict[str, Any] = {
    "format": TOUR_FORMAT,
    "title": "Mine",
    "stops": [{"caption": "It folds.", "frame": 9}],
}
VALUES: dict[str, Any] = {
    **{"format": VALUES_FORMAT, "name": "Heat", "unit": "K", "low": -1.5, "high": 2.0, "rows": 1},
    "data": base64.b64encode(bytes(range(16))).decode(),
}
STATES: dict[str, dict[str, Any]] = {
    **{status: {"status": status} for status in ("queued", "running", "verified")},
    "cancelled": {"status": "cancelled", "cancel_requested": True, "content_key": None},
    "gallery": {"status": "queued", "public": True, "shape": "wrench-24"},
}
"""Values of folds by the first word of a thing."""

ID = sa.bindparam("id")
OTHER_IDS = (PreviewRow.id, MovieRow.fold_id, TourRow.fold_id, ValuesRow.fold_id)
CHANGEABLE = sa.select(
    *(FoldRow.name, FoldRow.status, FoldRow.cancel_requested, FoldRow.owner),
    *(sa.exists().where(column == ID) for column in OTHER_IDS),
).where(FoldRow.id == ID)
"""Query for all values of a thing that an action may change."""


class Thing:
    """One fold with the objects that belong to it.

    Args:
        service: Service that has the fold.
        store: Store of the fold's rows.
        words: State of the fold, and later events, as in ``gallery+shared``.
    """

    def __init__(self, service: ServiceThread, store: Store, words: str) -> None:
        self.fold_id = new_id()
        self.tokens: dict[str, str | None] = {actor: new_token() for actor in ACTORS}
        self.tokens |= {"none": None, "short": "short-and-guessable"}
        self._service, self._store = service, store
        state, *events = words.split("+")
        row = a_fold(self.fold_id, **{"content_key": new_token(), **STATES[state]})
        self._store.add(row, self.owner("owner"))
        happen: dict[str, Callable[[], object]] = {
            "shared": self._share,
            "movie": lambda: self._add_movie(self.owner("owner").digest, of_owner=True),
            "asked-movie": lambda: self._add_movie(self.owner("asker").digest, of_owner=False),
            "taken-movie": lambda: self._add_movie("", of_owner=True),
            "preview": self._add_preview,
            "frames": self._add_frames,
            "tour": lambda: self._keep(TourRow, TOUR),
            "values": lambda: self._keep(ValuesRow, VALUES),
            "handed": lambda: self._give("PATCH", f"/api/folds/{self.fold_id}"),
            "rekeyed": lambda: self._give("POST", "/api/mine/key"),
            "deleted": lambda: self._store.delete(self.fold_id),
        }
        for event in events:
            happen[event]()

    def owner(self, actor: str) -> Owner:
        """Return an actor that has a token."""
        return Owner.from_token(self.tokens[actor] or "")

    def ask(self, actor: str, method: str, path: str, body: object = None) -> httpx.Response:
        """Send a request as an actor and return the answer."""
        token = self.tokens[actor]
        headers = {} if token is None else bearer(token)
        return self._service.http.request(method, path, headers=headers, json=body)

    def state(self) -> object:
        """Return all values that an action may change."""
        with self._store.reading() as session:
            return session.execute(CHANGEABLE, {"id": self.fold_id}).one_or_none()

    def _keep(self, kind: type[TourRow | ValuesRow], data: dict[str, Any]) -> None:
        assert write_beside(self._store, self.fold_id, self.owner("owner"), kind, data)

    def _share(self) -> None:
        content_key = self._store.fold(self.fold_id).content_key
        assert content_key is not None
        assert self._store.ask(content_key, self.owner("asker")) is not None

    def _give(self, method: str, path: str) -> None:
        answer = self.ask("owner", method, path, {"owner_token": self.tokens["heir"]})
        assert answer.status_code == 200, answer.text

    def _add_movie(self, token_hash: str, *, of_owner: bool) -> None:
        movie = a_movie(self.fold_id, MOVIE_ID, token_hash=token_hash, of_owner=of_owner)
        with self._store.changing() as session:
            session.add(movie)

    def _add_frames(self) -> None:
        chain = Chain.from_path(Path.from_cells([(0, 0, 0), (1, 0, 0), (1, 1, 0)]))
        path = self._store.folders.place(self.fold_id) / TIMELINE
        with TimelineWriter.create(path, chain) as writer:
            writer.append(Motion.from_angles(np.zeros((9, len(chain.folded_rad)))))

    def _add_preview(self) -> None:
        now, owner = time.time(), self.owner("owner").digest
        shape = {"name": "a shape", "modules": 16, "module": "cube", "key": "0" * 24, "query": ""}
        about = {"visitor": "somebody", "owner": owner, "created_at": now, "seen_at": now}
        row = PreviewRow(id=self.fold_id, **shape, **about)
        with self._store.changing() as session:
            session.add(row)
        directory = self._service.settings.previews_dir / self.fold_id
        directory.mkdir()  # after its row, without which it would be swept
        (directory / "input").write_bytes(b"")
