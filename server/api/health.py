"""Routes for operators: liveness, readiness and metrics."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from secrets import compare_digest
from typing import Final

from fastapi import APIRouter, Depends, Request
from fastapi.responses import JSONResponse, PlainTextResponse, Response
from fastapi.security import HTTPAuthorizationCredentials
from sqlalchemy.exc import SQLAlchemyError

from foldback.server.context import Context, Here
from foldback.server.dependencies.described_answers import problems
from foldback.server.dependencies.owner_tokens import Bearer
from foldback.server.errors import Forbidden, NotFound
from foldback.server.http.base_path import BELOW
from foldback.server.ops.metrics import METRICS_MEDIA_TYPE
from foldback.server.ops.readiness import Readiness
from foldback.server.store.stats import Stats

router = APIRouter(tags=["operation"])
PROXY_HEADERS: Final = (
    *("x-forwarded-for", "x-forwarded-host", "x-forwarded-proto", "x-real-ip", "forwarded", "via"),
)
"""Header fields that proxies add to the requests that they pass on."""


def inside(request: Request) -> None:
    """Answer 404 to requests that a proxy passed on, or whose address has the base path."""
    if BELOW in request.scope or any(name in request.headers for name in PROXY_HEADERS):
        raise NotFound("not-found", "Not found.")


@router.get("/health", summary="Liveness check")
async def get_health() -> dict[str, str]:
    """Answer 200 while the web process runs."""
    return {"status": "ok"}


@router.get(
    "/ready",
    summary="Readiness check",
    dependencies=[Depends(inside)],
    responses=problems(404),
)
def get_ready(request: Request) -> JSONResponse:
    """Answer 503, with the reasons, if the service is not ready.

    It is not ready if a part of it fails, no worker runs, or it is stopping. Requests through a
    proxy are answered with 404.
    """
    readiness: Readiness = request.app.state.readiness
    state = readiness.state()
    return JSONResponse(
        {"ready": state.ready, **asdict(state)},
        status_code=200 if state.ready else 503,
        headers={"Cache-Control": "no-store"},
    )


@router.get(
    "/metrics",
    summary="Prometheus metrics",
    response_class=PlainTextResponse,
    dependencies=[Depends(inside)],
    responses=problems(403, 404),
)
async def get_metrics(request: Request, context: Here, credentials: Bearer) -> Response:
    """Return counts in Prometheus' text format to clients that send the operator's token.

    Requests through a proxy are answered with 404.
    """
    if not _may_read(context, credentials):
        raise Forbidden(
            "not-public",
            "Metrics are for operators only; send the value of FOLDBACK_METRICS_TOKEN as "
            "'Authorization: Bearer …'.",
        )
    stats: Stats = request.app.state.stats
    readiness: Readiness = request.app.state.readiness
    streams, target_streams = len(context.streams), len(context.target_streams)
    try:
        counts = await asyncio.to_thread(stats.counts)
    except SQLAlchemyError:
        counts = None
    places = await asyncio.to_thread(readiness.places)
    text = context.metrics.text(counts, places, streams=streams, target_streams=target_streams)
    return Response(text, media_type=METRICS_MEDIA_TYPE)


def _may_read(context: Context, credentials: HTTPAuthorizationCredentials | None) -> bool:
    """Return True if the metrics are public or the request has the operator's token.

    The address of a request is not checked, because it may be that of a proxy on this machine.
    """
    token = context.settings.metrics_token
    if context.settings.metrics_public:
        return True
    if token is None or credentials is None:
        return False
    expected = token.get_secret_value()
    return compare_digest(credentials.credentials.encode(), expected.encode())
