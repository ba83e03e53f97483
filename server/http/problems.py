"""Problems: how the API says that something is wrong (RFC 9457, ``application/problem+json``)."""

from __future__ import annotations

import errno
import logging
from collections.abc import Callable, Mapping
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

from planner.errors import InputError
from planner.pipeline.request import Request as Asked
from server.http.access_log import request_id_of

MEDIA_TYPE: Final = "application/problem+json"
DISK_ERRORS: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG})
DATABASE_RETRY_S: Final = 5
DISK_RETRY_S: Final = 60
log = logging.getLogger("foldback.web")
CODES: Final = {404: "not-found", 408: "too-slow", 413: "too-large"}


class Problem(Exception):
    """An answer that is a problem.

    Attributes:
        status: The HTTP status.
        code: Short stable word for programs.
        detail: What was found, what was expected, what to do.
        where: Where in the input, or None.
        headers: Further headers of the answer.
    """

    def __init__(
        self,
        status: int,
        code: str,
        detail: str,
        *,
        where: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.code = code
        self.detail = detail
        self.where = where
        self.headers = dict(headers or {})

    @classmethod
    def of_input(cls, error: InputError) -> Problem:
        """The problem that an input cannot be used."""
        return cls(422, error.code, error.detail, where=error.where)

    def body(self) -> dict[str, Any]:
        """The JSON object."""
        return {
            "type": "about:blank",
            "title": HTTPStatus(self.status).phrase,
            "status": self.status,
            "code": self.code,
            "detail": self.detail,
            "where": self.where,
        }

    def response(self) -> JSONResponse:
        """The HTTP answer."""
        return JSONResponse(
            self.body(), status_code=self.status, headers=self.headers, media_type=MEDIA_TYPE
        )


def no_such_fold() -> Problem:
    """For an id that is not, or is no longer, a fold."""
    return Problem(404, "no-such-fold", "There is no fold at this address; it may be deleted.")


def no_such_preview() -> Problem:
    """For an id that is not, or is no longer, a preview."""
    return Problem(
        404, "no-such-preview", "There is no such preview, or not any more; send the file again."
    )


def no_such_movie() -> Problem:
    """For an id that is not, or is no longer, a movie of that fold."""
    return Problem(
        404, "no-such-movie", "There is no such movie, or not any more; ask for it anew."
    )


def of_trouble(error: BaseException | None) -> Problem | None:
    """The problem that the database does not answer or the disk is full, if it is one."""
    if isinstance(error, OperationalError) and "disk is full" in str(error.orig):
        return _disk()
    fault = isinstance(error, DataError | IntegrityError | ProgrammingError)
    if isinstance(error, DBAPIError | PoolTimeoutError) and not fault:
        return Problem(
            503,
            "no-database",
            f"The database does not answer; nothing was lost. Try again in {DATABASE_RETRY_S} s.",
            headers={"Retry-After": str(DATABASE_RETRY_S)},
        )
    if isinstance(error, OSError) and error.errno in DISK_ERRORS:
        return _disk()
    return None


def _disk() -> Problem:
    return Problem(
        507,
        "no-room",
        "The disk of the service takes nothing any more; nothing was lost. Try again later.",
        headers={"Retry-After": str(DISK_RETRY_S)},
    )


def install(app: FastAPI, page: Callable[[Problem], Response]) -> None:
    """Makes the application answer every error as a problem.

    Args:
        app: The application.
        page: Makes a page of one, for people who asked for a page.
    """

    def answer(request: Request, problem: Problem) -> Response:
        asked = request.headers.get("accept", "")
        if request.url.path.startswith("/api/") or "text/html" not in asked:
            return problem.response()
        return page(problem)

    async def on_problem(request: Request, error: Exception) -> Response:
        assert isinstance(error, Problem)
        return answer(request, error)

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        if (trouble := of_trouble(error.__cause__)) is not None:  # while a form came in
            log.error("%s: %r", trouble.code, error.__cause__)
            return answer(request, trouble)
        phrase = HTTPStatus(error.status_code).phrase
        code = CODES.get(error.status_code, phrase.lower().replace(" ", "-"))
        problem = Problem(error.status_code, code, str(error.detail), headers=error.headers)
        return answer(request, problem)

    async def on_validation(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        first = error.errors()[0]
        if (refusal := _refusal(first)) is not None:
            return answer(request, Problem.of_input(refusal))
        where = ".".join(str(part) for part in first["loc"])
        problem = Problem(422, "bad-request", f"{first['msg']}.", where=where)
        return answer(request, problem)

    async def on_trouble(request: Request, error: Exception) -> Response:
        trouble = of_trouble(error)
        if trouble is None:
            raise error
        log.error("%s: %r", trouble.code, error)
        return answer(request, trouble)

    async def on_anything(request: Request, error: Exception) -> Response:
        words = "Something went wrong inside the service; nothing was lost. Try again."
        headers = request_id_of(request.scope)
        return answer(request, Problem(500, "internal", words, headers=headers))

    app.add_exception_handler(Problem, on_problem)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(SQLAlchemyError, on_trouble)
    app.add_exception_handler(OSError, on_trouble)
    app.add_exception_handler(Exception, on_anything)


def _refusal(error: Any) -> InputError | None:
    """What the planner says of a parameter, so that it reads the same as on the command line."""
    place, name = error["loc"][0], str(error["loc"][-1])
    if place != "body" or name not in Asked.__dataclass_fields__:
        return None
    try:
        Asked.of(**{name: error["input"]}).check()
    except InputError as refusal:
        return refusal
    except TypeError:  # not even a text
        return None
    return None
