"""Search: the values between the steps of a fold.

A ``FoldSpec`` is what is known before anything is computed, a ``Result`` what has been computed of
one attempt, a ``Search`` all attempts with the results that are still needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path as FilePath
from typing import Final

import numpy as np

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.attempt import Attempt, Candidates, latest_playback
from foldback.planner.pipeline.preference import COMPUTING, Preference, Rank, rank
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.plan.plan import Plan
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.unfolding import Unfolding
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.smoothing import SMOOTHING_WAYS

_EXPLOSION: Final = PHASES.index("explosion")


@dataclass(frozen=True, slots=True, kw_only=True)
class Watch:
    """Channels to the observer of a running step.

    Attributes:
        progress: Called with the progress.
        cancelled: Asked periodically whether to stop.
        timeline: Path of the timeline that gets the frames as they are made; None for nowhere.
    """

    progress: Report = silent
    cancelled: Cancelled = never
    timeline: FilePath | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoldSpec:
    """Everything that is known of a fold before it is computed.

    Attributes:
        request: Request of the fold.
        candidates: Chains that may be folded.
        policy: Tries that the fold has.
        start: Chain as it is folded at the beginning of a refold; None for other folds.
        unfolding: Way of a refold to straight; None for other folds.
        recorded: Plan that is smoothed; None for other folds.
    """

    request: FoldRequest
    candidates: Candidates
    policy: RetryPolicy
    start: Chain | None = None
    unfolding: Unfolding | None = None
    recorded: Plan | None = None

    def parameters(self, record: Record | None = None) -> Parameters:
        """Return the parameters of a record; those of an explosion when None."""
        module = self.candidates.chains[0].module
        return self.request.parameters(module, smoothed=is_smoothing(record))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Result:
    """Everything that has been computed of one attempt so far.

    Attributes:
        chain: Chain that is folded.
        record: Record of its explosion; None where nothing explodes.
        playback: None before it is played back, and where the explosion failed.
        certificate: None before it is judged.
        recorded: Plan that it smooths; None for an explosion.
        forces: Torques and forces at each frame of a plan on a table.
    """

    chain: Chain
    record: Record | None = None
    playback: Playback | None = None
    certificate: Certificate | None = None
    recorded: Plan | None = None
    forces: TableForces | None = None

    def plan(self, request: FoldRequest) -> Plan:
        """Return the plan of an attempt that is judged, without what else was tried."""
        assert self.certificate is not None
        return Plan.assembled(
            self.chain,
            request.parameters(self.chain.module, smoothed=is_smoothing(self.record)),
            request.seed,
            self.record,
            self.playback,
            self.certificate,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """Attempts of a fold so far.

    Attributes:
        history: Outcomes, in order.
        results: Results by the index of their explosion; those that nothing needs are left out.
    """

    history: tuple[Attempt, ...] = ()
    results: Mapping[int, Result] = field(default_factory=dict[int, Result])

    @property
    def number(self) -> int:
        """Index of the explosion that is played back and certified now."""
        return max(self.results)

    @property
    def latest(self) -> int:
        """Index of the attempt that is played back and certified now."""
        return latest_playback(self.history, self.number)

    @property
    def current(self) -> Result:
        """Result that is played back and certified now."""
        return self.results[self.number]

    def with_current(self, result: Result, attempt: Attempt) -> Search:
        """Return the search with another current result and its attempt."""
        history = (*self.history[: self.latest], attempt, *self.history[self.latest + 1 :])
        return Search(history=history, results={**self.results, self.number: result})

    def pruned(self) -> Search:
        """Return the search with only the best of the explosions that no certificate has judged."""
        unjudged = [n for n, result in self.results.items() if result.certificate is None]
        if len(unjudged) < 2:
            return self
        unjudged.remove(max(unjudged, key=lambda number: self.rank(number, COMPUTING)))
        results = {n: result for n, result in self.results.items() if n not in unjudged}
        return replace(self, results=results)

    def rank(self, number: int, prefer: Preference) -> Rank:
        """Return how far an attempt came.

        Args:
            number: Index of its explosion.
            prefer: Preference among verified plans.
        """
        result = self.results[number]
        record, played, certificate = result.record, result.playback, result.certificate
        bent = inf
        if played is not None and len(played.frames):
            bent = 0.0
        elif record is not None and len(record.frames) and not is_smoothing(record):
            last = len(record.frames) - 1
            bent = share_bent(result.chain, record.frames.dense(result.chain, last, last + 1))
        return rank(
            None if certificate is None else certificate.as_dict(),
            straight=self.history[number].status == "straight",
            bent=bent,
            number=number,
            prefer=prefer,
        )


def is_smoothing(record: Record | None) -> bool:
    """Return True for the record of a smoothed motion, in place of an explosion."""
    return record is not None and record.strategy in SMOOTHING_WAYS


def keeps_frames(record: Record | None) -> bool:
    """Return True if the file of a record holds its frames, which the timeline does not show.

    So that others can check it, the file of a failed explosion holds them, too. On a table, the
    timeline shows frames of all hinges in place of windows.
    """
    return record is not None and (
        record.status != "straight" or record.table is not None or is_smoothing(record)
    )


def share_bent(chain: Chain, last: Motion) -> float:
    """Return the fraction of the folded chain's bends that an explosion has left; 0 after it."""
    if last.phase[-1] != _EXPLOSION:
        return 0.0
    remaining_rad = np.abs(last.joint_angles_rad[-1]).sum()
    return float(remaining_rad / max(np.abs(chain.folded_rad).sum(), 1e-9))
