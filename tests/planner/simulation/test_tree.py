import mujoco
import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.mujoco_tree import Servos, Tree
from tests.planner.chains import line, random_state

SOFT = Material(geom_size=0.3)


def moving_tree(chain: Chain, seed: int, step_s: float = 0.01) -> Tree:
    tree = Tree(chain, SOFT, step_s=step_s)
    state = random_state(chain, seed, maximum=0.8)
    tree.place(state.angles, state.position, wxyz_from_matrix(state.rotation))
    tree.data.qvel[:3], tree.data.qvel[3:6] = state.velocity, state.spin
    for name, rate in zip(chain.joint_names, state.rates, strict=True):
        tree.data.joint(name).qvel[0] = rate
    return tree


@pytest.mark.parametrize("modules", [3, 4, 24])
def test_torques_give_the_requested_accelerations(modules: int) -> None:
    chain = line(modules)
    tree = moving_tree(chain, modules)
    expected = np.random.default_rng(1).normal(size=len(chain.folded_rad))
    tree.begin_step()
    before = [tree.data.qacc.copy(), tree.data.qpos.copy(), tree.data.qvel.copy()]
    torques = tree.torques_for(expected)
    for own_acceleration, reference_acceleration in zip(
        before, (tree.data.qacc, tree.data.qpos, tree.data.qvel), strict=True
    ):
        np.testing.assert_array_equal(own_acceleration, reference_acceleration)
    tree.apply_torques(torques)
    mujoco.mj_forward(tree.model, tree.data)
    joint_names = np.array([tree.data.joint(name).qacc[0] for name in chain.joint_names])
    np.testing.assert_allclose(joint_names, expected, atol=1e-6)
    # No force acts on the root.
    np.testing.assert_array_equal(tree.data.qfrc_applied[:6], 0.0)


def test_torques_that_are_not_finite_raise() -> None:
    chain = line(6)
    tree = moving_tree(chain, 1)
    tree.begin_step()
    tree.apply_torques(np.full(len(chain.folded_rad), np.nan))
    with pytest.raises(SimulationError, match="finite"):
        tree.end_step()


def resting_tree(motors: Servos) -> Tree:
    tree = Tree(line(6), SOFT, step_s=0.01, motors=motors)
    tree.place(np.zeros(8), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return tree


def follow(tree: Tree, target: np.ndarray, steps: int) -> float:
    """Return the largest torque on the way to a target of servos."""
    largest = 0.0
    for _ in range(steps):
        tree.begin_step()
        tree.set_servo_targets(target)
        tree.end_step()
        largest = max(largest, float(np.abs(tree.motor_torques).max()))
    return largest


def test_servos_hold_their_target_within_their_torque() -> None:
    tree = resting_tree(Servos(stiffness=1e5, damping=1e4))
    target = np.linspace(-0.3, 0.3, 8)
    follow(tree, target, 800)
    np.testing.assert_allclose(tree.angles, target, atol=1e-3)
    for limit in (0.5, 20.0):
        tree = resting_tree(Servos(stiffness=1e4, damping=1e2, torque_limit=limit))
        assert follow(tree, np.full(8, 0.5), 50) == pytest.approx(limit)
