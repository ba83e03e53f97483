from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.errors import SimulationError
from foldback.planner.simulation.mujoco_models import Material, tree_spec
from foldback.planner.simulation.reduced_state import Acceleration, State
from foldback.planner.simulation.segments import Segments
from tests.case import case
from tests.planner.chains import Array, coil, folded_state, line, near_pairs_of, random_state
from tests.planner.explosion import chain_reference
from tests.planner.mujoco_tree import accelerate, solve_exactly

MATERIAL = Material(geom_size=0.5, stiffness=3.0, armature=10.0)


def tree_acceleration(
    chain: Chain, material: Material, state: State, forces: Array, held_hinges: Sequence[int] = ()
) -> Acceleration:
    """Return the acceleration of one MuJoCo tree, with some hinges locked by a huge inertia."""
    model: Any = tree_spec(chain, material).compile()
    for hinge in held_hinges:
        model.dof_armature[model.joint(chain.joint_names[hinge]).dofadr[0]] = 1e12
    return accelerate(solve_exactly(model), chain, state, forces=forces)


def difference(a: Acceleration, b: Acceleration) -> float:
    joined = np.concatenate([a.hinges, a.linear, a.angular])
    other_joined = np.concatenate([b.hinges, b.linear, b.angular])
    return float(np.linalg.norm(joined - other_joined) / np.linalg.norm(other_joined))


@pytest.mark.parametrize("modules", [3, 4, 17, 18, 40])
def test_accelerations_are_those_of_the_whole_tree_wherever_it_is_cut(modules: int) -> None:
    chain = line(modules)
    segments = Segments(chain, MATERIAL, **({"segment_modules": 5} if modules == 40 else {}))
    for seed in range(3):
        state = random_state(chain, seed)
        forces = np.random.default_rng(seed).normal(size=(modules, 3))
        segments.place(state)
        acceleration = segments.accelerations(state, forces)
        other_acceleration = tree_acceleration(chain, MATERIAL, state, forces)
        assert other_acceleration.contacts == acceleration.contacts == 0
        assert difference(acceleration, other_acceleration) < 2e-3


def test_contact_forces_are_those_of_the_whole_tree() -> None:
    # Folded, slightly perturbed, and hardly smaller than their cells, the modules touch in many
    # places. In MuJoCo, contacts of lighter bodies are softer. Bodies of a segment are lighter than
    # those of a whole tree, which causes a difference of a few per cent.
    chain = coil(32)
    material = Material(geom_size=0.999, stiffness=3.0, armature=10.0)
    segments = Segments(chain, material)
    differences: list[float] = []
    for seed, (rate, spin) in enumerate(((0.0, 0.0), (0.05, 0.0), (0.0, 3.0)) * 2):
        rng = np.random.default_rng(seed)
        state = folded_state(chain)
        state.angles += rng.normal(size=len(state.angles)) * 0.001
        state.rates[:] = rng.normal(size=len(state.rates)) * rate
        state.spin[:] = rng.normal(size=3) * spin
        forces = rng.normal(size=(32, 3)) * 5.0
        segments.place(state)
        acceleration = segments.accelerations(state, forces)
        other_acceleration = tree_acceleration(chain, material, state, forces)
        assert acceleration.contacts == other_acceleration.contacts > 20
        assert 0.0 < acceleration.depth < 0.02
        differences.append(difference(acceleration, other_acceleration))
    assert np.mean(differences) < 0.06
    assert max(differences) < 0.15


def test_numbers_that_are_not_finite_raise() -> None:
    chain = line(12)
    segments = Segments(chain, MATERIAL)
    for bad, field in product((np.nan, np.inf, 1e200), ("angles", "rates", "position", "velocity")):
        state = random_state(chain, 0)
        getattr(state, field)[1] = bad
        with (
            case(f"{bad} in {field}"),
            np.errstate(all="ignore"),
            pytest.raises(SimulationError, match="finite"),
        ):
            segments.place(state)
            segments.accelerations(state, np.zeros((12, 3)))
    state = random_state(chain, 1)
    segments.place(state)
    with pytest.raises(SimulationError, match="finite"):
        segments.free_accelerations(state, np.full((12, 3), np.nan))


