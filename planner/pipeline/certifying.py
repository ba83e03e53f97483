"""Certifying: playback → certificate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from planner.certificate.certificate import Certificate, certify
from planner.pipeline.job import Job, Search, Watch
from planner.pipeline.search import Explode, next_step
from planner.pipeline.workspace import Workspace


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """Result of the stage ``certify``.

    Attributes:
        certificate: Certificate of the best attempt when nothing else is tried, else of this one.
        again: Stage that tries again; None when nothing else is tried.
    """

    certificate: Certificate
    again: Literal["explode", "play_back"] | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {**self.certificate.as_dict(), "again": self.again}


def certify_latest(workspace: Workspace, watch: Watch) -> Judged:
    """Run the stage ``certify``: judge the latest playback, and say which stage follows."""
    place, job = workspace.attempt, workspace.read_job()
    place.drop_curves()
    search = with_certificate(job, workspace.read_search(job), watch)
    certificate = search.current.certificate
    assert certificate is not None
    place.write_judgement(search.current)
    workspace.write_history(search.history)
    if watch.cancelled():
        return Judged(certificate=certificate, again=None)
    step = next_step(search.history, job.policy)
    if isinstance(step, Explode):
        return Judged(certificate=certificate, again="explode")
    if step is not None:
        return Judged(certificate=certificate, again="play_back")
    workspace.keep_best(job.request.prefer)
    return Judged(certificate=workspace.read_certificate() or certificate, again=None)


def with_certificate(job: Job, search: Search, watch: Watch) -> Search:
    """Return the search with the certificate of its current playback, and the curves beside it."""
    result, curves = search.current, dict[str, Any]()
    playback = result.playback
    peeled = playback is not None and playback.frames.is_windowed
    certificate = certify(
        result.chain,
        result.record,
        playback,
        job.parameters(result.record),
        start=job.start,
        progress=watch.progress,
        cancelled=watch.cancelled,
        sink=partial(curves.__setitem__, "clearances") if peeled else None,
        forces=partial(curves.__setitem__, "forces"),
    )
    result = replace(result, certificate=certificate, **curves)
    return search.with_current(result, search.history[search.latest].judged(certificate, playback))
