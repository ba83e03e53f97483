"""The page that explains a problem, such as a missing page."""

from __future__ import annotations

from typing import Final

from fastapi import Request
from fastapi.responses import Response

from foldback.server.http.problems import Problem
from foldback.server.pages.page import page
from foldback.server.viewing.fold_lookup import viewing_of
from foldback.web.pictures.isometric import isometric_svg

PROBLEM_HEADINGS: Final = {
    404: "Page not found",
    429: "Too many requests",
    503: "Temporarily unavailable",
    507: "Storage is full",
}
DRAWN_CELLS: Final = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1))


def not_found_page(
    heading: str, text: str, *, status_code: int = 404, has_service: bool = True
) -> Response:
    """Return the page that explains a problem.

    Args:
        heading: Short heading.
        text: Explanation in one or two sentences.
        status_code: HTTP status of the response.
        has_service: True if it can link to other pages of a service.
    """
    drawing = isometric_svg(DRAWN_CELLS)
    return page(
        "message.html",
        status_code,
        heading=heading,
        text=text,
        drawing=drawing,
        has_service=has_service,
    )


def no_such_page(request: Request, words: tuple[str, str]) -> Response:
    """Return a page with a heading and a text, in a service or a viewer of one directory."""
    return not_found_page(*words, has_service=viewing_of(request).settings is not None)


def problem_page(problem: Problem) -> Response:
    """Return the page of any other problem."""
    heading = PROBLEM_HEADINGS.get(problem.status, "Something went wrong")
    answer = not_found_page(heading, problem.text, status_code=problem.status)
    answer.headers.update(problem.headers)
    return answer
