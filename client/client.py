"""Client of one service."""

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

from foldback.client.downloads import save
from foldback.client.fold import Fold
from foldback.client.problem import Problem
from foldback.client.proxies import environment_proxies, is_loopback, proxy_of
from foldback.client.retries import RETRIED_STATUSES, Retries
from foldback.client.upload import FoldOptions, ShapeOptions, Source, file_of, form_of

T = TypeVar("T")
CONNECT_TIMEOUT_S: Final = 10.0
"""Maximum time to open a connection to the service, in s; then the request fails. With a larger
value the client notices later that the service cannot be reached."""


class Client:
    """Client of one service. Requests are idempotent, so they are repeated if a response is lost.

    Args:
        base_url: Address of the service.
        token: Secret of the folds' owner: 24 to 200 characters. A new one if omitted.
        retries: Policy for repeating a request if the service is busy or cannot be reached.
        timeout_s: Maximum time without data of a response, in s.
        verify: Verification of the ``https`` certificate, as in httpx.

    The environment's proxies (``HTTPS_PROXY`` and others) are used, except for a service on this
    machine. Thread-safe. Close the client, or use it in a ``with`` statement.

    Raises:
        ConnectionError: If the environment names a proxy that httpx cannot use.
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
        # The client draws it, so that it owns an upload even if the response is lost.
        self.token = token or secrets.token_urlsafe(32)
        self.retries = retries or Retries()
        try:
            self._http = httpx.Client(
                base_url=self.base_url,
                timeout=httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_TIMEOUT_S)),
                limits=httpx.Limits(max_connections=None),
                verify=verify,
                trust_env=not is_loopback(self.base_url),
            )
        except (ImportError, ValueError, httpx.InvalidURL) as error:
            proxies = environment_proxies()
            if not proxies:
                raise
            raise ConnectionError(
                f"got the proxies {proxies}, expected proxies that httpx can use: {error}"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *of: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def fold(
        self,
        source: Source | None = None,
        *,
        shape: str | None = None,
        filename: str | None = None,
        **options: Unpack[FoldOptions],
    ) -> Fold:
        """Request a fold; the same request again returns the same fold.

        Args:
            source: Path of a file, its bytes, an open file, cells in the order of a path as (n, 3)
                numbers (or of a solid, with ``as_voxels``), or a solid as a 3D array.
            shape: Name of a gallery shape instead of a source.
            filename: Name of the source; its ending distinguishes some formats.
            options: Options of the fold, as for ``POST /api/folds``.

        Raises:
            Problem: If the service refuses it.
            ConnectionError: If the service cannot be reached.
        """
        payload = self._post(
            "/api/folds", source, shape, filename, form_of(options, FoldOptions, shape)
        )
        return Fold(self, payload["id"], token=payload["owner_token"], existing=payload["existing"])

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
        """Preview a shape: its cells and path. ``fold(preview=id)`` folds it.

        Args:
            source: Same as for ``fold``.
            shape: Name of a gallery shape instead of a source.
            filename: Name of the source.
            path: True to search for a path; without it the cells are ready sooner.
            full: True to return cells and mesh as well, which may be large.
            options: Options that turn the shape into a chain.

        Raises:
            Problem: If the service refuses it.
            ConnectionError: If the service cannot be reached.
        """
        query = {"path": path, "full": full}
        words = {name: "true" if value else "false" for name, value in query.items()}
        form = {**form_of(options, ShapeOptions, shape), **words}
        return self._post("/api/shapes/preview", source, shape, filename, form)

    def get(self, fold_id: str, token: str | None = None) -> Fold:
        """Return an existing fold by its id.

        Raises:
            Problem: If there is none.
        """
        return Fold(self, fold_id, token=token or self.token).refresh()

    def folds(self) -> list[Fold]:
        """Return the folds of the gallery and of this client's token, newest first."""
        payload = self.ask("GET", "/api/folds", token=self.token)["folds"]
        return [Fold(self, state["id"], token=self.token, state=state) for state in payload]

    def mine(self) -> Iterator[Fold]:
        """Yield all folds requested with this client's token, newest first."""
        path: str | None = "/api/mine/folds"
        while path is not None:
            payload = self.ask("GET", path, token=self.token)
            for fold in payload["folds"]:
                yield Fold(self, fold["id"], token=self.token, state=fold)
            path = payload["next"]

    def shapes(self) -> list[dict[str, Any]]:
        """Return the shapes of the gallery by ``name``, shortest chain first."""
        return self.ask("GET", "/api/shapes")["shapes"]

    def ask(self, method: str, path: str, **options: Any) -> Any:
        """Return a response's JSON; None if it is empty or an earlier attempt had succeeded."""
        return self._call(_json, method, path, **options)

    def save(self, path: str, to: Path, filename: str) -> Path:
        """Write a response to a file; return the file's path."""
        saved = self._call(partial(save, to=to, filename=filename), "GET", path)
        assert saved is not None
        return saved

    @contextmanager
    def opened(self, path: str, *, silence_s: float) -> Generator[httpx.Response]:
        """Open an endless response, without retries.

        Raises:
            Problem: If the service refuses it.
            ConnectionError: If the connection breaks.
        """
        timeout = httpx.Timeout(silence_s, connect=min(silence_s, CONNECT_TIMEOUT_S))
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
            raise TypeError("got a source and a shape, expected only one of them.")
        files = None if source is None else {"file": file_of(source, filename)}
        return self.ask("POST", path, data=form, files=files, token=self.token)

    def _call(
        self,
        take: Callable[[httpx.Response], T],
        method: str,
        path: str,
        *,
        token: str | None = None,
        retried_statuses: Collection[int] = (),
        **options: Any,
    ) -> T | None:
        """Send a request; return what ``take`` reads, or None if an earlier attempt had succeeded.

        Args:
            take: Function that reads the content of the response.
            method: HTTP method.
            path: Path within the service.
            token: Owner token, if the request needs it.
            retried_statuses: Statuses that show, from the second attempt on, that an earlier one
            succeeded.
            options: Additional arguments of httpx.
        """
        path = self._inside(path)
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        unsure = False
        for attempt in count(1):
            try:
                with self._http.stream(method, path, headers=headers, **options) as answer:
                    if answer.is_success:
                        return take(answer)
                    answer.read()
                problem = Problem.of(answer)
                if unsure and problem.status in retried_statuses:
                    return None
                pause_s = self.retries.pause_s(attempt, problem.retry_after)
                if problem.status not in RETRIED_STATUSES or pause_s is None:
                    raise problem
            except httpx.TransportError as error:
                unsure = True
                pause_s = self.retries.pause_s(attempt)
                if pause_s is None:
                    proxy = proxy_of(self.base_url)
                    through = "" if proxy is None else f" through the proxy {proxy}"
                    raise ConnectionError(
                        f"got no answer from {self.base_url}{through} in {attempt} attempts "
                        f"({error or type(error).__name__}); is the service running there?"
                    ) from error
            time.sleep(pause_s)
        raise AssertionError

    def _inside(self, path: str) -> str:
        """Return the path; raise ``Problem`` if it leads to another host."""
        if not path.startswith("/"):
            raise Problem(
                "bad-link", f"got the link {path[:100]!r}, expected a path that starts with /."
            )
        return path


def _json(answer: httpx.Response) -> Any:
    answer.read()
    return answer.json() if answer.content else None
