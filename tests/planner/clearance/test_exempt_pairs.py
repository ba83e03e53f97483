import copy

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_file import read_module
from foldback.planner.clearance.exempt_pairs import exempt_pairs
from foldback.planner.clearance.relief import near_faces, reach, relief_radius, relief_share
from foldback.planner.core import pair_separation
from foldback.planner.exports.mjcf import mjcf
from tests.planner.brackets import BRACKETS
from tests.planner.chains import anchored, coil, line, unvalidated


@pytest.mark.slow
def test_relieved_cubes_do_not_overlap_anywhere_in_the_joint_range() -> None:
    size = 0.9
    side = np.linspace(-0.5, 0.5, 17) * size
    points = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    radius = relief_radius(CUBE, size)
    assert radius is not None
    points = points[reach(CUBE, points) <= radius]
    angles = np.linspace(-CUBE.largest_angle_rad, CUBE.largest_angle_rad, 33)
    z, y = (values.ravel() for values in np.meshgrid(angles, angles))
    for rotation in Rotation.from_euler("ZY", np.stack([z, y], axis=-1)).as_matrix():
        seen_points = points @ rotation - CUBE.joint.offset[0]  # the next cube has no relief
        assert not (np.abs(seen_points) < 0.5 * size - 1e-9).all(axis=1).any()


def test_overlap_of_a_quarter_turn() -> None:
    chain = line(3)
    plan = np.stack([np.linspace(0.0, np.pi / 2, 91), np.zeros(91)], axis=1)
    exempt = exempt_pairs(chain, [plan], module_size=0.95)
    assert exempt.worst_overlap == pytest.approx(0.95 / np.sqrt(2.0) - 0.525, abs=1e-4)
    assert exempt.worst_overlap_bound == pytest.approx(exempt.worst_overlap, abs=1e-3)
    assert exempt.worst_overlap_at.frame == pytest.approx(45.0, abs=1.0)
    # Between two frames the overlap is deeper than at both, but within the bound.
    coarse = exempt_pairs(chain, [np.deg2rad([[5.0, 0.0], [85.0, 0.0]])], module_size=0.95)
    assert exempt.worst_overlap <= coarse.worst_overlap_bound + 1e-9


def test_worst_overlap_of_windows_and_frames_is_the_same() -> None:
    chain = coil(16)
    share = np.linspace(0.0, 1.0, 30)[:, None]
    angles = np.float32(chain.folded_rad) * np.clip(5.0 * share - np.arange(28) / 7.0, 0.0, 1.0)
    angles = np.concatenate([angles, chain.folded_rad[None]])[::-1].astype(np.float64)
    windows = exempt_pairs(chain, [anchored("explosion", angles).windowed(chain)], module_size=0.95)
    exempt_at_rest = exempt_pairs(chain, [angles], module_size=0.95)
    assert windows.worst_overlap == pytest.approx(exempt_at_rest.worst_overlap, abs=1e-6) != 0.0
    assert windows.worst_overlap_at == exempt_at_rest.worst_overlap_at


def test_worst_overlap_of_a_motion_is_that_of_its_worst_interval() -> None:
    # An interval by itself has no earlier frame from which a look could be skipped.
    random = np.random.default_rng(3)
    chain = line(12)
    angles = np.cumsum(random.normal(0.0, 0.05, (200, len(chain.folded_rad))), axis=0)
    angles = np.clip(angles, -np.pi / 2, np.pi / 2)
    whole = exempt_pairs(chain, [angles], module_size=0.95)
    intervals = [exempt_pairs(chain, [angles[k : k + 2]], module_size=0.95) for k in range(199)]
    assert whole.worst_overlap == max(at.worst_overlap for at in intervals) > 0.0
    assert whole.worst_overlap_bound == max(at.worst_overlap_bound for at in intervals)


