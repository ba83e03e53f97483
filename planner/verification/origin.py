"""Origin of a plan: its input is read again, and its attempts are those of a fold with its request.

Neither depends on a clock, so the same request leads to the same chains and the same attempts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes
from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.pipeline.attempt import Attempt, Candidates
from foldback.planner.pipeline.next_step import Explode, PlayBack, next_step
from foldback.planner.pipeline.preference import PlanFigures
from foldback.planner.pipeline.prepare import TIME_INDEPENDENT_METHODS
from foldback.planner.pipeline.reading import Reading, read_shape
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import Differences, value_differences
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.storage.file_names import CANDIDATES, INPUT, REQUEST, START_CHAIN

COMPARED: Final = (
    *("fold_time_s", "peak_torque_nm", "clearance_bound", "frames", "one_hinge_rad"),
    *("travel_ratio", "hinges_moving_mean", "reversals_mean"),
)
"""Figures of an attempt that must be those of its certificate."""


def input_differs(directory: FilePath, plan: Plan, notes: list[str]) -> Differences:
    """Yield the differences of the plan's chain from those that the input gives when read again."""
    needed = (INPUT, REQUEST, CANDIDATES, *(() if plan.start is None else (START_CHAIN,)))
    missing = [name for name in needed if not (directory / name).exists()]
    if missing:
        notes.append(
            f"There is no {missing[0]}, so nothing shows that the plan is of the shape that was "
            "requested."
        )
        return
    try:
        workspace = Workspace(directory)
        stored = workspace.read_candidates()
        input_now = _read_again(workspace)
    except (*UNREADABLE, PlannerError) as error:
        yield f"{INPUT}: the shape cannot be read again ({error})"
        return
    candidates, chain = input_now.candidates, chain_attributes(plan.chain)
    differences = [*_chain_differences(_chains_of(stored), _chains_of(candidates), CANDIDATES)]
    if differences and not (
        input_now.method in TIME_INDEPENDENT_METHODS or input_now.kind in ("path", "chain")
    ):
        # How long a search may take decides which of several paths it finds.
        if not _fills(plan.chain, candidates.chains[0]):
            yield f"{INPUT}: the plan's chain does not fill the cells of the shape in this file"
            return
        notes.append(
            f"The search found other paths through the same cells of the {INPUT}, because it is "
            "limited in time. Only the cells were compared."
        )
        yield from _likeness_differs(plan, next(iter(candidates.likenesses), None))
        return
    for difference in differences:
        yield f"{INPUT} was read again: {difference}"
    ends = [chain_attributes(candidate) for candidate in _with_other_ends(candidates)]
    if all(any(_chain_differences(chain, end, INPUT)) for end in ends):
        yield (
            f"{INPUT}: got a plan for {plan.chain.name} ({len(plan.chain)} modules), expected one "
            f"for {candidates.chains[0].name} ({len(candidates.chains[0])} modules), the shape in "
            "this file"
        )
        return
    yield from _likeness_differs(plan, candidates.likeness_of(plan.chain))


def _chain_differences(actual: Any, expected: Any, name: str) -> Differences:
    # Files hold angles in degrees, which are rounded when they are read.
    return value_differences(actual, expected, name, atol=1e-12)


def _chains_of(candidates: Candidates) -> dict[str, Any]:
    """Return candidates as plain values, without their likeness."""
    return replace(candidates, likenesses=()).as_dict()


def _likeness_differs(plan: Plan, recomputed: Likeness | None) -> Differences:
    """Yield the differences of the plan's likeness to its input from one measured again."""
    yield from value_differences(
        None if plan.likeness is None else plan.likeness.as_dict(),
        None if recomputed is None else recomputed.as_dict(),
        f"plan.npz likeness, measured again from {INPUT}",
        atol=1e-3,  # some points may lie on the other side of a surface on another processor
    )


def _read_again(workspace: Workspace) -> Reading:
    """Return the chains in the input. A smoothing keeps the end at which its plan begins."""
    request, data = workspace.read_request(), workspace.read_input()
    result = read_shape(request, data, start=workspace.read_start(request))
    if request.smooth:
        # Its input is a chain; how much that looks like a shape, the plan it smooths states.
        likeness = workspace.read_recorded().likeness
        likenesses = () if likeness is None else (likeness,)
        candidates = replace(result.candidates, two_ended=False, likenesses=likenesses)
        return replace(result, candidates=candidates)
    return result


def _with_other_ends(candidates: Candidates) -> list[Chain]:
    chains = candidates.chains
    return [*chains, *(chain.from_other_end() for chain in chains if candidates.two_ended)]


