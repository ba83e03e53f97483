"""Described answers: files and problems that a route may answer with, as OpenAPI describes them."""

from __future__ import annotations

from typing import Any

from foldback.server.schemas import ProblemBody


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the problems that a route may answer with, as OpenAPI describes them."""
    content = {"application/problem+json": {"schema": ProblemBody.model_json_schema()}}
    return {status: {"description": "A problem", "content": content} for status in statuses}


def file_or_problems(about: str, *kinds: str, problem: tuple[int, ...]) -> dict[int | str, Any]:
    """Return the answers of a route that sends a file of one of some media types."""
    content = {kind: dict[str, Any]() for kind in kinds}
    return {200: {"description": about, "content": content}, **problems(*problem)}
