from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.chain.honeycomb import ring_pairs
from planner.chain.trail import Trail, hinge_axes
from planner.errors import InputError
from planner.pathfinding.trails import circuit, free_cuts, opened

Ints = NDArray[np.int64]


@st.composite
def polycubes(draw: st.DrawFn) -> Ints:
    """Cells joined by their faces, grown one by one."""
    cells = [(0, 0, 0)]
    for _ in range(draw(st.integers(0, 20))):
        base = draw(st.sampled_from(cells))
        axis = draw(st.integers(0, 2))
        cell = tuple(
            c + (draw(st.sampled_from((-1, 1))) if k == axis else 0) for k, c in enumerate(base)
        )
        if cell not in cells:
            cells.append(cell)  # pyright: ignore[reportArgumentType]
    return np.array(cells)


@given(cells=polycubes())
def test_joined_cells_have_a_circuit_that_turns_where_four_meet(cells: Ints) -> None:
    pairs = ring_pairs(cells)
    nodes = circuit(pairs)
    assert len(nodes) == len(pairs) + 1
    np.testing.assert_array_equal(nodes[0], nodes[-1])
    used = {frozenset(map(tuple, step.tolist())) for step in np.stack([nodes[:-1], nodes[1:]], 1)}
    assert used == {frozenset(map(tuple, pair.tolist())) for pair in pairs}
    ring = nodes[:-1]
    _, inverse, counts = np.unique(ring, axis=0, return_inverse=True, return_counts=True)
    straight = (ring - np.roll(ring, 1, axis=0) == np.roll(ring, -1, axis=0) - ring).all(axis=1)
    assert not straight[counts[inverse.reshape(-1)] == 2].any()


def test_opened_trail_starts_where_it_is_cut() -> None:
    nodes = circuit(ring_pairs(np.array([[0, 0, 0], [1, 0, 0]])))
    free = free_cuts(nodes)
    assert free.any()
    assert not free.all()
    trail = Trail.from_nodes(opened(nodes, int(np.flatnonzero(free)[3])))
    np.testing.assert_array_equal(trail.nodes[0], nodes[np.flatnonzero(free)[3]])
    assert (trail.nodes == trail.nodes[0]).all(axis=1).sum() == 2  # its two ends, nobody else


def test_separate_cells_have_no_circuit() -> None:
    with pytest.raises(InputError, match="in 2 parts") as refusal:
        circuit(ring_pairs(np.array([[0, 0, 0], [5, 0, 0]])))
    assert refusal.value.code == "no-trail"


def test_odd_node_is_named() -> None:
    with pytest.raises(InputError, match="an odd number") as refusal:
        circuit(ring_pairs(np.zeros((1, 3), dtype=np.int64))[:-1])
    assert refusal.value.where.startswith("node (")


@pytest.mark.parametrize(
    ("nodes", "code", "where"),
    [
        ([[1, 0, 0], [1, 1, 0], [1, 1, 1]], "not-a-node", "node 2"),
        ([[1, 0, 0], [1, 1, 0], [1, 0, 1]], "not-adjacent", "node 1"),
        ([[1, 0, 0], [1, 1, 0], [1, 0, 0]], "repeated-cell", "modules 0 and 1"),
        ([[1, 0, 0], [1, 1, 0]], "too-few-nodes", None),
    ],
)
def test_bad_trails_are_refused_with_their_place(nodes, code: str, where: str | None) -> None:
    with pytest.raises(InputError) as refusal:
        Trail.from_nodes(nodes)
    assert refusal.value.code == code
    assert refusal.value.where == where


def test_hinge_axes_lie_along_the_odd_or_the_even_coordinate() -> None:
    nodes = np.array([[1, 0, 0], [0, 0, 3], [1, 1, 2], [2, 1, 5]])
    np.testing.assert_array_equal(hinge_axes(nodes), [0, 2, 2, 0])
