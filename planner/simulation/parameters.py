"""Parameters of a fold, and the presets.

``default`` is ours, ``paper`` is as published, ``direct`` is the baseline that servoes straight to
the target without a record.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Literal

from planner.chain.module import Module
from planner.errors import InputError

World = Literal["floating", "table"]
Base = Literal["clamped", "free"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplosionParameters:
    """How the chain is let go.

    Lengths in pitches, module mass 1. The time unit is the simulation's own.

    Attributes:
        repulsion_gain: γ of eq. 3 while the chain is packed.
        loose_repulsion: Factor of γ once it has come apart: its strands then slide past each other
            without touching.
        repulsion_cutoff: Distance above which modules do not repel each other.
        spring: Hinge spring towards straight.
        armature: Rotor inertia of a hinge.
        tension: λ of eq. 1 is set so that the largest force that adds up along the chain is this
            many times the spring.
        geom_size: Size of the collision hull; less than 1, so that neighbours in the folded shape
            do not touch.
        step_s, step_in_contact_s: Smallest and largest time step; largest one in contact.
        drag: Smallest and largest uniform drag α, per s.
        joint_cap_rad: Turn of a hinge in one step, at most.
        pair_cap, pair_cap_loose: Approach of two near modules in one step, at most, until the chain
            is loose and after. It decides how deep contacts go.
        slide_cap: Way of two near modules along each other in one step, at most.
        body_cap: Way of a module in one step, at most.
        loose_rad: Bend of every hinge below which the chain is loose.
        snapshot_rad, snapshot_distance: Turn of a hinge, and way of a module, since the last
            snapshot, from which on the next is kept.
        finish_rad: Bend of every hinge below which the chain is straightened by kinematics, if that
            is clear.
        verify_size: Module size at which that and the snapshots are checked; contacts are no deeper
            than it allows.
        max_steps: Steps after which the explosion gives up.
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
    verify_size: float = 0.95
    max_steps: int = 60_000


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperExplosionParameters:
    """The published explosion: constant gains, fixed step, fixed snapshot interval.

    The paper's figures have no units; read as centimetres, grams and seconds they fit together.
    Which of them the paper gives, names, or does not have:
        ``planner.pipeline.settings.SETTINGS``.

    Attributes:
        radial_gain: λ of eq. 1; its d is the diameter of one module, a pitch.
        repulsion_gain: γ of eq. 3.
        damping: Share of its speed that the whole chain loses in each step.
        friction: Of contacts.
        step_s: Time step.
        pitch_cm: Distance of neighbouring modules, the paper's "diameter".
        density_kg_m3: Of a solid module.
        snapshot_interval: Steps between two snapshots.
        repulsion_cutoff: Modules farther apart (in pitches) don't repel.
        spring: Hinge spring towards straight, in g·cm²/s².
        stop_deg: Where the hinges' stops are.
        geom_size: Size of the collision hull.
        max_steps: Give up after so many steps.
    """

    radial_gain: float = 0.1
    repulsion_gain: float = 1.0
    damping: float = 0.1
    friction: float = 0.1
    step_s: float = 0.01
    pitch_cm: float = 1.0
    density_kg_m3: float = 2700.0
    snapshot_interval: int = 10
    repulsion_cutoff: float = 2.5
    spring: float = 1.0
    stop_deg: float = 90.0
    geom_size: float = 0.99
    max_steps: int = 400_000

    def module_mass_g(self, module: Module) -> float:
        """What a module weighs in grams."""
        return 1e-3 * self.density_kg_m3 * module.volume * self.pitch_cm**3


