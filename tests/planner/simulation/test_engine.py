"""Engine of explosions: its accelerations equal those of one MuJoCo tree of the same bodies."""

from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.core.structures import Accelerations, Loads, Lumps
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.engine import Engine, build_chain_model
from foldback.planner.simulation.mujoco_models import Material, tree_spec
from foldback.planner.simulation.reduced_state import Acceleration, State
from tests.planner.brackets import BRACKETS
from tests.planner.chains import (
    Array,
    coil,
    line,
    random_rotation,
    random_state,
    unvalidated,
)
from tests.planner.mujoco_tree import accelerate, scale_masses, solve_exactly

CHAINS = {
    "cubes": coil(32),
    "line": line(60),
    "tetrahedra": Chain.from_angles(TETRAHEDRON, np.zeros(11)),
    "brackets": unvalidated(BRACKETS, np.zeros(10)),
}


def random_lumps(seed: int) -> Lumps:
    rng = np.random.default_rng(seed)
    axes = np.stack([random_rotation(rng) for _ in range(2)])
    moments = np.array([[900.0, 800.0, 500.0], [60.0, 40.0, 50.0]])
    return Lumps(np.array([30.0, 8.0]), rng.normal(size=(2, 3)), axes, moments)


def tree(chain: Chain, size: float, masses: Array, rotors: Array, lumps: Lumps) -> Any:
    """Return one MuJoCo tree that includes the composite bodies."""
    spec = tree_spec(chain, Material(geom_size=size))
    for end, module in enumerate((0, len(chain) - 1)):
        if lumps.masses[end]:
            body = spec.body(f"module_{module}").add_body()
            body.explicitinertial, body.mass = True, float(lumps.masses[end])
            body.ipos = lumps.centres[end].tolist()
            body.iquat = wxyz_from_matrix(lumps.axes[end]).tolist()
            body.inertia = lumps.moments[end].tolist()
    model: Any = spec.compile()
    scale_masses(model, masses)
    for name, rotor in zip(chain.joint_names, rotors, strict=True):
        model.dof_armature[model.joint(name).dofadr[0]] = rotor
    return solve_exactly(model)


def check_same(computed_accelerations: Accelerations, state: State, expected: Acceleration) -> None:
    """Compare accelerations; those of the engine's root are in the world, angular first."""
    root = [*(state.rotation @ expected.angular), *expected.linear]
    accelerations = np.array([*expected.hinges, *root])
    within = 1e-9 * np.abs(accelerations).max()
    np.testing.assert_allclose(
        [*computed_accelerations.qdd, *computed_accelerations.root], accelerations, atol=within
    )


@pytest.mark.parametrize("has_lumps", [False, True], ids=["modules", "lumps"])
@pytest.mark.parametrize("chain", CHAINS.values(), ids=CHAINS)
def test_engine_of_a_free_chain_moves_as_one_tree(chain: Chain, has_lumps: bool) -> None:
    rng = np.random.default_rng(len(chain))
    hinges = len(chain.folded_rad)
    masses = 1.0 + 0.2 * rng.normal(size=len(chain))
    rotors = rng.uniform(0.0, 1e4, hinges) * rng.integers(0, 2, hinges)
    torques = 20.0 * has_lumps * rng.normal(size=hinges)
    lumps = random_lumps(3) if has_lumps else Lumps.none()
    weights = masses * chain.module.masses(len(chain))
    model = build_chain_model(chain, root=chain.root, masses=weights, lumps=lumps)
    engine = Engine(model, chain.stops_rad())
    mj_model = tree(chain, 0.02, masses, rotors, lumps)
    loads = Loads(torques, rotors, np.zeros((len(chain), 3)), np.zeros(3))
    state = random_state(chain, 7, maximum=1.2)
    for _ in range(3):
        engine.place(state)
        accelerations = engine.constrained(state, loads, None)
        expected = accelerate(mj_model, chain, state, torques=torques)
        assert expected.contacts == 0
        check_same(accelerations, state, expected)
        state.rates += 1e-3 * accelerations.qdd
        state.advance(1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_engine_in_contact_moves_as_one_tree(seed: int) -> None:
    chain = coil(32)
    rng = np.random.default_rng(seed)
    hinges = len(chain.folded_rad)
    masses = 1.0 + 0.1 * rng.normal(size=len(chain))
    rotors, torques = np.full(hinges, 500.0), 50.0 * rng.normal(size=hinges)
    state = State.at_rest(0.99 * chain.folded_rad, np.zeros(3), random_rotation(rng))
    state.angles += 0.01 * rng.normal(size=hinges)
    state.rates[:] = 0.05 * rng.normal(size=hinges)
    engine = Engine(build_chain_model(chain, root=chain.root, masses=masses), chain.stops_rad())
    engine.place(state)
    finder = ContactFinder(chain, Material(geom_size=1.0))
    finder.allocate(len(chain))
    contacts = finder.find(engine.positions, engine.rotations)
    loads = Loads(torques, rotors, np.zeros((len(chain), 3)), np.zeros(3))
    accelerations = engine.constrained(state, loads, contacts)
    mj_model = tree(chain, 1.0, masses, rotors, Lumps.none())
    expected = accelerate(mj_model, chain, state, torques=torques)
    assert expected.contacts == len(contacts.points.depths) > 2
    check_same(accelerations, state, expected)
