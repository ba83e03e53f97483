import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import dodecahedron_pairs, ring_pairs
from foldback.planner.chain.trail import Trail, hinge_axes
from foldback.planner.clearance.clearance import closest
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.eulerian_circuits import cut_open, eulerian_circuit, free_cuts
from tests.case import case
from tests.planner.lattice import Ints, box_array, connected_sets
from tests.refusal import refused


@given(cells=connected_sets(maximum=20))
def test_joined_cells_have_a_circuit_that_turns_where_four_meet(cells: Ints) -> None:
    pairs = ring_pairs(cells)
    nodes = eulerian_circuit(pairs)
    assert len(nodes) == len(pairs) + 1
    np.testing.assert_array_equal(nodes[0], nodes[-1])
    used = {frozenset(map(tuple, step.tolist())) for step in np.stack([nodes[:-1], nodes[1:]], 1)}
    assert used == {frozenset(map(tuple, pair.tolist())) for pair in pairs}
    ring = nodes[:-1]
    _, inverse, counts = np.unique(ring, axis=0, return_inverse=True, return_counts=True)
    straight = (ring - np.roll(ring, 1, axis=0) == np.roll(ring, -1, axis=0) - ring).all(axis=1)
    assert not straight[counts[inverse.reshape(-1)] == 2].any()


def test_opened_trail_starts_where_it_is_cut() -> None:
    nodes = eulerian_circuit(ring_pairs(np.array([[0, 0, 0], [1, 0, 0]])))
    free = free_cuts(nodes)
    assert free.any()
    assert not free.all()
    trail = Trail.from_nodes(cut_open(nodes, int(np.flatnonzero(free)[3])))
    np.testing.assert_array_equal(trail.nodes[0], nodes[np.flatnonzero(free)[3]])
    assert (trail.nodes == trail.nodes[0]).all(axis=1).sum() == 2  # only the two ends are odd


def test_separate_cells_have_no_circuit() -> None:
    with refused("no-trail", match="in 2 parts"):
        eulerian_circuit(ring_pairs(np.array([[0, 0, 0], [5, 0, 0]])))


def test_odd_node_is_named() -> None:
    with pytest.raises(InputError, match="an odd number") as refusal:
        eulerian_circuit(ring_pairs(np.zeros((1, 3), dtype=np.int64))[:-1])
    assert refusal.value.where.startswith("node (")


def test_bad_trails_are_refused_with_their_place() -> None:
    for nodes, code, error_place in (
        ([[1, 0, 0], [1, 1, 0], [1, 1, 1]], "not-a-node", "node 2"),
        ([[1, 0, 0], [1, 1, 0], [1, 0, 1]], "not-adjacent", "node 1"),
        ([[1, 0, 0], [1, 1, 0], [1, 0, 0]], "repeated-cell", "modules 0 and 1"),
        ([[1, 0, 0], [1, 1, 0]], "too-few-nodes", None),
    ):
        with case((nodes, code)), refused(code, error_place):
            Trail.from_nodes(nodes)


def test_hinge_axes_lie_along_the_odd_or_the_even_coordinate() -> None:
    nodes = np.array([[1, 0, 0], [0, 0, 3], [1, 1, 2], [2, 1, 5]])
    np.testing.assert_array_equal(hinge_axes(nodes), [0, 2, 2, 0])


ONE = np.zeros((1, 3), dtype=np.int64)


def corners(pair: Ints) -> NDArray[np.float64]:
    """Return the (4, 3) corners of the tetrahedron whose long edges end at two nodes."""
    axes = np.eye(3)[hinge_axes(pair)]
    return np.concatenate([pair - axes, pair + axes]).astype(np.float64)


def test_dodecahedron_has_twelve_faces() -> None:
    found_corners = np.concatenate([corners(pair) for pair in dodecahedron_pairs(ONE)])
    hull = ConvexHull(found_corners)
    assert hull.volume == pytest.approx(24 * TETRAHEDRON.volume)
    normals = np.unique(np.round(hull.equations[:, :3], 9), axis=0)
    assert len(normals) == 12


def test_folded_chain_fills_the_tetrahedra_of_its_trail() -> None:
    for pairs in (
        ring_pairs(ONE),
        ring_pairs(box_array(2, 2, 2)),
        ring_pairs(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]])),
        dodecahedron_pairs(np.array([[0, 0, 0], [2, 2, 0], [2, 0, 2]])),
    ):
        with case(pairs):
            chain = Chain.from_trail(Trail.from_nodes(cut_open(eulerian_circuit(pairs), 5)))
            assert len(chain) == len(pairs)
            np.testing.assert_allclose(np.abs(np.rad2deg(chain.folded_rad)) % 90.0, 0.0, atol=1e-12)
            pair_corners = {tuple(sorted(map(tuple, corners(pair).tolist()))) for pair in pairs}
            poses = chain.folded_poses
            turned = np.einsum("nij,vj->nvi", poses.rotations, chain.module.pieces[0].corners)
            modules = np.rint(poses.positions[:, None, :] + turned) + 0.0
            assert {
                tuple(sorted(map(tuple, module))) for module in modules.tolist()
            } == pair_corners
            full = closest(chain.module, poses.positions, poses.rotations, module_size=1.0)
            assert full.clearance == pytest.approx(0.0, abs=1e-9)  # face to face, without overlap
