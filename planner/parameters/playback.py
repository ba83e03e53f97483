"""Parameters of playbacks: by robots, by the published rule, and on a table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.parameters.setting import described, setting, shared


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParameters:
    """Model errors of the simulated robots, their number, and the engine that simulates them.

    Torques are relative to the largest torque that the plan asks of a robot without errors.

    Attributes:
        robots: Number of robots, each with errors of its own; 0 for one ideal robot.
        mass_error: Relative standard deviation of the modules' masses and inertias.
        joint_friction: Mean dry friction of the joints. Each joint has 0.5 to 1.5 times this
            value, and its servo compensates the mean.
        motor_limit: Largest torque of a motor.
        servo_give: Error of a hinge at rest whose servo gives its largest torque.
        damping_s: Ratio kv / kp of the servos, in units of time.
        encoder_step: Resolution of the encoders, rad. Each has an offset of up to half of it.
        encoder_noise: Standard deviation of a measured angle, rad, drawn anew in each step of the
            servo.
        engine: ``foldback`` for our own engine, or ``mujoco``.
    """

    robots: int = setting(
        3,
        label="Robots",
        help="Number of simulated robots with model errors; 0 means one ideal robot.",
        range=(0, 20),
        is_whole=True,
    )
    mass_error: float = setting(
        0.03,
        label="Mass error",
        help="Relative standard deviation of the modules' masses and inertias.",
        unit="of the mean",
        range=(0.0, 0.2),
    )
    joint_friction: float = setting(
        0.02,
        label="Joint friction",
        help="Mean dry friction of the joints; each joint has 0.5 to 1.5 times this value.",
        unit="× the plan's largest torque",
        range=(0.0, 0.5),
    )
    motor_limit: float = setting(
        2.0,
        label="Motor torque limit",
        help="Maximum torque of a motor.",
        unit="× the plan's largest torque",
        range=(0.1, 100.0),
    )
    servo_give: float = setting(
        0.01,
        label="Servo yield",
        help="Angle error of a motionless hinge whose motor is at its torque limit.",
        unit="rad",
        range=(1e-4, 0.5),
    )
    damping_s: float = described(0.2, "Servo damping relative to stiffness", "s")
    encoder_step: float = setting(
        2.0 * math.pi / 2**18,  # 18 bits per turn
        label="Encoder step",
        help="Smallest angle that an encoder can measure. Default: an encoder with 18 bits per "
        "turn.",
        unit="rad",
        range=(0.0, 0.1),
    )
    encoder_noise: float = setting(
        1e-5,
        label="Encoder noise",
        help="Standard deviation of the error of a measured angle.",
        unit="rad",
        range=(0.0, 0.01),
    )
    engine: str = shared("foldback", ExplosionParameters)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaybackParameters:
    """Parameters of a playback, which folds the straight chain.

    ``spacing_rad``, ``distance_weight`` and ``steps_per_rad`` stand at no edge: with 0.7 or 1.4
    times as much, clearances are 0.043 to 0.044 pitches, as with these values (decision 0051).

    Attributes:
        controller: ``robot`` (servos with feed-forward on robots with model errors),
            ``computed-torque`` (an ideal robot; only the encoders' resolution is left),
            ``paper`` (the threshold rule) or ``direct`` (straight to the target: the baseline
            that fails).
        robot: Model errors of the robots, for the controller ``robot``. Only its ``encoder_step``
            is left for ``computed-torque``.
        spacing_rad: Distance of the reference's control points along the record.
        distance_weight: Radians that a displacement of one pitch counts as, along the record.
        steps_per_rad: Simulation steps for each radian of the record's length.
        step_s: Time step.
        paced_by: ``torque``: the pace that makes the largest torque smallest. ``speed``: the
            fastest pace that the hinges' speed limit allows, whatever torque it needs. For
            simulated playbacks.
        bandwidth: Bandwidth w of computed torque, in 1/s.
        stiffness: Servo gain kp.
        friction: Coefficient of friction of contacts.
        motor_max_force: Largest torque of a motor in module masses · pitch²/s²; None for no limit.
            Motors of ``paper`` and ``direct`` are velocity constraints, as in ODE.
        threshold: The published rule: the next snapshot is the target once every hinge's squared
            error, rad², is below this.
        motor_gain: Speed of a motor per radian of error, kp / kv, in 1/s.
        damping: Fraction of its velocity that the chain loses in each step.
        steps_per_snapshot: The published rule: smallest number of steps for each snapshot.
        direct_steps: Number of steps in which the baseline's target goes from straight to folded.
        simulated_modules: Longest chain that is simulated, in modules; longer ones are played back
            by kinematics. None: up to 500 modules, and up to 2000 where that is not expected to
            take long (``planner/playback/simulation_work.py``).
        max_steps: Number of steps after which a playback without robots gives up.
    """

    controller: str = described("robot", "Controller")
    robot: RobotParameters = field(default_factory=RobotParameters)
    spacing_rad: float = described(0.03, "Control point spacing", "rad")
    distance_weight: float = described(
        0.03, "Weight of displacements in the path length", "rad/pitch"
    )
    steps_per_rad: float = described(50.0, "Steps per radian")
    step_s: float = shared(0.08, PaperExplosionParameters)
    paced_by: str = described("torque", "Quantity that limits the pace")
    bandwidth: float = described(7.5, "Bandwidth", "per s")
    stiffness: float = described(1e7, "Servo stiffness")
    friction: float = shared(0.0, PaperExplosionParameters)
    motor_max_force: float | None = setting(
        None,
        label="Joint motor maximum force",
        help="Maximum torque of a hinge's motor in playback; `none` means no limit.",
        unit="module mass · pitch²/s²",
        source="named",
        range=(1e-3, 1e8),
        optional=True,
        direct=True,
    )
    threshold: float = setting(
        0.15,
        label="Maximum squared error",
        help="The motors go on to the next snapshot when every hinge's squared error is below "
        "this value.",
        unit="rad²",
        source="published",
        range=(1e-6, 10.0),
    )
    motor_gain: float = setting(
        30.0,
        label="Servo gain",
        help="Speed of a motor per radian of error.",
        unit="1/s",
        source="named",
        range=(0.01, 100.0),
        direct=True,
    )
    damping: float = shared(0.0, PaperExplosionParameters)
    steps_per_snapshot: int = setting(
        1,
        label="Steps for each snapshot",
        help="Minimum number of motor steps for each snapshot. With 0, only the maximum "
        "squared error decides when the next snapshot follows, except at the first snapshot.",
        unit="steps",
        range=(0, 1000),
        is_whole=True,
    )
    direct_steps: int = described(4000, "Duration of the target motion", "steps")
    simulated_modules: int | None = setting(
        None,
        label="Longest simulated chain",
        help="Longer chains are played back without a simulation of forces; `none` means up to 500 "
        "modules, and up to 2000 if the simulation is expected to add less than 8 s.",
        unit="modules",
        range=(2, 20_000),
        is_whole=True,
        optional=True,
        is_own=True,
    )
    max_steps: int = described(200_000, "Step limit", "steps")


PUBLISHED_PLAYBACK: Final = PlaybackParameters(
    controller="paper",
    step_s=0.01,
    friction=0.1,
    damping=0.1,
    motor_gain=60.0,
    simulated_modules=600,
)
"""Playback parameters of the presets ``paper`` and ``direct``: the values of the published method
where the paper states them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TablePlaybackParameters:
    """Parameters of a playback on a table, in units of module mass, pitch and gravity.

    The time unit is √(pitch / gravity), 32 ms for a pitch of 1 cm; torques are in w·p.

    Attributes:
        step: Time step.
        geom_size: Size of the collision hull as a fraction of the module.
        contact_time: ``solref[0]`` of contacts.
        table_hardness: ``solimp`` of contacts with the table; 1 would be rigid.
        module_hardness: ``solimp`` of contacts between modules.
        armature: Rotor inertia of every hinge.
        stops_early_rad: Distance of the stops from the end of a joint's range. A hinge that hits a
            stop overshoots it by a little in one step.
        firmness: ``solimp`` of the motors; 1 would be rigid below their limit.
        gain: Speed of a motor per radian of error, per unit of time.
        spacing_rad: Distance of the reference's control points along the record.
        inertial_share: Fraction of the motors' limit that may accelerate the chain.
        braking_share: Fraction of it that may stop a hinge that lags behind.
        fastest: Largest speed of a hinge, rad per unit of time.
        frame_rad: Rotation of the fastest hinge between two recorded frames.
        settle: Time at the end in which the chain comes to rest.
    """

    step: float = described(0.24, "Time step", "√(pitch/gravity)")
    geom_size: float = described(0.99, "Size of the collision hull relative to the module")
    contact_time: float = described(0.48, "Time constant of contacts", "√(pitch/gravity)")
    table_hardness: float = described(0.999, "Hardness of contacts with the table, 1 is rigid")
    module_hardness: float = described(0.999, "Hardness of contacts between modules, 1 is rigid")
    armature: float = described(0.01, "Rotor inertia of a hinge", "m·p²")
    stops_early_rad: float = described(
        0.01, "Distance of the stops from the end of the range", "rad"
    )
    firmness: float = described(0.9999, "Firmness of the motors below their limit, 1 is rigid")
    gain: float = described(5.0, "Motor speed per joint error", "√(gravity/pitch)")
    spacing_rad: float = described(0.03, "Distance of control points along the record", "rad")
    inertial_share: float = described(0.3, "Share of the motors' limit that may accelerate")
    braking_share: float = described(0.2, "Share of the motors' limit that may brake a late hinge")
    fastest: float = described(0.3, "Largest hinge speed", "rad·√(gravity/pitch)")
    frame_rad: float = described(0.05, "Rotation of the fastest hinge between two frames", "rad")
    settle: float = described(5.0, "Time to come to rest at the end", "√(pitch/gravity)")

    @classmethod
    def usual(cls, *, clamped: bool) -> TablePlaybackParameters:
        """Return the parameters for a base.

        Modules of a free chain would overlap in steps as long as those of a clamped one.
        """
        return cls() if clamped else cls(step=0.12, contact_time=0.24)
