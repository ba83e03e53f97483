"""Context: what the routes of one running service share."""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from typing import TYPE_CHECKING

from fastapi import Request

from server.addresses import address_of
from server.children import Reader
from server.exports import Exports
from server.fork_server import ForkServer
from server.gallery import Gallery
from server.gates import Gate
from server.jobs import Jobs
from server.leases import Leases
from server.metrics import Metrics
from server.movies import Movies
from server.preview_scenes import PreviewScenes
from server.previews import Previews
from server.settings import Settings
from server.store import Store
from server.streams import Streams
from server.trajectories import Trajectories
from server.uploads import Uploads
from server.watch import Watch
from server.workshop import Workshop

if TYPE_CHECKING:
    from web.films import Films


@dataclass(frozen=True, slots=True, kw_only=True)
class Context:
    """Everything with a lifetime that a request may need."""

    settings: Settings
    store: Store
    jobs: Jobs
    films: Films
    fork_server: ForkServer | None
    reader: Reader
    preparer: Reader
    previews: Previews
    preview_scenes: PreviewScenes
    workshop: Workshop
    exports: Exports
    movies: Movies
    gallery: Gallery
    watch: Watch
    streams: Streams
    robots: Streams
    trajectories: Trajectories
    answers: Gate
    uploads: Uploads
    metrics: Metrics
    leases: Leases
    secret: bytes

    def visitor(self, request: Request) -> str:
        """A name for who asks, which does not give the address away."""
        address = address_of(request)
        return hmac.new(self.secret, address.encode(), hashlib.sha256).hexdigest()[:32]


def context_of(request: Request) -> Context:
    """The context of the application that a request is for."""
    context: Context = request.app.state.context
    return context
