"""Problem: an error that the service reports."""

from __future__ import annotations

from typing import Any

import httpx


class Problem(Exception):
    """Error response of the service (RFC 9457), or error of a failed job.

    Attributes:
        status: The HTTP status; None for a failed job.
        code: Short stable identifier for programs.
        detail: Actual value, expected value, remedy.
        where: Position in the input, or None.
        values: Values that the detail names; numbers of modules, cells and angles count from 0.
        retry_after: Seconds to wait before another attempt, if the service states them.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        status: int | None = None,
        where: str | None = None,
        values: dict[str, Any] | None = None,
        retry_after: float | None = None,
    ) -> None:
        super().__init__(f"{code}: {where + ': ' if where else ''}{detail}")
        self.status = status
        self.code = code
        self.detail = detail
        self.where = where
        self.values = values or {}
        self.retry_after = retry_after

    @classmethod
    def of(cls, answer: httpx.Response) -> Problem:
        """Return the problem in a response, which may also come from a proxy."""
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
            values=problem.get("values"),
            retry_after=_seconds(answer.headers.get("retry-after")),
        )


def _seconds(text: str | None) -> float | None:
    try:
        seconds = float(text or "")
    except ValueError:
        return None
    return seconds if 0.0 <= seconds < float("inf") else None