@dataclass(frozen=True, slots=True, kw_only=True)
class PeelingParameters:
    """How a chain is peeled off its folded core.

    Lengths in pitches, module mass 1. The time unit is the simulation's own.

    Attributes:
        unit: Modules that are let go at once.
        repulsion_gain: γ of eq. 3.
        repulsion_cutoff: Distance above which modules and cells do not repel each other.
        spring: Hinge spring towards straight, near the core.
        stiffening: Factor of the spring far from the core.
        armature: Rotor inertia of a hinge.
        tension: Largest force that adds up along the window, as a multiple of the spring.
        pull: Force on the window's last module, as a multiple of the spring.
        alignment: Torque that turns the rod to where it is to point, as a multiple of the spring.
        turn_rad: Turn in one step of the direction in which the rod is to point.
        geom_size: Size of the collision hull.
        step_s, step_in_contact_s: Smallest and largest time step; largest one in contact.
        drag: Smallest and largest uniform drag α, per s.
        joint_cap_rad: Turn of a hinge in one step, at most.
        pair_cap, pair_cap_loose: Approach of two near modules in one step, at most, until the
            window is loose and after.
        slide_cap: Way of two near modules along each other in one step, at most.
        body_cap: Way of a module of the window in one step, at most.
        loose_rad: Bend of every hinge below which the window is loose.
        release_rad: Bend of the last unit's hinges below which the next unit may be let go.
        skipped: Joints next to the core that ``release_rad`` does not apply to.
        release_contacts: Contacts in the window up to which the next unit may be let go.
        window: Modules in the window below which the next unit may be let go.
        most_modules: Modules in the window, at most.
        rod_modules: Modules whose inertia the rod has, at most.
        retire_rad: Bend below which outer hinges may become part of the rod.
        retire_step_rad: Turn by which they are straightened from one snapshot to the next.
        retire_height: Distance from the core beyond which they may do so.
        snapshot_rad, snapshot_distance: Turn of a hinge, and way of a module of the window, since
            the last snapshot, from which on the next is kept.
        finish_rad: Bend below which the last window is straightened by kinematics, if clear.
        verify_size: Module size at which that, joints of the rod and snapshots are checked.
        patience: Steps without progress after which a pulse of repulsion begins.
        max_steps_per_module: Steps for each module after which the peeling gives up.
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
        """Steps after which the peeling of a chain of so many modules gives up."""
        return self.max_steps_per_module * modules + 5000


@dataclass(frozen=True, slots=True, kw_only=True)
class TableParameters(PeelingParameters):
    """How a chain is peeled off its core on a table, under gravity.

    Torques are in w·p, the weight of a module times the pitch; forces in weights of a module.

    Attributes:
        weight: Of a module, in units of the simulation's forces: beside it rotors and drag are
            slight.
        spring_torque: Of a hinge's spring for a radian, near straight.
        largest_spring_torque: Of a hinge's spring, at first.
        pull: Force on the window's last module towards where the rod is to point, at first.
        turning: Torque that turns the rod to where it is to point, at first.
        first_bound: Largest static torque of a frame that is kept, at first.
        raised_by: Factor of that bound when nothing else helps.
        most_torque: That bound never gets larger; the explosion is stuck then.
        refusals: Frames that are taken back before the bound is raised.
        unbent: Sum of all turns of the window, seen from above, below which the next unit may be
            let go, except of ``skipped`` joints next to the core.
        drawn_steps: Steps for which forces that were drawn anew last.
        most_pushes: Times without progress in a row after which it goes back to an earlier release.
        most_returns: Times that it does so without getting farther, before it has stalled.
        friction: μ between modules and floor.
        base: Whether the first module is ``clamped`` to the table or the chain lies ``free``, and
            drifts as a whole so that it rubs least.
    """

    unit: int = 1
    skipped: int = 2
    window: int = 200
    retire_height: float = 2.5
    snapshot_rad: float = 0.05
    verify_size: float = 0.95
    patience: int = 400
    max_steps_per_module: int = 1500
    weight: float = 25.0
    spring_torque: float = 3.0
    largest_spring_torque: float = 2.0
    pull: float = 0.3
    turning: float = 1.0
    first_bound: float = 2.0
    raised_by: float = 1.15
    most_torque: float = 8.0
    refusals: int = 8
    unbent: float = 1.5
    drawn_steps: int = 200
    most_pushes: int = 9
    most_returns: int = 1
    friction: float = 0.0
    base: Base = "free"

    @property
    def held(self) -> bool:
        """Whether a playback holds the first module.

        It holds that of a chain that lies free without friction, too: the least push would have it
        slide away for good.
        """
        return self.base == "clamped" or self.friction == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TablePlaybackParameters:
    """How a chain is folded on a table, in natural units: module mass, pitch and gravity are 1.

    Time is in √(pitch / gravity), 32 ms for a pitch of 1 cm; torques are in w·p.

    Attributes:
        step: Time step.
        geom_size: Collision hull as a fraction of the full module.
        contact_time: ``solref[0]`` of contacts.
        table_hardness: ``solimp`` of contacts with the table: 1 would not give at all.
        module_hardness: The same of contacts between modules.
        armature: Rotor inertia of every hinge.
        stops_early_rad: By how much stops begin before the end of a joint's range: what is thrown
            at them goes a little farther in a step.
        firmness: ``solimp`` of the motors: 1 would not give at all below their limit.
        gain: Rate of a motor for one radian that is left, per unit of time.
        spacing_rad: Distance of the reference's control points along the record.
        inertial_share: Share of the motors' limit that may go into speeding up and slowing down.
        braking_share: Share of it with which a hinge that lags may be stopped again.
        fastest: Largest rate of a hinge, in radians per unit of time.
        frame_rad: Turn of the fastest hinge between two frames that are kept.
        settle: Time that is left at the end.
    """

    step: float = 0.24
    geom_size: float = 0.99
    contact_time: float = 0.48
    table_hardness: float = 0.999
    module_hardness: float = 0.999
    armature: float = 0.01
    stops_early_rad: float = 0.01
    firmness: float = 0.9999
    gain: float = 5.0
    spacing_rad: float = 0.03
    inertial_share: float = 0.3
    braking_share: float = 0.2
    fastest: float = 0.3
    frame_rad: float = 0.05
    settle: float = 5.0

    @classmethod
    def usual(cls, *, clamped: bool) -> TablePlaybackParameters:
        """The usual ones; modules of a chain that lies free overlap in steps twice as long."""
        return cls() if clamped else cls(step=0.12, contact_time=0.24)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParameters:
    """What is not ideal about a robot, and how many of its kind a plan is tried on.

    Torques are multiples of the largest one that the plan asks of a robot without faults.

    Attributes:
        mass_error: Standard deviation of the modules' masses and inertias, as a share of them.
        friction: Dry friction of a joint; each has from half to one and a half times that, and
            its servo reckons with that.
        torque_limit: Largest torque of a motor.
        give_rad: Angle by which a hinge at rest is off when its servo gives its largest torque.
        damping_s: kv / kp of the servos.
        encoder_rad: Step of the encoders, of 18 bits a turn; each is off by up to half of one.
        noise_rad: Standard deviation of what they read at each step of the servo.
        runs: Robots, each with faults of its own.
    """

    mass_error: float = 0.03
    friction: float = 0.02
    torque_limit: float = 2.0
    give_rad: float = 0.01
    damping_s: float = 0.2
    encoder_rad: float = 2.0 * math.pi / 2**18
    noise_rad: float = 1e-5
    runs: int = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaybackParameters:
    """How the straight chain is folded again.

    Attributes:
        controller: ``robot`` (servos with feed-forward on robots with faults),
            ``computed-torque`` (an ideal robot: its encoders' steps are all that is off),
            ``paper`` (the threshold rule) or ``direct`` (straight to the target: the baseline
            that fails).
        robot: What robots are like, of ``robot``.
        spacing_rad: Distance of the reference's control points along the record.
        distance_weight: Radians that a displacement of one pitch counts as, along the record.
        steps_per_rad: Simulation steps for one radian of the record's length.
        step_s: Time step.
        paced_by: ``torque``: as fast as keeps the largest torque least; ``speed``: as fast as the
            hinges' speed allows, whatever torque it takes. Of simulated playbacks.
        bandwidth: w of computed torque, in 1/s.
        encoder_rad: Step of the hinges' encoders, of 18 bits a turn; 0 for exact ones. What the
            controller of computed torque does not see is the error that is left.
        stiffness: Servo gain kp.
        friction: Of contacts.
        torque_limit: Largest torque of a motor in module masses · pitch² / s²; None for no limit.
            ``paper`` and ``direct`` then have motors as constraints, as ODE has.
        gain: Of a servo, in 1/s: the motors' rate for one radian that is left, kp / kv.
        damping: Share of its velocity that the chain loses in each step.
        least_steps: The paper's rule: each snapshot is the target for so many steps at least.
        direct_steps: Steps in which the baseline's target goes from straight to folded.
        threshold_rad2: The paper's rule: next snapshot below this squared error.
        dynamic_up_to: Longer chains are not simulated: the playback is kinematic.
        max_steps: Give up after so many steps.
    """

    controller: str = "robot"
    robot: RobotParameters = field(default_factory=RobotParameters)
    spacing_rad: float = 0.03
    distance_weight: float = 0.03
    steps_per_rad: float = 50.0
    step_s: float = 0.08
    paced_by: str = "torque"
    bandwidth: float = 7.5
    encoder_rad: float = 2.0 * math.pi / 2**18
    stiffness: float = 1e7
    friction: float = 0.0
    torque_limit: float | None = None
    threshold_rad2: float = 0.15
    gain: float = 30.0
    damping: float = 0.0
    least_steps: int = 1
    direct_steps: int = 4000
    dynamic_up_to: int = 500
    max_steps: int = 200_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """Everything a fold depends on apart from its chain and seed.

    Attributes:
        preset: Name of the set.
        explosion: How the chain is let go; None for direct servoing.
        playback: How it is folded again.
        peeling: How it is let go where the strategy is to peel it.
        table: How it is let go on a table.
        world: Where it folds: ``floating``, or on a ``table`` under gravity.
        strategy: How it is let go, ``auto`` included, see ``planner.explosion.strategies``.
        module_size: Size at which the plan is verified, as a fraction of the pitch.
        density_kg_m3: Of a solid module, for torques in newton-metres.
        joint_speed_limit_rad_s: Sets the fold time in the certificate.
    """

    preset: str = "default"
    explosion: ExplosionParameters | PaperExplosionParameters | None = field(
        default_factory=ExplosionParameters
    )
    playback: PlaybackParameters = field(default_factory=PlaybackParameters)
    peeling: PeelingParameters = field(default_factory=PeelingParameters)
    table: TableParameters = field(default_factory=TableParameters)
    world: World = "floating"
    strategy: str = "auto"
    module_size: float = 0.95
    density_kg_m3: float = 2700.0
    joint_speed_limit_rad_s: float = 1.0

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, nested as the parameters are."""
        return asdict(self)


PUBLISHED_PLAYBACK: Final = PlaybackParameters(
    controller="paper", step_s=0.01, friction=0.1, damping=0.1, gain=60.0, dynamic_up_to=600
)
PRESETS: Final = ("default", "paper", "direct")
"""Names of parameter sets: foldback's own, the published method, and servoing straight there."""
BASELINE: Final = "one-by-one"
STRATEGIES: Final = ("simultaneous", "blocks", "peel", BASELINE)
AUTO: Final = "auto"
STRATEGY_OPTIONS: Final = (AUTO, *STRATEGIES)
FLOATING: Final = "floating"
WORLDS: Final = (FLOATING, "table")
"""Where a chain folds: nowhere, without gravity; or on a table, under it."""


def unknown_strategy(name: str) -> InputError:
    """The refusal of a strategy that is none."""
    return InputError(
        "unknown-strategy",
        f"got the strategy {name!r}, expected one of: {', '.join(STRATEGY_OPTIONS)}.",
    )


def preset(name: str) -> Parameters:
    """The parameters of that name.

    Raises:
        InputError: ``unknown-preset``.
    """
    if name == "default":
        return Parameters()
    if name == "paper":
        return Parameters(
            preset="paper",
            explosion=PaperExplosionParameters(),
            playback=PUBLISHED_PLAYBACK,
        )
    if name == "direct":
        return Parameters(
            preset="direct",
            explosion=None,
            playback=replace(PUBLISHED_PLAYBACK, controller="direct", max_steps=20_000),
        )
    raise InputError(
        "unknown-preset", f"got the preset {name!r}, expected one of: {', '.join(PRESETS)}."
    )
