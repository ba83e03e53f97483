"""foldback's planner: how a straight chain of modules folds into a solid.

    from pathlib import Path
    from planner import fold, read

    plan = fold(read(Path("wrench.json").read_bytes()))
    print(plan.certificate.verdict)

Names are loaded when they are first used, so that a program that only reads a file does not carry a
simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.certificate import Certificate, certify
    from planner.chain import Chain
    from planner.errors import InputError, PlannerError, SimulationError, TimelineError
    from planner.explosion import explode
    from planner.folding import fold
    from planner.frames import Frames
    from planner.kinematics import Poses, forward_kinematics
    from planner.modules import CUBE, Module
    from planner.parameters import PRESETS, Parameters, preset
    from planner.paths import Path
    from planner.plan import Plan
    from planner.playback import Playback, play_back
    from planner.readers import read
    from planner.record import Record
    from planner.refold import refold
    from planner.smooth_plan import smooth_plan
    from planner.timeline import Timeline, TimelineWriter
    from planner.verification import Verification, verify

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
    "Verification",
    "certify",
    "explode",
    "fold",
    "forward_kinematics",
    "play_back",
    "preset",
    "read",
    "refold",
    "smooth_plan",
    "verify",
]

_HOMES = {
    "planner.certificate": ("Certificate", "certify"),
    "planner.chain": ("Chain",),
    "planner.errors": ("InputError", "PlannerError", "SimulationError", "TimelineError"),
    "planner.explosion": ("explode",),
    "planner.frames": ("Frames",),
    "planner.folding": ("fold",),
    "planner.kinematics": ("Poses", "forward_kinematics"),
    "planner.modules": ("CUBE", "Module"),
    "planner.parameters": ("PRESETS", "Parameters", "preset"),
    "planner.paths": ("Path",),
    "planner.plan": ("Plan",),
    "planner.playback": ("Playback", "play_back"),
    "planner.readers": ("read",),
    "planner.record": ("Record",),
    "planner.refold": ("refold",),
    "planner.smooth_plan": ("smooth_plan",),
    "planner.timeline": ("Timeline", "TimelineWriter"),
    "planner.verification": ("Verification", "verify"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = found
    return found
