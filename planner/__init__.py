"""foldback's planner: how a straight chain of modules folds into a solid.

    from pathlib import Path
    from planner import fold, read

    plan = fold(read(Path("wrench.json").read_bytes()))
    print(plan.certificate.verdict)

What ``__all__`` names is public. Names are loaded when they are first used, so that a program that
only reads a file does not carry a simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from planner.certificate.certificate import Certificate, certify
    from planner.certificate.table_certificate import table_certificate
    from planner.certificate.table_figures import TableCertificate
    from planner.chain.chain import Chain
    from planner.chain.kinematics import Poses, forward_kinematics
    from planner.chain.module import CUBE, TETRAHEDRON, Module
    from planner.chain.path import Path
    from planner.errors import InputError, PlannerError, SimulationError, TimelineError
    from planner.explosion.simultaneous import explode
    from planner.motion.motion import Motion
    from planner.motion.record import Record
    from planner.motion.timeline import Timeline, TimelineWriter
    from planner.parameters.parameters import PRESETS, Parameters, preset
    from planner.pipeline.fold import fold, refold, smooth_plan
    from planner.plan.plan import Plan
    from planner.playback.playback import Playback, play_back
    from planner.progress import Progress
    from planner.readers import read
    from planner.verification.verify import Verification, verify

__all__ = [
    "CUBE",
    "PRESETS",
    "TETRAHEDRON",
    "Certificate",
    "Chain",
    "InputError",
    "Module",
    "Motion",
    "Parameters",
    "Path",
    "Plan",
    "PlannerError",
    "Playback",
    "Poses",
    "Progress",
    "Record",
    "SimulationError",
    "TableCertificate",
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
    "table_certificate",
    "verify",
]

_HOMES = {
    "planner.certificate.certificate": ("Certificate", "certify"),
    "planner.certificate.table_certificate": ("table_certificate",),
    "planner.certificate.table_figures": ("TableCertificate",),
    "planner.chain.chain": ("Chain",),
    "planner.errors": ("InputError", "PlannerError", "SimulationError", "TimelineError"),
    "planner.explosion.simultaneous": ("explode",),
    "planner.motion.motion": ("Motion",),
    "planner.pipeline.fold": ("fold", "refold", "smooth_plan"),
    "planner.chain.kinematics": ("Poses", "forward_kinematics"),
    "planner.chain.module": ("CUBE", "TETRAHEDRON", "Module"),
    "planner.parameters.parameters": ("PRESETS", "Parameters", "preset"),
    "planner.chain.path": ("Path",),
    "planner.plan.plan": ("Plan",),
    "planner.playback.playback": ("Playback", "play_back"),
    "planner.readers": ("read",),
    "planner.motion.record": ("Record",),
    "planner.motion.timeline": ("Timeline", "TimelineWriter"),
    "planner.progress": ("Progress",),
    "planner.verification.verify": ("Verification", "verify"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = found
    return found
