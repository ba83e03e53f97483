"""Exit statuses of commands, besides 0: done, and what was computed is verified or possible."""

from __future__ import annotations

from typing import Final

INVALID_INPUT: Final = 2
"""Exit status of a command whose input or options are invalid, as typer's own errors have it."""
NOT_ACHIEVED: Final = 3
"""Exit status of a command that came to its end with a negative result: a plan that is not
verified, a shape without a path, a motion that needs too much torque, no suitable servo."""
