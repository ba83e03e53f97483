from itertools import combinations, product

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.core import pair_separation
from foldback.planner.simulation.contact_finder import robot_contacts
from foldback.planner.simulation.reduced_state import turned
from tests.planner.chains import Array, line, random_rotation

UPRIGHT = np.eye(3)
ON_EDGE = turned(np.array([0.0, 0.0, np.pi / 4]))
# The diagonal of the cube is along x: a corner points at the other module.
ON_CORNER = turned(np.array([0.0, np.arctan(1 / np.sqrt(2)), 0.0])) @ ON_EDGE.T


def separation(
    gap: Array, first: Array, second: Array, *, size: float = 1.0, enough: float = 100.0
) -> float:
    return pair_separation(
        np.asarray(gap, dtype=np.float64), first, second, CUBE.hull, size, enough
    )


def test_separation_from_a_face() -> None:
    assert ON_CORNER @ np.array([1.0, 1.0, 1.0]) == pytest.approx([np.sqrt(3), 0.0, 0.0])
    for second, half, distances in (
        (UPRIGHT, 0.5, (1.5, 1.0001, 0.9)),
        (ON_EDGE, np.sqrt(0.5), (2.0, 1.3, 1.1)),
        (ON_CORNER, np.sqrt(0.75), (2.0, 1.5, 1.35)),
    ):
        for distance in distances:
            expected = distance - 0.5 - half
            assert separation([distance, 0.0, 0.0], UPRIGHT, second) == pytest.approx(expected)


def test_crossed_edges() -> None:
    # One has an edge along z, the other along y: only a cross product of edges separates them.
    # Which of their own axes these edges lie along makes no difference.
    for distance, first, second in product((2.0, 1.5, 1.4), range(3), range(3)):
        first_pose = ON_EDGE @ np.roll(UPRIGHT, first, axis=0)
        second_pose = turned(np.array([0.0, np.pi / 4, 0.0])) @ np.roll(UPRIGHT, second, axis=0)
        expected = distance - 2.0 * np.sqrt(0.5)
        assert separation([distance, 0.0, 0.0], first_pose, second_pose) == pytest.approx(expected)


def test_depth_of_one_in_the_other() -> None:
    assert separation([0.0, 0.0, 0.0], UPRIGHT, UPRIGHT) == pytest.approx(-1.0)
    assert separation([0.7, 0.0, 0.0], UPRIGHT, UPRIGHT, size=0.9) == pytest.approx(-0.2)


def two_boxes(size: float) -> mujoco.MjModel:
    body = '<body><freejoint/><geom type="box" size="{0} {0} {0}" mass="1"/></body>'
    boxes = 2 * body.format(0.5 * size)
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{boxes}</worldbody></mujoco>")


@given(st.integers(0, 2**32 - 1), st.floats(0.3, 1.8), st.floats(0.5, 1.0))
def test_separation_has_the_sign_of_mujocos_distance_and_is_never_larger(
    seed: int, distance: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    first, second = random_rotation(rng), random_rotation(rng)
    gap = rng.normal(size=3)
    gap *= distance / np.linalg.norm(gap)
    our_separation = separation(gap, first, second, size=size)
    model = two_boxes(size)
    data = mujoco.MjData(model)
    for k, (place, rotation) in enumerate(((np.zeros(3), first), (gap, second))):
        data.qpos[7 * k : 7 * k + 3] = place
        mujoco.mju_mat2Quat(data.qpos[7 * k + 3 : 7 * k + 7], rotation.ravel())
    mujoco.mj_kinematics(model, data)
    mujocos = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None)
    if our_separation > 1e-5:
        assert mujocos > 0.0
        assert our_separation <= mujocos + 1e-5
    elif our_separation < -1e-5:
        assert mujocos < 1e-5


@pytest.mark.parametrize(
    "chain", [line(16), Chain.from_angles(TETRAHEDRON, np.zeros(15))], ids=["cubes", "tetrahedra"]
)
def test_contacts_of_crowded_modules_are_those_of_mujocos_collision(chain: Chain) -> None:
    size, n = 0.95, len(chain)
    finder = robot_contacts(chain, geom_size=size, step_s=0.08)
    finder.allocate(n)
    count = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        positions = rng.uniform(0.0, 2.6, (n, 3))
        rotations = np.stack([random_rotation(rng) for _ in range(n)])
        contacts = finder.find(positions, rotations)
        assert contacts is not None
        depths = dict[tuple[int, int], float]()
        for modules, depth in zip(contacts.points.pairs, contacts.points.depths, strict=True):
            pair = tuple(sorted(modules.tolist()))
            depths[pair] = max(depth, depths.get(pair, 0.0))
        for i, j in combinations(range(n), 2):
            if j - i < 2:
                continue  # linked modules may overlap
            separation = pair_separation(
                positions[j] - positions[i], rotations[i], rotations[j], chain.module.hull, size, 9
            )
            if abs(separation) > 1e-6:
                assert (separation < 0.0) == ((i, j) in depths), (seed, i, j, separation)
            if -0.1 < separation < -1e-6:
                # MuJoCo prefers normals of faces, along which modules may be a little deeper.
                assert depths[i, j] == pytest.approx(-separation, abs=1e-3)
            count += separation < 0.0
    assert count > 500


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5))
def test_separation_beyond_enough_is_a_bound(seed: int, enough: float) -> None:
    rng = np.random.default_rng(seed)
    first, second, gap = random_rotation(rng), random_rotation(rng), rng.normal(size=3)
    whole_separation = separation(gap, first, second)
    early = separation(gap, first, second, enough=enough)
    if early < enough:
        assert early == whole_separation
    else:
        assert whole_separation >= enough
