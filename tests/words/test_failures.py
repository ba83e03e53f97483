"""Location of a stall and list of attempts on the fold's page."""

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast, get_args

import numpy as np

from foldback.planner.certificate.figures import FoldSummary
from foldback.planner.motion.failure_schemas import KnotFigures, SpentKind
from foldback.web.pictures.knot_drawing import KnotDrawing, drawing_of
from foldback.words.failures import FAILURE_HEADINGS, attempts, collision, failure

KNOT = {"kind": "knot", "modules": [5, 6, 9], "words": "its path is knotted.", "evidence": None}


def row(status: str = "failed", error: object = None, stage: str = "explode") -> Any:
    return SimpleNamespace(status=status, error=error, stage=stage)


def test_verified_and_running_folds_have_no_failure() -> None:
    for status in ("verified", "running", "queued"):
        assert failure(row(status), {"stuck": KNOT}) is None
    assert failure(row(), {}) is None


CROSSINGS = [(0.5, 3.5), (2.5, 5.5), (4.5, 1.5)]
"""Parameters of the strand above and of the one below at each crossing, which alternate."""


def trefoil(sign: int) -> KnotFigures:
    """Return a knot with three crossings of a sign."""
    diagram = [{"over": over, "under": under, "sign": sign} for over, under in CROSSINGS]
    knot_evidence = {
        "kind": "knot",
        "determinant": 3,
        "crossings": 3,
        "closings": [[]],
        "polygon": [],
    }
    return cast("KnotFigures", {**knot_evidence, "sight": [0.0, 0.0, 1.0], "diagram": diagram})


def test_knot_is_drawn_with_a_gap_at_each_crossing() -> None:
    stuck = {**KNOT, "evidence": trefoil(1)}
    failure_page = failure(row(), {"stuck": stuck})
    assert failure_page is not None and failure_page["heading"] == "The chain is knotted"
    drawn = failure_page["knot"]
    assert drawn is not None and len(drawn["strokes"]) == 3
    assert drawn["label"] == "A knot with 3 crossings, determinant 3"
    numbers = [float(n) for n in re.findall(r"[\d.]+", " ".join(drawn["strokes"]))]
    assert min(numbers) > 0.0 and max(numbers) < drawn["side"]
    # Its mirror image is drawn as the mirror image.
    other_drawing = drawing_of(trefoil(-1))
    assert other_drawing is not None and [_signs(drawn), _signs(other_drawing)] == [
        [1, 1, 1],
        [-1, -1, -1],
    ]


def _signs(drawn: KnotDrawing) -> list[int]:
    """Return the signs of the drawn crossings, at which one stroke ends and the next begins."""
    strokes = [
        np.array([[float(n) for n in point.split()] for point in stroke[1:].split(" L")])
        for stroke in drawn["strokes"]
    ]
    signs: list[int] = []
    for one_stroke, two in zip(strokes, [*strokes[1:], strokes[0]], strict=True):
        middle, under = (one_stroke[-1] + two[0]) / 2, two[0] - one_stroke[-1]
        _, over = min(
            (float(np.linalg.norm(stroke[k] - middle)), tuple(stroke[k + 1] - stroke[k - 1]))
            for stroke in strokes
            for k in range(1, len(stroke) - 1)
        )
        signs.append(-int(np.sign(over[0] * under[1] - over[1] * under[0])))  # y points down
    return signs


def test_failure_lists_blocks_and_budgets() -> None:
    turn = {"hinge": 7, "module": 4, "turned_rad": -0.0349, "modules": [4, 9], "overlap": 0.0123}
    move = {"direction": [0, -1, 0], "moved": 0.5, "modules": [5, 2], "overlap": 0.45}
    evidence = {"kind": "blocks", "module_size": 0.95, "bent_above_rad": 0.1, "first_hinge": 0}
    evidence |= {"turns": [turn], "unit": [5, 7], "moves": [move]}
    failure_page = failure(row(), {"stuck": {**KNOT, "kind": "buried", "evidence": evidence}})
    assert (
        failure_page is not None
        and failure_page["heading"] == "Stalled: modules blocked each other"
    )
    assert failure_page["blocks"] == [
        "If hinge 7 at module 5 turns by 2°, modules 5 and 10 overlap by 1.2 % of the spacing",
        "If the part that unfolds next moves by 50 % of the spacing along −y, modules 6 and 3 "
        "overlap by 45 % of the spacing",
    ]
    many_turns = {**evidence, "turns": 30 * [turn]}
    failure_page = failure(row(), {"stuck": {**KNOT, "kind": "joints", "evidence": many_turns}})
    assert (
        failure_page is not None
        and failure_page["blocks"][-1] == "7 more motions are blocked in the same way"
    )
    turns = {
        "kind": "quarter_turns",
        "module_size": 0.95,
        "turns": [{**turn, "turned_rad": -0.785}, turn],
    }
    failure_page = failure(row(), {"stuck": {**KNOT, "kind": "blocked", "evidence": turns}})
    assert failure_page is not None and failure_page["heading"] == "No single joint can turn"
    assert failure_page["blocks"][0].startswith(
        "If hinge 7 at module 5 turns by −45°, modules 5 and 10"
    )
    budget = {"kind": "budget", "spent": "steps", "allowed": 9, "used": 9, "bent_hinges": 1}
    budget["largest_bend_rad"] = 0.2
    failure_page = failure(row(), {"stuck": {**KNOT, "kind": "joints", "evidence": budget}})
    assert (
        failure_page is not None and failure_page["heading"] == "Stalled: too many simulation steps"
    )
    assert set(get_args(SpentKind)) <= FAILURE_HEADINGS.keys()