def test_chain_is_free_until_it_touches_or_a_hinge_is_at_its_stop() -> None:
    chain = coil(12)
    segments = Segments(chain, Material(geom_size=1.02))
    segments.stops = np.tile([-1.5, 1.5], (len(chain.folded_rad), 1))
    state = State.at_rest(0.0 * chain.folded_rad, np.zeros(3), np.eye(3))
    near = near_pairs_of(12)

    def is_free() -> bool:
        segments.place(state)
        return segments.is_free(state, near)

    assert is_free()
    state.angles[3] = 1.6
    assert not is_free()
    state.angles[:] = 0.95 * chain.folded_rad
    assert np.abs(state.angles).max() < 1.5
    assert not is_free()


@pytest.mark.parametrize("seed", range(2))
def test_contacts_push_a_chain_with_hinges_at_their_stops(seed: int) -> None:
    # If joint stops were applied after contacts, contacts would rely on hinges that cannot move.
    chain = coil(40)
    rng = np.random.default_rng(seed)
    state = State.at_rest(0.99 * chain.folded_rad, np.zeros(3), np.eye(3))
    state.angles += 0.01 * rng.normal(size=len(state.angles))
    forces = 3.0 * rng.normal(size=(40, 3))
    stop_rad = float(np.sort(np.abs(state.angles))[-8])
    stops = np.tile([-stop_rad, stop_rad], (len(state.angles), 1))
    state.stop_at(stops)
    outwards = np.sign(state.angles) * (np.abs(state.angles) >= stop_rad)
    assert (outwards != 0.0).sum() >= 8
    segments = Segments(chain, Material(geom_size=1.0, stiffness=3.0))
    segments.stops = stops
    segments.place(state)
    acceleration = chain_reference.accelerations(segments, state, forces)
    assert acceleration.contacts > 2
    assert (outwards * acceleration.hinges < 1e-6).all()
    indices = np.flatnonzero((outwards != 0.0) & (np.abs(acceleration.hinges) < 1e-6))
    assert 0 < len(indices) < (outwards != 0.0).sum()
    material = Material(geom_size=1.0, stiffness=3.0)
    tree = tree_acceleration(chain, material, state, forces, indices.tolist())
    assert difference(acceleration, tree) < 1e-6
    # No hinge is locked unnecessarily: each one alone would move beyond its stop.
    for hinge in indices.tolist():
        free_hinges = [free_hinge for free_hinge in indices.tolist() if free_hinge != hinge]
        freed = tree_acceleration(chain, material, state, forces, free_hinges)
        assert outwards[hinge] * freed.hinges[hinge] > 0.0


def test_method_for_many_contacts_agrees_with_the_exact_one() -> None:
    modules = 90
    # The iterative solver for many contacts approximates the forces of the exact one.
    chain = coil(modules)
    segments = Segments(chain, Material(geom_size=1.0, stiffness=3.0, armature=10.0))
    state = State.at_rest(0.99 * chain.folded_rad, np.zeros(3), np.eye(3))
    rng = np.random.default_rng(modules)
    state.angles += 0.01 * rng.normal(size=len(state.angles))
    segments.place(state)
    forces = 3.0 * rng.normal(size=(modules, 3))
    exact = chain_reference.accelerations(segments, state, forces)
    assert exact.contacts > 2
    free = segments.free_accelerations(state, forces)
    nearly = chain_reference.accelerations(segments, state, forces, max_direct=0)
    assert difference(free, exact) > 0.1
    # They differ, because the compliance of a contact is that of two unlinked modules.
    assert difference(nearly, exact) < 0.05
