"""Table of the plans for a preference: one row per plan, with gain and cost."""

import json
from pathlib import Path
from typing import Any

import pytest

from foldback.cli.summary import show_choice
from foldback.planner.pipeline.preference import PREFERENCES, Preference
from foldback.words.plan_choice import PREFERENCE_WORDS, choice_of, superlative

FIGURES = {"frames": 100, "seconds": 3.0}
WRITHING, CALM = (
    {"travel_ratio": ratio, "hinges_moving_mean": moving}
    for ratio, moving in ((2.25, 141.0), (1.03, 7.2))
)
SLOW = {"fold_time_s": 100.0, "peak_torque_nm": 0.0001, "clearance_bound": 0.04, **WRITHING}
QUICK = {"fold_time_s": 20.0, "peak_torque_nm": 0.001, "clearance_bound": 0.0312, **CALM}
SMOOTH = {"fold_time_s": 10.0, "peak_torque_nm": 0.03, "clearance_bound": 0.03129}


def attempt(
    strategy: str, attempt_figures: dict[str, float] | None, **extra: Any
) -> dict[str, Any]:
    expected = {} if attempt_figures is None else {"figures": {**FIGURES, **attempt_figures}}
    verdict = {} if attempt_figures is None else {"verified": True}
    values = {"candidate": 0, "seed": 0, "strategy": strategy, "status": "straight", "steps": 1}
    return {**values, "seconds": 2.0, **verdict, **expected, **extra}


ATTEMPTS = (
    attempt("peel", {**SLOW, "one_hinge_rad": 0.002}),
    attempt("blocks", None, status="stalled"),
    attempt("simultaneous", QUICK, candidate=1),
    attempt("smoothed", {**SMOOTH, "one_hinge_rad": 0.01}, smooths=2, seed=1),
    attempt("simultaneous", {**QUICK, "fold_time_s": 5.0}, verified=False),
)


def write_attempts(directory: Path, chosen_index: int, *attempts: dict[str, Any]) -> Path:
    attempt_rows = [
        {**attempt, "chosen": True} if k == chosen_index else attempt
        for k, attempt in enumerate(attempts)
    ]
    (directory / "attempts.json").write_text(json.dumps(attempt_rows))
    return directory


def test_text_has_gain_and_cost_of_the_chosen_plan(tmp_path: Path) -> None:
    cases: tuple[tuple[Preference, int, str], ...] = (
        ("time", 3, "The folding time is 10 s instead of 100 s"),
        (
            "torque",
            2,
            "The torque at the same folding time of 100 s is 40 µN·m instead of 100 µN·m",
        ),
        ("clearance", 2, "The proved clearance is 0.0312 instead of 0.0400 pitch"),
        ("margin", 3, "The allowed error in one hinge is 0.57° instead of 0.11°"),
        (
            "calm",
            2,
            "The hinges travel 1.03 instead of 2.25 times the least, and 7 instead of 141 of them "
            "move at once",
        ),
    )
    for prefer, chosen_row, text in cases:
        choice = choice_of(write_attempts(tmp_path, chosen_row, *ATTEMPTS), prefer)
        assert choice["text"] == f"{text}. Finding this plan took 11 s of additional computing."
        assert choice["seconds"] == 100.0, "of those that are verified"
        assert [plan["chosen"] for plan in choice["plans"]].count(True) == 1
        assert superlative(prefer, len(choice["plans"])) is not None
    first = choice_of(write_attempts(tmp_path, 0, *ATTEMPTS), "clearance")
    assert first["text"].startswith("The first plan that worked is still the best after 11 s")


def test_plans_have_labels_and_rows(tmp_path: Path) -> None:
    choice = choice_of(write_attempts(tmp_path, 3, *ATTEMPTS), "time")
    plans = {plan["label"]: plan["verified"] for plan in choice["plans"]}
    labels = ("1. One part at a time", "3. All at once, path 2", "4. Plan 3, smoothed, seed 1")
    assert plans == {**dict.fromkeys(labels, True), "5. All at once": False}
    assert choice["plans"][1]["cells"] == ["20", "1 mN·m", "40 µN·m", "0.0312", "3"]
    assert choice["plans"][1]["torque_mnm"] == pytest.approx(0.04)
    calm = choice_of(write_attempts(tmp_path, 3, *ATTEMPTS), "calm")
    assert calm["plans"][1]["moving"] == 7.2
    assert calm["plans"][1]["cells"] == ["20", "1.03", "7", "0.0312", "3"]
    for plan_choice in (choice, calm):
        assert all(
            len(plan["cells"]) == len(plan_choice["columns"]) - 1 for plan in plan_choice["plans"]
        )


def test_no_choice_without_a_preference_or_a_plan(tmp_path: Path) -> None:
    assert choice_of(tmp_path, "time") is None
    assert choice_of(write_attempts(tmp_path, 0, *ATTEMPTS), "computing") is None
    assert choice_of(write_attempts(tmp_path, 9, ATTEMPTS[1], ATTEMPTS[4]), "time") is None
    assert superlative("computing", 3) is None
    assert set(PREFERENCE_WORDS) == set(PREFERENCES)


def test_command_line_prints_the_choice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    show_choice(choice_of(write_attempts(tmp_path, 3, *ATTEMPTS), "time"))
    lines = capsys.readouterr().out.splitlines()
    (chosen_line,) = (line for line in lines if line.startswith("→"))
    assert "4. Plan 3, smoothed" in chosen_line
    assert "10 s instead of 100 s. Finding this plan took 11 s of additional" in lines[-1]
    show_choice(None)
    assert not capsys.readouterr().out


def test_headings_of_the_table_are_whole_in_a_narrow_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for prefer in ("time", "calm"):
        choice = choice_of(write_attempts(tmp_path, 3, *ATTEMPTS), prefer)
        show_choice(choice)
        words = capsys.readouterr().out.split()
        assert "…" not in "".join(words)
        for heading in choice["columns"]:
            assert set(heading.split()) <= set(words)
