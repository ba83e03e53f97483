"""Exempt pairs: linked modules, which no check of clearance tests, and how deep they overlap.

Modules fewer than ``Module.apart`` links from each other share a joint, and their full-size hulls
overlap while it turns. So a real module lacks some material there, its *relief*: decision 0018.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.clearance.relief import near_faces, relief_radius, relief_share
from foldback.planner.core import deepest_overlap
from foldback.planner.core.structures import Link
from foldback.planner.motion.motion import Motion, as_motion

RULE_LINKED: Final = "consecutive modules (i, i+1)"
"""Text for certificates of chains of cubes: the rule by which consecutive modules, which overlap at
their common joint, are exempt from the collision check."""
RULE_NONE: Final = "none"
"""Text for certificates that no pair of modules is exempt from the collision check."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Closest place of a motion: frame number (a fraction means between two) and two modules."""

    frame: float
    modules: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExemptPairs:
    """Pairs of modules that are not checked against each other. Lengths in pitches.

    Attributes:
        rule: Rule that exempts them, in words.
        apart: The pairs are (i, j) with i < j < i + apart.
        count: Number of pairs.
        worst_overlap: Deepest overlap of such a pair in the motion at the module size, at frames
            and halfway between them. 0 when there is none, None when there is no motion.
        worst_overlap_at: Place of the deepest overlap; None if nothing overlaps.
        worst_overlap_bound: Upper bound of the overlap over the motion; None without a motion.
        relief_radius: A real module lacks all material that is farther than this from its joint
            along any direction in which the next module may lie, see ``relief.reach``. None if it
            lacks nothing.
        relief_share: Fraction (0…1) of its volume that it lacks.
    """

    rule: str
    apart: int
    count: int
    worst_overlap: float | None
    worst_overlap_at: Place | None
    worst_overlap_bound: float | None
    relief_radius: float | None
    relief_share: float


def exempt_pairs(
    chain: Chain, motions: Sequence[Motion | Array], *, module_size: float
) -> ExemptPairs:
    """Return the pairs of a chain that are not checked, and how deep they overlap in motions.

    Args:
        chain: The chain.
        motions: Motions, or the (F, J) hinge angles of each, rad; may be empty.
        module_size: Module size as a fraction of the pitch.
    """
    module, count = chain.module, len(chain)
    pairs = len(module.exempt_pairs(count))
    depth, bound, place = 0.0, 0.0, None
    for motion in motions if pairs and len(chain.folded_rad) else ():
        motion = as_motion(motion)
        overlap = deepest_overlap(
            _link(module, module_size),
            chain.folded_rad,
            np.ascontiguousarray(motion.first, dtype=np.int64),
            np.ascontiguousarray(motion.offsets, dtype=np.int64),
            np.ascontiguousarray(motion.angles_rad, dtype=np.float64),
        )
        bound = max(bound, overlap.bound)
        if overlap.depth > depth:
            holds = overlap.joint + module.rigid_links
            depth = overlap.depth
            place = Place(frame=overlap.frame, modules=(holds, holds + 1))
    return ExemptPairs(
        rule=RULE_LINKED if pairs else RULE_NONE,
        apart=module.apart,
        count=pairs,
        worst_overlap=depth if motions else None,
        worst_overlap_at=place,
        worst_overlap_bound=bound if motions else None,
        relief_radius=relief_radius(module, float(module_size)),
        relief_share=relief_share(module, float(module_size)),
    )


def _link(module: Module, module_size: float) -> Link:
    return Link(
        joint=module.joint,
        hull=module.hull,
        size=float(module_size),
        face=module.joint.offset / np.linalg.norm(module.joint.offset, axis=1, keepdims=True),
        distance=near_faces(module, module_size),
    )
