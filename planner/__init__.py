"""foldback's planner: how a straight chain of modules folds into a solid.

from planner import Path, fold, read
plan = fold(read(open("wrench.json", "rb").read()))
print(plan.certificate.verdict)
"""

from planner.certificate import Certificate, certify
from planner.chain import Chain
from planner.errors import InputError, PlannerError, SimulationError, TimelineError
from planner.explosion import explode
from planner.fold import fold
from planner.kinematics import Poses, forward_kinematics
from planner.modules import CUBE, Module
from planner.parameters import PRESETS, Parameters, preset
from planner.paths import Path
from planner.plan import Plan
from planner.playback import Playback, play_back
from planner.readers import read
from planner.record import Record
from planner.timeline import Frames, Timeline, TimelineWriter

__all__ = [
    "CUBE",
    "PRESETS",
    "Certificate",
    "Chain",
    "Frames",
    "InputError",
    "Module",
    "Parameters",
    "Path",
    "Plan",
    "PlannerError",
    "Playback",
    "Poses",
    "Record",
    "SimulationError",
    "Timeline",
    "TimelineError",
    "TimelineWriter",
    "certify",
    "explode",
    "fold",
    "forward_kinematics",
    "play_back",
    "preset",
    "read",
]
