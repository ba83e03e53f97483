"""Exit statuses of commands besides 0, which means that the result is verified or possible."""

from __future__ import annotations

from typing import Final

INVALID_INPUT: Final = 2
"""Exit status of a command whose input or options are invalid; typer's own errors also use it."""
NOT_ACHIEVED: Final = 3
"""Exit status of a command that completed with a negative result: a plan that is not
verified, a shape without a path, a motion that needs too much torque, no suitable servo."""
