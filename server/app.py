"""The application: routes, their shared state, and the middleware of every response."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Final

from fastapi import FastAPI

from foldback.server.api import (
    folds,
    health,
    mine,
    module_values,
    movies,
    results,
    shapes,
    tours,
    trajectories,
)
from foldback.server.context import Context
from foldback.server.http import problems
from foldback.server.http.access_log import Access
from foldback.server.http.base_path import BelowPath
from foldback.server.http.cut_requests import CutRequests
from foldback.server.http.forwarded_address import ForwardedAddress
from foldback.server.http.head import HeadAsGet
from foldback.server.http.read_only import ReadOnly
from foldback.server.http.request_rate import RequestRate
from foldback.server.http.response_cache import ResponseCache
from foldback.server.http.security import (
    AllowedHosts,
    SameOrigin,
    SecurityHeaders,
    ShortPrintableAddresses,
    hosts_of,
)
from foldback.server.http.upload_limits import (
    MAX_FORM_FIELD_BYTES,
    MAX_FORM_FIELDS,
    MAX_FORM_FILES,
    BodyLimit,
    UploadsAtOnce,
)
from foldback.server.limits.fair_threads import FairThreads
from foldback.server.live_class import class_connections
from foldback.server.ops.metrics import Metrics
from foldback.server.ops.readiness import Readiness
from foldback.server.pages import (
    fold,
    gallery,
    kiosk,
    landing,
    oembed,
    paper,
    pictures,
    player_data,
    prerendered_pages,
    preview,
    privacy,
    share,
    static,
)
from foldback.server.pages.problem_page import problem_page
from foldback.server.settings import Settings
from foldback.server.store.stats import Stats
from foldback.server.submission.shipped_folds import import_shipped_folds

log = logging.getLogger("foldback.service")

ROUTERS: Final = (
    folds,
    results,
    tours,
    module_values,
    movies,
    mine,
    shapes,
    health,
    landing,
    prerendered_pages,
    fold,
    static,
    paper,
    gallery,
    kiosk,
    player_data,
    share,
    oembed,
    pictures,
    preview,
    privacy,
    trajectories,
    class_connections,
)


def create_app(settings: Settings | None = None) -> FastAPI:
    """Return the application with the given settings, or with those of the environment."""
    settings = settings or Settings()
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        asyncio.get_running_loop().set_default_executor(FairThreads())
        context = await asyncio.to_thread(Context.open, settings, metrics)
        if settings.shipped_folds and not settings.read_only:
            await asyncio.to_thread(import_shipped_folds, settings, context.store, context.gallery)
        app.state.context = context
        stats = app.state.stats = Stats(settings, context.leases)
        app.state.readiness = Readiness(settings, context.leases, context.store.folders.check)
        if settings.prewarm:
            await asyncio.to_thread(context.fork_server.start)
        try:
            yield
        finally:
            context.close()
            stats.close()

    app = FastAPI(
        title="foldback",
        version=version("foldback"),
        description="Plans how a straight chain of modules folds into a solid.",
        lifespan=lifespan,
        form_limits={
            "max_files": MAX_FORM_FILES,
            "max_fields": MAX_FORM_FIELDS,
            "max_part_size": MAX_FORM_FIELD_BYTES,
        },
        openapi_url="/api/openapi.json",
        servers=[{"url": settings.base_path}] if settings.base_path else None,
        # FastAPI's pages load scripts from other sites; the service's is in prerendered_pages.py.
        docs_url=None,
        redoc_url=None,
    )
    app.openapi_version = "3.2.0"  # first version that describes server-sent events
    problems.install(app, problem_page)

    for module in ROUTERS:
        app.include_router(module.router)
    app.include_router(trajectories.schemas)

    _add_middleware(app, settings, metrics)
    return app


def _add_middleware(app: FastAPI, settings: Settings, metrics: Metrics) -> None:
    """Add the middleware, innermost first."""
    app.add_middleware(ResponseCache)
    app.add_middleware(HeadAsGet)
    app.add_middleware(
        BodyLimit,
        most_bytes=settings.max_upload_bytes,
        seconds=settings.upload_seconds,
        idle_s=settings.upload_idle_s,
    )
    app.add_middleware(UploadsAtOnce, settings=settings)
    if settings.read_only:
        app.add_middleware(ReadOnly, page=problem_page)
    app.add_middleware(SameOrigin, origins=settings.origins)
    app.add_middleware(ShortPrintableAddresses)
    app.add_middleware(AllowedHosts, hosts=hosts_of(settings.host, settings.allowed_hosts))
    app.add_middleware(
        RequestRate,
        rate=settings.requests_per_second_of_visitor,
        burst=settings.requests_at_once_of_visitor,
    )
    app.add_middleware(CutRequests)
    app.add_middleware(SecurityHeaders)
    app.add_middleware(Access, metrics=metrics)
    app.add_middleware(BelowPath, base_path=settings.base_path)
    app.add_middleware(ForwardedAddress, proxies=settings.trusted_proxies)
