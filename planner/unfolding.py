"""Unfolding: the way back from a folded configuration to straight, with which a refold begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.errors import InputError
from planner.frames import PHASES

if TYPE_CHECKING:
    from planner.plan import Plan

Array = NDArray[np.float64]
ENDS_WITHIN_RAD: Final = 1e-6
START_CHAIN: Final = "start.json"
START_PLAN: Final = "start.npz"
"""In a refold's directory: the chain as it is folded at the beginning, and the plan for that."""


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

    @classmethod
    def of_plan(cls, plan: Plan) -> Unfolding:
        """The way back of a plan; of one that is a refold itself, that of its second half.

        Raises:
            InputError: ``refold-not-folded`` when the plan does not lead from straight to folded.
        """
        folding = plan.phase == PHASES.index("playback")
        angles, times = plan.joint_angles_rad[folding], plan.time_s[folding]
        folded = plan.chain.folded_rad
        if not (
            len(angles) > 1
            and np.isfinite(angles).all()
            and np.isfinite(times).all()
            and (np.diff(times) >= 0.0).all()
            and np.abs(angles[0]).max() <= ENDS_WITHIN_RAD
            and np.abs(angles[-1] - folded).max() <= ENDS_WITHIN_RAD
        ):
            raise InputError(
                "refold-not-folded",
                f"got a plan of {plan.chain.name} that does not lead from straight to folded, "
                "expected one that does; fold that shape again, with another seed or preset.",
            )
        return cls(chain=plan.chain, time_s=times - times[0], folding_rad=angles)


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
