"""Context: resources that the routes of a running service share."""

from __future__ import annotations

import secrets
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from math import ceil
from typing import Annotated

from fastapi import Depends, Request
from starlette.requests import HTTPConnection

from foldback.planner.readers.gallery import Gallery
from foldback.server.errors import TooMany
from foldback.server.files.artifacts import Artifacts
from foldback.server.files.fold_figures import figures_by
from foldback.server.files.pictures import Pictures
from foldback.server.files.preview_reports import PreviewReports
from foldback.server.files.trajectories import Trajectories
from foldback.server.files.uploads import Uploads
from foldback.server.http.client_address import address_of
from foldback.server.jobs.eta import EtaEstimator
from foldback.server.jobs.movies import Movies
from foldback.server.limits.concurrency_quota import Quota
from foldback.server.limits.networks import hidden
from foldback.server.limits.single_flight import SingleFlight
from foldback.server.limits.token_buckets import SharedBuckets, TokenBuckets
from foldback.server.live_class.live_classes import LiveClasses
from foldback.server.ops.metrics import Metrics
from foldback.server.processes.children import Children, Pool
from foldback.server.processes.fork_server import ForkServer
from foldback.server.processes.limits import READER_PROCESSES, ChildLimits
from foldback.server.processes.scratch import Scratch
from foldback.server.settings import Settings
from foldback.server.store.estimates import Estimates
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.previews import Previews
from foldback.server.target_streams.stream_rates import stream_rates
from foldback.server.viewing.fold_lookup import Viewing
from foldback.server.viewing.fold_states import FoldStates
from foldback.server.viewing.frame_waits import FrameWaits
from foldback.web.timeline.shared_views import TimelineViews


@dataclass(frozen=True, slots=True, kw_only=True)
class Context(Viewing):
    """Shared resources of all requests, from start to shutdown."""

    settings: Settings
    store: Store
    fork_server: ForkServer
    reader: Pool
    previews: Previews
    preview_reports: PreviewReports
    pictures: Pictures
    movies: Movies
    gallery: Gallery
    fold_states: FoldStates
    streams: Quota
    target_streams: Quota
    stream_rates: SharedBuckets
    classes: LiveClasses
    trajectories: Trajectories
    answers: SingleFlight
    lists: TokenBuckets
    uploads: Uploads
    metrics: Metrics
    leases: Leases
    remaining: EtaEstimator
    estimates: Estimates
    secret: bytes
    resources: ExitStack

    @classmethod
    def open(cls, settings: Settings, metrics: Metrics) -> Context:
        """Open all resources of the application; if one fails, those before it are closed.

        Args:
            settings: The settings.
            metrics: Counters of the web process.
        """
        with ExitStack() as opened:
            return cls._opened(settings, metrics, opened)

    @classmethod
    def _opened(cls, settings: Settings, metrics: Metrics, opened: ExitStack) -> Context:
        """Open all resources, each of which ``opened`` closes: the latest first."""
        uploads = opened.enter_context(closing(Uploads(settings)))
        store = opened.enter_context(closing(Store(settings)))
        leases = Leases(settings, store)
        estimates = Estimates(store)
        remaining = EtaEstimator(store, leases, estimates)
        fold_states = opened.enter_context(closing(FoldStates(store, remaining)))
        waits = opened.enter_context(
            closing(FrameWaits(settings.max_waits, settings.max_waits_of_visitor))
        )
        answers = opened.enter_context(closing(_answers(settings)))
        artifacts = opened.enter_context(closing(_artifacts(settings, store)))
        awaited = ChildLimits.of(settings, awaited=True)
        fork_server = opened.enter_context(
            closing(ForkServer(["reader", "preparer", "retimer", "figures", "pictures"]))
        )
        Scratch(settings.motions_dir).sweep()
        motions = replace(awaited, folders=(str(settings.motions_dir),))
        plotter = Children("figures", replace(awaited, folders=()), fork_server)
        opened.callback(plotter.close)
        figures = opened.enter_context(closing(figures_by(plotter, settings, store)))
        verdicts = opened.enter_context(closing(figures_by(plotter, settings, store, "verdict")))
        retimer = Pool("retimer", motions, wall_s=settings.retime_seconds, fork_server=fork_server)
        drawer = Pool("pictures", motions, wall_s=settings.preview_seconds, fork_server=fork_server)
        pictures = opened.enter_context(closing(Pictures(settings, drawer)))
        trajectories = opened.enter_context(closing(Trajectories(settings, retimer)))
        previews = opened.enter_context(closing(Previews(settings, store)))
        preparer = _preparer(settings, awaited, fork_server)
        preview_reports = opened.enter_context(
            closing(PreviewReports(settings, previews, preparer))
        )
        reader = opened.enter_context(closing(_reader(settings, awaited, fork_server)))
        if not settings.read_only:
            previews.start_sweeping()
        return cls(
            settings=settings,
            store=store,
            timelines=TimelineViews(),
            waits=waits,
            streams=_quota("event streams", settings.max_streams, settings.max_streams_of_visitor),
            target_streams=_quota(
                "target streams",
                settings.max_target_streams,
                settings.max_target_streams_of_visitor,
            ),
            stream_rates=stream_rates(),
            classes=LiveClasses(settings),
            trajectories=trajectories,
            answers=answers,
            lists=TokenBuckets(
                settings.lists_per_second_of_visitor, 20 * settings.lists_per_second_of_visitor
            ),
            uploads=uploads,
            fork_server=fork_server,
            reader=reader,
            previews=previews,
            preview_reports=preview_reports,
            artifacts=artifacts,
            figures=figures,
            verdicts=verdicts,
            pictures=pictures,
            movies=Movies(settings, store),
            gallery=Gallery(),
            fold_states=fold_states,
            remaining=remaining,
            estimates=estimates,
            metrics=metrics,
            leases=leases,
            secret=store.secret("visitors", secrets.token_bytes(32)),
            resources=opened.pop_all(),
        )

    def close(self) -> None:
        """Close all resources, the latest first."""
        self.resources.close()

    def take_list(self, request: Request) -> None:
        """Count a visitor's request for a list.

        Raises:
            TooMany: If the visitor or its network exceeds the rate limit of lists.
        """
        if wait_s := self.lists.take(address_of(request)):
            raise TooMany(
                "too-many-lists",
                "got too many requests for lists from your address; try again in "
                "{retry_after_s} s.",
                retry_after_s=ceil(wait_s),
            )

    def visitor(self, request: Request) -> str:
        """Return the pseudonym of the visitor and its networks."""
        return hidden(address_of(request), self.secret)


