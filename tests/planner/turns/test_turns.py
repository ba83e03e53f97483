"""Turns: swept cells, searches, steps, and the plans that are made of them."""

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.path import Path
from foldback.planner.chain.rotations import QUARTER_RAD
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import cube_turning_gap
from foldback.planner.errors import InputError
from foldback.planner.explosion.blocking import no_quarter_turn
from foldback.planner.explosion.diagnosis import diagnose
from foldback.planner.explosion.strategies import ranked_strategies
from foldback.planner.explosion.turning import unfold_in_turns
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.fold import fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.steps import steps_of
from foldback.planner.readers import read
from foldback.planner.turns.beam_search import unfold
from foldback.planner.turns.cube_turns import cube_turning
from foldback.planner.turns.moves import RoomProof, moves_between
from foldback.planner.turns.shortening import shortened
from foldback.planner.turns.tetrahedron_turns import tetrahedron_turning
from foldback.planner.turns.turn_sequence import NoTurns, TurnSequence, find_turns
from tests.planner.chains import line, shuffled

SHAPES = FilePath(__file__).parents[3] / "examples" / "shapes"
SIZE = 0.95


def path_of(name: str) -> Path:
    path = read((SHAPES / f"{name}.json").read_bytes())
    assert isinstance(path, Path)
    return path


def chain_of(name: str) -> Chain:
    return Chain.from_path(path_of(name))


def sequence(chain: Chain, *, at_once: int | None = None, size: float = SIZE) -> TurnSequence:
    turns = find_turns(chain, module_size=size, at_once=at_once, seed=0)
    assert isinstance(turns, TurnSequence)
    return turns


def test_gap_of_a_turning_square_is_that_of_many_samples() -> None:
    random = np.random.default_rng(0)
    for _ in range(80):
        a, b, c, d = random.integers(-6, 7, 4)
        if (a, b) == (c, d):
            continue
        gap, sampled = cube_turning_gap(a, b, c, d, 0.475), sampled_gap(a, b, c, d, 0.475)
        assert gap <= sampled + 1e-9
        # Between two samples a corner goes at most its radius times half their distance.
        assert sampled - gap <= 0.5 * (np.hypot(a, b) + 0.7) * (np.pi / 2) / 400


def sampled_gap(a: int, b: int, c: int, d: int, half: float) -> float:
    """Return the smallest distance of two squares at 401 angles, by points of their edges."""
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    least_gap = np.inf
    for angle in np.linspace(0.0, np.pi / 2, 401):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        moved = (np.array([a, b]) + corners) @ turn.T
        apart = np.inf
        for points, centre, axes in (
            (moved, np.array([c, d]), np.eye(2)),
            (np.array([c, d]) + corners, turn @ [a, b], turn),
        ):
            beyond = np.maximum(np.abs((points - centre) @ axes) - half, 0.0)
            apart = min(apart, float(np.hypot(*beyond.T).min()))
        least_gap = min(least_gap, apart)
    return least_gap


@pytest.mark.parametrize(
    ("name", "turns", "most_steps"), [("wrench-24", 19, 1), ("mallet-64", 50, 6)]
)
def test_shapes_fold_in_turns_with_room(name: str, turns: int, most_steps: int) -> None:
    chain = chain_of(name)
    folding = sequence(chain)
    assert folding.turns <= turns
    assert len(folding.hinges) <= most_steps
    rests = folding.rest_angles_rad
    assert not rests[0].any()
    assert rests[-1] == pytest.approx(chain.folded_rad, abs=1e-9)
    assert folding.room == pytest.approx(0.045)
    assert sweep(chain, rests, module_size=SIZE).clearance >= folding.room
    for hinges, change in zip(folding.hinges, np.diff(rests, axis=0), strict=True):
        assert sorted(hinges) == np.flatnonzero(change).tolist()


