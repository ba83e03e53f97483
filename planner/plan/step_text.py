"""Sentences for the steps of a fold: where to turn, how far, and what to hold."""

from __future__ import annotations

import numpy as np

from foldback.planner.chain.module import Module
from foldback.planner.plan.steps import Modules, Step, Turn


def ordinal(number: int) -> str:
    """Return a number as a numeral: 1st, 2nd, 3rd or 4th."""
    ending = "th" if number // 10 % 10 == 1 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def modules_text(module: Module, modules: Modules) -> str:
    """Return consecutive modules as text, counted from 1: cubes 8 to 24."""
    first, last = (number + 1 for number in modules)
    if first == last:
        return f"{module.words.singular} {first}"
    return f"{module.words.plural} {first} {'and' if last == first + 1 else 'to'} {last}"


def angle_text(turn: Turn) -> str:
    """Return the angle of a turn in degrees, with its sign."""
    return f"{np.rad2deg(turn.angle_rad):+.4g}°".replace("-", "−")


def turn_text(module: Module, turn: Turn) -> str:
    """Return a turn as text: 7th cube, +90° (z)."""
    hinge = module.hinge_names[turn.hinge % module.hinges_per_joint]
    axis = f" ({hinge})" if hinge else ""
    return f"{ordinal(turn.module + 1)} {module.words.singular}, {angle_text(turn)}{axis}"


def step_text(module: Module, step: Step, *, max_listed: int = 5) -> str:
    """Return what to do in a step: Turn at the 7th cube, +90° (z). Hold cubes 8 to 24.

    Args:
        module: Kind of the modules.
        step: The step.
        max_listed: Maximum number of turns that are listed.
    """
    hold = f"Hold {modules_text(module, step.held)}."
    turns = [turn_text(module, turn) for turn in step.turns]
    # Turns are at a module's centre, or at its border with the next one.
    central = not any(module.piece(turn.module).exit.any() for turn in step.turns)
    preposition = "at" if central else "after"
    if len(turns) == 1:
        return f"Turn {preposition} the {turns[0]}. {hold}"
    unlisted = len(turns) - max_listed
    listed = "; ".join(turns[:max_listed] if unlisted > 1 else turns)
    suffix = f"; and {unlisted} more" if unlisted > 1 else ""
    return f"Make {len(turns)} turns together, {preposition} the {listed}{suffix}. {hold}"
