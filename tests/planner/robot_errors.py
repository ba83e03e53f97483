"""Model errors of simulated robots, one at a time, and robots without any."""

from foldback.planner.parameters.playback import RobotParameters

ERRORS = {
    "mass_error": 0.1,
    "joint_friction": 0.2,
    "encoder_step": 2e-3,
    "encoder_noise": 1e-3,
}
"""Values of the parameters that are errors, large enough to be seen."""
FAULTLESS = RobotParameters(robots=1, **dict.fromkeys(ERRORS, 0.0))
