"""Turns of tetrahedra: gaps between cells, sequences, and a plan that is made of one."""

from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.core import GAP_TOLERANCE, pair_separation, tetrahedron_turning_gap
from foldback.planner.errors import InputError
from foldback.planner.explosion.strategies import ranked_strategies
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.fold import fold
from foldback.planner.readers import read
from foldback.planner.turns.tetrahedron_turns import tetrahedron_turning
from foldback.planner.turns.turn_sequence import TurnSequence, find_turns

SHAPES = FilePath(__file__).parents[3] / "examples" / "shapes"
SIZE = 0.95


def chain_of(name: str) -> Chain:
    chain = read((SHAPES / f"{name}.json").read_bytes())
    assert isinstance(chain, Chain)
    return chain


def seen_from(chain: Chain, hinge: int) -> tuple[Ints, Array]:
    """Return cells, and orientations, seen from a hinge that runs along the first axis."""
    poses = chain.folded_poses
    frame = poses.rotations[hinge] @ np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    node = poses.positions[hinge] + poses.rotations[hinge] @ TETRAHEDRON.joint.anchor[0]
    cells = np.rint(2.0 * (poses.positions - node) @ frame).astype(np.int64)
    return cells, frame.T @ poses.rotations


def test_gap_of_a_turning_tetrahedron_is_that_of_many_samples() -> None:
    chain = chain_of("tetra-cube-2")
    cells, orientations = seen_from(chain, 40)
    random = np.random.default_rng(0)
    reach = 2.0 * TETRAHEDRON.inner_radius * (1.0 - SIZE)
    clear = 0
    for _ in range(150):
        a, b = int(random.integers(41, 60)), int(random.integers(20, 40))
        gap = tetrahedron_turning_gap(cells[a], cells[b], TETRAHEDRON.hull, SIZE, reach)
        minimum = 1.0
        for angle in np.linspace(0.0, np.pi / 2, 201):
            c, s = np.cos(angle), np.sin(angle)
            turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
            apart = cells[b] / 2.0 - turn @ (cells[a] / 2.0)
            minimum = min(
                minimum,
                pair_separation(
                    apart,
                    turn @ orientations[a],
                    orientations[b].copy(),
                    TETRAHEDRON.hull,
                    SIZE,
                    1.0,
                ),
            )
        radius = min(np.hypot(*cells[a][1:]), np.hypot(*cells[b][1:])) / 2.0 + TETRAHEDRON.radius
        assert gap <= max(0.0, min(minimum, reach)) + 1e-6
        assert minimum - gap <= 2.0 * GAP_TOLERANCE + radius * np.pi / 800 or gap == reach
        clear += gap > 0.0
    assert 0 < clear < 150


@pytest.mark.parametrize(
    ("name", "most_steps"), [("tetra-ring", 1), ("tetra-dodecahedron", 3), ("tetra-letter-f", 5)]
)
def test_each_bent_hinge_turns_once(name: str, most_steps: int) -> None:
    chain = chain_of(name)
    turns = find_turns(chain, module_size=SIZE, at_once=None, seed=0)
    assert isinstance(turns, TurnSequence)
    assert turns.turns == np.count_nonzero(chain.folded_rad)
    assert len(turns.hinges) <= most_steps
    rests = turns.rest_angles_rad
    assert not rests[0].any()
    assert rests[-1] == pytest.approx(chain.folded_rad, abs=1e-9)
    assert sweep(chain, rests, module_size=SIZE).clearance >= turns.room - 1e-9 > 0.015


def test_smallest_tables_grow_to_the_same_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = chain_of("tetra-dodecahedron")
    codes = np.random.default_rng(0).integers(0, 2**64, (23, 3), np.uint64)
    clear: list[list[bool]] = []
    for slots in (2**4, 2**14):
        monkeypatch.setattr("foldback.planner.turns.tetrahedron_turns.MIN_TABLE_ENTRIES", slots)
        turning = tetrahedron_turning(chain, SIZE)
        states = turning.folded[None]
        turns = turning.turns(states, np.zeros(1, np.uint64), codes, weight=0.5)
        every = np.arange(len(turns.hinge))
        clear.append(turning.are_clear(states, turns, every, room=0.01).tolist())
    assert clear[0] == clear[1]
    assert any(clear[0])


def test_plan_of_tetrahedra_is_proved(tmp_path: FilePath) -> None:
    plan = fold(chain_of("tetra-ring"), seed=0, strategy="turns")
    assert plan.certificate.verdict == "verified (simulated)"
    plan.save_npz(tmp_path / "plan.npz")
    assert foldback_check.check(str(tmp_path / "plan.npz"))["verdict"] == "proved"


def test_only_right_angles_are_turned() -> None:
    chain = Chain.from_angles(TETRAHEDRON, np.array([0.5, np.pi / 2, 0.0]))
    with pytest.raises(InputError, match=r"strategy turns, .* hinge 0 here is at 28\.6479°"):
        ranked_strategies(chain, Parameters(strategy="turns"))
