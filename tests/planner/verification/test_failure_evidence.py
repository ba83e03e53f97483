"""Reasons of refusals: reported reasons hold, and falsified ones are refuted."""

import json
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.explosion.diagnosis import Diagnosis, diagnose
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.motion.record import Record, Spent, TableRecord
from foldback.planner.parameters.explosion import ExplosionParameters, PeelingParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.plan.plan import Plan
from foldback.planner.verification.failure_evidence import check_reason
from foldback.planner.verification.plan_failure import reason_of
from foldback.planner.verification.verify import verify
from tests.planner.chains import anchored, chain_of, coil, knotted, shuffled
from tests.planner.folds import write_request
from tests.planner.peels import snake
from tests.planner.plans import with_values

DEFAULTS: Final = Parameters()
FEW_STEPS: Final = replace(DEFAULTS, explosion=ExplosionParameters(max_steps=10))
UNITS: Final = replace(DEFAULTS, peeling=PeelingParameters(unit=6))
SPIRALS: Final = (
    "22 12 02 03 04 05 15 25 35 45 55 54 53 52 51 50 40 30 20 10 00 01 11 21 31 41 42 43 44 34 24 "
    "14 13 23 33 32"
)
"""Cells of two interleaved spirals that are joined at their outer ends."""
Values = dict[str, Any]
Stuck = tuple[Chain, Record, Parameters, Values]


def stuck(
    chain: Chain, parameters: Parameters = DEFAULTS, *, angles: Any = None, **data: Any
) -> Stuck:
    """Return an explosion that ends at some angles, folded ones by default, and its diagnosis."""
    values: Values = {"status": "stalled", "reason": None, "pushes": 41, "steps": 1, **data}
    angles = chain.folded_rad if angles is None else angles
    values.setdefault("spent", Spent("pushes", 40, 41))
    record = Record(frames=anchored("explosion", angles[None]), seconds=0.1, **values)
    diagnosis = diagnose(chain, record, parameters)
    plain = json.loads(json.dumps(diagnosis.as_dict()))
    assert Diagnosis.from_dict(plain) == diagnosis
    return chain, record, parameters, plain


def differences(stuck: Stuck, **changes: Any) -> tuple[str, ...]:
    """Return the differences that a check finds in a reason after its evidence has changed."""
    chain, record, parameters, data = stuck
    data = {**data, "evidence": {**data["evidence"], **changes}}
    plain = json.loads(json.dumps(parameters.as_dict()))
    found_differences = check_reason(chain, record, data, plain)  # type: ignore[arg-type]
    assert found_differences.confirmed is (not found_differences.differences)
    return found_differences.differences


def with_one(items: list[Values], **values: Any) -> list[Values]:
    """Return the items with other values in the first one."""
    return [{**items[0], **values}, *items[1:]]


def test_diagnosis_names_the_kind_and_the_modules() -> None:
    box = snake((3, 3, 3))
    turns = np.abs(box.folded_rad).reshape(-1, 2).max(axis=1) > 1.0
    _, record, parameters, data = stuck(box)
    assert data["kind"] == "contacts"
    assert data["modules"] == (np.flatnonzero(turns) + 1).tolist()
    assert "16 hinges were still bent, by up to 90°" in data["words"]
    for status in ("straight", "cancelled"):
        assert diagnose(box, replace(record, status=status), parameters) is None
    steps = [(k, k, 0) for k in range(7)]
    stairs = chain_of([cell for x, y, z in steps for cell in ((x, y, z), (x + 1, y, z))])
    for status, share, kind in (
        ("stalled", 1.0, "joints"),
        ("timeout", 0.0, "limit"),
        ("stalled", 0.5, "joints"),
        ("diverged", 0.5, "broken"),
        ("timeout", 0.5, "limit"),
    ):
        data = stuck(stairs, angles=share * stairs.folded_rad, status=status)[3]
        assert (data["kind"], bool(data["modules"])) == (kind, kind != "limit"), (status, share)


@pytest.fixture(scope="module")
def knot() -> Stuck:
    return stuck(knotted(6))


@pytest.fixture(scope="module")
def spirals() -> Stuck:
    cells = [(int(cell[0]), int(cell[1]), 0) for cell in SPIRALS.split()]
    return stuck(chain_of(cells, "spirals"))


@pytest.fixture(scope="module")
def pit() -> Stuck:
    """Peeling whose core encloses the next six modules in a pit; all others are straight."""
    chain = shuffled((4, 4, 3), 50, 7)
    angles = np.where(np.arange(len(chain.folded_rad)) < 66, chain.folded_rad, 0.0)
    return stuck(chain, UNITS, angles=angles, strategy="peel")