def test_number_of_hinges_at_once_is_kept() -> None:
    chain = chain_of("wrench-24")
    for most_turns in (1, 4):
        folding = sequence(chain, at_once=most_turns)
        assert max(map(len, folding.hinges)) == most_turns
        assert sweep(chain, folding.rest_angles_rad, module_size=SIZE).clearance >= folding.room


def test_two_hinges_turn_at_once_where_no_single_one_can() -> None:
    chain = chain_of("arrow")
    folding = sequence(chain)
    assert folding.turns <= 1.05 * np.count_nonzero(chain.folded_rad)
    assert sweep(chain, folding.rest_angles_rad, module_size=SIZE).clearance >= folding.room


@pytest.mark.parametrize("module", ["cubes", "tetrahedra"])
def test_pairs_get_straight_or_move_a_part_that_does_not_turn(module: str) -> None:
    if module == "cubes":
        chain = shuffled((3, 3, 4), 100, 200)
        turning = cube_turning(chain, SIZE)
    else:
        levels = np.array([1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0, 0.0])
        chain = Chain.from_angles(TETRAHEDRON, QUARTER_RAD * levels)
        turning = tetrahedron_turning(chain, SIZE)
    pairs = turning.pairs(turning.folded)
    states = np.concatenate([turning.folded[None], pairs]).astype(float)
    rotations = forward_kinematics(chain.module, QUARTER_RAD * states).rotations[:, -1]
    assert (np.count_nonzero(pairs != turning.folded, axis=1) == 2).all()
    gains = np.count_nonzero(turning.folded) - np.count_nonzero(pairs, axis=1)
    assert set(gains.tolist()) == {0, 2}
    for rotation in rotations[1:][gains == 0]:
        assert rotation == pytest.approx(rotations[0], abs=1e-9)


def test_a_symmetric_pair_frees_a_packed_chain() -> None:
    chain = shuffled((3, 3, 4), 100, 200)
    assert isinstance(find_turns(chain, module_size=SIZE, at_once=1, seed=0), NoTurns)
    folding = sequence(chain)
    assert sweep(chain, folding.rest_angles_rad, module_size=SIZE).clearance >= folding.room > 0.0


def test_turns_that_are_undone_later_are_left_out_where_all_stays_clear() -> None:
    chain = chain_of("wrench-24")
    turning = cube_turning(chain, SIZE)
    proof = RoomProof(chain, turning, 0.0225)
    search = unfold(turning, turning.folded, room=0.0225, width=4, seed=0)
    moves = moves_between(search.states)
    hinge = next(h for h in range(len(turning.folded)) if not turning.folded[h])
    forward, backward = ((hinge, 1),), ((hinge, -1),)
    detour = [*moves[:-2], forward, *moves[-2:], backward]
    assert proof.one_by_one(turning.folded, detour)
    assert shortened(turning.folded, detour, proof) == moves
    assert shortened(turning.folded, [forward], proof) == [forward]


@pytest.mark.parametrize("name", ["seven", "letter-u"])
def test_pairs_keep_the_largest_room(name: str) -> None:
    chain = chain_of(name)
    folding = sequence(chain)
    assert folding.room == pytest.approx(0.045)
    assert sweep(chain, folding.rest_angles_rad, module_size=SIZE).clearance >= folding.room


def test_without_a_free_hinge_it_says_so_once() -> None:
    plan = fold(path_of("arrow"), strategy="one-by-one")
    (attempt,) = plan.attempts
    assert attempt["reason"]["code"] == "no-quarter-turn"
    assert attempt["reason"]["values"] == {"turns": 327, "joints": 204}
    assert (attempt["diagnosis"] or {})["kind"] == "blocked"


