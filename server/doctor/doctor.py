"""Doctor: all checks of the service's requirements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import ValidationError

from foldback.server.doctor import children, data, drawing, machine
from foldback.server.doctor.check_result import Check, CheckResult, examine
from foldback.server.ops.startup_errors import REMEDY, settings_words
from foldback.server.settings import Settings

CHECKS: Final[tuple[tuple[str, Check], ...]] = (
    ("python", machine.python),
    ("settings", machine.variables),
    ("data directory", data.directory),
    ("database", data.database),
    ("storage", data.storage),
    ("port", machine.port),
    ("allowed hosts", machine.names),
    ("memory", machine.memory),
    ("open files", machine.files),
    ("clock", machine.clock),
    ("core", drawing.core),
    ("MuJoCo", drawing.mujoco),
    ("computing processes", children.confinement),
    ("OpenGL", drawing.gl),
    ("encoder", drawing.encoder),
)


def examined(fields: Mapping[str, Any]) -> list[CheckResult]:
    """Return the results of all checks, or the errors of the settings.

    Args:
        fields: Settings from the command line, by name; None if not given.
    """
    try:
        settings = Settings(**{name: value for name, value in fields.items() if value is not None})
    except ValidationError as error:
        fault = settings_words(error)
        return [CheckResult(name="settings", verdict="problem", finding=fault, remedy=REMEDY)]
    return examine(CHECKS, settings)
