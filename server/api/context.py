"""Context: what the routes of one running service share."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

from fastapi import Request
from starlette.requests import HTTPConnection

from planner.readers.gallery import Gallery
from server.api.fold_lookup import Viewing
from server.api.fold_states import FoldStates
from server.errors import TooMany
from server.files.pictures import Pictures
from server.files.preview_reports import PreviewReports
from server.files.preview_scenes import PreviewScenes
from server.files.trajectories import Trajectories
from server.files.uploads import Uploads
from server.http.client_address import address_of
from server.http.live_classes import LiveClasses
from server.jobs.eta import EtaEstimator
from server.jobs.movies import Movies
from server.limits.concurrency_quota import Quota
from server.limits.networks import hidden
from server.limits.single_flight import SingleFlight
from server.limits.token_buckets import SharedBuckets, TokenBuckets
from server.ops.metrics import Metrics
from server.processes.children import Reader
from server.processes.fork_server import ForkServer
from server.settings import Settings
from server.store.estimates import Estimates
from server.store.folds import Store
from server.store.leases import Leases
from server.store.previews import Previews


@dataclass(frozen=True, slots=True, kw_only=True)
class Context(Viewing):
    """Everything with a lifetime that a request may need."""

    settings: Settings
    store: Store
    fork_server: ForkServer | None
    reader: Reader
    previews: Previews
    preview_reports: PreviewReports
    preview_scenes: PreviewScenes
    pictures: Pictures
    movies: Movies
    gallery: Gallery
    fold_states: FoldStates
    streams: Quota
    robots: Quota
    robot_rates: SharedBuckets
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

    def take_list(self, request: Request) -> None:
        """Count one list that a visitor asks for.

        Raises:
            TooMany: If the visitor or its network asks for lists faster than they are answered.
        """
        if wait_s := self.lists.take(address_of(request)):
            raise TooMany(
                "too-many-lists",
                "got too many requests for lists from your address; try again in "
                f"{ceil(wait_s)} s.",
                retry_after_s=ceil(wait_s),
            )

    def visitor(self, request: Request) -> str:
        """Return the visitor's name with its networks, without revealing the address."""
        return hidden(address_of(request), self.secret)


def context_of(request: HTTPConnection) -> Context:
    """Return the context of the application that a request or a websocket is for."""
    context: Context = request.app.state.context
    return context


async def in_list_rate(request: Request) -> None:
    """Count the request as one for a list: a dependency of routes that read many rows."""
    context_of(request).take_list(request)
