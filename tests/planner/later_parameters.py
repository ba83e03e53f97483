"""Parameters of a later version, which has more of them than the plans that exist."""

from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from foldback.planner.parameters.parameters import Parameters, preset
from foldback.planner.parameters.playback import RobotParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class LaterRobotParameters(RobotParameters):
    """Robot parameters with one more."""

    made_up_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LaterParameters(Parameters):
    """Parameters with a whole part more."""

    gripper: RobotParameters = field(default_factory=LaterRobotParameters)


def later(name: str, **extra: Any) -> Parameters:
    """Return a preset as a later version has it.

    Args:
        name: Name of the preset.
        extra: Values of the parameters that the later version adds to those of robots.
    """
    parameters = preset(name)
    field_values = {field.name: getattr(parameters, field.name) for field in fields(parameters)}
    robot = LaterRobotParameters(**asdict(parameters.playback.robot), **extra)
    field_values["playback"] = replace(parameters.playback, robot=robot)
    return LaterParameters(**field_values)
