"""The checker of exhaustion files proves true ones, and no forged one."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foldback import foldback_check_exhaustion
from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.module import Module
from foldback.planner.reachability.deciding import Decider
from foldback.planner.reachability.exhaustion_file import write_exhaustion
from foldback.planner.reachability.verdict import Exhaustion
from foldback.planner.turns.hinge_steps import HingeSteps

PRISM = module_named("snake-prism")
SNOWMAN = "02202200022022000220220"
"""Figure of which single quarter turns lead to 16 states."""


def whole_proof(module: Module, figure: np.ndarray, goal: np.ndarray) -> dict[str, Any]:
    """Return the values of the file of a proof by all states of the whole chain."""
    steps = HingeSteps(module, module.module_count(len(figure)))
    search = steps.search(figure, goal, max_states=1000)
    assert search.exhausted
    proof = Exhaustion(first=0, modules=steps.modules, states=search.states, goal=goal)
    return json.loads(write_exhaustion(module, proof, figure=figure, goal=goal))


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    figure = np.array([int(digit) for digit in SNOWMAN], np.int8)
    return whole_proof(PRISM, figure, np.zeros_like(figure))


def checked(tmp_path: Path, values: dict[str, Any]) -> dict[str, Any]:
    path = tmp_path / "exhaustion.json"
    path.write_text(json.dumps(values))
    return foldback_check_exhaustion.check(str(path))


def test_a_true_file_is_proved(tmp_path: Path, values: dict[str, Any]) -> None:
    result = checked(tmp_path, values)
    assert result["verdict"] == "proved", result
    assert (result["states"], result["turns"]) == (16, 16 * 46)
    assert result["blocked"] > 600


def test_a_part_of_the_chain_is_proved_by_the_program(tmp_path: Path) -> None:
    decider = Decider(PRISM, np.pi / 2 * np.array([0, 0, 0, 0, 2, 2, 0, 0, 0]))
    verdict = decider.verdict(sizes=False)
    assert verdict.exhaustion is not None
    assert verdict.exhaustion.modules == 5
    path = tmp_path / "exhaustion.json"
    path.write_bytes(
        write_exhaustion(PRISM, verdict.exhaustion, figure=verdict.figure, goal=verdict.goal)
    )
    program = [sys.executable, foldback_check_exhaustion.__file__, str(path)]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith("proved: modules 4 to 8 of 10 reach 1 states")


def test_limited_hinges_need_no_evidence_beyond_their_stops(tmp_path: Path) -> None:
    values = whole_proof(
        module_named("tetrahedron"), np.array([1, 0, 0], np.int8), np.array([2, 0, 0], np.int8)
    )
    assert any(None in pair for rows in values["turns"] for pair in rows)
    assert checked(tmp_path, values)["verdict"] == "proved"


def blocked_place(values: dict[str, Any]) -> tuple[int, int, int]:
    """Return a state, hinge and direction of a turn that is blocked."""
    for state, rows in enumerate(values["turns"]):
        for hinge, row in enumerate(rows):
            for side in (0, 1):
                if isinstance(row[side], list):
                    return state, hinge, side
    raise AssertionError


def free_place(values: dict[str, Any]) -> tuple[int, int, int]:
    for state, rows in enumerate(values["turns"]):
        for hinge, row in enumerate(rows):
            for side in (0, 1):
                if isinstance(row[side], int):
                    return state, hinge, side
    raise AssertionError


def at_rest(values: dict[str, Any]) -> None:
    state, hinge, side = blocked_place(values)
    values["turns"][state][hinge][side][2] = 0.0


def other_modules(values: dict[str, Any]) -> None:
    state, hinge, side = blocked_place(values)
    values["turns"][state][hinge][side][:2] = [0, 23]


def blocks_a_free_turn(values: dict[str, Any]) -> None:
    state, hinge, side = free_place(values)
    values["turns"][state][hinge][side] = [hinge, hinge + 1, 0.5]


def leads_elsewhere(values: dict[str, Any]) -> None:
    state, hinge, side = free_place(values)
    values["turns"][state][hinge][side] = state


def stops_a_free_hinge(values: dict[str, Any]) -> None:
    state, hinge, side = free_place(values)
    values["turns"][state][hinge][side] = None


def drops_a_state(values: dict[str, Any]) -> None:
    values["states"].pop()
    values["turns"].pop()


def drops_turns(values: dict[str, Any]) -> None:
    values["turns"].pop()


def drops_a_hinge(values: dict[str, Any]) -> None:
    values["turns"][3].pop()


def begins_elsewhere(values: dict[str, Any]) -> None:
    values["figure"][2] = 1


def has_the_goal(values: dict[str, Any]) -> None:
    values["goal"] = list(values["states"][5])


def has_the_goal_by_full_turns(values: dict[str, Any]) -> None:
    values["goal"] = [level - 4 for level in values["states"][5]]


def lists_a_state_twice(values: dict[str, Any]) -> None:
    values["states"][7] = values["states"][6]


def makes_the_modules_thinner(values: dict[str, Any]) -> None:
    for corner in values["module"]["pieces"][0]["parts"][0]["corners"]:
        corner[:] = [0.4 + 0.2 * x for x in corner]


def makes_larger_steps(values: dict[str, Any]) -> None:
    values["module"]["pieces"][0]["joint"]["step_deg"] = 120


FORGERIES = [
    at_rest,
    other_modules,
    blocks_a_free_turn,
    leads_elsewhere,
    stops_a_free_hinge,
    drops_a_state,
    drops_turns,
    drops_a_hinge,
    begins_elsewhere,
    has_the_goal,
    has_the_goal_by_full_turns,
    lists_a_state_twice,
    makes_the_modules_thinner,
    makes_larger_steps,
]


@pytest.mark.parametrize("forge", FORGERIES, ids=lambda forge: forge.__name__)
def test_no_forged_file_is_proved(
    tmp_path: Path, values: dict[str, Any], forge: Callable[[dict[str, Any]], None]
) -> None:
    forged = json.loads(json.dumps(values))
    forge(forged)
    assert forged != values
    assert checked(tmp_path, forged)["verdict"] != "proved"


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", "foldback-exhaustion/2"),
        ("modules", 10**9),
        ("modules", True),
        ("part", {"first": -1, "modules": 24}),
        ("part", None),
        ("states", [[1e400] * 23]),
        ("states", []),
        ("module", {}),
        ("turns", {}),
    ],
)
def test_strange_values_are_refused(
    tmp_path: Path, values: dict[str, Any], key: str, value: object
) -> None:
    assert checked(tmp_path, {**values, key: value})["verdict"] != "proved"


def test_what_is_no_json_is_unreadable(tmp_path: Path) -> None:
    path = tmp_path / "exhaustion.json"
    for data in (b"", b"[" * 100_000, b"\xff", b"null"):
        path.write_bytes(data)
        assert foldback_check_exhaustion.check(str(path))["verdict"] == "unreadable"
    assert foldback_check_exhaustion.check(str(tmp_path / "none.json"))["verdict"] == "unreadable"


def test_many_corners_take_little_memory() -> None:
    round_body = [
        [np.cos(a), np.sin(a), z] for a in np.linspace(0.0, 2.0 * np.pi, 17)[:16] for z in (-1, 1)
    ]
    document = json.loads(json.dumps(PRISM.document))
    document["pieces"][0]["parts"][0]["corners"] = round_body
    part = foldback_check_exhaustion.Part(document, 0, 3)
    assert len(part.bodies[0][0].edges) >= 9
    rows = part.rows_at_once(0, 2)
    assert 1 <= rows * len(part.bodies[0][0].edges) ** 2 * 32 <= 1 << 22
    axes, places = part.poses(np.zeros((2, 2)))
    assert (part.overlap(0, 2, axes, places) > 0.1).all()
