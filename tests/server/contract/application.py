"""The service's application in this process, without a socket, a worker or a browser."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
from anyio.from_thread import start_blocking_portal

from server.api.context import Context
from server.app import create_app
from server.settings import Settings
from tests.server.here import NOWHERE
from tests.server.service import bearer


class Application:
    """Starts an application on an empty data directory; `ask` sends it one request."""

    def __init__(self, data_dir: Path) -> None:
        self._settings = Settings(
            _env_prefix=NOWHERE,  # type: ignore[call-arg]
            data_dir=data_dir,
            workers=0,
            prewarm=False,
            finished_folds=False,
            requests_per_second_of_visitor=1e5,
            requests_at_once_of_visitor=10**6,
            lists_per_second_of_visitor=1e5,
        )
        self._settings.make_directories()
        self._app = create_app(self._settings)

    def __enter__(self) -> Application:
        with ExitStack() as stack:
            self._portal = stack.enter_context(start_blocking_portal())
            life = self._app.router.lifespan_context(self._app)
            stack.enter_context(self._portal.wrap_async_context_manager(life))
            self._open = stack.pop_all()
        transport = httpx.ASGITransport(app=self._app)
        self._client = httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000")
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    @property
    def context(self) -> Context:
        """Services that the routes share."""
        context: Context = self._app.state.context
        return context

    def description(self) -> dict[str, Any]:
        """Return the OpenAPI description."""
        return self._app.openapi()

    def ask(
        self, method: str, path: str, *, token: str | None = None, body: object = None
    ) -> httpx.Response:
        """Send a request and return its answer."""
        headers = {} if token is None else bearer(token)

        async def answer() -> httpx.Response:
            return await self._client.request(method, path, headers=headers, json=body)

        return self._portal.call(answer)