def test_knot_is_confirmed_by_the_chain_and_its_diagram(knot: Stuck) -> None:
    data = knot[3]
    assert (data["kind"], data["evidence"]["kind"]) == ("knot", "knot")
    assert (data["evidence"]["determinant"], data["evidence"]["crossings"]) == (3, 3)
    assert "the knot's determinant is 3" in data["words"]
    assert differences(knot) == ()
    assert "cannot be checked" in differences(knot, polygon="a knot")[0]
    assert "expected one of" in differences(knot, kind="magic")[0]


def test_falsified_knot_is_refuted(knot: Stuck) -> None:
    evidence = knot[3]["evidence"]
    diagram = evidence["diagram"]
    assert "expected 3" in differences(knot, determinant=5)[0]
    swapped = {"over": diagram[0]["under"], "under": diagram[0]["over"]}
    for other_diagram in (
        with_one(diagram, **swapped),
        with_one(diagram, sign=-diagram[0]["sign"]),
    ):
        assert "crossings in the evidence" in differences(knot, diagram=other_diagram)[0]
    # The polygon of another knot, with its true crossings, is not that of this chain.
    plain = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.3, 1.0, 0.2]]
    found_differences = differences(knot, polygon=plain, diagram=[], crossings=0)
    assert any("polynomial of the chain" in difference for difference in found_differences)
    # Ends joined straight through the chain could tie any knot.
    through = [[float(value) for value in knot[0].folded_poses.positions.mean(axis=0)]]
    assert any(
        "near the chain" in difference for difference in differences(knot, closings=[through])
    )
    assert any(
        "expected at least one" in difference for difference in differences(knot, closings=[])
    )
    # Closures with many corners could tie a knot far from the chain.
    [[first, *other_closings]] = evidence["closings"]
    closings_aside = [[value + 50.0 * k for k, value in enumerate(first)]] * 3
    assert any(
        "at most 3" in difference
        for difference in differences(knot, closings=[[*closings_aside, *other_closings]])
    )


def test_knot_that_has_opened_is_no_reason(knot: Stuck) -> None:
    """The folded chain is knotted, but the knot has opened since: another reason holds."""
    chain, _, _, data = knot
    bent = 0.2 * chain.folded_rad
    free = stuck(chain, angles=bent)
    assert free[3]["kind"] != "knot" and free[3]["evidence"]["kind"] == "budget"
    assert differences(free) == ()
    claimed = (*free[:3], data)
    assert any("shows no knot" in difference for difference in differences(claimed))


def test_blocked_turns_are_confirmed(spirals: Stuck) -> None:
    data = spirals[3]
    evidence = data["evidence"]
    assert (evidence["kind"], evidence["module_size"]) == ("blocks", 0.95)
    assert len(evidence["turns"]) == 11
    assert "none of the 11 hinges" in data["words"]
    assert "modules 0 and 23" in data["words"]
    assert differences(spirals) == ()


def test_falsified_turn_is_refuted(spirals: Stuck) -> None:
    for values, words in (
        ({"turned_rad": 1.0}, "rad towards the straight position"),
        ({"modules": [0, 30]}, "overlap by"),
        ({"modules": [20, 30]}, "on each side"),
        ({"overlap": 0.5}, "expected 0.5"),
    ):
        turns = with_one(spirals[3]["evidence"]["turns"], **values)
        assert any(words in difference for difference in differences(spirals, turns=turns))
    assert "cannot be checked" in differences(spirals, turns=[{}])[0]


def test_each_bent_hinge_has_to_be_blocked(spirals: Stuck) -> None:
    evidence = spirals[3]["evidence"]
    assert "one for each bent hinge" in differences(spirals, turns=evidence["turns"][1:])[0]
    assert "expected at most 1.05" in differences(spirals, bent_above_rad=9.0, turns=[])[0]
    assert any("module_size" in difference for difference in differences(spirals, module_size=1.2))
    assert any(
        "first_hinge" in difference for difference in differences(spirals, first_hinge=60, turns=[])
    )
    # The hinges of a coil are free: such a run has used up its pulses.
    free = stuck(coil(12))
    assert free[3]["evidence"]["kind"] == "budget" and differences(free) == ()


def test_buried_unit_is_blocked_in_all_directions(pit: Stuck) -> None:
    data = pit[3]
    evidence = data["evidence"]
    assert (data["kind"], evidence["kind"]) == ("buried", "blocks")
    assert (evidence["unit"], evidence["module_size"]) == ([29, 34], 0.98)
    assert len(evidence["moves"]) == 6
    assert "(modules 29 to 34) cannot move" in data["words"]
    assert differences(pit) == ()
    moves = evidence["moves"]
    assert "each of the six" in differences(pit, moves=moves[1:])[0]
    assert "and one before module 29" in differences(pit, moves=with_one(moves, modules=[40, 2]))[0]
    assert "at most" in differences(pit, moves=with_one(moves, moved=3.0))[0]
    assert "whose last module is" in differences(pit, unit=[29, 33])[0]


