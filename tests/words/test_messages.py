"""Error messages: texts that pages show to people, and details for programs."""

from dataclasses import replace

from foldback.planner.errors import InputError, named
from foldback.planner.explosion.failure_evidence import (
    BlockEvidence,
    BudgetEvidence,
    KnotEvidence,
    Move,
    Turn,
)
from foldback.planner.reasons import TEXTS, Reason, ReasonValues
from foldback.planner.reasons import ReasonCode as Code
from foldback.server.errors import Unusable
from foldback.server.http.problems import Problem
from foldback.words.messages import PEOPLE, reason_text
from tests.case import case

FREE: ReasonValues = {"friction": 0.2, "clamped": False}
TURNS = tuple(
    Turn(hinge=k, module=k, turned_rad=0.1, modules=pair, overlap=0.1)
    for k, pair in enumerate(((1, 9), (2, 8), (3, 7), (4, 6)), start=1)
)
MOVE = Move(direction=(1, 0, 0), moved=0.5, modules=(5, 2), overlap=0.1)
BLOCKS = BlockEvidence(
    module_size=0.95, bent_above_rad=0.1, first_hinge=0, turns=TURNS, unit=(5, 7), moves=(MOVE,)
)
EVIDENCE = (
    (
        BLOCKS,
        "none of the 4 hinges bent by more than 6° (at modules 2, 3, 4 and 1 more) can straighten "
        "by itself, because modules would overlap: modules 2 and 10, modules 3 and 9, modules 4 "
        "and 8, and 1 more pair; the part that would unfold next (modules 6 to 8) cannot move in "
        "any of the six directions, because modules would overlap: modules 6 and 3 (at a module "
        "size of 0.95)",
    ),
    (
        replace(BLOCKS, turns=TURNS[:1], unit=None, moves=()),
        "the hinge at module 2 cannot straighten, because modules would overlap: modules 2 and 10 "
        "(at a module size of 0.95)",
    ),
    (
        KnotEvidence(determinant=3, closings=(), polygon=(), sight=(0.0, 0.0, 1.0), diagram=()),
        "the chain is knotted (the knot's determinant is 3; that of a chain without a knot is 1): "
        "a drawing of the stalled chain, with both ends extended outwards, has 0 crossings",
    ),
    (
        BudgetEvidence(
            spent="pushes", allowed=1000, used=1000, bent_hinges=2, largest_bend_rad=0.5
        ),
        "the limit of 1\u00a0000 random pushes in a row without progress was reached; 2 hinges "
        "were still bent, by up to 29°",
    ),
)
"""Evidence, and its text for people."""
REASONS = (
    (
        Reason.of(Code.TORQUE_LIMIT, torque=3.21, frame=4, limit_torque=2.0, **FREE),
        "a hinge needs a torque of 3.21 w·p in frame 4 (with friction μ = 0.2 and no clamped "
        "module), but the limit is 2 w·p",
        "a hinge needs a torque of 3.21 w·p in frame 5 (with friction μ = 0.2 and no clamped "
        "module), but the limit is 2 w·p",
    ),
    (
        Reason.of(Code.SINKS_INTO_TABLE, depth=0.1, frame=3, limit=0.02),
        "modules sink 0.1 pitch into the table in frame 3, but at most 0.02 pitch is allowed",
        "modules sink 10 % of the spacing into the table in frame 4, but at most 2 % of the "
        "spacing is allowed",
    ),
    (
        Reason.of(Code.TOUCH, motion="plan", modules=[82, 112], frame=1413.5),
        "in the plan, modules 82 and 112 touch (frame 1413.5 of the plan)",
        "in the plan, modules 83 and 113 touch (frame 1415 of the plan)",
    ),
    (
        Reason.of(Code.TOUCH, motion="simulated playback", robot=2, modules=None, frame=0.0),
        "in the simulated playback of robot 2, modules touch (frame 0 of the simulated playback "
        "of robot 2)",
        "in the simulated folding motion of robot 3, modules touch (frame 1 of the simulated "
        "folding motion of robot 3)",
    ),
    (
        Reason.of(Code.STRAIGHT_ERROR, error=0.2),
        "at the straight shape, the modules are 0.2 pitch on average (root mean square) from "
        "their places",
        "at the straight shape, the modules are 20 % of the spacing on average (root mean square) "
        "from their places",
    ),
    (
        Reason.of(Code.PLAN_SHAPE, shape=[19, 6], expected=[20, 6]),
        "the plan has the shape (19, 6), expected 20 frames of 6 joint angles",
        "the plan has the shape (19, 6), expected 20 frames of 6 joint angles",
    ),
    (
        Reason.of(Code.STUCK_PEELING, folded=5, pushes=40, module=6, bend_rad=1.5),
        "the chain is stuck with modules 0 to 5 still folded: 40 random pushes in a row made no "
        "progress. The joint of module 6 is still bent by 86°. Start the chain at its other end, "
        "or try another path",
        "the chain is stuck with modules 1 to 6 still folded: 40 random pushes in a row made no "
        "progress. The joint of module 7 is still bent by 86°. Start the chain at its other end, "
        "or try another path",
    ),
    (
        Reason.of(Code.MISSED, error=1.0),
        "the modules ended 1 pitch from their targets on average (root mean square)",
        "the modules ended one spacing from their targets on average (root mean square)",
    ),
    (
        Reason.of(Code.EXPLOSION_FAILED, status="stalled"),
        "the explosion stalled",
        "the unfolding stalled",
    ),
)
"""Reasons, and their texts for programs and for people."""


def test_input_errors_count_from_zero_for_programs_and_from_one_for_people() -> None:
    template = "cells {cells} are {steps} steps apart."
    error = InputError("not-adjacent", template, where="cells {cells}", cells=[1, 2], steps=3)
    assert (error.where, error.detail) == ("cells 1 and 2", "cells 1 and 2 are 3 steps apart.")
    assert str(error) == error.detail
    assert error.message == "cells 2 and 3 are 3 steps apart."
    assert named(error, "{a}.csv").message == "{a}.csv: cells 2 and 3 are 3 steps apart."
    assert error.changed(where="here").message == "here: cells 2 and 3 are 3 steps apart."
    assert InputError("bad", "got {0}.", where="a {b}").message == "a {b}: got {0}."
    body = Problem.of(Unusable.of(error)).body()
    assert body["values"] == {"cells": [1, 2], "steps": 3}
    assert (body["where"], body["detail"]) == (error.where, error.detail)
    assert body["message"] == "Cells 2 and 3 are 3 steps apart."


def test_error_of_another_process_is_no_template() -> None:
    values = {"cells": [1, 2]}
    error = InputError.reported("bad", "{cells.x} is bad.", "{cells}", "cell 2 is bad", values)
    assert (error.detail, error.where) == ("{cells.x} is bad.", "{cells}")
    assert (error.message, error.values) == ("cell 2 is bad", values)
    assert error.changed("so {cells.x}").detail == "so {cells.x}"


def test_evidence_counts_from_one_for_people() -> None:
    for evidence, words in EVIDENCE:
        with case(type(evidence).__name__):
            assert evidence.text(PEOPLE) == words
    assert "modules 1 and 9, modules 2 and 8" in BLOCKS.text()


def test_reasons_count_from_zero_for_programs_and_from_one_for_people() -> None:
    for reason, for_programs, for_people in REASONS:
        with case(reason.code):
            assert reason.text() == for_programs
            assert reason_text(reason) == for_people
            assert reason_text(reason.as_dict()) == for_people
    assert set(TEXTS) == set(Code)
