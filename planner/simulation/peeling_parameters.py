"""Parameters of peeling."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PeelingParameters:
    """How a chain is peeled off its folded core.

    Lengths in pitches, module mass 1. The time unit is the simulation's own.

    Attributes:
        unit: Modules that are let go at once.
        repulsion_gain: γ of eq. 3.
        repulsion_cutoff: Modules and cells farther apart don't repel.
        spring: Hinge spring towards straight, near the core.
        stiffening: Far from the core it is this many times as stiff.
        armature: Rotor inertia of a hinge.
        tension: The largest force that adds up along the window, in springs.
        pull: Force on the window's last module, in springs.
        alignment: Torque that turns the rod where it shall point, in springs.
        turn_rad: How far that direction turns in a step.
        geom_size: Size of the collision hull.
        step_s, step_in_contact_s: Smallest and largest time step; largest one in contact.
        drag: Smallest and largest uniform drag α.
        joint_cap_rad: No hinge turns more in one step.
        pair_cap, pair_cap_loose: No two near modules come nearer by more in one step, until the
            window is loose and after.
        slide_cap: Nor do they slide along each other by more.
        body_cap: No module of the window moves more in one step.
        loose_rad: A window is loose when every hinge is below this.
        release_rad: The next unit is let go when all hinges of the last one are below this.
        skipped: But for so many joints next to the core.
        rod_modules: The rod has the inertia of so many modules at most.
        release_contacts: And there are no more contacts than this.
        window: And there are fewer modules in the window.
        most_modules: There are never more.
        retire_rad: Outer hinges below this become part of the rod.
        retire_step_rad: And are straightened by so much from a snapshot to the next.
        retire_height: When they are so far from the core.
        snapshot_rad, snapshot_distance: A snapshot is kept when a hinge has turned or a module of
            the window has moved this much.
        finish_rad: Below this the last window may be straightened kinematically.
        verify_size: Module size at which that, retirements and snapshots are checked.
        patience: Steps without progress after which something is tried.
        max_steps_per_module: Give up after so many steps for each module, and some more.
    """

    unit: int = 32
    repulsion_gain: float = 1.0
    repulsion_cutoff: float = 2.5
    spring: float = 3.0
    stiffening: float = 10.0
    armature: float = 10.0
    tension: float = 25.0
    pull: float = 15.0
    alignment: float = 15.0
    turn_rad: float = 0.03
    geom_size: float = 0.9995
    step_s: tuple[float, float] = (0.004, 0.1)
    step_in_contact_s: float = 0.06
    drag: tuple[float, float] = (0.1, 2.0)
    joint_cap_rad: float = 0.03
    pair_cap: float = 0.03
    pair_cap_loose: float = 0.05
    slide_cap: float = 0.1
    body_cap: float = 0.4
    loose_rad: float = 1.2
    release_rad: float = 1.3
    skipped: int = 8
    rod_modules: int = 4
    release_contacts: int = 12
    window: int = 64
    most_modules: int = 160
    retire_rad: float = 0.2
    retire_step_rad: float = 0.12
    retire_height: float = 4.0
    snapshot_rad: float = 0.1
    snapshot_distance: float = 0.7
    finish_rad: float = 1.0
    verify_size: float = 0.98
    patience: int = 500
    max_steps_per_module: int = 60
