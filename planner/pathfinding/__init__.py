"""Paths through shapes: an order in which a chain can visit every cell once."""

from __future__ import annotations

from planner.pathfinding.blocks import block_path, halved
from planner.pathfinding.candidates import METHODS, PathSearch, find_paths
from planner.pathfinding.exact import ExactSearch, exact_path
from planner.pathfinding.snake import is_box, snake_path

__all__ = [
    "METHODS",
    "ExactSearch",
    "PathSearch",
    "block_path",
    "exact_path",
    "find_paths",
    "halved",
    "is_box",
    "snake_path",
]
