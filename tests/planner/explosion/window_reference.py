"""One step of a floating window in plain NumPy, to compare the compiled loop with."""

import numpy as np

from foldback.planner.core import FIXED, window_inverse_step_limit
from foldback.planner.core.structures import ContactModel, DetectedContacts, Loads
from foldback.planner.explosion.loop.checkpoint import PULSE_STEPS
from foldback.planner.explosion.loop.step_control import StepControl
from foldback.planner.explosion.peeling.core import distance_at
from foldback.planner.explosion.peeling.run import Peeling
from foldback.planner.explosion.peeling.window import Window, rotate_towards
from foldback.planner.parameters.explosion import PeelingParameters
from tests.planner.chains import Array


def step(run: Peeling, weights: Array) -> None:
    """Make one step of a run that neither restarts nor releases."""
    window, control, p = run.world, run.control, run.parameters
    window.place()
    control.steps += 1
    pulse = run.pulses.remaining_steps
    weak = pulse > PULSE_STEPS[1] - PULSE_STEPS[0]
    run.pulses.remaining_steps = max(0, pulse - 1)
    aim = rotate_towards(window.heading.aim, window.heading.target, p.turn_rad)
    window.heading = type(window.heading)(aim, window.heading.target, window.heading.centre)
    scale = p.spring * control.tension * (0.05 if weak else 1.0)
    forces = radial_forces(window, weights, aim) * p.tension * scale
    forces[-1] += p.pull * scale * aim
    forces += p.repulsion_gain * (4.0 if weak else 1.0) * repulsion(window, p.repulsion_cutoff)
    torque = p.alignment * p.spring * np.cross(window.rod_direction, aim)
    if control.steps % 5 == 0:
        window.model.set_stiffness(stiffness(window, p))
    torques = -window.model.stiffness * window.state.angles
    loads = Loads(torques, window.model.rotor_inertias, forces, torque)
    finder, model, state = window.setting.finder, window.model, window.state
    contacts = finder.find(model.positions, model.rotations)
    count, depth = 0, 0.0
    if contacts is not None:
        count, depth = len(contacts.points.depths), float(contacts.points.depths.max())
        time_constant = max(2.0 * control.step_s, 0.03)
        contacts = DetectedContacts(
            contacts.points, ContactModel(time_constant, 1.0, contacts.model.solimp)
        )
    accelerations = model.constrained(state, loads, contacts)
    control.depth = depth
    deep = depth > control.allowed.back_off
    control.tension = max(0.05, 0.85 * control.tension) if deep else min(1, 1.02 * control.tension)
    state.rates += control.step_s * accelerations.qdd
    state.rates /= 1.0 + control.drag * control.step_s
    limit_speeds(window, control, p, count)
    state.angles += control.step_s * state.rates
    window.time_s += control.step_s
    state.stop_at(model.stops)


def radial_forces(window: Window, weights: Array, aim: Array) -> Array:
    """Return (m, 3) forces of equation 1, whose largest sum beyond a joint is 1."""
    source = window.heading.centre - 2.0 * aim
    gains = weights[window.first : window.first + window.modules]
    forces = gains[:, None] * (window.model.positions - source)
    beyond = np.cumsum(forces[: FIXED - 2 : -1], axis=0)
    return forces / np.linalg.norm(beyond, axis=1).max()


def repulsion(window: Window, cutoff: float) -> Array:
    """Return (m, 3) forces of equation 3 with gain 1, between modules and from the core's cells."""
    positions, core = window.model.positions, window.setting.peelable.core
    forces = np.zeros_like(positions)
    for i in range(FIXED, len(positions)):
        cells = core.cells[: min(window.first + FIXED, window.first + i - 1)]
        for others in (cells, positions[i + 2 :]):
            gaps = positions[i] - others
            distances = np.linalg.norm(gaps, axis=1)
            pushes = gaps / distances[:, None] ** 3 * (distances < cutoff)[:, None]
            forces[i] += pushes.sum(axis=0)
            if others is not cells:
                forces[i + 2 :] -= pushes
    return forces


def stiffness(window: Window, p: PeelingParameters) -> Array:
    """Return the (H,) stiffness of springs, which grows with the distance from the core."""
    heights = distance_at(window.held.field, window.model.positions[1:-1])
    share = np.clip((heights - 2.0) / 6.0, 0.0, 1.0)
    return np.repeat(p.spring * (1.0 + (p.stiffening - 1.0) * share), 2)


def limit_speeds(window: Window, control: StepControl, p: PeelingParameters, contacts: int) -> None:
    """Scale velocities to what a step allows, and adapt step and drag."""
    state, model = window.state, window.model
    model.place(state)  # the positions are the same, the velocities are not
    packed, loose = window.setting.step_limits()
    limits = loose if np.abs(state.angles).max() < p.loose_rad else packed
    excess = control.step_s * window_inverse_step_limit(
        state.rates,
        model.modules,
        window.held.cells,
        window.rod_modules,
        p.repulsion_cutoff,
        limits,
    )
    control.contacts = contacts
    if excess > 1.0:
        state.rates /= excess
        control.drag = min(p.drag[1], 1.05 * control.drag)
        control.step_s = max(p.step_s[0], 0.97 * control.step_s)
    else:
        control.drag = max(p.drag[0], 0.97 * control.drag)
        control.step_s = min(p.step_s[1], 1.03 * control.step_s)
    if contacts:
        control.step_s = min(control.step_s, p.step_in_contact_s)
