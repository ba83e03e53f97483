"""The application: routes, their shared state, and the middleware of every response."""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import replace
from importlib.metadata import version
from typing import Final

from fastapi import FastAPI

from planner.readers.gallery import Gallery
from server.api import (
    folds,
    health,
    mine,
    module_values,
    movies,
    player_data,
    results,
    robot,
    shapes,
    tours,
)
from server.api.context import Context
from server.api.fold_states import FoldStates
from server.api.frame_waits import FrameWaits
from server.api.shipped_folds import import_shipped_folds
from server.files.artifacts import Artifacts
from server.files.pictures import Pictures
from server.files.preview_reports import PreviewReports
from server.files.preview_scenes import PreviewScenes
from server.files.trajectories import Trajectories
from server.files.uploads import Uploads
from server.http import problems
from server.http.access_log import Access
from server.http.base_path import BelowPath
from server.http.head import HeadAsGet
from server.http.live_classes import LiveClasses
from server.http.read_only import ReadOnly
from server.http.request_rate import RequestRate
from server.http.response_cache import ResponseCache
from server.http.security import (
    AllowedHosts,
    PrintingAddresses,
    SameOrigin,
    SecurityHeaders,
    hosts_of,
)
from server.http.upload_limits import (
    MAX_FORM_FIELD_BYTES,
    MAX_FORM_FIELDS,
    MAX_FORM_FILES,
    BodyLimit,
    UploadsAtOnce,
)
from server.jobs.eta import EtaEstimator
from server.jobs.movies import Movies
from server.limits.concurrency_quota import Quota
from server.limits.fair_threads import FairThreads
from server.limits.robot_rates import robot_rates
from server.limits.single_flight import SingleFlight
from server.limits.token_buckets import TokenBuckets
from server.ops.metrics import Metrics
from server.ops.readiness import Readiness
from server.pages import (
    class_connections,
    fold,
    gallery,
    kiosk,
    landing,
    oembed,
    paper,
    pictures,
    prerendered_pages,
    preview,
    privacy,
    shape_drawings,
    share,
    static,
)
from server.pages.problem_page import problem_page
from server.processes.children import Pool, Reader
from server.processes.fork_server import ForkServer
from server.processes.limits import READER_PROCESSES, ChildLimits
from server.processes.scratch import Scratch
from server.settings import Settings
from server.store.estimates import Estimates
from server.store.folds import Store
from server.store.leases import Leases
from server.store.previews import Previews
from server.store.stats import Stats
from web.timeline.shared_views import TimelineViews

WARM_UP_DELAY_S: Final = 1.5
"""Time between the start of the web process and the preparation of its landing page, in s, so that
the first requests do not compete with the preparation. A larger value makes the first view of the
landing page slow for longer. Chosen."""
UPLOAD_QUEUE_TIMEOUT_S: Final = 60.0
"""Maximum time that an upload waits until a process is free to read it, in s; then it is refused. A
smaller value refuses more uploads under load; a larger one keeps more connections open. Chosen."""
log = logging.getLogger("foldback.web")

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
    shape_drawings,
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
    robot,
    class_connections,
)


def create_app(
    settings: Settings | None = None, *, fork_server: ForkServer | None = None
) -> FastAPI:
    """Return the application with the given settings, or those of the environment.

    Args:
        settings: The settings.
        fork_server: One that forks for others, too: it goes on when the application ends.
    """
    settings = settings or Settings()
    metrics = Metrics()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        asyncio.get_running_loop().set_default_executor(FairThreads())
        context = await asyncio.to_thread(_open, settings, metrics, fork_server)
        app.state.context = context
        stats = app.state.stats = Stats(settings, context.leases)
        app.state.readiness = Readiness(settings, context.leases, context.store.folders.check)
        warming = asyncio.create_task(_warm_up(context)) if settings.prewarm else None
        try:
            yield
        finally:
            if warming is not None:
                warming.cancel()
            _close(context, shared=fork_server is not None)
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
        # FastAPI's own pages load scripts from elsewhere; ours is in prerendered_pages.py.
        docs_url=None,
        redoc_url=None,
    )
    app.openapi_version = "3.2.0"  # the first that describes server-sent events
    problems.install(app, problem_page)

    for module in ROUTERS:
        app.include_router(module.router)
    app.include_router(robot.schemas)

    _add_middleware(app, settings, metrics)
    return app


def _add_middleware(app: FastAPI, settings: Settings, metrics: Metrics) -> None:
    """Add what handles each request before its route, the innermost first."""
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
    app.add_middleware(PrintingAddresses)
    app.add_middleware(AllowedHosts, hosts=hosts_of(settings.host, settings.allowed_hosts))
    app.add_middleware(
        RequestRate,
        rate=settings.requests_per_second_of_visitor,
        burst=settings.requests_at_once_of_visitor,
    )
    app.add_middleware(SecurityHeaders)
    app.add_middleware(Access, metrics=metrics)
    app.add_middleware(BelowPath, base_path=settings.base_path)


async def _warm_up(context: Context) -> None:
    """Start and load what the first visitors would wait for."""
    # In a thread: starting a process takes a moment that the first answer need not wait for.
    if context.fork_server is not None:
        await asyncio.to_thread(context.fork_server.start)
    await asyncio.sleep(WARM_UP_DELAY_S)  # the service has come to rest
    await asyncio.to_thread(landing.warm_up, context.gallery)


