"""The gallery in words: kinds of shapes, their status, and what they need to rest on a table."""

from __future__ import annotations

import math
from typing import Final

from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, MODULE_NAMES, words_named
from foldback.planner.parameters.parameters import FLOATING, WORLD_CHOICES
from foldback.words.quantities import sentence

TAG_LABELS: Final = {
    "tool": "Tools",
    "animal": "Animals",
    "thing": "Things",
    "building": "Buildings",
    "letter": "Letters",
    "hollow": "Hollow",
    "furniture": "Furniture",
    "vehicle": "Vehicles",
    "kitchen": "Kitchen",
    "solid": "Solids",
    "ring": "Rings",
    "number": "Numbers",
    "sign": "Signs",
    "plant": "Plants",
    "snake": "Rubik’s snake",
    "puzzle": "Puzzles",
    "robot": "Robots",
    "paper": "From the paper",
}
CHAIN_LABELS: Final = {
    name: sentence(words_named(name, None).plural)
    if name == DEFAULT_MODULE or words_named(name, None) != words_named(DEFAULT_MODULE, None)
    else f"{sentence(name.replace('-', ' '))}s"
    for name in MODULE_NAMES
}
"""Labels of the kinds of chains that foldback ships, by the names of their modules."""
WORLD_LABELS: Final = {
    name: choice.label for name, choice in WORLD_CHOICES.items() if name != FLOATING
}
CARD_STATUS_LABELS: Final = {
    "verified": "Verified",
    "running": "Running",
    "failed": "Failed",
    "new": "Not folded yet",
}
METHOD_LABELS: Final = {"direct": "joints turned directly", "paper": "method from the paper"}
"""Labels on a fold's card for presets of planner settings other than the default preset."""


def rest_of(torque_wp: float | None) -> str | None:
    """Return the requirement for folding on a table; the torque is rounded up.

    Args:
        torque_wp: Torque within which a shape rests on a table, in w·p; None if unknown.
    """
    if torque_wp is None:
        return None
    if torque_wp < 0.05:
        return "Can be folded on a table (needs almost no motor torque)"
    times = f"{math.ceil(10 * torque_wp) / 10:.1f}"
    spacing_text = f"{times} modules at a distance of one spacing"
    return f"Can be folded on a table (joints must hold {spacing_text})"


def method_of(preset: str, world: str) -> str:
    """Return a fold's method in words; empty for the default method in zero gravity."""
    world_text = "on a table" if world == "table" else ""
    return ", ".join(filter(None, (METHOD_LABELS.get(preset, ""), world_text)))
