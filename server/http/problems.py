"""Problems: error responses of the API (RFC 9457, ``application/problem+json``)."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
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

from foldback.planner.errors import DamagedError, InputError, located
from foldback.planner.parameters.option import options_of
from foldback.planner.pipeline.request import FoldRequest
from foldback.server import errors
from foldback.server.errors import (
    NoRoom,
    NoSuch,
    ServiceError,
    Unavailable,
    Unusable,
    no_room,
    read_only,
    refusal_of,
)
from foldback.server.http.access_log import request_id_of
from foldback.server.store.object_store import StorageError
from foldback.words.quantities import sentence

PROBLEM_MEDIA_TYPE: Final = "application/problem+json"
DISK_ERRNOS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
DATABASE_RETRY_S: Final = 5
"""Value of the ``Retry-After`` header, in s, while the database cannot be reached."""
log = logging.getLogger("foldback.service")
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
HANDLED_ERRORS: Final = (
    *(ServiceError, InputError, DamagedError, StorageError, HTTPException),
    *(RequestValidationError, SQLAlchemyError, OSError),
)
"""Errors that a route may raise; any other error is a fault of the service."""
NOT_FOUND: Final = HTTPStatus.NOT_FOUND.phrase
"""Detail by which the framework reports an address without a route."""
NO_SUCH_ADDRESS: Final = "There is nothing at this address."
PROBLEM_CODES: Final = {404: "not-found", 408: "too-slow", 413: "too-large"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Error response.

    Attributes:
        status: The HTTP status.
        code: Short stable identifier for programs.
        detail: Actual value, expected value, remedy.
        where: Position in the input, or None.
        values: Plain JSON values that the detail names; parts of an input count from 0.
        message: The detail as a sentence for people, with its position.
        headers: Additional headers of the response.
    """

    status: int
    code: str
    detail: str
    where: str | None = None
    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    message: str | None = None
    headers: Mapping[str, str] = field(default_factory=dict[str, str])

    @classmethod
    def of(cls, error: ServiceError) -> Problem:
        """Return the HTTP representation of a service error."""
        status = next(HTTP_STATUSES[kind] for kind in type(error).__mro__ if kind in HTTP_STATUSES)
        retry_after_s = error.retry_after_s
        return cls(
            status=status,
            code=error.code,
            detail=error.detail,
            where=error.where,
            values=error.values,
            message=error.message,
            headers={
                **STATUS_HEADERS.get(status, {}),
                **({} if retry_after_s is None else {"Retry-After": str(retry_after_s)}),
            },
        )

    @property
    def text(self) -> str:
        """The message as a sentence, for people."""
        return sentence(self.message or located(self.detail, self.where))

    def body(self) -> dict[str, Any]:
        """Return the JSON object."""
        return {
            "type": "about:blank",
            "title": HTTPStatus(self.status).phrase,
            "status": self.status,
            "code": self.code,
            "values": self.values,
            "detail": self.detail,
            "message": self.text,
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
    """Return an error response, for middleware outside of the application's error handlers."""
    return Problem.of(error).response()


class Guard:
    """Base class of middleware that refuses some requests and websockets.

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
    """Return the response for a problem: a page if the client accepts HTML, else JSON."""
    accepted = request.headers.get("accept", "")
    if request.url.path.startswith("/api/") or "text/html" not in accepted:
        return problem.response()
    return page(problem)


def of_trouble(error: BaseException | None) -> ServiceError | None:
    """Return a service error if the database is unavailable or the disk is full, else None."""
    if isinstance(error, OperationalError) and "disk is full" in str(error.orig):
        return _disk()
    if isinstance(error, OperationalError) and "readonly database" in str(error.orig):
        return read_only()
    fault = isinstance(error, DataError | IntegrityError | ProgrammingError)
    if isinstance(error, DBAPIError | PoolTimeoutError) and not fault:
        return Unavailable(
            "no-database",
            "The database does not answer; nothing was lost. Try again in {retry_after_s} s.",
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
        page: Creates the error page for browsers.
    """

    async def on_error(request: Request, error: Exception) -> Response:
        problem = _problem_of(error, request.url.path)
        if isinstance(error, NoSuch | StorageError):
            return problem.response()  # pages handle these errors; other requests are downloads
        return answer_of(request, problem, page)

    async def on_anything(request: Request, error: Exception) -> Response:
        words = "An error occurred inside the service. Nothing was lost. Try again."
        headers = request_id_of(request.scope)
        problem = Problem(status=500, code="internal", detail=words, headers=headers)
        return answer_of(request, problem, page)

    for kind in HANDLED_ERRORS:
        app.add_exception_handler(kind, on_error)
    app.add_exception_handler(Exception, on_anything)


def _problem_of(error: Exception, path: str) -> Problem:
    """Return the problem of one of ``HANDLED_ERRORS``, and log faults of the service.

    Raises:
        Exception: If it is an unexpected error of the database or the disk.
    """
    match error:
        case ServiceError() | InputError():
            return Problem.of(refusal_of(error))
        case DamagedError():
            log.error("%s: %s", path, error)
            return Problem.of(refusal_of(error))
        case StorageError():
            log.error("%s", error)
            detail = "The storage of the service does not answer right now; try again in a moment."
            return Problem.of(Unavailable("storage", detail, retry_after_s=5))
        case RequestValidationError():
            return Problem.of(_refusal(error.errors()[0]))
        case HTTPException() if of_trouble(error.__cause__) is None:
            phrase = HTTPStatus(error.status_code).phrase
            return Problem(
                status=error.status_code,
                code=PROBLEM_CODES.get(error.status_code, phrase.lower().replace(" ", "-")),
                detail=NO_SUCH_ADDRESS if error.detail == NOT_FOUND else str(error.detail),
                headers=error.headers or {},
            )
        case _:
            # The framework wraps errors that occur while it reads a form.
            cause = error.__cause__ if isinstance(error, HTTPException) else error
            if (trouble := of_trouble(cause)) is None:
                raise error
            log.error("%s: %r", trouble.code, cause)
            return Problem.of(trouble)


def _refusal(error: Any) -> Unusable:
    """Return the refusal of a parameter; options have the messages of the command line."""
    place, name = error["loc"][0], str(error["loc"][-1])
    if place == "body" and name in options_of(FoldRequest):
        try:
            with suppress(TypeError):  # not a string
                FoldRequest.of(**{name: error["input"]}).check()
        except InputError as refusal:
            return Unusable.of(refusal)
    location = ".".join(str(part) for part in error["loc"])
    if error["type"] == "value_error":  # text for a file; FastAPI's message names classes
        detail = "got text, expected a file; send this form field as a file with a file name."
        return Unusable("bad-request", detail, where=location)
    return Unusable("bad-request", f"{error['msg']}.", where=location)