def _open(settings: Settings, metrics: Metrics, shared: ForkServer | None) -> Context:
    store = Store(settings)
    previews = Previews(settings, store)
    leases = Leases.of(settings, store)
    awaited = ChildLimits.of(settings, awaited=True)
    fork_server = shared or ForkServer.where_possible(
        ["reader", "preparer", "retimer"],
        warm=settings.prewarm and not settings.read_only,
        directory=settings.root,
    )
    motions = Scratch(settings.motions_dir)
    motions.sweep()
    estimates = Estimates(store)
    remaining = EtaEstimator(store, leases, estimates)
    gallery = Gallery()
    if settings.finished_folds and not settings.read_only:
        import_shipped_folds(settings, store, gallery)
    if not settings.read_only:
        previews.start_sweeping()
    return Context(
        settings=settings,
        store=store,
        timelines=TimelineViews(),
        waits=FrameWaits(settings.max_waits, settings.max_waits_of_visitor),
        streams=_quota("event streams", settings.max_streams, settings.max_streams_of_visitor),
        robots=_quota("robots", settings.max_robots, settings.max_robots_of_visitor),
        robot_rates=robot_rates(),
        classes=LiveClasses(settings),
        trajectories=_trajectories(settings, awaited, motions, fork_server),
        answers=SingleFlight(
            "answers",
            at_once=2,
            total=settings.answers_waiting,
            per_visitor=settings.answers_waiting_of_visitor,
        ),
        lists=TokenBuckets(
            settings.lists_per_second_of_visitor, 20 * settings.lists_per_second_of_visitor
        ),
        uploads=Uploads(settings),
        fork_server=fork_server,
        reader=_reader(settings, awaited, fork_server),
        previews=previews,
        preview_reports=PreviewReports(
            settings, previews, _preparer(settings, awaited, fork_server)
        ),
        preview_scenes=PreviewScenes(previews),
        artifacts=_artifacts(settings, store),
        pictures=_pictures(settings, awaited, motions),
        movies=Movies(settings, store),
        gallery=gallery,
        fold_states=FoldStates(store, remaining),
        remaining=remaining,
        estimates=estimates,
        metrics=metrics,
        leases=leases,
        secret=store.secret("visitors", secrets.token_bytes(32)),
    )


def _close(context: Context, *, shared: bool) -> None:
    """Close what has been opened, first what uses the rest.

    Args:
        context: Objects of the application.
        shared: True if the fork server goes on for other applications.
    """
    own_fork_server = None if shared else context.fork_server
    for part in (
        context.reader,
        context.preview_reports,
        context.previews,
        context.trajectories,
        context.pictures,
        own_fork_server,
        context.artifacts,
        context.answers,
        context.waits,
        context.fold_states,
        context.preview_scenes,
        context.store,
        context.uploads,
    ):
        if part is not None:
            part.close()


def _artifacts(settings: Settings, store: Store) -> Artifacts:
    return Artifacts(
        store,
        # With a storage they are among the copies, which have a bound of their own.
        on_stored=store.add_derived if store.folders.storage is None else None,
        min_free_disk_bytes=settings.min_free_disk_bytes,
        total=settings.files_waiting,
        per_visitor=settings.files_waiting_of_visitor,
    )


def _quota(what: str, total: int, per_visitor: int) -> Quota:
    return Quota(what, total=total, per_visitor=per_visitor)


def _trajectories(
    settings: Settings, awaited: ChildLimits, motions: Scratch, fork_server: ForkServer | None
) -> Trajectories:
    return Trajectories(
        Pool(
            "retimer",
            replace(awaited, folders=(str(settings.motions_dir),)),
            wall_s=settings.retime_seconds,
            fork_server=fork_server,
        ),
        motions,
        Scratch(settings.scratch_dir),
        total=settings.answers_waiting,
        per_visitor=settings.answers_waiting_of_visitor,
    )


def _pictures(settings: Settings, awaited: ChildLimits, motions: Scratch) -> Pictures:
    # Started by itself: the fork server would have to load and compile what pictures need.
    pool = Pool(
        "pictures",
        replace(awaited, folders=(str(settings.motions_dir),)),
        wall_s=settings.preview_seconds,
    )
    return Pictures(pool, motions)


def _reader(settings: Settings, awaited: ChildLimits, fork_server: ForkServer | None) -> Reader:
    pool = Pool("reader", awaited, wall_s=settings.read_seconds, fork_server=fork_server)
    return _bounded(pool, "uploads", settings.max_uploads, settings.max_uploads_of_visitor)


def _preparer(settings: Settings, awaited: ChildLimits, fork_server: ForkServer | None) -> Reader:
    pool = Pool("preparer", awaited, wall_s=settings.preview_seconds, fork_server=fork_server)
    total, per_visitor = settings.previews_waiting, settings.previews_waiting_of_visitor
    return _bounded(pool, "previews", total, per_visitor)


def _bounded(pool: Pool, what: str, total: int, per_visitor: int) -> Reader:
    quota = Quota(
        what,
        at_once=READER_PROCESSES,
        at_once_per_visitor=1,
        total=total,
        per_visitor=per_visitor,
        timeout_s=UPLOAD_QUEUE_TIMEOUT_S,
    )
    return Reader(pool, quota)
