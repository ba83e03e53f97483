"""Where the files of deploy/ are, and which settings they name."""

from __future__ import annotations

import re
from pathlib import Path

DEPLOY = Path(__file__).parents[2] / "deploy"
EXAMPLES = (
    "compose.yaml",
    "Dockerfile",
    "Caddyfile",
    "example.env",
    "systemd/foldback.env",
    "systemd/foldback-web.service",
    "systemd/foldback-worker@.service",
)


def settings_named(text: str) -> set[str]:
    """The settings that a text sets or speaks of."""
    return set(re.findall(r"\bFOLDBACK_([A-Z0-9_]+)\b", text))
