"""Window of a peeling: it moves like one MuJoCo tree with the same boxes and tail."""

from itertools import product
from typing import Any

import mujoco
import numpy as np

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.core.structures import Loads
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.fixed_base_window import FixedBaseWindow
from foldback.planner.simulation.mujoco_models import (
    Material,
    add_module_geoms,
    add_next_body,
    base_spec,
    exclude,
    set_inertia,
)
from foldback.planner.simulation.reduced_state import State
from tests.planner.chains import Array, line

MATERIAL = Material(
    geom_size=0.98, stiffness=2.0, armature=3.0, stops_early_rad=CUBE.largest_angle_rad - 1.6
)
MAX_ROD_MASS = 4
BOX = (np.array([[0.0, 0.0, 0.0]]), np.array([[0.5, 0.5, 0.5]]))
FAR_BOX = (np.array([[0.0, 0.0, -50.0]]), np.array([[0.5, 0.5, 0.5]]))


def random_state(chain: Chain, seed: int, maximum: float = 0.4) -> State:
    rng = np.random.default_rng(seed)
    state = State.at_rest(
        rng.uniform(-maximum, maximum, len(chain.folded_rad)), np.zeros(3), np.eye(3)
    )
    state.rates = 0.3 * rng.normal(size=len(state.angles))
    return state


def add_box(body: Any, centre: Array, half: Array) -> None:
    geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX)
    geom.pos, geom.size = centre.tolist(), half.tolist()
    geom.mass, geom.condim = 0.0, 1
    geom.solref = [MATERIAL.contact_time_constant, 1.0]
    geom.solimp = [0.95, 0.99, 0.005, 0.5, 2.0]


def tree_of(chain: Chain, rod: int, boxes: tuple[Array, Array]) -> tuple[Any, Any]:
    """Return one MuJoCo tree that is fixed at module 0, with a rod as a body of its own."""
    spec = base_spec()
    names = [f"module_{i}" for i in range(len(chain))]
    body = spec.worldbody.add_body()
    body.name = names[0]
    set_inertia(body, chain, 0, 1.0)
    for i in range(1, len(chain)):
        body = add_next_body(body, chain, i, names[i], MATERIAL)
        set_inertia(body, chain, i, 1.0)
        add_module_geoms(body, chain.module, i, MATERIAL)
    for centre, half in zip(*boxes, strict=True):
        add_box(spec.worldbody, centre, half - 0.01)
    if rod:
        end = body.add_body()
        end.name = "rod"
        mass = float(min(rod, MAX_ROD_MASS))
        end.explicitinertial, end.mass = True, mass
        end.pos, end.ipos = [0.5, 0.0, 0.0], [0.5 * mass, 0.0, 0.0]
        end.inertia = [mass / 6.0, *[mass * (1.0 + mass**2) / 12.0] * 2]
        add_box(end, np.array([0.5 * rod, 0.0, 0.0]), np.array([0.5 * rod - 0.01, 0.49, 0.49]))
    exclude(spec, names, [(i, i + 1) for i in range(len(chain) - 1)])
    model: Any = spec.compile()
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
    model.opt.iterations, model.opt.tolerance = 100, 1e-12
    return model, mujoco.MjData(model)


def accelerate(
    window: FixedBaseWindow, finder: ContactFinder, state: State, forces: Array, torque: Array
) -> tuple[Array, int]:
    """Return hinge accelerations of a window, and the number of its contacts."""
    window.place(state)
    torques = -window.stiffness * state.angles
    contacts = finder.find(window.positions, window.rotations)
    loads = Loads(torques, window.rotor_inertias, forces, torque)
    qdd = window.constrained(state, loads, contacts).qdd
    return qdd, 0 if contacts is None else len(contacts.points.depths)


def simulate(
    chain: Chain, state: State, rod: int, boxes: tuple[Array, Array] = FAR_BOX
) -> tuple[Array, Array, int, int]:
    """Return hinge accelerations of the window and of the tree, and their contact counts."""
    rng = np.random.default_rng(7)
    forces, torque = rng.normal(size=(len(chain), 3)), rng.normal(size=3)
    finder = ContactFinder(chain, MATERIAL)
    finder.set_boxes(*boxes)
    window = FixedBaseWindow(chain, MATERIAL, finder, rod=rod, heaviest_rod=MAX_ROD_MASS)
    qdd, contacts = accelerate(window, finder, state, forces, torque)
    model, data = tree_of(chain, rod, boxes)
    for name, angle, rate in zip(chain.joint_names, state.angles, state.rates, strict=True):
        data.joint(name).qpos[0], data.joint(name).qvel[0] = angle, rate
    for i in range(len(chain)):
        data.body(f"module_{i}").xfrc_applied[:3] = forces[i]
    data.body(f"module_{len(chain) - 1}").xfrc_applied[3:] = torque
    mujoco.mj_forward(model, data)
    dofs = [model.joint(name).dofadr[0] for name in chain.joint_names]
    return qdd, data.qacc[dofs], contacts, int(data.ncon)


