"""Client: talks to one service."""

from __future__ import annotations

import secrets
import ssl
import time
from collections.abc import Callable, Collection, Generator, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, Final, Self, TypeVar, Unpack

import httpx

from foldback_client.downloads import save
from foldback_client.fold import Fold
from foldback_client.problem import Problem
from foldback_client.retries import TRY_AGAIN, Retries
from foldback_client.upload import FoldOptions, ShapeOptions, Source, file_of, form_of

T = TypeVar("T")
CONNECT_S: Final = 10.0


class Client:
    """Asks one service. Everything it asks for may be asked for twice, so it is when need be.

    Args:
        base_url: Where the service is.
        token: Proves what is one's own: 24 to 200 characters, kept secret. A new one if not given.
        retries: How often to ask where the service is busy or out of reach.
        timeout_s: How long an answer may be silent.
        verify: How to check the certificate of ``https``, as httpx takes it.

    It may be used from many threads. Close it, or use it in a ``with``.
    """

    def __init__(
        self,
        base_url: str,
        token: str | None = None,
        *,
        retries: Retries | None = None,
        timeout_s: float = 60.0,
        verify: ssl.SSLContext | bool = True,
    ) -> None:
        self.base_url = base_url.rstrip("/")
        # One's own from the start: an upload whose answer got lost is still one's own.
        self.token = token or secrets.token_urlsafe(32)
        self.retries = retries or Retries()
        self._http = httpx.Client(
            base_url=self.base_url,
            timeout=httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_S)),
            limits=httpx.Limits(max_connections=None),
            verify=verify,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *of: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes its connections."""
        self._http.close()

    def fold(
        self,
        source: Source | None = None,
        *,
        shape: str | None = None,
        filename: str | None = None,
        **options: Unpack[FoldOptions],
    ) -> Fold:
        """Asks for a fold; the same again gives the same fold.

        Args:
            source: A file's path, its bytes, an open file, cells in the order of a path as (n, 3)
                numbers (or of a solid, with ``as_voxels``), or a solid as a 3D array.
            shape: Or the name of a gallery shape.
            filename: What to call the source; its ending tells some formats apart.
            options: How to fold it, as ``POST /api/folds`` has it.

        Raises:
            Problem: When the service refuses it.
            ConnectionError: When the service cannot be reached.
        """
        told = self._post(
            "/api/folds", source, shape, filename, form_of(options, FoldOptions, shape)
        )
        return Fold(self, told["id"], token=told["owner_token"], existing=told["existing"])

    def preview(
        self,
        source: Source | None = None,
        *,
        shape: str | None = None,
        filename: str | None = None,
        path: bool = True,
        full: bool = True,
        **options: Unpack[ShapeOptions],
    ) -> dict[str, Any]:
        """What would come of a shape: cells, a path, whether there is one. ``fold(preview=id)``.

        Args:
            source: As ``fold`` takes it.
            shape: Or the name of a gallery shape.
            filename: What to call the source.
            path: Whether to look for a path; without one, cells come sooner.
            full: Whether to tell cells and mesh too, which may be large.
            options: How it is to become a chain.

        Raises:
            Problem: When the service refuses it.
            ConnectionError: When the service cannot be reached.
        """
        asked = {"path": path, "full": full}
        words = {name: "true" if value else "false" for name, value in asked.items()}
        form = {**form_of(options, ShapeOptions, shape), **words}
        return self._post("/api/shapes/preview", source, shape, filename, form)

    def get(self, fold_id: str, token: str | None = None) -> Fold:
        """A fold that is there, by its id.

        Raises:
            Problem: When there is none.
        """
        return Fold(self, fold_id, token=token or self.token).refresh()

    def folds(self) -> list[Fold]:
        """Folds of the gallery and one's own, newest first."""
        told = self.ask("GET", "/api/folds", token=self.token)["folds"]
        return [Fold(self, each["id"], token=self.token, state=each) for each in told]

    def mine(self) -> Iterator[Fold]:
        """All folds that were asked for with one's own token, newest first."""
        path: str | None = "/api/mine/folds"
        while path is not None:
            told = self.ask("GET", path, token=self.token)
            for each in told["folds"]:
                yield Fold(self, each["id"], token=self.token, state=each)
            path = told["next"]

    def shapes(self) -> list[dict[str, Any]]:
        """Shapes of the gallery by ``name``, shortest chain first."""
        return self.ask("GET", "/api/shapes")["shapes"]

    def ask(self, method: str, path: str, **asked: Any) -> Any:
        """The JSON of an answer; None when it is empty or what was wanted was done already."""
        return self._call(_json, method, path, **asked)

    def save(self, path: str, to: Path, filename: str) -> Path:
        """The file that an answer was written to."""
        saved = self._call(partial(save, to=to, filename=filename), "GET", path)
        assert saved is not None
        return saved

    @contextmanager
    def opened(self, path: str, *, silence_s: float) -> Generator[httpx.Response]:
        """An answer without an end, asked for once.

        Raises:
            Problem: When the service refuses it.
            ConnectionError: When it breaks off.
        """
        timeout = httpx.Timeout(silence_s, connect=min(silence_s, CONNECT_S))
        try:
            with self._http.stream("GET", self._inside(path), timeout=timeout) as answer:
                if not answer.is_success:
                    answer.read()
                    raise Problem.of(answer)
                yield answer
        except httpx.TransportError as error:
            raise ConnectionError(
                f"the connection to {self.base_url} was lost ({error})."
            ) from error

    def _post(
        self,
        path: str,
        source: Source | None,
        shape: str | None,
        filename: str | None,
        form: dict[str, str],
    ) -> Any:
        if source is not None and shape is not None:
            raise TypeError("got a source and a shape, expected one of them.")
        files = None if source is None else {"file": file_of(source, filename)}
        return self.ask("POST", path, data=form, files=files, token=self.token)

    def _call(
        self,
        take: Callable[[httpx.Response], T],
        method: str,
        path: str,
        *,
        token: str | None = None,
        again: Collection[int] = (),
        **asked: Any,
    ) -> T | None:
        """What is taken from a good answer; None when an earlier attempt had done it already.

        Args:
            take: Takes the content, which is still to come.
            method: Of HTTP.
            path: Within the service.
            token: The owner token, where it is asked for.
            again: Statuses which say so from the second attempt on.
            asked: As httpx takes it.
        """
        path = self._inside(path)
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        unsure = False
        for attempt in count(1):
            try:
                with self._http.stream(method, path, headers=headers, **asked) as answer:
                    if answer.is_success:
                        return take(answer)
                    answer.read()
                problem = Problem.of(answer)
                if unsure and problem.status in again:
                    return None
                pause_s = self.retries.pause_s(attempt, problem.retry_after)
                if problem.status not in TRY_AGAIN or pause_s is None:
                    raise problem
            except httpx.TransportError as error:
                unsure = True
                pause_s = self.retries.pause_s(attempt)
                if pause_s is None:
                    raise ConnectionError(
                        f"got no answer from {self.base_url} in {attempt} attempts "
                        f"({error or type(error).__name__}); is the service running there?"
                    ) from error
            time.sleep(pause_s)
        raise AssertionError

    def _inside(self, path: str) -> str:
        """The path; what the service tells must not lead elsewhere."""
        if not path.startswith("/"):
            raise Problem(
                "bad-link", f"got the link {path[:100]!r}, expected a link of the service."
            )
        return path


def _json(answer: httpx.Response) -> Any:
    answer.read()
    return answer.json() if answer.content else None
