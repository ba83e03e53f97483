"""Errors of the service: reasons why it refuses or cannot complete a request.

They know no protocol: ``server.http.problems`` says what each is over HTTP.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Self

from planner.errors import DamagedError, InputError
from planner.file_names import CHAIN, PLAN, PLAN_TEXT, TIMELINE
from planner.files import READ_ONLY_ERRORS

MOTION_FILES: Final = (TIMELINE, CHAIN, PLAN, PLAN_TEXT)
"""Files that hold the motion of a fold. If one of them is damaged, error messages say that the
motion is damaged."""
FULL_DISK_RETRY_S: Final = 60
"""Value of the ``Retry-After`` header, in s, if a request is refused because the disk is full or
cannot be written. A smaller value brings more requests that fail again. Chosen."""
READ_ONLY_WORDS: Final = "New folds cannot be accepted: the disk is read-only."


class ServiceError(Exception):
    """Root of the reasons for which a request is refused. Subclasses are kinds of reasons.

    Attributes:
        code: Short stable word for programs.
        detail: The value found, the value expected, and the remedy.
        where: Part of the input, or None.
        retry_after_s: Time after which another attempt may succeed, in s; None if it would not.
    """

    def __init__(
        self, code: str, detail: str, *, where: str | None = None, retry_after_s: int | None = None
    ) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
        self.where = where
        self.retry_after_s = retry_after_s


class Malformed(ServiceError):
    """The request is invalid."""


class Unusable(ServiceError):
    """The request is understood, but its input cannot be used."""

    @classmethod
    def of(cls, error: InputError) -> Self:
        """Return the error that the planner cannot use an input."""
        return cls(error.code, error.detail, where=error.where)


class TooLarge(ServiceError):
    """The input or the result is larger than permitted."""


class Unidentified(ServiceError):
    """The request is for an owner only, and has no token."""


class Forbidden(ServiceError):
    """The request is not permitted to this client."""


class NotFound(ServiceError):
    """The requested thing does not exist."""


class NoSuch(NotFound, LookupError):
    """There is nothing with the requested id, or not any more."""


class Conflict(ServiceError):
    """The request does not match the state of the fold."""


class WebsocketNeeded(ServiceError):
    """The resource is available over a websocket only."""


class TooMany(ServiceError):
    """The client has exceeded a limit."""


class Unavailable(ServiceError):
    """The request cannot be served now: the service is busy, or a part of it is away."""


class TooSlow(ServiceError):
    """The request exceeded a time limit."""


class Damaged(ServiceError):
    """Stored data is missing, or is not what was written."""

    @classmethod
    def of(cls, error: DamagedError) -> Self:
        """Return the error that visitors read; the log names the file."""
        return cls("damaged-data", f"{damage_words([error.path])}. The operator can restore it.")


def damage_words(names: Iterable[str]) -> str:
    """Return what is said of a fold with damaged files, without a full stop."""
    motion = any(part in name for name in names for part in MOTION_FILES)
    return f"The stored {'motion' if motion else 'data'} of this fold is damaged"


class NoRoom(ServiceError):
    """The disk is full."""


def read_only() -> NoRoom:
    """Return the error of a disk that cannot be written at all."""
    return NoRoom("read-only", READ_ONLY_WORDS, retry_after_s=FULL_DISK_RETRY_S)


def not_stored(what: str, error: OSError) -> NoRoom:
    """Return the error of something that could not be written."""
    if error.errno in READ_ONLY_ERRORS:
        return read_only()
    return no_room(f"The {what} could not be stored ({error.strerror}); try again later.")


def no_room(detail: str) -> NoRoom:
    """Return the error of a disk that is full, or nearly so."""
    return NoRoom("no-room", detail, retry_after_s=FULL_DISK_RETRY_S)


def refusal_of(error: ServiceError | InputError | DamagedError) -> ServiceError:
    """Return the reason for a refusal that an error gives."""
    match error:
        case InputError():
            return Unusable.of(error)
        case DamagedError():
            return Damaged.of(error)
        case _:
            return error
