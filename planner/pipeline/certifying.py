"""Certifying: playback → certificate."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from foldback.planner.certificate.certificate import certify
from foldback.planner.pipeline.search import FoldSpec, Search, Watch


def with_certificate(fold_spec: FoldSpec, search: Search, watch: Watch) -> Search:
    """Return the search with the certificate of its current playback, and the curves beside it."""
    result, curves = search.current, dict[str, Any]()
    playback = result.playback
    certificate = certify(
        result.chain,
        result.record,
        playback,
        fold_spec.parameters(result.record),
        start=fold_spec.start,
        progress=watch.progress,
        cancelled=watch.cancelled,
        forces=partial(curves.__setitem__, "forces"),
    )
    result = replace(result, certificate=certificate, **curves)
    attempt = search.history[search.latest].judged(result.chain, certificate, playback)
    return search.with_current(result, attempt)
