"""Unfolding: the way back from a folded configuration to straight, with which a refold begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import InputError

Array = NDArray[np.float64]
ENDS_WITHIN_RAD: Final = 1e-6
"""Angle that a plan's last frame may differ by from the chain's folded angles."""
START_CHAIN: Final = "start.json"
"""In a refold's directory: the chain as it is folded at the beginning."""
START_PLAN: Final = "start.npz"
"""In a refold's directory: the plan that folds that chain."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unfolding:
    """A plan's folding, which is to be run backwards.

    Attributes:
        chain: The chain, folded as it is at the beginning.
        time_s: (F,) simulated time of the folding, from 0 on.
        folding_rad: (F, J) hinge angles of the folding, from straight to folded.
    """

    chain: Chain
    time_s: Array
    folding_rad: Array


def check_fits(begins: Chain, module: str, modules: int) -> None:
    """Refuses to refold a chain into one of other modules, or of another number of them.

    Args:
        begins: The chain as it is folded at the beginning.
        module: The kind of module that the other shape is made of.
        modules: How many of them.

    Raises:
        InputError: ``refold-differs``.
    """
    if (module, modules) != (begins.module.name, len(begins)):
        raise InputError(
            "refold-differs",
            f"got a shape of {modules} {PLURALS[module]}, expected one of {len(begins)} "
            f"{PLURALS[begins.module.name]}, as {begins.name} has.",
        )


PLURALS: Final = {"cube": "cubes", "tetrahedron": "tetrahedra"}