def test_budget_agrees_with_parameters_and_record() -> None:
    chain = coil(12)
    record = explode(chain, FEW_STEPS.explosion)  # type: ignore[arg-type]
    diagnosis = diagnose(chain, record, FEW_STEPS)
    data = json.loads(json.dumps(diagnosis.as_dict()))
    assert data["words"].startswith("the limit of 10 steps was reached; ")
    late = (chain, record, FEW_STEPS, data)
    assert differences(late) == ()
    for values, words in (
        ({"used": 9}, "as in the record"),
        ({"allowed": 30_000}, "expected at least the limit"),
        ({"allowed": 5}, "as in the parameters"),
        ({"allowed": 5}, "used 10), as in the record"),
        ({"spent": "pushes"}, "does not fit the status timeout"),
        ({"bent_hinges": 1}, "bent_hinges"),
        ({"largest_bend_rad": 0.1}, "largest_bend_rad"),
    ):
        assert any(words in difference for difference in differences(late, **values)), values


def on_table(spent: Spent | None, *, status: str = "stalled", **values: Any) -> Stuck:
    """Return an explosion of a coil on a table that ends as it was folded."""
    table = TableRecord(bound=8.0, taken_back=9, raised=(), friction=0.0)
    return stuck(coil(12), strategy="peel", table=table, status=status, spent=spent, **values)


def test_budget_of_table_fold_is_confirmed_by_limits_of_the_table() -> None:
    for status, spent in (
        ("stalled", Spent("refusals", 8, 9)),
        ("stalled", Spent("pushes", 9, 10)),
        ("timeout", Spent("steps", 1500 * 12 + 5000, 23_000)),
        ("diverged", Spent("pushes", 8, 8)),
    ):
        used = {} if spent.kind == "refusals" else {spent.kind: spent.used}
        late = on_table(spent, status=status, **used)
        data = {key: late[3]["evidence"][key] for key in ("spent", "allowed", "used")}
        assert data == {"spent": spent.kind, "allowed": spent.allowed, "used": spent.used}
        assert differences(late) == ()
        assert any("as in the record" in difference for difference in differences(late, allowed=1))


def test_budget_of_table_fold_that_was_not_used_up_is_refuted() -> None:
    few_pushes = on_table(Spent("pushes", 9, 3), pushes=3)
    assert any("at least the limit" in difference for difference in differences(few_pushes))
    other_pushes = on_table(Spent("pushes", 8, 9), pushes=9)
    assert any(
        "expected 9, as in the parameters" in difference for difference in differences(other_pushes)
    )
    chain, record, parameters, data = on_table(Spent("refusals", 8, 9))
    assert record.table is not None
    weak = replace(record, table=replace(record.table, bound=2.0))
    assert any(
        "torque limit 8" in difference
        for difference in differences((chain, weak, parameters, data))
    )


def test_failed_fold_is_verified_with_its_reason(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    hasty = replace(FEW_STEPS, strategy="simultaneous")
    monkeypatch.setattr(FoldRequest, "parameters", lambda *_, **__: hasty)
    summary = run_stages(write_request(tmp_path, strategy="simultaneous"))
    assert summary["status"] == "failed"
    assert summary["stuck"]["evidence"]["spent"] == "steps"
    tried_attempts = Plan.load(tmp_path / "plan.npz").attempts
    assert len(tried_attempts) > 1
    assert summary["stuck"] in [attempt["diagnosis"] for attempt in tried_attempts]
    verification = verify(tmp_path)
    assert verification.reason is not None and verification.reason.confirmed
    assert verification.as_dict()["reason"]["words"] == summary["stuck"]["words"]
    plan = Plan.load(tmp_path / "plan.npz")
    notes: list[str] = []
    for name, value, words in (("words", "the chain is knotted", "words"), ("evidence", None, "")):
        data = {**summary["stuck"], name: value}
        tried_attempts = tuple({**attempt, "diagnosis": data} for attempt in plan.attempts)
        repeated_reason = reason_of(tmp_path, with_values(plan, attempts=tried_attempts), notes)
        assert (repeated_reason is None) is (value is None)
        assert repeated_reason is None or (
            not repeated_reason.confirmed and words in repeated_reason.differences[0]
        )
    assert len(notes) == 1 and "was not checked" in notes[0]
