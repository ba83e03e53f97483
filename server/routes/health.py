"""Routes for operators: is it alive, is it ready, what are its figures."""

from __future__ import annotations

import shutil

from fastapi import APIRouter
from fastapi.responses import JSONResponse, PlainTextResponse
from sqlalchemy.exc import SQLAlchemyError

from server.routes.folds import Here

router = APIRouter(tags=["operation"])


@router.get("/health", summary="Is it alive?")
def get_health() -> dict[str, str]:
    """Answers whenever the web process runs."""
    return {"status": "ok"}


@router.get("/ready", summary="Can it take folds?")
def get_ready(context: Here) -> JSONResponse:
    """503 while the database does not answer, the disk is full, or no worker runs here."""
    settings = context.settings
    try:
        context.store.check()
        database = "ok"
    except SQLAlchemyError as error:
        database = f"does not answer: {type(error).__name__}"
    free = shutil.disk_usage(settings.root).free
    disk = "ok" if free >= settings.min_free_disk_bytes else f"{free // 2**20} MiB free"
    workers = len(context.leases.workers())
    ready = database == disk == "ok" and (workers > 0 or settings.workers == 0)
    return JSONResponse(
        {"ready": ready, "database": database, "disk": disk, "workers": workers},
        status_code=200 if ready else 503,
    )


@router.get("/metrics", summary="Figures for Prometheus", response_class=PlainTextResponse)
def get_metrics(context: Here) -> PlainTextResponse:
    """Counters in Prometheus' text format."""
    text = context.metrics.text(context.store.counts())
    return PlainTextResponse(text, media_type="text/plain; version=0.0.4")
