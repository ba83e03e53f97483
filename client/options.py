"""Options of folds and previews, written by ``docs/make_options.py``."""

from __future__ import annotations

from typing import Literal, TypedDict


class PreviewOptions(TypedDict, total=False):
    """Options that turn a shape into a chain."""

    seed: int
    module: Literal["cube", "tetrahedron"]
    modules: int
    method: Literal["auto", "blocks", "fitted", "exact", "snake"]
    repair: bool
    ends: Literal["any", "surface"]
    threshold: int
    inside_out: bool
    thickness: int
    as_voxels: bool
    start: tuple[int, int, int]
    world: Literal["floating", "table"]


class PlanOptions(TypedDict, total=False):
    """Options of a fold that its preview has not."""

    preset: Literal["default", "paper", "direct"]
    settings: str
    module_size: float
    joint_error: str
    strategy: Literal["auto", "simultaneous", "blocks", "peel", "turns", "one-by-one"]
    at_once: int
    prefer: Literal["computing", "time", "torque", "clearance", "margin", "calm"]
