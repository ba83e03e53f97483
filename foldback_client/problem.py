"""Problem: an error that the service reports."""

from __future__ import annotations

from typing import Any

import httpx


class Problem(Exception):
    """An answer that is a problem (RFC 9457), or a job that ended as one.

    Attributes:
        status: The HTTP status; None when a job ended so.
        code: Short stable word for programs.
        detail: Value found, value expected, remedy.
        where: Position in the input, or None.
        retry_after: Seconds after which to try again, when the service says so.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        status: int | None = None,
        where: str | None = None,
        retry_after: float | None = None,
    ) -> None:
        super().__init__(f"{code}: {where + ': ' if where else ''}{detail}")
        self.status = status
        self.code = code
        self.detail = detail
        self.where = where
        self.retry_after = retry_after

    @classmethod
    def of(cls, answer: httpx.Response) -> Problem:
        """Return the problem in an answer that was read; a proxy may have written it."""
        try:
            body: Any = answer.json()
        except ValueError:
            body = None
        problem: dict[str, Any] = body if isinstance(body, dict) else {}
        plain = f"got the HTTP status {answer.status_code}"
        if answer.has_redirect_location:
            plain += f" and a redirect to {answer.headers['location']}; use that address"
        return cls(
            str(problem.get("code") or f"http-{answer.status_code}"),
            str(problem.get("detail") or plain),
            status=answer.status_code,
            where=problem.get("where"),
            retry_after=_seconds(answer.headers.get("retry-after")),
        )


def _seconds(text: str | None) -> float | None:
    try:
        found = float(text or "")
    except ValueError:
        return None
    return found if 0.0 <= found < float("inf") else None