def test_window_without_contacts_moves_as_one_tree() -> None:
    for modules, rod in product((4, 30), (0, 3, 200)):
        chain = line(modules)
        own_state, reference_state, contacts, other_outputs = simulate(
            chain, random_state(chain, rod, 0.15), rod
        )
        assert contacts == other_outputs == 0
        np.testing.assert_allclose(
            own_state, reference_state, atol=1e-9 * np.abs(reference_state).max()
        )


def test_window_in_contact_with_boxes_itself_and_its_rod_moves_as_one_tree() -> None:
    chain = line(14)
    contact_modules = set[int]()
    for seed in range(10):
        state = random_state(chain, seed, 1.5)
        state.rates *= 0.0
        own_state, reference_state, contacts, other_outputs = simulate(chain, state, 6, BOX)
        assert contacts == other_outputs
        contact_modules.add(contacts)
        np.testing.assert_allclose(
            own_state, reference_state, atol=1e-4 * np.abs(reference_state).max()
        )
    assert len(contact_modules) > 2


def test_contact_finder_serves_wider_windows_and_other_rods() -> None:
    small, large = line(5), line(60)
    shared = ContactFinder(small, MATERIAL)
    for chain, rod in ((small, 40), (large, 7), (small, 0)):
        state = random_state(chain, 1, 1.2)
        accelerations: list[tuple[Array, int]] = []
        for finder in (shared, ContactFinder(chain, MATERIAL)):
            finder.set_boxes(*BOX)
            window = FixedBaseWindow(chain, MATERIAL, finder, rod=rod, heaviest_rod=MAX_ROD_MASS)
            forces = np.zeros((len(chain), 3))
            accelerations.append(accelerate(window, finder, state, forces, np.zeros(3)))
        assert accelerations[0][1] == accelerations[1][1]
        np.testing.assert_allclose(accelerations[0][0], accelerations[1][0], rtol=1e-9, atol=1e-9)


def test_boxes_are_moved_resized_added_and_removed() -> None:
    chain = line(5)
    finder = ContactFinder(chain, MATERIAL)
    state = random_state(chain, 0, 0.0)

    def cubes(*centres: tuple[float, float, float]) -> tuple[Array, Array]:
        return np.array(centres), np.full((len(centres), 3), 0.5)

    many_values = [(100.0 + i, 0.0, 0.0) for i in range(80)]
    cases = [
        (FAR_BOX, 0),
        (cubes((4.9, 0.0, 0.0)), 4),
        (cubes((6.0, 0.0, 0.0)), 0),
        ((np.array([[6.0, 0.0, 0.0]]), np.array([[1.6, 0.5, 0.5]])), 4),
        (cubes((4.0, 9.0, 0.0), (4.0, 0.9, 0.0)), 4),
        (cubes((4.0, 9.0, 0.0)), 0),
        (cubes((4.9, 0.0, 0.0), *many_values), 4),
        (cubes(*many_values), 0),
    ]
    for boxes, contacts in cases:
        finder.set_boxes(*boxes)
        window = FixedBaseWindow(chain, MATERIAL, finder, rod=0, heaviest_rod=MAX_ROD_MASS)
        window.place(state)
        found_contacts = finder.find(window.positions, window.rotations)
        assert (0 if found_contacts is None else len(found_contacts.points.depths)) == contacts


def test_long_rod_touches_no_unused_cube() -> None:
    """Unused cubes once lay along a line from 20 000 pitches on, where a long rod touched them."""
    small, large = line(5), line(60)
    finder = ContactFinder(small, MATERIAL)
    finder.set_boxes(*FAR_BOX)
    FixedBaseWindow(large, MATERIAL, finder, rod=0, heaviest_rod=MAX_ROD_MASS)
    window = FixedBaseWindow(small, MATERIAL, finder, rod=500_000, heaviest_rod=MAX_ROD_MASS)
    for rotation in (np.eye(3), np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])):
        window.place(State.at_rest(np.zeros(len(small.folded_rad)), np.zeros(3), rotation))
        assert finder.find(window.positions, window.rotations) is None
