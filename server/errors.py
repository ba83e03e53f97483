"""Errors of the service: reasons why it refuses or cannot complete a request.

They do not depend on a protocol: ``server.http.problems`` maps them to HTTP responses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final, Self

from foldback.planner.errors import DamagedError, InputError, located
from foldback.planner.storage.file_names import CHAIN, PLAN, TIMELINE
from foldback.planner.storage.files import READ_ONLY_ERRORS

MOTION_FILES: Final = (TIMELINE, CHAIN, PLAN)
"""Files with the motion of a fold. If one of them is damaged, error messages say that the motion is
damaged."""
FULL_DISK_RETRY_S: Final = 60
"""Value of the ``Retry-After`` header, in s, if a request is refused because the disk is full or
cannot be written."""
UNEXPECTED_WORDS: Final = "an unexpected error occurred inside the service; its log has the reason."
"""What visitors learn about an exception that no code expects; its text may name files and code."""
READ_ONLY_WORDS: Final = "New folds cannot be accepted: the disk is read-only."


class ServiceError(Exception):
    """Base class of the reasons why a request is refused; subclasses are kinds of reasons.

    Attributes:
        code: Short stable identifier for programs.
        detail: Actual value, expected value, remedy.
        where: Part of the input, or None.
        values: Plain JSON values that the detail names; parts of an input count from 0.
        message: The detail for people, with its place.
        retry_after_s: Time after which another attempt may succeed, in s; None if it would not.

    Args:
        code, where, message, retry_after_s: See above.
        template: The detail; if there are values, it names them in braces, as in ``str.format``,
            and may name ``retry_after_s``, too.
        values: Values that the template names.
    """

    def __init__(
        self,
        code: str,
        template: str,
        *,
        where: str | None = None,
        message: str | None = None,
        retry_after_s: int | None = None,
        **values: Any,
    ) -> None:
        if "{retry_after_s}" in template:
            values["retry_after_s"] = retry_after_s
        self.code = code
        self.detail = template.format(**values) if values else template
        super().__init__(self.detail)
        self.where = where
        self.values: Mapping[str, Any] = values
        self.message = message or located(self.detail, where)
        self.retry_after_s = retry_after_s


class Malformed(ServiceError):
    """The request is invalid."""


class Unusable(ServiceError):
    """The request is understood, but its input cannot be used."""

    @classmethod
    def of(cls, error: InputError) -> Self:
        """Return the error for an input that the planner refuses."""
        unusable = cls(error.code, error.detail, where=error.where, message=error.message)
        unusable.values = error.values
        return unusable


class TooLarge(ServiceError):
    """The input or the result is larger than permitted."""


class Unidentified(ServiceError):
    """The request requires an owner token and has none."""


class Forbidden(ServiceError):
    """This client is not permitted to make the request."""


class NotFound(ServiceError):
    """The requested thing does not exist."""


class NoSuch(NotFound, LookupError):
    """There is no item with the requested id, or it has been deleted."""


class Conflict(ServiceError):
    """The request does not match the state of the fold."""


class WebsocketNeeded(ServiceError):
    """The resource is available only over a websocket."""


class TooMany(ServiceError):
    """The client has exceeded a limit."""


class Unavailable(ServiceError):
    """The service is busy, or a part of it is unavailable."""


class TooSlow(ServiceError):
    """The request exceeded a time limit."""


class Damaged(ServiceError):
    """Stored data are missing or damaged."""

    @classmethod
    def of(cls, error: DamagedError) -> Self:
        """Return the error for visitors; only the log names the file."""
        return cls("damaged-data", f"{damage_words([error.path])}. The operator can restore it.")


def damage_words(names: Iterable[str]) -> str:
    """Return the message about a fold with damaged files, without a full stop."""
    motion = any(part in name for name in names for part in MOTION_FILES)
    return f"The stored {'motion' if motion else 'data'} of this fold is damaged"


class NoRoom(ServiceError):
    """The disk is full."""


def read_only() -> NoRoom:
    """Return the error for a read-only disk."""
    return NoRoom("read-only", READ_ONLY_WORDS, retry_after_s=FULL_DISK_RETRY_S)


def not_stored(subject: str, error: OSError) -> NoRoom:
    """Return the error for something that could not be written."""
    if error.errno in READ_ONLY_ERRORS:
        return read_only()
    template = f"The {subject} could not be stored ({{reason}}); try again later."
    return no_room(template, reason=error.strerror)


def no_room(template: str, **values: Any) -> NoRoom:
    """Return the error for a disk that is full or nearly full."""
    return NoRoom("no-room", template, retry_after_s=FULL_DISK_RETRY_S, **values)


def refusal_of(error: ServiceError | InputError | DamagedError) -> ServiceError:
    """Return the service error that corresponds to an error."""
    match error:
        case InputError():
            return Unusable.of(error)
        case DamagedError():
            return Damaged.of(error)
        case _:
            return error
