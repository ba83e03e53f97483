"""Suggestions: the buttons that request another fold like a given one, or show it."""

from __future__ import annotations

from typing import Final, NamedTuple

from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES
from foldback.planner.pipeline.preference import Preference
from foldback.words.plan_choice import PREFERENCE_WORDS


class Button(NamedTuple):
    """Text of a button, and the hint beside it."""

    text: str
    hint: str = ""


AGAIN_LABELS: Final = {
    "same": "Fold again",
    "preset": "Try foldback’s own method",
    "module_size": "Try the default module size",
    "strategy": "Try to unfold all hinges at once",
    "seed": "Try another random start",
}
"""Buttons that try a failed or cancelled fold again, by what changes."""
RECORDED: Final = Button("Before smoothing", "The original plan")
FLOATING_FOLD: Final = Button("In zero gravity", "The same fold without a table")
PUBLISHED_CHANGED: Final = Button("As in the paper, changed", "With your own settings")
EXPLOSION: Final = Button("All hinges at once", "Smooth motion, without rests between turns")
OTHER_PRESETS: Final = {
    "default": Button(
        "foldback’s own method", "Single turns for short chains, otherwise all hinges at once"
    ),
    "direct": Button(
        "Joints turned directly",
        "Every joint turns straight to its final angle; fails for most shapes",
    ),
}
"""Presets, besides the published one, that a fold may be compared with."""


def another_seed(seed: int) -> Button:
    """Return the button for the same fold with another seed."""
    return Button("Another random start", f"Random start {seed}")


def on_a_table(time: str, modules: int) -> Button:
    """Return the button for a fold on a table.

    Args:
        time: Expected time in words.
        modules: Number of modules; the button warns that long chains usually get stuck.
    """
    stuck = "; chains this long usually get stuck" if modules > MAX_TABLE_MODULES else ""
    return Button("On a table", f"With gravity, takes {time}{stuck}")


def preferring(preference: Preference, time: str) -> Button:
    """Return the button for a fold with another preference that takes a time in words."""
    return Button(PREFERENCE_WORDS[preference], f"Takes {time}")


def published(time: str) -> Button:
    """Return the button for a fold by the published method that takes a time in words."""
    return Button("As in the paper", f"Takes {time}")


def about(seconds: float) -> str:
    """Return a time that is not known exactly: ``about a minute``."""
    minutes = round(seconds / 60)
    if minutes > 1:
        return f"about {minutes} minutes"
    return "about a minute" if seconds >= 45 else "less than a minute"
