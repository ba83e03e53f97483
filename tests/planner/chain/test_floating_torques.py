import mujoco
import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.cantilever_statics import static_torque
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.floating_torques import (
    floating_torques,
    path_torques,
    spline_derivatives,
)
from foldback.planner.simulation.mujoco_models import Material, tree_spec
from foldback.planner.simulation.mujoco_tree import Tree
from tests.planner.brackets import BRACKETS
from tests.planner.chains import coil, line, random_angles, unvalidated


def tetrahedra(modules: int) -> Chain:
    return Chain.from_angles(TETRAHEDRON, np.zeros(modules - 1), name="line")


@pytest.mark.parametrize(
    "chain",
    [coil(9), tetrahedra(8), unvalidated(BRACKETS, np.zeros(8))],
    ids=["cubes", "tetrahedra", "brackets"],
)
def test_torques_agree_with_the_simulated_tree(chain: Chain) -> None:
    tree = Tree(chain, Material(), step_s=0.01)
    rng = np.random.default_rng(3)
    angles = np.stack([random_angles(chain, rng) for _ in range(4)])
    rates, accelerations = rng.normal(size=(2, *angles.shape))
    computed_floating_torques = floating_torques(chain.module, angles, rates, accelerations)
    for k in range(len(angles)):
        tree.evaluate(angles[k], rates[k])
        np.testing.assert_allclose(
            computed_floating_torques[k], tree.torques_for(accelerations[k]), atol=1e-10
        )


def test_torques_of_a_configuration_do_not_depend_on_others_beside_it() -> None:
    chain = coil(9)
    rng = np.random.default_rng(4)
    angles, rates, accelerations = rng.normal(size=(3, 7, len(chain.folded_rad)))
    torques = floating_torques(chain.module, angles, rates, accelerations)
    for k in range(len(angles)):
        motion = (array[k : k + 1] for array in (angles, rates, accelerations))
        np.testing.assert_array_equal(floating_torques(chain.module, *motion)[0], torques[k])


def test_torques_along_a_path_have_terms_of_acceleration_and_of_speed() -> None:
    chain = coil(9)
    rng = np.random.default_rng(5)
    angles, first, second = rng.normal(size=(3, 7, len(chain.folded_rad)))
    a, b = path_torques(chain.module, angles, first, second)
    rate, acceleration = 0.7, -0.3
    expected = floating_torques(
        chain.module, angles, rate * first, acceleration * first + rate**2 * second
    )
    np.testing.assert_allclose(acceleration * a + rate**2 * b, expected, atol=1e-12)


def test_rates_and_accelerations_of_a_known_motion() -> None:
    times = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.03, 200))
    times -= times[0]
    angles = np.stack([1.0 - np.cos(times), times**3], axis=1)
    at = np.array([0, 50, 150])
    rates, accelerations = spline_derivatives(times, angles, at, from_rest=True)
    time = times[at]
    np.testing.assert_allclose(rates, np.stack([np.sin(time), 3 * time**2], 1), atol=1e-5)
    np.testing.assert_allclose(accelerations, np.stack([np.cos(time), 6 * time], 1), atol=2e-3)


def test_frames_that_are_not_finite_or_too_few_have_no_torques() -> None:
    chain = coil(9)
    angles = np.tile(chain.folded_rad, (3, 1))
    rates = np.zeros_like(angles)
    rates[1, 2] = np.nan
    computed_floating_torques = floating_torques(chain.module, angles, rates, np.zeros_like(angles))
    assert np.isnan(computed_floating_torques[1]).any()
    np.testing.assert_allclose(computed_floating_torques[[0, 2]], 0.0, atol=1e-12)
    few_spline_derivatives = spline_derivatives(
        np.array([0.0, 1, 1, 2]), np.zeros((4, 3)), np.arange(4), from_rest=True
    )
    assert np.isnan(few_spline_derivatives).all()


@pytest.mark.parametrize(
    "chain", [line(5), line(14), unvalidated(BRACKETS, np.zeros(8))], ids=["5", "14", "brackets"]
)
def test_torque_in_the_worst_direction_agrees_with_mujoco(chain: Chain) -> None:
    # Torques are linear in gravity, so that three directions suffice.
    rng = np.random.default_rng(len(chain))
    model = tree_spec(chain, Material(geom_size=0.1)).compile()
    data = mujoco.MjData(model)
    dofs = [int(model.joint(name).dofadr[0]) for name in chain.joint_names]
    for _ in range(60):
        angles = random_angles(chain, rng)
        for name, angle in zip(chain.joint_names, angles, strict=True):
            data.joint(name).qpos[0] = angle
        torques = np.empty((3, len(dofs)))
        for axis in range(3):
            model.opt.gravity[:] = np.eye(3)[axis]
            mujoco.mj_forward(model, data)
            torques[axis] = data.qfrc_bias[dofs]
        worst = float(np.linalg.norm(torques, axis=0).max())
        assert static_torque(chain, angles) == pytest.approx(worst, rel=1e-9)
