"""Doctor: looks at all that the service needs."""

from __future__ import annotations

from typing import Final

from server.checks import data, drawing, machine
from server.checks.finding import Check, Finding, examine
from server.settings import Settings

CHECKS: Final[tuple[tuple[str, Check], ...]] = (
    ("python", machine.python),
    ("data directory", data.directory),
    ("database", data.database),
    ("job system", data.jobs),
    ("storage", data.storage),
    ("port", machine.port),
    ("allowed hosts", machine.names),
    ("memory", machine.memory),
    ("open files", machine.files),
    ("clock", machine.clock),
    ("kernels", drawing.kernels),
    ("OpenGL", drawing.gl),
    ("encoder", drawing.encoder),
)


def examined(settings: Settings) -> list[Finding]:
    """What all checks find."""
    return examine(CHECKS, settings)
