"""foldback: how a straight chain of modules folds into a solid.

    from pathlib import Path
    from foldback.planner import fold, read

    plan = fold(read(Path("wrench.json").read_bytes()))
    print(plan.certificate.verdict)

What ``__all__`` names is public. Names are loaded when they are first used, so that a program that
only reads a file does not carry a simulator.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from foldback.planner.certificate.certificate import Certificate, certify
    from foldback.planner.certificate.table_certificate import table_certificate
    from foldback.planner.certificate.table_figures import TableCertificate
    from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
    from foldback.planner.chain.chain import Chain
    from foldback.planner.chain.kinematics import Poses, forward_kinematics
    from foldback.planner.chain.module import Module
    from foldback.planner.chain.path import Path
    from foldback.planner.errors import InputError, PlannerError, SimulationError, TimelineError
    from foldback.planner.explosion.simultaneous import explode
    from foldback.planner.motion.motion import Motion
    from foldback.planner.motion.record import Record
    from foldback.planner.motion.timeline import Timeline, TimelineWriter
    from foldback.planner.parameters.parameters import PRESETS, Parameters, preset
    from foldback.planner.pipeline.fold import fold, refold, smooth_plan
    from foldback.planner.plan.plan import Plan
    from foldback.planner.playback.playback import Playback, play_back
    from foldback.planner.progress import Progress
    from foldback.planner.readers import read
    from foldback.planner.verification.verify import Verification, verify

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
    "foldback.planner.certificate.certificate": ("Certificate", "certify"),
    "foldback.planner.certificate.table_certificate": ("table_certificate",),
    "foldback.planner.certificate.table_figures": ("TableCertificate",),
    "foldback.planner.chain.chain": ("Chain",),
    "foldback.planner.errors": ("InputError", "PlannerError", "SimulationError", "TimelineError"),
    "foldback.planner.explosion.simultaneous": ("explode",),
    "foldback.planner.motion.motion": ("Motion",),
    "foldback.planner.pipeline.fold": ("fold", "refold", "smooth_plan"),
    "foldback.planner.chain.kinematics": ("Poses", "forward_kinematics"),
    "foldback.planner.chain.built_in_modules": ("CUBE", "TETRAHEDRON"),
    "foldback.planner.chain.module": ("Module",),
    "foldback.planner.parameters.parameters": ("PRESETS", "Parameters", "preset"),
    "foldback.planner.chain.path": ("Path",),
    "foldback.planner.plan.plan": ("Plan",),
    "foldback.planner.playback.playback": ("Playback", "play_back"),
    "foldback.planner.readers": ("read",),
    "foldback.planner.motion.record": ("Record",),
    "foldback.planner.motion.timeline": ("Timeline", "TimelineWriter"),
    "foldback.planner.progress": ("Progress",),
    "foldback.planner.verification.verify": ("Verification", "verify"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value
