"""Parameters of our explosions: all at once, peeled off the folded core, and peeled on a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

from foldback.planner.chain.module import DEFAULT_MODULE_SIZE
from foldback.planner.parameters.setting import described, setting, shared

Base = Literal["clamped", "free"]


MUJOCO: Final = "mujoco"
"""Value of the setting ``engine`` with which MuJoCo itself simulates the explosion and robots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplosionParameters:
    """Parameters of an explosion that releases the whole chain at once.

    Lengths are in pitches, masses in module masses; the time unit is the simulation's own. Values
    without another source were chosen on the shapes of the gallery. None stands at an edge: with
    0.7 or 1.4 times any of the forces, limits and distances below but sizes, ten folds of 24 to 40
    cubes are verified in about the same time, with other motions and clearances of 0.039 to 0.044
    pitches instead of 0.044 (decision 0051).

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
        engine: ``foldback`` for our own engine, or ``mujoco``; robots have the same.
    """

    repulsion_gain: float = described(1.0, "Repulsion gain γ")
    loose_repulsion: float = described(10.0, "Repulsion factor of the loosened chain")
    repulsion_cutoff: float = described(2.5, "Repulsion cutoff", "pitches")
    spring: float = described(3.0, "Hinge spring")
    armature: float = described(10.0, "Rotor inertia of a hinge")
    tension: float = described(12.0, "Spring tension", "× the hinge spring")
    geom_size: float = described(0.9995, "Size of the collision hull", "pitch")
    step_s: tuple[float, float] = described((0.004, 0.1), "Time step", "s")
    step_in_contact_s: float = described(0.06, "Longest time step in contact", "s")
    drag: tuple[float, float] = described((0.05, 2.0), "Drag", "per s")
    joint_cap_rad: float = described(0.02, "Largest hinge rotation per step", "rad")
    pair_cap: float = described(
        0.025, "Maximum decrease of the distance between two modules per step", "pitch"
    )
    pair_cap_loose: float = described(
        0.05,
        "Maximum decrease of the distance between two modules per step, loosened chain",
        "pitch",
    )
    slide_cap: float = described(0.1, "Largest sliding between two modules per step", "pitch")
    body_cap: float = described(0.4, "Largest module movement per step", "pitch")
    loose_rad: float = described(1.2, "Hinge angle below which the chain counts as loosened", "rad")
    snapshot_rad: float = described(0.015, "Rotation between snapshots", "rad")
    snapshot_distance: float = described(0.7, "Displacement between snapshots", "pitch")
    finish_rad: float = described(
        0.6, "Hinge angle below which hinges are straightened directly", "rad"
    )
    verify_size: float = described(
        DEFAULT_MODULE_SIZE, "Module size in the check of the explosion", "pitch"
    )
    max_steps: int = described(60_000, "Step limit", "steps")
    engine: str = setting(
        "foldback",
        label="Physics engine",
        help="Engine that simulates the explosion and the robots. With `mujoco`, these are steps "
        "of MuJoCo alone, for up to 500 modules; without it, one robot is simulated by both.",
        words=("foldback", MUJOCO),
    )


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

    unit: int = described(32, "Modules that are released together", "modules")
    repulsion_gain: float = shared(1.0, ExplosionParameters)
    repulsion_cutoff: float = shared(2.5, ExplosionParameters)
    spring: float = shared(3.0, ExplosionParameters)
    stiffening: float = described(10.0, "Factor of the hinge spring far from the core")
    armature: float = shared(10.0, ExplosionParameters)
    tension: float = shared(25.0, ExplosionParameters)
    pull: float = described(15.0, "Force on the last module", "× the hinge spring")
    alignment: float = described(15.0, "Torque that turns the tail", "× the hinge spring")
    turn_rad: float = described(0.03, "Largest change of the tail's heading per step", "rad")
    geom_size: float = shared(0.9995, ExplosionParameters)
    step_s: tuple[float, float] = shared((0.004, 0.1), ExplosionParameters)
    step_in_contact_s: float = shared(0.06, ExplosionParameters)
    drag: tuple[float, float] = shared((0.1, 2.0), ExplosionParameters)
    joint_cap_rad: float = shared(0.03, ExplosionParameters)
    pair_cap: float = shared(0.03, ExplosionParameters)
    pair_cap_loose: float = shared(0.05, ExplosionParameters)
    slide_cap: float = shared(0.1, ExplosionParameters)
    body_cap: float = shared(0.4, ExplosionParameters)
    loose_rad: float = shared(1.2, ExplosionParameters)
    release_rad: float = described(
        1.3, "Hinge angle below which the next modules are released", "rad"
    )
    skipped: int = described(8, "Joints next to the core without that condition", "joints")
    rod_modules: int = described(4, "Largest inertia of the tail", "modules")
    release_contacts: int = described(
        12, "Largest number of contacts at which modules are released", "contacts"
    )
    window: int = described(64, "Size of the window below which modules are released", "modules")
    most_modules: int = described(160, "Largest window", "modules")
    retire_rad: float = described(0.2, "Hinge angle below which hinges join the tail", "rad")
    retire_step_rad: float = described(
        0.12, "Rotation per snapshot of hinges that join the tail", "rad"
    )
    retire_height: float = described(
        4.0, "Smallest distance from the core at which hinges join the tail", "pitch"
    )
    snapshot_rad: float = shared(0.1, ExplosionParameters)
    snapshot_distance: float = shared(0.7, ExplosionParameters)
    finish_rad: float = shared(1.0, ExplosionParameters)
    verify_size: float = shared(0.98, ExplosionParameters)
    patience: int = described(500, "Steps without progress before a pulse of repulsion", "steps")
    max_steps_per_module: int = described(60, "Step limit for each module", "steps")

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
        table_torque: Largest value of that limit; beyond it the explosion has stalled.
        refusals: Number of frames that are rejected before the limit grows.
        unbent: The next group may be released when the turns of the window, seen from above, add
            up to less than this (rad), except for ``skipped`` joints next to the core.
        drawn_steps: Number of steps for which a set of random forces acts.
        most_pushes: Number of pulses in a row without progress before an earlier release is taken
            back.
        most_returns: Number of such returns without progress after which the explosion has
            stalled.
        table_friction: Coefficient of friction μ between modules and table.
        table_base: ``clamped``: the first module is fixed to the table. ``free``: the chain lies
            on it and moves as a whole so that it slides least.
    """

    unit: int = shared(1, PeelingParameters)
    skipped: int = shared(2, PeelingParameters)
    window: int = shared(200, PeelingParameters)
    retire_height: float = shared(2.5, PeelingParameters)
    snapshot_rad: float = shared(0.05, PeelingParameters)
    verify_size: float = shared(DEFAULT_MODULE_SIZE, PeelingParameters)
    patience: int = shared(400, PeelingParameters)
    max_steps_per_module: int = shared(1500, PeelingParameters)
    weight: float = described(25.0, "Weight of a module in the simulation")
    spring_torque: float = described(3.0, "Torque of the hinge spring at 1 rad", "w·p")
    largest_spring_torque: float = described(
        2.0, "Initial limit of the hinge spring's torque", "w·p"
    )
    pull: float = described(0.3, "Initial force on the last module", "module weights")
    turning: float = described(1.0, "Initial torque that turns the tail", "w·p")
    first_bound: float = described(2.0, "Initial limit of the static torque", "w·p")
    raised_by: float = described(1.15, "Factor by which that limit grows")
    table_torque: float = setting(
        8.0,
        label="Largest torque on a table",
        help="Largest torque that a hinge may need to hold the chain still, in w·p (module "
        "weight × pitch).",
        unit="w·p",
        range=(0.1, 1000.0),
    )
    refusals: int = described(8, "Rejected frames before that limit grows", "frames")
    unbent: float = described(1.5, "Sum of turns below which the next modules are released", "rad")
    drawn_steps: int = described(200, "Steps under the same random forces", "steps")
    most_pushes: int = described(9, "Pulses without progress before modules are taken back")
    most_returns: int = described(1, "Returns without progress before the explosion stalls")
    table_friction: float = setting(
        0.0,
        label="Friction of the table",
        help="Coefficient of friction μ between modules and table.",
        range=(0.0, 2.0),
    )
    table_base: Base = setting(
        "free",
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
        return self.table_base == "clamped" or self.table_friction == 0.0
