"""Descriptions of the service for programs and for the command line, as text."""

import json
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from foldback.server.cli.command_line import COMMANDS
from tests.server.cli.test_command_line import foldback

WIDTH = 100
"""Width of the terminal for which help texts are formatted, in columns."""


def openapi_text(description: dict[str, Any]) -> str:
    """Return an OpenAPI description with its fields in their order, without the version."""
    expected = {**description, "info": {**description["info"], "version": "…"}}
    return json.dumps(expected, indent=1, ensure_ascii=False) + "\n"


def help_text() -> str:
    """Return the help of every command and of its subcommands."""
    return "\n".join(f"$ foldback {' '.join(words)}\n{text}" for words, text in _helps())


def _helps() -> Iterator[tuple[list[str], str]]:
    yield ["--help"], _help("--help")
    for command in COMMANDS:
        text = _help(command, "--help")
        yield [command, "--help"], text
        _, _, listed = text.partition("─ Commands ─")
        for line in listed.splitlines()[1:]:
            if (name := line.strip("│ ").partition(" ")[0]).isidentifier():
                yield [command, name, "--help"], _help(command, name, "--help")


def _help(*words: str) -> str:
    text = foldback(*words, COLUMNS=str(WIDTH), TERM="dumb", NO_COLOR="1").stdout
    lines = [line.rstrip() for line in text.replace(version("foldback"), "…").splitlines()]
    return "\n".join(lines).strip("\n") + "\n"
