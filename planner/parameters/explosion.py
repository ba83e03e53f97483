"""Parameters of our explosions: all at once, peeled off the folded core, and peeled on a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from foldback.planner.chain.module import DEFAULT_MODULE_SIZE
from foldback.planner.parameters.setting import setting

Base = Literal["clamped", "free"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplosionParameters:
    """Parameters of an explosion that releases the whole chain at once.

    Lengths are in pitches, masses in module masses; the time unit is the simulation's own. Values
    without another source were chosen on the shapes of the gallery.

    Attributes:
        repulsion_gain: γ of equation 3 while the chain is packed.
        loose_repulsion: Factor of γ once the chain is loose. Its strands then slide past each other
            without touching.
        repulsion_cutoff: Distance above which modules do not repel each other.
        spring: Stiffness of the hinge springs, which pull towards straight.
        armature: Rotor inertia of a hinge.
        tension: Largest force that may add up along the chain, as a multiple of ``spring``; λ of
            equation 1 follows from it. Larger values straighten faster and press contacts deeper.
        geom_size: Size of the collision hull. It is below 1 so that neighbours in the folded shape
            do not touch.
        step_s: Smallest and largest time step.
        step_in_contact_s: Largest time step while modules touch.
        drag: Smallest and largest uniform drag α, per unit of time.
        joint_cap_rad: Largest rotation of a hinge in one step.
        pair_cap: Largest approach of two near modules in one step while the chain is packed. It
            limits how deep contacts go.
        pair_cap_loose: The same once the chain is loose.
        slide_cap: Largest displacement of two near modules along each other in one step.
        body_cap: Largest displacement of a module in one step.
        loose_rad: The chain counts as loose when every hinge is bent less than this.
        snapshot_rad: Rotation of a hinge since the last snapshot at which the next one is taken.
        snapshot_distance: Displacement of a module since the last snapshot that does so, too.
        finish_rad: Bend of all hinges below which the chain is straightened by
            kinematics if the motion is free of collisions.
        verify_size: Module size at which that motion and the snapshots are checked. Contacts must
            not be deeper than it allows.
        max_steps: Number of steps after which the explosion gives up.
    """

    repulsion_gain: float = 1.0
    loose_repulsion: float = 10.0
    repulsion_cutoff: float = 2.5
    spring: float = 3.0
    armature: float = 10.0
    tension: float = 12.0
    geom_size: float = 0.9995
    step_s: tuple[float, float] = (0.004, 0.1)
    step_in_contact_s: float = 0.06
    drag: tuple[float, float] = (0.05, 2.0)
    joint_cap_rad: float = 0.02
    pair_cap: float = 0.025
    pair_cap_loose: float = 0.05
    slide_cap: float = 0.1
    body_cap: float = 0.4
    loose_rad: float = 1.2
    snapshot_rad: float = 0.015
    snapshot_distance: float = 0.7
    finish_rad: float = 0.6
    verify_size: float = DEFAULT_MODULE_SIZE
    max_steps: int = 60_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PeelingParameters:
    """Parameters of an explosion that releases modules group by group from the folded core.

    The *window* holds the modules that move, between the core, which is still folded, and the
    straight tail, which moves as one rigid body. Units as in ``ExplosionParameters``.

    Attributes:
        unit: Number of modules that are released together.
        repulsion_gain: γ of equation 3.
        repulsion_cutoff: Distance above which modules and cells of the core do not repel each
            other.
        spring: Stiffness of the hinge springs near the core.
        stiffening: Factor of the stiffness far from the core.
        armature: Rotor inertia of a hinge.
        tension: Largest force that may add up along the window, as a multiple of ``spring``.
        pull: Force on the last module of the window, as a multiple of ``spring``.
        alignment: Torque that turns the tail towards its goal heading, as a multiple of ``spring``.
        turn_rad: Largest change of the goal heading in one step.
        geom_size: Size of the collision hull.
        step_s: Smallest and largest time step.
        step_in_contact_s: Largest time step while modules touch.
        drag: Smallest and largest uniform drag α, per unit of time.
        joint_cap_rad: Largest rotation of a hinge in one step.
        pair_cap: Largest approach of two near modules in one step until the window is loose.
        pair_cap_loose: The same once the window is loose.
        slide_cap: Largest displacement of two near modules along each other in one step.
        body_cap: Largest displacement of a module of the window in one step.
        loose_rad: The window counts as loose when every hinge is bent less than this.
        release_rad: The next group may be released when the hinges of the last one are bent less
            than this.
        skipped: Number of joints next to the core that ``release_rad`` does not apply to.
        release_contacts: Largest number of contacts in the window at which the next group may be
            released.
        window: The next group may be released when the window has fewer modules than this.
        most_modules: Largest number of modules in the window.
        rod_modules: Largest number of modules whose inertia the tail has.
        retire_rad: Outer hinges that are bent less than this may become part of the tail.
        retire_step_rad: Rotation by which they are straightened from one snapshot to the next.
        retire_height: Smallest distance from the core at which they may do so.
        snapshot_rad: Rotation of a hinge since the last snapshot at which the next one is taken.
        snapshot_distance: Displacement of a module of the window that does so, too.
        finish_rad: Bend of all hinges below which the last window is straightened by
            kinematics if the motion is free of collisions.
        verify_size: Module size at which that motion, the joints of the tail and the snapshots are
            checked.
        patience: Number of steps without progress after which a pulse of repulsion starts.
        max_steps_per_module: Number of steps for each module after which the peeling gives up.
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

    def most_steps(self, modules: int) -> int:
        """Return the number of steps after which the peeling of a chain gives up.

        Args:
            modules: Number of modules of the chain.
        """
        return self.max_steps_per_module * modules + 5000


