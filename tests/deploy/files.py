"""Files of deploy/: paths, settings that they name, and compose.yaml with its variables."""

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

DEPLOY = Path(__file__).parents[2] / "deploy"
EXAMPLES = (
    "compose.yaml",
    "Dockerfile",
    "Caddyfile",
    "compose.example.env",
    "database.sh",
    "alerts.yml",
    "prometheus.yml",
    "systemd/foldback-.service.d/common.conf",
    "systemd/foldback.env",
    "systemd/foldback-web.service",
    "systemd/foldback-worker@.service",
    "sweep.Dockerfile",
    *(
        f"kubernetes/{name}.yaml"
        for name in (
            *("kustomization", "namespace", "settings", "web", "worker", "workers-by-queue"),
            *("proxy", "network", "sweep/kustomization", "sweep/namespace", "sweep/dask"),
            "sweep/network",
        )
    ),
)


def settings_named(text: str) -> set[str]:
    """Return the names of the settings in a text."""
    return set(re.findall(r"\bFOLDBACK_([A-Z0-9_]+)\b", text))


def variables(name: str = "compose.example.env") -> dict[str, str]:
    """Return the variables that a file of deploy/ sets."""
    lines = (DEPLOY / name).read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


def compose(arguments: Mapping[str, str]) -> dict[str, Any]:
    """Return compose.yaml with its variables replaced, as compose does it."""

    def value(match: re.Match[str]) -> str:
        name, operator, default = match.groups()
        if name in arguments:
            return arguments[name]
        assert operator == ":-", f"{name} is not in compose.example.env"
        return default

    text = (DEPLOY / "compose.yaml").read_text()
    return yaml.safe_load(re.sub(r"\$\{([A-Z0-9_]+)(?:(:-|:\?)([^}]*))?\}", value, text))


def check(check_name: str, passed: bool) -> None:
    """Print the result of a check, and exit if it failed."""
    print(f"{'ok ' if passed else 'NOT'} {check_name}", flush=True)
    if not passed:
        sys.exit(1)
