"""Parameters of playbacks: by robots, by the published rule, and on a table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from foldback.planner.parameters.setting import setting, shared

ENCODER_STEP_RAD: Final = 2.0 * math.pi / 2**18
"""Resolution of a simulated joint encoder with 18 bits per turn, in rad."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotParameters:
    """Model errors of the simulated robots, and the number of robots.

    Torques are relative to the largest torque that the plan asks of a robot without errors.

    Attributes:
        mass_error: Relative standard deviation of the modules' masses and inertias.
        friction: Mean dry friction of the joints. Each joint has 0.5 to 1.5 times this value, and
            its servo compensates the mean.
        torque_limit: Largest torque of a motor.
        give_rad: Error of a hinge at rest whose servo gives its largest torque.
        damping_s: Ratio kv / kp of the servos, in units of time.
        encoder_rad: Resolution of the encoders. Each has an offset of up to half of it.
        noise_rad: Standard deviation of a measured angle, drawn anew in each step of the servo.
        runs: Number of robots, each with errors of its own; 0 for one ideal robot.
    """

    mass_error: float = setting(
        0.03,
        label="Mass error",
        help="Relative standard deviation of the modules' masses and inertias.",
        unit="of the mean",
        range=(0.0, 0.2),
    )
    friction: float = setting(
        0.02,
        name="joint_friction",
        label="Joint friction",
        help="Mean dry friction of the joints; each joint has 0.5 to 1.5 times this value.",
        unit="× the plan's largest torque",
        range=(0.0, 0.5),
    )
    torque_limit: float = setting(
        2.0,
        name="motor_limit",
        label="Motor torque limit",
        help="Maximum torque of a motor.",
        unit="× the plan's largest torque",
        range=(0.1, 100.0),
    )
    give_rad: float = setting(
        0.01,
        name="servo_give",
        label="Servo yield",
        help="Angle error of a motionless hinge whose motor is at its torque limit.",
        unit="rad",
        range=(1e-4, 0.5),
    )
    damping_s: float = 0.2
    encoder_rad: float = setting(
        ENCODER_STEP_RAD,
        name="encoder_step",
        label="Encoder step",
        help="Smallest angle that an encoder can measure. Default: an encoder with 18 bits per "
        "turn.",
        unit="rad",
        range=(0.0, 0.1),
    )
    noise_rad: float = setting(
        1e-5,
        name="encoder_noise",
        label="Encoder noise",
        help="Standard deviation of the error of a measured angle.",
        unit="rad",
        range=(0.0, 0.01),
    )
    runs: int = setting(
        3,
        name="robots",
        label="Robots",
        help="Number of simulated robots with model errors; 0 means one ideal robot.",
        range=(0, 20),
        whole=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaybackParameters:
    """Parameters of a playback, which folds the straight chain.

    Attributes:
        controller: ``robot`` (servos with feed-forward on robots with model errors),
            ``computed-torque`` (an ideal robot; only the encoders' resolution is left),
            ``paper`` (the threshold rule) or ``direct`` (straight to the target: the baseline
            that fails).
        robot: Model errors of the robots, for the controller ``robot``.
        spacing_rad: Distance of the reference's control points along the record.
        distance_weight: Radians that a displacement of one pitch counts as, along the record.
        steps_per_rad: Simulation steps for each radian of the record's length.
        step_s: Time step.
        paced_by: ``torque``: the pace that makes the largest torque smallest. ``speed``: the
            fastest pace that the hinges' speed limit allows, whatever torque it needs. For
            simulated playbacks.
        bandwidth: Bandwidth w of computed torque, in 1/s.
        encoder_rad: Resolution of the encoders for computed torque; 0 for exact ones.
        stiffness: Servo gain kp.
        friction: Coefficient of friction of contacts.
        torque_limit: Largest torque of a motor in module masses · pitch²/s²; None for no limit.
            Motors of ``paper`` and ``direct`` are velocity constraints, as in ODE.
        threshold_rad2: The published rule: the next snapshot is the target once every hinge's
            squared error is below this.
        gain: Speed of a motor per radian of error, kp / kv, in 1/s.
        damping: Fraction of its velocity that the chain loses in each step.
        least_steps: The published rule: smallest number of steps for each snapshot.
        direct_steps: Number of steps in which the baseline's target goes from straight to folded.
        dynamic_up_to: Longest chain that is simulated, in modules; longer ones are played back by
            kinematics.
        max_steps: Number of steps after which the playback gives up.
    """

    controller: str = "robot"
    robot: RobotParameters = field(default_factory=RobotParameters)
    spacing_rad: float = 0.03
    distance_weight: float = 0.03
    steps_per_rad: float = 50.0
    step_s: float = shared(0.08, "step_s")
    paced_by: str = "torque"
    bandwidth: float = 7.5
    encoder_rad: float = ENCODER_STEP_RAD
    stiffness: float = 1e7
    friction: float = shared(0.0, "friction")
    torque_limit: float | None = setting(
        None,
        name="motor_max_force",
        label="Joint motor maximum force",
        help="Maximum torque of a hinge's motor in playback; `none` means no limit.",
        unit="module mass · pitch²/s²",
        source="named",
        range=(1e-3, 1e8),
        optional=True,
        direct=True,
    )
    threshold_rad2: float = setting(
        0.15,
        name="threshold",
        label="Maximum squared error",
        help="The motors go on to the next snapshot when every hinge's squared error is below "
        "this value.",
        unit="rad²",
        source="published",
        range=(1e-6, 10.0),
    )
    gain: float = setting(
        30.0,
        name="motor_gain",
        label="Servo gain",
        help="Speed of a motor per radian of error.",
        unit="1/s",
        source="named",
        range=(0.01, 100.0),
        direct=True,
    )
    damping: float = shared(0.0, "damping")
    least_steps: int = setting(
        1,
        name="steps_per_snapshot",
        label="Steps for each snapshot",
        help="Minimum number of motor steps for each snapshot. With 0, only the maximum "
        "squared error decides when the next snapshot follows, except at the first snapshot.",
        unit="steps",
        range=(0, 1000),
        whole=True,
    )
    direct_steps: int = 4000
    dynamic_up_to: int = setting(
        500,
        name="simulated_modules",
        label="Longest simulated chain",
        help="Longer chains are played back without a simulation of forces.",
        unit="modules",
        range=(2, 20_000),
        whole=True,
    )
    max_steps: int = 200_000


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
        """Return the parameters for a base.

        Modules of a free chain would overlap in steps as long as those of a clamped one.
        """
        return cls() if clamped else cls(step=0.12, contact_time=0.24)