def _fills(first: Chain, second: Chain) -> bool:
    """Return True if two chains fill the same cells."""
    if len(first) != len(second) or first.module.name != second.module.name:
        return False
    places = [np.sort(_rows(chain.folded_poses.positions)) for chain in (first, second)]
    return bool((places[0] == places[1]).all())


def _rows(positions: Any) -> Any:
    """Return one comparable value for each rounded place."""
    rounded = np.rint(positions / 1e-6).astype(np.int64)
    return rounded.view([("x", np.int64), ("y", np.int64), ("z", np.int64)]).reshape(-1)


def attempts_differ(directory: FilePath, plan: Plan, notes: list[str]) -> Differences:
    """Yield the differences of the plan's attempts from those that a fold with its request makes.

    What an attempt has come to (status, steps, verdict, figures) is taken from the file, except for
    the one whose plan this is; which attempt follows it is computed again.
    """
    if not all((directory / name).exists() for name in (REQUEST, CANDIDATES)):
        notes.append("The attempts of the plan are reported only.")
        return
    try:
        workspace = Workspace(directory)
        request, candidates = workspace.read_request(), workspace.read_candidates()
        history = [Attempt.from_dict(values) for values in plan.attempts]
        policy = RetryPolicy.of(request, candidates)
        yield from _sequence_differs(history, policy)
        yield from _own_attempt_differs(plan, history, candidates)
    except (*UNREADABLE, PlannerError) as error:
        yield f"plan.npz attempts: they cannot be read ({error})"
    if len(history := plan.attempts) > 1:
        notes.append(
            f"Of the {len(history)} attempts, the results of all but the plan's own are reported "
            "only; their order, strategies, seeds and paths were computed again from them."
        )


def _sequence_differs(history: Sequence[Attempt], policy: RetryPolicy) -> Differences:
    """Yield where the attempts are not those that follow from the ones before."""
    for number, attempt in enumerate(history):
        # A failed one is judged only when nothing is left to try.
        before = tuple(
            attempt.unjudged() if attempt.failed else attempt for attempt in history[:number]
        )
        step = next_step(before, policy)
        finer, patience = 1, 0
        if isinstance(step, Explode):
            spec = step.spec
        elif isinstance(step, PlayBack) and before and not before[-1].failed:
            spec = before[-1].spec
            finer, patience = step.finer, step.patience
        else:
            yield f"plan.npz attempts[{number}]: got another attempt, expected no more attempts"
            return
        actual = {**asdict(attempt.spec), "finer": attempt.finer, "patience": attempt.patience}
        expected = {**asdict(spec), "finer": finer, "patience": patience}
        if (
            differing := next((name for name in actual if actual[name] != expected[name]), None)
        ) is not None:
            yield (
                f"plan.npz attempts[{number}].{differing}: got {actual[differing]!r}, expected "
                f"{expected[differing]!r}"
            )
            return


def _own_attempt_differs(
    plan: Plan, history: Sequence[Attempt], candidates: Candidates
) -> Differences:
    """Yield the differences of the attempt whose plan this is from the plan."""
    if plan.explosion is None:
        if history:
            yield f"plan.npz attempts: got {len(history)}, expected none without an explosion"
        return
    number = own_attempt(plan)
    if number is None:
        yield "plan.npz attempts: none of them has the figures of the plan's explosion and verdict"
        return
    attempt, certificate = history[number], plan.certificate
    if attempt.spec.strategy != plan.explosion["strategy"]:
        yield (
            f"plan.npz attempts[{number}].strategy: got {attempt.spec.strategy!r}, expected "
            f"{plan.explosion['strategy']!r}"
        )
    if chain_attributes(candidates.chain_of(attempt.spec)) != chain_attributes(plan.chain):
        yield f"plan.npz attempts[{number}]: its chain is not that of the plan"
    if attempt.figures is not None:
        figures = PlanFigures.of(certificate.as_dict())
        for name in COMPARED:
            yield from value_differences(
                getattr(attempt.figures, name),
                getattr(figures, name),
                f"plan.npz attempts[{number}].figures.{name}",
            )


def own_attempt(plan: Plan) -> int | None:
    """Return the number of the attempt whose plan this is; None if none can be."""
    own_figures = {key: value for key, value in (plan.explosion or {}).items() if key != "strategy"}
    reason = plan.certificate.reason
    refusal = None if reason is None else reason.as_dict()
    fits = [
        number
        for number, values in enumerate(plan.attempts)
        if own_figures == {key: values.get(key) for key in own_figures}
        and values.get("verified") == plan.certificate.verified
        and values.get("refusal") == refusal
    ]
    marked = [number for number in fits if plan.attempts[number].get("chosen")]
    return next(iter([*marked, *reversed(fits)]), None)
