"""Modules of several pieces and parts in kernels: against plain NumPy and dense sampling."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from foldback.planner.arrays import Ints
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.core import (
    BODY_COLUMNS,
    contact_points,
    least_separation,
    mark_blamed_hinges,
    module_clearances,
    pair_separation,
    sweep_frames,
)
from foldback.planner.core.structures import Angles, Hull, Shape, Solid, Tolerance
from foldback.planner.statics.contacts import solid_of
from tests.planner.brackets import BRACKETS
from tests.planner.chains import Array, random_rotation

Part = tuple[Array, Array, Array]
"""Corners, face normals and edge directions."""
Pieces = tuple[tuple[Part, ...], ...]
SIZE = 0.9


def part_of(corners: Array) -> Part:
    """Return a convex part, with all its normals and edges: more than one of each parallel set."""
    hull = ConvexHull(corners)
    sides = corners[hull.simplices]
    edges = np.concatenate([sides[:, k] - sides[:, k - 1] for k in range(3)])
    return corners, hull.equations[:, :3], edges / np.linalg.norm(edges, axis=1)[:, None]


def box(low: list[float], high: list[float]) -> Part:
    corners = np.array(list(product(*zip(low, high, strict=True))))
    return corners, np.eye(3), np.eye(3)


WEDGE = part_of(
    np.array([(x, y, z) for z in (-0.3, 0.3) for x, y in ((-0.2, -0.2), (0.4, -0.2), (-0.2, 0.4))])
)
ANGLE = (box([-0.4, -0.4, -0.2], [0.4, -0.1, 0.2]), box([-0.4, -0.1, -0.2], [-0.1, 0.4, 0.2]))
"""An angle bracket: its inner corner is a hollow, which the centre lies in."""
ROOF = (box([-0.3, -0.3, -0.4], [0.3, 0.3, 0.0]), part_of(WEDGE[0] + [0.0, 0.0, 0.3]))
PIECES: list[Pieces] = [((WEDGE,), ANGLE), (ANGLE, ROOF), (ANGLE,), ((ANGLE[0],), (WEDGE,), ROOF)]


def ends(counts: list[int]) -> Ints:
    """Return the ends of each of consecutive ranges of so many items: from, up to."""
    stops: Ints = np.cumsum(counts, dtype=np.int64)
    return np.stack([np.append(0, stops[:-1]), stops], axis=1)


def hull_of(pieces: Pieces) -> Hull:
    parts = [part for piece in pieces for part in piece]
    vertices, normals, edges = (np.concatenate([part[k] for part in parts]) for k in range(3))
    return Hull(
        vertices=vertices,
        normals=normals,
        edges=edges,
        parts=np.hstack([ends([len(part[k]) for part in parts]) for k in range(3)]),
        pieces=ends([len(piece) for piece in pieces]),
        kinds=np.arange(len(pieces)),
        first=0,
        radius=float(np.linalg.norm(vertices, axis=1).max()),
    )


def part_separation(p: Part, q: Part, gap: Array, a: Array, b: Array) -> float:
    """Return the largest separation of two parts over all candidate axes."""
    across = np.cross((p[2] @ a.T)[:, None], q[2] @ b.T).reshape(-1, 3)
    across = across[np.linalg.norm(across, axis=1) > 1e-9]
    across /= np.linalg.norm(across, axis=1)[:, None]
    axes = np.concatenate([p[1] @ a.T, q[1] @ b.T, across])
    of_a, of_b = SIZE * p[0] @ a.T @ axes.T, (SIZE * q[0] @ b.T + gap) @ axes.T
    return float(np.maximum(of_b.min(0) - of_a.max(0), of_a.min(0) - of_b.max(0)).max())


def separation(pieces: Pieces, i: int, j: int, gap: Array, a: Array, b: Array) -> float:
    """Return the least separation of any part of module i and any part of module j."""
    return min(
        part_separation(p, q, gap, a, b)
        for p in pieces[i % len(pieces)]
        for q in pieces[j % len(pieces)]
    )


def separations(pieces: Pieces, positions: Array, rotations: Array) -> Array:
    """Return the (n, n) separations of all modules of a configuration; ∞ on the diagonal."""
    n = len(positions)
    table = np.full((n, n), np.inf)
    for j in range(n):
        for i in range(j):
            gap = positions[j] - positions[i]
            table[i, j] = table[j, i] = separation(pieces, i, j, gap, rotations[i], rotations[j])
    return table


@pytest.mark.parametrize("pieces", PIECES, ids=["wedge+angle", "angle+roof", "angle", "three"])
def test_separation_is_the_least_one_of_parts(pieces: Pieces) -> None:
    rng = np.random.default_rng(0)
    hull = hull_of(pieces)
    signs: set[bool] = set()
    for _ in range(40):
        i, j = rng.integers(0, 7, 2)
        a, b = random_rotation(rng), random_rotation(rng)
        gap = rng.normal(0.0, 0.6, 3)
        expected = separation(pieces, i, j, gap, a, b)
        for enough in (np.inf, 0.1):
            value = pair_separation(gap, a, b, hull, SIZE, enough, int(i), int(j))
            if expected < 0.1:
                assert value == pytest.approx(expected, abs=1e-12)
            else:  # balls around two parts may show more than the axes do
                assert value >= min(enough, expected) - 1e-12
        signs.add(expected > 0.0)
    assert signs == {True, False}


def test_module_in_the_hollow_of_another_one_is_apart() -> None:
    # The hulls of both overlap, and the centre of the wedge lies where the bracket is hollow.
    pieces: Pieces = (ANGLE, (box([0.0, 0.0, -0.1], [0.2, 0.2, 0.1]),))
    upright = np.eye(3)
    got = pair_separation(np.zeros(3), upright, upright, hull_of(pieces), 1.0, np.inf, 0, 1)
    assert got == pytest.approx(0.1)
    positions, rotations = np.zeros((2, 3)), np.stack([upright, upright])
    clearance = np.empty((1, 2), dtype=np.float32)
    nearest = np.empty((1, 2), dtype=np.int32)
    solid = Solid(hull_of(pieces), 1.0, 0.1)
    module_clearances(positions[None], rotations[None], solid, 1, 0.5, clearance, nearest)
    assert clearance[0] == pytest.approx([0.1, 0.1]) and nearest.tolist() == [[1, 0]]


@pytest.mark.parametrize("pieces", PIECES, ids=["wedge+angle", "angle+roof", "angle", "three"])
def test_clearances_of_configurations(pieces: Pieces) -> None:
    rng = np.random.default_rng(1)
    hull = hull_of(pieces)
    pairs = np.array([(i, j) for j in range(7) for i in range(j)], dtype=np.int64)
    for _ in range(4):
        poses = forward_kinematics(TETRAHEDRON, rng.normal(0.0, 1.0, 6))
        positions = np.ascontiguousarray(1.2 * poses.positions)
        rotations = np.ascontiguousarray(poses.rotations)
        expected = separations(pieces, positions, rotations)
        least, i, j = least_separation(positions, rotations, pairs, hull, SIZE, 0.5)
        assert least == pytest.approx(min(expected.min(), 0.5))
        assert expected[i, j] == pytest.approx(least)
        clearance = np.empty((1, 7), dtype=np.float32)
        nearest = np.empty((1, 7), dtype=np.int32)
        solid = Solid(hull, SIZE, 0.1 if all(len(piece) == 1 for piece in pieces) else 0.0)
        module_clearances(positions[None], rotations[None], solid, 1, 0.5, clearance, nearest)
        assert clearance[0] == pytest.approx(np.minimum(expected.min(axis=0), 0.5), abs=1e-6)


def shape_of(hull: Hull, hinges: int) -> Shape:
    """Return a chain with the joints of tetrahedra and other hulls, without windows."""
    core = np.zeros((hinges + 1, BODY_COLUMNS))
    core[:, 3:12] = np.eye(3).ravel()
    nothing = np.zeros(0, dtype=np.int64)
    return Shape(
        joint=TETRAHEDRON.joint,
        hull=hull,
        size=SIZE,
        min_checked_gap=2,
        root=hinges // 2,
        folded_rad=np.zeros(hinges),
        core=core,
        boxes=np.zeros((0, 6)),
        origin=np.zeros(3),
        width=1.0,
        cells=nothing,
        starts=nothing,
        members=nothing,
        tail_positions=np.zeros((0, 3)),
        tail_rotations=np.zeros((0, 3, 3)),
        tolerance=Tolerance(0.0, 0.0, 0.0, 0.0),
    )


@pytest.mark.parametrize("pieces", [PIECES[0], PIECES[3]], ids=["wedge+angle", "three"])
def test_sweep_proves_no_more_than_samples_show(pieces: Pieces) -> None:
    # The parts of a pair are separated along different axes, and each loses along its own.
    hull = hull_of(pieces)
    verdicts: list[bool] = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        start = rng.normal(0.0, 1.3, 5)
        step = rng.uniform(-0.4, 0.4, len(start))
        angles = Angles(
            first=np.zeros(2, dtype=np.int64),
            offsets=np.arange(3) * len(start),
            shift=0,
            values=np.concatenate([start, start + step]),
        )
        shape = shape_of(hull, len(start))
        per_frame = np.empty(2)
        result = sweep_frames(shape, angles, 0, 2, 0.5, np.full(2, np.inf), per_frame, 0.9)
        least = 0.5
        for s in np.linspace(0.0, 1.0, 11):
            poses = forward_kinematics(TETRAHEDRON, start + s * step)
            table = separations(pieces, poses.positions, poses.rotations)
            least = min(least, table[np.triu_indices(len(table), 2)].min())
            if s in (0.0, 1.0):
                apart = np.where(np.tri(len(table), k=1, dtype=bool), np.inf, table)
                assert per_frame[int(s)] == pytest.approx(min(0.5, apart.min()), abs=1e-9)
        proved = result.unproved_at < 0.0
        verdicts.append(proved)
        if proved:
            assert 0.0 < result.lower_bound <= least + 1e-9
            assert result.clearance >= result.lower_bound
        assert proved == (least > 1e-3)
    assert True in verdicts and False in verdicts


def test_blamed_hinges_lie_between_modules_that_are_close() -> None:
    rng = np.random.default_rng(3)
    pieces, margin = PIECES[0], 0.02
    angles = rng.normal(0.0, 1.0, (8, 5))
    blamed = np.zeros(angles.shape, dtype=bool)
    joint = TETRAHEDRON.joint
    count = mark_blamed_hinges(angles, joint, hull_of(pieces), 2, SIZE, margin, blamed)
    expected = np.zeros_like(blamed)
    for k, row in enumerate(angles):
        poses = forward_kinematics(TETRAHEDRON, row)
        table = separations(pieces, poses.positions, poses.rotations)
        for i, j in np.argwhere(table < margin):
            expected[k, i:j] |= j - i >= 2
    assert np.array_equal(blamed, expected)
    assert count == expected.any(axis=1).sum() and 0 < count < len(angles)


def test_contacts_of_modules_are_those_of_their_parts() -> None:
    solid = solid_of(BRACKETS, 1.0)
    rotations = np.stack([np.eye(3)] * 2)
    touching: set[int] = set()
    for gap in ([0.0, 0.0, 0.41], [0.0, 0.62, 0.0], [0.72, 0.1, 0.02], [0.0, 0.0, -0.4]):
        positions = np.array([[0.0, 0.0, 0.0], gap])
        contacts = contact_points(positions, rotations, solid, 1, -1.0, 0.03)
        expected: list[Array] = []
        for q in (1, 2):
            alone = solid._replace(pieces=np.array([[0, 1], [q, q + 1]]))
            of_parts = contact_points(positions, rotations, alone, 1, -1.0, 0.03)
            expected.extend(np.column_stack([of_parts.points, of_parts.normals, of_parts.gaps]))
            touching.add(q if len(of_parts.points) else 0)
        assert np.column_stack([contacts.points, contacts.normals, contacts.gaps]) == pytest.approx(
            np.array(expected).reshape(-1, 7)
        )
        assert len(set(contacts.feature.tolist())) == len(contacts.feature)
    assert touching == {0, 1, 2}


def test_corners_of_all_parts_touch_the_floor() -> None:
    solid = solid_of(BRACKETS, 1.0)
    positions = np.array([[0.0, 0.0, 0.2], [3.0, 0.0, 0.2]])
    contacts = contact_points(positions, np.stack([np.eye(3)] * 2), solid, 1, 0.02, 0.0)
    lowest = [piece.corners[:, 2] < -0.19 for piece in BRACKETS.pieces]
    assert contacts.first.tolist() == [0] * int(lowest[0].sum()) + [1] * int(lowest[1].sum())
    assert contacts.feature.tolist() == [*np.flatnonzero(lowest[0]), *np.flatnonzero(lowest[1])]