def test_failure_by_a_limit_names_the_limit_and_the_progress() -> None:
    stuck = {"kind": "stopped", "modules": [3, 8], "words": "the chain was still unfolding"}
    stuck["evidence"] = None
    error = {"code": "time-limit", "detail": "unfolding took long.", "where": "explode"}
    failure_page = failure(row(error=error), {"stuck": stuck})
    assert failure_page["text"] == "Unfolding took long. The chain was still unfolding."
    # Completed stages are not reported as running.
    detail = {"detail": "the clearance check exceeded its limit of 5 s"}
    failure_page = failure(row(error=detail, stage="certify"), {"stuck": stuck})
    assert (
        failure_page is not None
        and failure_page["text"] == "The clearance check exceeded its limit of 5 s."
    )
    assert failure(row("cancelled"), {"stuck": stuck}) is None  # nothing stalled


def test_failure_by_an_overlap_has_its_frame() -> None:
    place = {"frame": 12.5, "modules": [3, 7]}
    summary_values = {
        "min_clearance": -0.0119,
        "min_clearance_at": place,
        "min_clearance_playback": 0.0,
    }
    certificate = {"module_size": 1.0, **summary_values, "min_clearance_playback_at": None}
    summary = {"certificate": certificate, "explosion": {"frames": 200}, "refold": None}
    failure_page = failure(row(), summary)
    assert failure_page is not None and failure_page["heading"] == "Modules overlap"
    assert failure_page["text"] == (
        "In the plan, modules 4 and 8 overlap by 1.19\N{NO-BREAK SPACE}% of the spacing "
        "(each module fills 100\N{NO-BREAK SPACE}% of the spacing)."
    )
    assert (failure_page["modules"], failure_page["frame"]) == ([3, 7], 212.5)
    # Their timelines contain only their own plans.
    for alone in ({"refold": {"start": "a"}}, {"smoothing": {"way": "smoothed"}}):
        summary_values = failure(row(), {**summary, **alone})
        assert summary_values is not None and summary_values["frame"] == 12.5


def test_only_an_overlap_is_called_not_safe() -> None:
    values = {"motion": "plan", "modules": [3, 7], "progress": 0.401, "frame": 12.5}
    refusal = {"code": "overlap", "values": {**values, "depth": 0.01, "module_size": 0.95}}
    assert collision(refused(refusal)) == "modules 4 and 8 collide 40 % through the motion"
    in_a_robot = {**refusal, "values": {**refusal["values"], "motion": "simulated playback"}}
    assert collision(refused(in_a_robot)) == (
        "modules 4 and 8 collide in the simulation, 40 % through the motion"
    )
    assert collision(refused({"code": "touch", "values": values})) is None
    assert collision({}) is None


def refused(refusal: dict[str, Any]) -> FoldSummary:
    return cast("FoldSummary", {"certificate": {"reason": refusal}})


def test_failure_of_a_playback_that_ends_elsewhere() -> None:
    def summary(code: str, **values: Any) -> Any:
        reason = {"code": code, "values": values}
        return {"certificate": {"min_clearance": 0.1, "verified": False, "reason": reason}}

    failure_page = failure(row(), summary("playback-end", error=1.0))
    assert failure_page["heading"] == "The chain does not end in its target shape"
    assert failure_page["modules"] == []
    assert failure_page["text"] == (
        "The folding motion ends one spacing on average (root mean square) from the folded shape."
    )
    beyond = failure(row(), summary("no-playback"))
    assert beyond is not None and beyond["heading"] == "Not verified"


def test_attempts_are_listed_with_strategy_and_outcome(tmp_path: Path) -> None:
    assert attempts(tmp_path) == []
    values = {"motion": "plan", "modules": [1, 3], "frame": 3.0}
    touch = {"code": "touch", "values": values}
    attempt_values = {"candidate": 0, "seed": 4, "strategy": "simultaneous", "steps": 8400}
    attempt_rows = [
        {
            **attempt_values,
            "status": "stalled",
            "diagnosis": KNOT,
            "verified": False,
            "refusal": touch,
        },
        {**attempt_values, "strategy": "peel", "status": "timeout", "diagnosis": None},
        {**attempt_values, "status": "straight", "verified": False, "refusal": touch},
        {**attempt_values, "status": "straight", "verified": True, "finer": 4, "candidate": 1},
        {**attempt_values, "status": "straight"},
        {"candidate": 1, "seed": 4, "strategy": "peel", "status": "begun"},
    ]
    (tmp_path / "attempts.json").write_text(json.dumps(attempt_rows))
    ends = {
        "Stalled after 8400 steps: the chain is knotted": "bad",
        "Not straight after 8400 steps": "bad",
        "In the plan, modules 2 and 4 touch": "bad",
        "Verified": "good",
        "Unfolded, not checked": "off",
        "Interrupted": "off",
    }
    rows = attempts(tmp_path)
    assert {a["end"]: a["tone"] for a in rows} == ends
    assert rows[0]["strategy"] == "All at once"
    assert rows[3]["how"] == "Path 2, seed 4, folded in a larger number of smaller steps"