def test_no_turn_is_free_where_the_search_offers_none() -> None:
    blocked = 0
    for seed in range(6):
        chain = shuffled((3, 3, 3), 50, seed)
        turning = cube_turning(chain, SIZE)
        codes = np.zeros((len(chain.folded_rad), 3), np.uint64)
        states = turning.folded[None]
        turns = turning.turns(states, np.zeros(1, np.uint64), codes, weight=0.5)
        clear = turning.are_clear(states, turns, np.arange(len(turns.hinge)), room=0.0)
        assert (no_quarter_turn(chain, module_size=SIZE) is None) is bool(clear.any())
        blocked += not clear.any()
    assert 0 < blocked < 6


def test_plan_rests_at_frames_and_is_proved(tmp_path: FilePath) -> None:
    plan = fold(path_of("wrench-24"), seed=0, strategy="turns", at_once=8)
    assert plan.certificate.verdict == "verified (simulated)"
    steps = steps_of(plan)
    assert steps.turn_count == 19
    assert max(len(step.turns) for step in steps.steps) <= 8
    assert steps.frames[-1] == len(plan.motion) - 1
    quarters = steps.rests_rad / (np.pi / 2)
    assert np.abs(quarters - np.rint(quarters)).max() < 1e-6
    plan.save_npz(tmp_path / "plan.npz")
    assert foldback_check.check(str(tmp_path / "plan.npz"))["verdict"] == "proved"


def test_auto_folds_short_chains_in_turns() -> None:
    plan = fold(path_of("wrench-24"), seed=0)
    (attempt,) = plan.attempts
    assert (attempt["strategy"], attempt["roomy"]) == ("turns", True)
    assert plan.certificate.verdict == "verified (simulated)"
    assert (plan.certificate.clearance_bound or 0.0) > 0.044
    assert len(steps_of(plan).steps) == 1


def test_auto_explodes_where_turns_take_many_steps() -> None:
    chain = shuffled((3, 3, 3), 50, 0)
    sequence_steps = len(sequence(chain).hinges)
    record = unfold_in_turns(chain, "turns", module_size=SIZE, at_once=None, seed=0, roomy=True)
    assert sequence_steps > 3
    assert record.status == "stalled"
    assert str(record.reason) == f"turns were found in {sequence_steps} steps, more than 3"
    evidence = diagnose(chain, record, Parameters())
    assert evidence is not None
    assert f"take {sequence_steps} steps; 3 are allowed" in evidence.text()
    plan = fold(chain, seed=0)
    assert [attempt["strategy"] for attempt in plan.attempts] == ["turns", "simultaneous"]
    assert plan.certificate.verdict == "verified (simulated)"


def test_straight_chain_folds_without_a_step() -> None:
    plan = fold(Path.from_cells([(k, 0, 0) for k in range(3)], name="line"), strategy="turns")
    assert plan.certificate.verdict == "verified (simulated)"
    with pytest.raises(InputError, match="straight chain"):
        steps_of(plan)


def test_modules_that_only_come_too_near_do_not_block_a_turn() -> None:
    # Full-size tetrahedra touch each other, so no turn keeps any distance.
    angles = np.array([np.pi / 2, -np.pi / 2])
    record = unfold_in_turns(
        Chain.from_angles(TETRAHEDRON, angles), "turns", module_size=1.0, at_once=None, seed=0
    )
    assert record.status == "stalled" and "free" not in str(record.reason)
    assert record.spent is not None and record.spent.kind == "turns"


def test_angles_with_few_digits_fold_to_these_angles() -> None:
    exact = chain_of("wrench-24")
    near = replace(exact, folded_rad=exact.folded_rad + np.deg2rad(1e-3))
    assert sequence(near).rest_angles_rad[-1] == pytest.approx(near.folded_rad, abs=1e-12)


def test_long_chains_are_told_the_limit_of_turns() -> None:
    with pytest.raises(InputError, match="at most 500 modules; this chain has 501"):
        ranked_strategies(line(501), Parameters(strategy="turns"))


def test_hinges_at_once_are_for_turns_only() -> None:
    with pytest.raises(InputError, match="hinges at once") as refused:
        FoldRequest(at_once=4).check()
    assert refused.value.where == "at_once"
