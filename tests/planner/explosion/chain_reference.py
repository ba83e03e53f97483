"""Steps of our engine's explosion in plain NumPy, to compare the compiled loop with."""

import numpy as np

from foldback.planner.core.structures import MAX_DIRECT_CONTACTS, ContactModel, DetectedContacts
from foldback.planner.explosion.loop.checkpoint import PULSE_STEPS
from foldback.planner.explosion.simultaneous import Simultaneous
from foldback.planner.simulation.mujoco_models import SOLIMP
from foldback.planner.simulation.reduced_state import Acceleration, State
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import Array

CONTACT_MODEL = ContactModel(0.03, 1.0, np.array(SOLIMP))


def accelerations(
    segments: Segments, state: State, forces: Array, *, max_direct: int = MAX_DIRECT_CONTACTS
) -> Acceleration:
    """Return the acceleration of a placed state under its contacts and stops."""
    points = segments.find_placed(state)
    model = CONTACT_MODEL._replace(max_direct=max_direct)
    contacts = None if points is None else DetectedContacts(points, model)
    return segments.contact_accelerations(state, forces, contacts)


def step(run: Simultaneous) -> None:
    """Make one step of a run that neither restarts nor creeps."""
    world, control, state, p = run.world, run.control, run.world.state, run.world.parameters
    engine = world.engine
    assert isinstance(engine, Segments)
    engine.place(state)
    control.steps += 1
    weak = run.pulses.remaining_steps > PULSE_STEPS[1] - PULSE_STEPS[0]
    run.pulses.remaining_steps = max(0, run.pulses.remaining_steps - 1)
    forces = radial_forces(engine.positions, world.forces.weights)
    forces *= p.tension * p.spring * control.tension * (0.05 if weak else 1.0)
    bent = np.abs(state.angles).sum() / np.abs(world.chain.folded_rad).sum()
    span = np.linalg.norm(engine.positions[-1] - engine.positions[0]) / (len(world.chain) - 1)
    looseness = np.clip((0.5 * (1.0 - bent) + 0.5 * span - 0.05) / 0.2, 0.0, 1.0)
    push = p.repulsion_gain * (1.0 + (p.loose_repulsion - 1.0) * looseness)
    forces += (4.0 if weak else 1.0) * push * repulsion(engine.positions, p.repulsion_cutoff)
    points = engine.find_placed(state)
    count, depth, contacts = 0, 0.0, None
    if points is not None:
        count, depth = len(points.depths), float(points.depths.max())
        model = CONTACT_MODEL._replace(time_constant=max(2.0 * control.step_s, 0.03))
        contacts = DetectedContacts(points, model)
    acceleration = engine.contact_accelerations(state, forces, contacts)
    control.depth = depth
    deep = depth > control.allowed.back_off
    control.tension = max(0.05, 0.85 * control.tension) if deep else min(1, 1.02 * control.tension)
    state.accelerate(acceleration, control.step_s, control.drag)
    limit_speeds(run, engine, count)
    state.advance(control.step_s)
    world.time_s += control.step_s
    state.stop_at(engine.stops)


def radial_forces(positions: Array, weights: Array) -> Array:
    """Return (n, 3) forces of equation 1, whose largest sum along the chain is 1."""
    forces = weights[:, None] * (positions - positions.mean(axis=0))
    forces -= forces.mean(axis=0)
    return forces / np.linalg.norm(np.cumsum(forces, axis=0), axis=1).max()


def repulsion(positions: Array, cutoff: float) -> Array:
    """Return (n, 3) forces of equation 3 with gain 1, between modules that are not linked."""
    gaps = positions[:, None] - positions[None]
    distances = np.linalg.norm(gaps, axis=-1)
    order = np.arange(len(positions))
    near = (np.abs(order[:, None] - order) > 1) & (distances < cutoff)
    scale = np.zeros_like(distances)
    scale[near] = distances[near] ** -3
    return (scale[:, :, None] * gaps).sum(axis=1)


def limit_speeds(run: Simultaneous, engine: Segments, contacts: int) -> None:
    """Scale velocities to what a step allows, and adapt step and drag."""
    control, state, p = run.control, run.world.state, run.world.parameters
    engine.place(state)  # the positions are the same, the velocities are not
    excess = control.step_s * max(
        np.abs(state.rates).max() / p.joint_cap_rad,
        np.linalg.norm(engine.velocities, axis=1).max() / p.body_cap,
        pair_limit(run, engine),
    )
    control.contacts = contacts
    if excess > 1.0:
        state.scale_velocities(1.0 / excess)
        control.drag = min(p.drag[1], 1.05 * control.drag)
        control.step_s = max(p.step_s[0], 0.97 * control.step_s)
    else:
        control.drag = max(p.drag[0], 0.97 * control.drag)
        control.step_s = min(p.step_s[1], 1.03 * control.step_s)
    if contacts:
        control.step_s = min(control.step_s, p.step_in_contact_s)


def pair_limit(run: Simultaneous, engine: Segments) -> float:
    """Return the largest ratio of a near pair's relative speed to what it may move in a step."""
    p, radius, largest = run.world.parameters, run.world.chain.module.radius, 0.0
    loose = np.abs(run.world.state.angles).max() < p.loose_rad
    approach = p.pair_cap_loose if loose else p.pair_cap
    positions, velocities, spins = engine.positions, engine.velocities, engine.spins
    for i in range(len(positions)):
        for j in range(i + 2, len(positions)):
            gap = positions[j] - positions[i]
            distance = np.linalg.norm(gap)
            if distance >= p.repulsion_cutoff:
                continue
            relative = velocities[j] - velocities[i] - np.cross(0.5 * (spins[i] + spins[j]), gap)
            surface = radius * np.linalg.norm(spins[j] - spins[i])
            closing = max(-(relative @ gap) / distance, 0.0) + surface
            more = 0.5 * max(distance - 2.0 * radius, 0.0)
            sliding = (np.linalg.norm(relative) + surface) / (p.slide_cap + more)
            largest = max(largest, closing / (approach + more), float(sliding))
    return largest
