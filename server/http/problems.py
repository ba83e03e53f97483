"""Problems: how the API says that something is wrong (RFC 9457, ``application/problem+json``)."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from sqlalchemy.exc import (
    DataError,
    DBAPIError,
    IntegrityError,
    OperationalError,
    ProgrammingError,
    SQLAlchemyError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from planner.errors import DamagedError, InputError
from planner.parameters.option import options_of
from planner.pipeline.request import FoldRequest
from server import errors
from server.errors import (
    NoRoom,
    NoSuch,
    ServiceError,
    Unavailable,
    Unusable,
    no_room,
    read_only,
)
from server.http.access_log import request_id_of
from server.store.object_store import StorageError
from words.messages import message_for_people

PROBLEM_MEDIA_TYPE: Final = "application/problem+json"
DISK_ERRNOS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
DATABASE_RETRY_S: Final = 5
"""Value of the ``Retry-After`` header, in s, while the database cannot be reached. A smaller value
brings more requests that fail again. Chosen."""
STORAGE_RETRY_S: Final = 5
"""Value of the ``Retry-After`` header, in s, while the object store cannot be reached. A smaller
value brings more requests that fail again. Chosen."""
log = logging.getLogger("foldback.web")
HTTP_STATUSES: Final[Mapping[type, int]] = {
    errors.Malformed: 400,
    errors.Unidentified: 401,
    errors.Forbidden: 403,
    errors.NotFound: 404,
    errors.Conflict: 409,
    errors.TooLarge: 413,
    errors.Unusable: 422,
    errors.WebsocketNeeded: 426,
    errors.TooMany: 429,
    errors.Unavailable: 503,
    errors.TooSlow: 504,
    errors.Damaged: 500,
    errors.NoRoom: 507,
}
STATUS_HEADERS: Final[Mapping[int, Mapping[str, str]]] = {
    401: {"WWW-Authenticate": "Bearer"},
    426: {"Upgrade": "websocket"},
}
"""Header fields that an error response must have, by its HTTP status (RFC 9110, sections 15.5.2 and
15.5.22)."""
PROBLEM_CODES: Final = {404: "not-found", 408: "too-slow", 413: "too-large"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """An answer that is a problem.

    Attributes:
        status: The HTTP status.
        code: Short stable word for programs.
        detail: Value found, value expected, remedy.
        where: Position in the input, or None.
        headers: Further headers of the answer.
    """

    status: int
    code: str
    detail: str
    where: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def of(cls, error: ServiceError) -> Problem:
        """Return the HTTP representation of a service error."""
        status = next(HTTP_STATUSES[kind] for kind in type(error).__mro__ if kind in HTTP_STATUSES)
        again = error.retry_after_s
        return cls(
            status=status,
            code=error.code,
            detail=error.detail,
            where=error.where,
            headers={
                **STATUS_HEADERS.get(status, {}),
                **({} if again is None else {"Retry-After": str(again)}),
            },
        )

    def body(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            "type": "about:blank",
            "title": HTTPStatus(self.status).phrase,
            "status": self.status,
            "code": self.code,
            "detail": self.detail,
            "message": message_for_people(self.detail),
            "where": self.where,
        }

    def response(self) -> JSONResponse:
        """Return the HTTP answer."""
        return JSONResponse(
            self.body(),
            status_code=self.status,
            headers=self.headers,
            media_type=PROBLEM_MEDIA_TYPE,
        )


def response_of(error: ServiceError) -> JSONResponse:
    """Return the answer of middleware outside of the application's error handlers."""
    return Problem.of(error).response()


