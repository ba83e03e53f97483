"""Verdicts on figures of the snake: each is proved by motions or by all states that there are."""

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.errors import InputError
from foldback.planner.reachability import deciding
from foldback.planner.reachability.deciding import Decider
from foldback.planner.reachability.verdict import Verdict
from foldback.planner.turns.hinge_steps import HingeSteps
from foldback.planner.twist_chains.figures import snake_figure
from foldback.words.reachability import verdict_lines

PRISM = module_named("snake-prism")


def decided(code: str, goal: str | None = None) -> Verdict:
    figures = [
        None if digits is None else np.pi / 2 * np.array([int(d) for d in digits])
        for digits in (code, goal)
    ]
    return Decider(PRISM, *figures).verdict()


def code_of(name: str) -> str:
    figure = snake_figure(name)
    assert figure is not None
    return figure.code.text()


def turns_are_free(verdict: Verdict) -> bool:
    """Return True if each turn of a verdict is free, by another computation than the search's."""
    sequence = verdict.sequence
    assert sequence is not None
    steps = HingeSteps(PRISM, verdict.modules)
    quarters = np.rint(sequence.rest_angles_rad / (np.pi / 2)).astype(np.int64)
    assert (steps.normal(quarters[-1]) == verdict.figure).all()
    assert not quarters[0].any()
    for before, after in zip(quarters[:-1], quarters[1:], strict=True):
        hinges = np.flatnonzero(after != before)
        size = steps.motion_size(before.astype(np.int8), hinges, (after - before)[hinges])
        if size < sequence.size - 2e-4:
            return False
    return True


def test_a_figure_that_one_joint_at_a_time_leads_to() -> None:
    verdict = decided(code_of("Ball"))
    assert verdict.kind == "one-joint"
    assert verdict.sequence is not None
    assert verdict.sequence.size > 1.0 - 1e-6
    assert verdict.exhaustion is None
    assert turns_are_free(verdict)
    assert verdict_lines(verdict.figures(), PRISM) == [
        f"One joint at a time leads there: {verdict.sequence.turns} quarter turns."
    ]


def test_a_figure_for_smaller_modules_alone() -> None:
    verdict = decided(code_of("lightsabre"))
    assert verdict.kind == "smaller-modules"
    assert verdict.smaller is not None
    assert verdict.smaller.size == pytest.approx(0.80627, abs=2e-4)
    assert verdict.is_largest
    assert verdict.exhaustion is not None
    assert (verdict.exhaustion.modules, len(verdict.exhaustion.states)) == (5, 1)
    assert turns_are_free(verdict)
    lines = verdict_lines(verdict.figures(), PRISM)
    assert lines[0].startswith(
        "One joint at a time leads there with smaller prisms, of at most 0.8062 of the full size"
    )
    assert lines[1].endswith("between prisms 5 to 9 no joint can make a single quarter turn.")


def test_a_figure_that_several_joints_at_once_lead_to() -> None:
    verdict = decided("112012301321")
    assert verdict.kind == "several-joints"
    assert verdict.exhaustion is not None
    assert verdict.at_full_size is not None
    assert verdict.at_full_size.turns > verdict.at_full_size.moves
    assert turns_are_free(verdict)


def test_from_one_figure_to_another() -> None:
    verdict = decided("0021", "1200")
    assert verdict.kind == "one-joint"
    assert verdict.sequence is not None
    quarters = np.rint(verdict.sequence.rest_angles_rad / (np.pi / 2)) % 4
    assert quarters[0].tolist() == [1, 2, 0, 0]
    assert quarters[-1].tolist() == [0, 0, 2, 1]


def test_from_one_figure_to_another_by_way_of_straight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deciding, "MAX_STATES", 1000)  # too few for the direct way
    verdict = decided(code_of("Ball"), code_of("Top"))
    assert verdict.kind == "one-joint"
    assert verdict.sequence is not None
    quarters = np.rint(verdict.sequence.rest_angles_rad / (np.pi / 2)).astype(np.int64)
    assert not (quarters % 4).any(axis=1).all()
    assert "".join(map(str, quarters[0] % 4)) == code_of("Top")
    assert "".join(map(str, quarters[-1] % 4)) == code_of("Ball")


def test_a_figure_that_overlaps_itself_is_refused_with_two_modules() -> None:
    with pytest.raises(InputError, match="modules 0 and 4 would lie in one another") as caught:
        decided("2220")
    assert caught.value.code == "overlap"
