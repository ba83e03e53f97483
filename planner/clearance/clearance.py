"""Clearance of a configuration: the least distance of its modules."""

from __future__ import annotations

from dataclasses import dataclass

from foldback.planner.arrays import Array
from foldback.planner.chain.module import Module
from foldback.planner.core import least_separation, near_pairs


@dataclass(frozen=True, slots=True, kw_only=True)
class Closest:
    """The closest place of a configuration.

    Attributes:
        clearance: Lower bound of the least distance in pitches; if modules overlap, exactly minus
            the depth of the deepest overlap.
        modules: The two modules; None if all are at least the cutoff apart.
    """

    clearance: float
    modules: tuple[int, int] | None


def closest(
    module: Module, positions: Array, rotations: Array, *, module_size: float, enough: float = 0.5
) -> Closest:
    """Find the closest place of one configuration.

    Args:
        module: The kind of module.
        positions: (n, 3) centres in pitches.
        rotations: (n, 3, 3) orientations.
        module_size: Module size as a fraction of the pitch; 1 fills the lattice.
        enough: Cutoff in pitches: distances of this and more are not told apart.
    """
    pairs = near_pairs(positions, 2.0 * module.radius * module_size + enough, module.apart)
    value, first, second = least_separation(
        positions,
        rotations,
        pairs,
        module.hull,
        module_size,
        enough,
    )
    return Closest(clearance=float(value), modules=None if first < 0 else (int(first), int(second)))
