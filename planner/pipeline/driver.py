"""Driver: the loop that computes the steps of a fold, in memory and on files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath

from foldback.planner.pipeline.attempt import Attempt
from foldback.planner.pipeline.attempt_pool import AttemptPool
from foldback.planner.pipeline.certifying import with_certificate
from foldback.planner.pipeline.exploding import with_explosion
from foldback.planner.pipeline.next_step import (
    Certify,
    Explode,
    PlayBack,
    Step,
    next_step,
    with_begun,
    with_count,
)
from foldback.planner.pipeline.playing_back import with_playback
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.pipeline.search import FoldSpec, Search, Watch


class Store:
    """Place of a fold's results while its steps are computed: memory, that is, the search itself.

    A subclass also writes files.
    """

    def begin(
        self, fold_spec: FoldSpec, search: Search, step: Step, history: Sequence[Attempt]
    ) -> tuple[Search, FilePath | None]:
        """Prepare for the results of a step.

        Args:
            fold_spec: Request, candidates and limits of the fold.
            search: Attempts so far.
            step: Step that is computed next.
            history: Attempts so far, with the one of this step.

        Returns:
            The search with all results that the step needs, and the path of its timeline; None if
            no timeline is written.
        """
        del fold_spec, step, history
        return search, None

    def save(self, search: Search, step: Step) -> None:
        """Store the results of a step."""


def run_steps(
    fold_spec: FoldSpec,
    search: Search,
    store: Store,
    watch: Watch,
    pool: AttemptPool,
    *,
    only: type[Step] | None = None,
) -> Search:
    """Compute steps until a plan is verified or nothing is left to try; return all attempts.

    Args:
        fold_spec: Request, candidates and limits of the fold.
        search: Attempts so far.
        store: Place of the results.
        watch: Channels to the observer.
        pool: Explosions that are made beside.
        only: Kind of the steps that are computed: the loop ends before the first of another kind.
            None for all kinds.
    """
    step = next_step(search.history, fold_spec.policy)
    while step is not None and (only is None or isinstance(step, only)):
        history = with_begun(search.history, step)
        search, timeline = store.begin(fold_spec, search, step, history)
        report = with_count(watch.progress, history, fold_spec.policy)
        search = advance(
            fold_spec, search, step, replace(watch, progress=report, timeline=timeline), pool
        ).pruned()
        store.save(search, step)
        if isinstance(step, Certify) and watch.cancelled():
            break
        before, step = step, next_step(search.history, fold_spec.policy)
        if isinstance(before, Explode) and not isinstance(step, Explode):
            _rest(fold_spec, search, pool)
    return search


def advance(
    fold_spec: FoldSpec, search: Search, step: Step, watch: Watch, pool: AttemptPool
) -> Search:
    """Return the search after one more step; earlier results stay as they are."""
    if isinstance(step, Explode):
        return with_explosion(fold_spec, search, step.spec, watch, pool)
    search = replace(search, history=with_begun(search.history, step))
    if isinstance(step, PlayBack):
        return with_playback(fold_spec, search, watch, finer=step.finer, patience=step.patience)
    return with_certificate(fold_spec, search, watch)


def _rest(fold_spec: FoldSpec, search: Search, pool: AttemptPool) -> None:
    """End what explodes beside, when the last explosion of a series makes it of little use."""
    record = search.current.record
    # what comes out at once is rarely refused
    may_try_more = len(search.history) > 1 or fold_spec.request.prefer != COMPUTING
    if record is not None and (record.status != "straight" or not may_try_more):
        pool.end_running()