def context_of(request: HTTPConnection) -> Context:
    """Return the context of the application that a request or a websocket is for."""
    context: Context = request.app.state.context
    return context


Here = Annotated[Context, Depends(context_of)]
"""The context, as a dependency of routes."""


async def in_list_rate(request: Request) -> None:
    """Count the request as one for a list: a dependency of routes that read many rows."""
    context_of(request).take_list(request)


def _answers(settings: Settings) -> SingleFlight:
    return SingleFlight(
        "answers",
        at_once=2,
        total=settings.answers_waiting,
        per_visitor=settings.answers_waiting_of_visitor,
    )


def _artifacts(settings: Settings, store: Store) -> Artifacts:
    return Artifacts(
        store,
        # With an object store they are among the local copies, which have their own limit.
        min_free_disk_bytes=settings.min_free_disk_bytes,
        total=settings.files_waiting,
        per_visitor=settings.files_waiting_of_visitor,
    )


def _quota(subject: str, total: int, per_visitor: int) -> Quota:
    return Quota(subject, total=total, per_visitor=per_visitor)


def _reader(settings: Settings, awaited: ChildLimits, fork_server: ForkServer) -> Pool:
    quota = _turns("uploads", settings.max_uploads, settings.max_uploads_of_visitor)
    wall_s = settings.read_seconds
    return Pool("reader", awaited, wall_s=wall_s, fork_server=fork_server, quota=quota)


def _preparer(settings: Settings, awaited: ChildLimits, fork_server: ForkServer) -> Pool:
    total, per_visitor = settings.previews_waiting, settings.previews_waiting_of_visitor
    quota, wall_s = _turns("previews", total, per_visitor), settings.preview_seconds
    return Pool("preparer", awaited, wall_s=wall_s, fork_server=fork_server, quota=quota)


def _turns(subject: str, total: int, per_visitor: int) -> Quota:
    """Return the quota in which visitors take turns at the children that read uploads."""
    return Quota(
        subject,
        at_once=READER_PROCESSES,
        at_once_per_visitor=1,
        total=total,
        per_visitor=per_visitor,
        timeout_s=60.0,
    )
