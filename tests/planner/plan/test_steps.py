"""Steps of plans that rest: what moves, what is held, and where the turns lead."""

import csv
import io
import json
from typing import Any

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.exports.formats import export_named
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.step_text import ordinal
from foldback.planner.plan.steps import steps_between, steps_of
from foldback.planner.readers.angle_strings import read_angle_string
from tests.planner.chains import coil
from tests.planner.plans import resting, turn_by_turn

RING = read_angle_string("- - - + - - - + - - -", name="ring")
CHAINS = {"cube": coil(12), "tetrahedron": RING}


def document(plan: Plan) -> dict[str, Any]:
    return json.loads(export_named("steps").write(plan))


def test_the_shorter_side_of_a_single_turn_moves() -> None:
    rests = np.zeros((3, 2 * 6))  # 8 cubes
    rests[1:, 2 * 1] = np.pi / 2  # joint at module 2
    rests[2:, 2 * 4 + 1] = -np.pi / 2  # joint at module 5
    first, second = steps_between(CUBE, rests)
    (turn,) = first.turns
    assert (turn.hinge, turn.module, turn.moves, first.held) == (2, 2, (0, 2), (3, 7))
    assert first.moving == ((0, 2),)
    (turn,) = second.turns
    assert (turn.hinge, turn.module, turn.moves, second.held) == (9, 5, (6, 7), (0, 5))
    assert (turn.from_rad, turn.to_rad) == (0.0, -np.pi / 2)


def test_all_but_the_largest_part_move_in_a_merged_step() -> None:
    rests = np.zeros((3, 2 * 8))  # 10 cubes
    rests[1:, [2 * 1, 2 * 1 + 1, 2 * 6]] = np.pi / 2  # both hinges at module 2, and one at module 7
    (step,) = steps_between(CUBE, rests)
    assert (step.parts, step.held) == (((0, 2), (3, 7), (8, 9)), (3, 7))
    assert [turn.moves for turn in step.turns] == [(0, 2), (0, 2), (8, 9)]


@pytest.mark.parametrize("at_once", [1, 3])
@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_turns_of_the_document_lead_from_straight_to_folded(chain: Chain, at_once: int) -> None:
    plan = resting(chain, turn_by_turn(chain, at_once))
    steps = document(plan)["steps"]
    placed = [poses.positions for poses in steps_of(plan).poses()]
    points, angles = placed[0].copy(), np.zeros(len(chain.folded_rad))
    for step, after in zip(steps, placed[1:], strict=True):
        # Turns far from the held part come first: they leave the axes of the others in place.
        ahead = [turn for turn in step["turns"] if turn["moves"][0] == 0]
        behind = [turn for turn in step["turns"] if turn["moves"][0] > 0]
        for turn in (*ahead, *reversed(behind)):
            angle = turn["to_rad"] - turn["from_rad"]
            angles[turn["hinge"]] += angle
            rotation, pivot = Rotation.from_rotvec(angle * np.array(turn["axis"])), turn["pivot"]
            moved = slice(turn["moves"][0], turn["moves"][1] + 1)
            points[moved] = rotation.apply(points[moved] - pivot) + pivot
        np.testing.assert_allclose(points, after, atol=1e-6)
    np.testing.assert_allclose(angles, chain.folded_rad, atol=1e-12)
    np.testing.assert_allclose(points, chain.folded_poses.positions, atol=1e-6)


def test_document_names_joints_angles_and_times() -> None:
    chain = CHAINS["cube"]
    plan = resting(chain, turn_by_turn(chain, 3), frames_per_step=5)
    stated_document = document(plan)
    assert (stated_document["format"], stated_document["module"], stated_document["modules"]) == (
        "foldback-steps/1",
        "cube",
        12,
    )
    assert stated_document["turns"] == np.count_nonzero(chain.folded_rad)
    assert sum(len(step["turns"]) for step in stated_document["steps"]) == stated_document["turns"]
    for number, step in enumerate(stated_document["steps"], 1):
        assert step["number"] == number
        assert (step["start_frame"], step["end_frame"]) == (5 * number - 5, 5 * number)
        assert (step["start_s"], step["duration_s"]) == (5 * number - 5, 5)
        assert len(step["turns"]) > 1 or number == len(stated_document["steps"])
        for turn in step["turns"]:
            assert turn["joint"] == chain.joint_names[turn["hinge"]]
            assert (turn["from_deg"], abs(turn["to_deg"])) == (0, 90)
            assert np.deg2rad(turn["to_deg"]) == pytest.approx(turn["to_rad"])


def test_step_texts_count_modules_from_one() -> None:
    chain = CHAINS["cube"]
    single = document(resting(chain, turn_by_turn(chain, 1)))["steps"][0]
    assert single["text"] == "Turn at the 7th cube, +90° (z). Hold cubes 1 to 7."
    merged = document(resting(chain, turn_by_turn(chain, 20)))["steps"][0]
    assert merged["text"].startswith("Make 10 turns together, at the 2nd cube, ")
    assert merged["text"].endswith("; and 5 more. Hold cubes 1 and 2.")
    (text,) = [step["text"] for step in document(resting(RING, turn_by_turn(RING, 20)))["steps"]]
    assert text.startswith("Make 11 turns together, after the 1st tetrahedron, −90°; ")
    assert [ordinal(n) for n in (1, 2, 3, 4, 11, 12, 13, 21, 111, 122)] == [
        *("1st", "2nd", "3rd", "4th", "11th", "12th", "13th", "21st", "111th", "122nd")
    ]


def test_tables_and_scenes_mark_the_steps() -> None:
    chain = CHAINS["cube"]
    plan = resting(chain, turn_by_turn(chain, 4), frames_per_step=3)
    rows = list(csv.DictReader(io.StringIO(export_named("csv").write(plan).decode())))
    assert [int(row["step"]) for row in rows] == [0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    scene = pygltflib.GLTF2.load_from_bytes(export_named("glb").write(plan))
    assert scene is not None
    marks = [{"name": f"Step {k}", "start_s": 3.0 * k - 3.0, "end_s": 3.0 * k} for k in (1, 2, 3)]
    assert [animation.extras for animation in scene.animations or ()] == [{"steps": marks}]


def test_a_plan_that_never_rests_has_no_steps(folded: Any) -> None:
    with pytest.raises(InputError) as refusal:
        export_named("steps").write(folded.plan)
    assert refusal.value.code == "no-steps"
    assert "got a plan that does not rest between steps" in refusal.value.detail