@dataclass(frozen=True, slots=True, kw_only=True)
class TableParameters(PeelingParameters):
    """Parameters of a peeling on a table, under gravity.

    Torques are in w·p (weight of a module × pitch), forces in module weights.

    Attributes:
        weight: Weight of a module in units of the simulation's forces. Next to it, drag and the
            inertia of the rotors are small.
        spring_torque: Torque of a hinge's spring at one radian, near straight.
        largest_spring_torque: Initial limit of the torque of a hinge's spring.
        pull: Initial force on the last module of the window towards the goal heading.
        turning: Initial torque that turns the tail towards its goal heading.
        first_bound: Initial limit of the static torque in a frame that is recorded.
        raised_by: Factor by which that limit grows when nothing else helps.
        most_torque: Largest value of that limit; beyond it the explosion has stalled.
        refusals: Number of frames that are rejected before the limit grows.
        unbent: The next group may be released when the turns of the window, seen from above, add
            up to less than this (rad), except for ``skipped`` joints next to the core.
        drawn_steps: Number of steps for which a set of random forces acts.
        most_pushes: Number of pulses in a row without progress before an earlier release is taken
            back.
        most_returns: Number of such returns without progress after which the explosion has
            stalled.
        friction: Coefficient of friction μ between modules and table.
        base: ``clamped``: the first module is fixed to the table. ``free``: the chain lies on it
            and moves as a whole so that it slides least.
    """

    unit: int = 1
    skipped: int = 2
    window: int = 200
    retire_height: float = 2.5
    snapshot_rad: float = 0.05
    verify_size: float = DEFAULT_MODULE_SIZE
    patience: int = 400
    max_steps_per_module: int = 1500
    weight: float = 25.0
    spring_torque: float = 3.0
    largest_spring_torque: float = 2.0
    pull: float = 0.3
    turning: float = 1.0
    first_bound: float = 2.0
    raised_by: float = 1.15
    most_torque: float = setting(
        8.0,
        name="table_torque",
        label="Largest torque on a table",
        help="Largest torque that a hinge may need to hold the chain still, in w·p (module "
        "weight × pitch).",
        unit="w·p",
        range=(0.1, 1000.0),
    )
    refusals: int = 8
    unbent: float = 1.5
    drawn_steps: int = 200
    most_pushes: int = 9
    most_returns: int = 1
    friction: float = setting(
        0.0,
        name="table_friction",
        label="Friction of the table",
        help="Coefficient of friction μ between modules and table.",
        range=(0.0, 2.0),
    )
    base: Base = setting(
        "free",
        name="table_base",
        label="Base",
        help="`free`: the chain lies on the table and may drift. `clamped`: its first module "
        "is fixed to the table. With friction, a clamped base needs several times the torque "
        "of a free one.",
        words=get_args(Base),
    )

    @property
    def held(self) -> bool:
        """True if the first module is held during the playback.

        A free chain without friction is held as well, because the least force would push it away.
        """
        return self.base == "clamped" or self.friction == 0.0