class Guard:
    """Middleware that answers some requests and websockets with a refusal.

    Args:
        app: Inner ASGI application.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        asks = scope["type"] in ("http", "websocket")
        refusal = self.refusal(scope) if asks else None
        answer = self._app if refusal is None else response_of(refusal)
        await answer(scope, receive, send)

    def refusal(self, scope: Scope) -> ServiceError | None:
        """Return the reason why a request is refused; None if it is not."""
        raise NotImplementedError


def answer_of(
    request: HTTPConnection, problem: Problem, page: Callable[[Problem], Response]
) -> Response:
    """Return the answer that is a problem: a page where a browser asks for one, else JSON."""
    asked = request.headers.get("accept", "")
    if request.url.path.startswith("/api/") or "text/html" not in asked:
        return problem.response()
    return page(problem)


def of_trouble(error: BaseException | None) -> ServiceError | None:
    """Return the error that the database does not answer or the disk is full, or None."""
    if isinstance(error, OperationalError) and "disk is full" in str(error.orig):
        return _disk()
    if isinstance(error, OperationalError) and "readonly database" in str(error.orig):
        return read_only()
    fault = isinstance(error, DataError | IntegrityError | ProgrammingError)
    if isinstance(error, DBAPIError | PoolTimeoutError) and not fault:
        return Unavailable(
            "no-database",
            f"The database does not answer; nothing was lost. Try again in {DATABASE_RETRY_S} s.",
            retry_after_s=DATABASE_RETRY_S,
        )
    if isinstance(error, OSError) and error.errno == errno.EROFS:
        return read_only()
    if isinstance(error, OSError) and error.errno in DISK_ERRNOS:
        return _disk()
    return None


def _disk() -> NoRoom:
    return no_room("The disk of the service is full; nothing was lost. Try again later.")


def install(app: FastAPI, page: Callable[[Problem], Response]) -> None:
    """Make the application answer every error as a problem.

    Args:
        app: The application.
        page: Makes a page of one, for people who asked for a page.
    """

    def answer(request: Request, problem: Problem) -> Response:
        return answer_of(request, problem, page)

    async def on_error(request: Request, error: Exception) -> Response:
        assert isinstance(error, ServiceError)
        return answer(request, Problem.of(error))

    async def on_no_such(request: Request, error: Exception) -> Response:
        assert isinstance(error, NoSuch)
        return response_of(error)  # pages say it themselves; what else asks downloads files

    async def on_damage(request: Request, error: Exception) -> Response:
        assert isinstance(error, DamagedError)
        log.error("%s: %s", request.url.path, error)
        return answer(request, Problem.of(errors.Damaged.of(error)))

    async def on_storage(request: Request, error: Exception) -> Response:
        log.error("%s", error)
        return response_of(
            Unavailable(
                "storage",
                "The storage of the service does not answer right now; try again in a moment.",
                retry_after_s=STORAGE_RETRY_S,
            )
        )

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if (trouble := of_trouble(error.__cause__)) is not None:  # while a form came in
            log.error("%s: %r", trouble.code, error.__cause__)
            return answer(request, Problem.of(trouble))
        phrase = HTTPStatus(error.status_code).phrase
        code = PROBLEM_CODES.get(error.status_code, phrase.lower().replace(" ", "-"))
        headers = error.headers or {}
        problem = Problem(
            status=error.status_code, code=code, detail=str(error.detail), headers=headers
        )
        return answer(request, problem)

    async def on_validation(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        first = error.errors()[0]
        if (refusal := _refusal(first)) is not None:
            return answer(request, Problem.of(Unusable.of(refusal)))
        where = ".".join(str(part) for part in first["loc"])
        return answer(request, Problem.of(Unusable("bad-request", f"{first['msg']}.", where=where)))

    async def on_trouble(request: Request, error: Exception) -> Response:
        trouble = of_trouble(error)
        if trouble is None:
            raise error
        log.error("%s: %r", trouble.code, error)
        return answer(request, Problem.of(trouble))

    async def on_anything(request: Request, error: Exception) -> Response:
        words = "An error occurred inside the service. Nothing was lost. Try again."
        headers = request_id_of(request.scope)
        return answer(request, Problem(status=500, code="internal", detail=words, headers=headers))

    app.add_exception_handler(ServiceError, on_error)
    app.add_exception_handler(NoSuch, on_no_such)
    app.add_exception_handler(DamagedError, on_damage)
    app.add_exception_handler(StorageError, on_storage)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(SQLAlchemyError, on_trouble)
    app.add_exception_handler(OSError, on_trouble)
    app.add_exception_handler(Exception, on_anything)


def _refusal(error: Any) -> InputError | None:
    """Return the planner's error about a parameter, worded as on the command line."""
    place, name = error["loc"][0], str(error["loc"][-1])
    if place != "body" or name not in options_of(FoldRequest):
        return None
    try:
        FoldRequest.of(**{name: error["input"]}).check()
    except InputError as refusal:
        return refusal
    except TypeError:  # not even a text
        return None
    return None