def test_relief_of_hinges_is_the_reach_over_their_range() -> None:
    # The ranges differ from one end to the other, and the next module lies aside of the hinge.
    document = copy.deepcopy(BRACKETS.document)
    for piece in document["pieces"]:
        piece["joint"] = {
            "kind": "hinge",
            "hinges": [{"axis": [0, 0.6, 0.8], "range_deg": [-20, 70]}],
        }
    module = read_module(document | {"linked_overlap": True})
    points = np.random.default_rng(4).normal(0.0, 0.3, (50, 3))
    angles = np.deg2rad(np.linspace(-20.0, 70.0, 181))
    for row in range(2):
        before = int(module.joint_holders[row])
        link = module.link(before)
        turned = Rotation.from_rotvec(np.outer(angles, link.axes[0])).as_matrix()
        ways = turned @ (link.turn @ link.offset) / np.linalg.norm(link.offset)
        sampled = ((points - link.anchor) @ ways.T).max(axis=1)
        assert reach(module, points, row) == pytest.approx(sampled, abs=1e-4)
        corners = module.piece(before + 1).corners
        along = -link.offset / np.linalg.norm(link.offset)
        nearest = (0.9 * corners - (-link.offset)) @ -along
        assert near_faces(module, 0.9)[row] == pytest.approx(nearest.min())
    assert relief_radius(module, 0.9) == near_faces(module, 0.9).min() > 0.0
    assert 0.0 < relief_share(module, 0.9) < 1.0


def test_deepest_overlap_of_brackets_is_that_of_their_parts() -> None:
    module = read_module(BRACKETS.document | {"linked_overlap": True})
    motion = np.linspace(np.zeros(4), np.array([-1.5, 0.4, -1.2, 0.3]), 40)
    chain = unvalidated(module, motion[-1])
    exempt = exempt_pairs(chain, [motion], module_size=0.95)
    depth = 0.0
    for angles in motion:
        poses = forward_kinematics(module, angles)
        for i in range(4):
            gap, turns = poses.positions[i + 1] - poses.positions[i], poses.rotations[i : i + 2]
            apart = pair_separation(gap, *turns, module.hull, 0.95, np.inf, i, i + 1)
            depth = max(depth, -apart)
    assert depth > 0.05
    assert exempt.worst_overlap == pytest.approx(depth, abs=2e-3)
    assert depth <= exempt.worst_overlap + 1e-9 <= exempt.worst_overlap_bound + 2e-9


def test_tetrahedra_have_no_exempt_pairs() -> None:
    chain = Chain.from_angles(TETRAHEDRON, np.zeros(4))
    exempt = exempt_pairs(chain, [np.zeros((2, 4))], module_size=0.95)
    assert (exempt.rule, exempt.count, exempt.worst_overlap_bound) == ("none", 0, 0.0)
    assert (exempt.relief_radius, exempt.relief_share) == (None, 0.0)
    exempt = exempt_pairs(line(4), (), module_size=0.95)  # at an instant between frames
    assert exempt.count and exempt.relief_radius is not None
    assert (exempt.worst_overlap, exempt.worst_overlap_bound, exempt.worst_overlap_at) == (
        None,
    ) * 3


@pytest.mark.parametrize(("module", "count"), [(CUBE, 9), (CUBE, 801), (TETRAHEDRON, 12)])
def test_exported_model_excludes_exactly_the_exempt_pairs(module: Module, count: int) -> None:
    row = Chain.from_angles(module, np.zeros(len(module.joint_names(count))))
    model = mujoco.MjModel.from_xml_string(mjcf(row, module_size=0.95))
    excluded = {
        tuple(sorted(int(model.body(b).name.split("_")[1]) for b in (key >> 16, key & 0xFFFF)))
        for key in model.exclude_signature.tolist()
    }
    assert excluded == set(module.exempt_pairs(count))
    assert len(excluded) == model.nexclude == exempt_pairs(row, (), module_size=0.95).count
