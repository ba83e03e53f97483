"""Unfolding: the motion from a folded configuration to straight, with which a refold begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.errors import InputError

MAX_ANGLE_DIFFERENCE_RAD: Final = 1e-6
"""Maximum difference, rad, of two hinge angles that count as equal, where rounding is to be
ignored: a plan's last frame and its folded chain, a first frame and the straight chain, an angle
and the end of a joint's range."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unfolding:
    """Folding motion of a plan, to be run backwards.

    Attributes:
        chain: The chain, folded as it is at the beginning.
        time_s: (F,) simulated time of the folding, from 0 on, s.
        folding_rad: (F, J) hinge angles of the folding, from straight to folded, rad.
        rest_frames: Frames at which the chain rests between turns, the first and the last among
            them; empty if it does not.
    """

    chain: Chain
    time_s: Array
    folding_rad: Array
    rest_frames: tuple[int, ...] = ()


def check_fits(begins: Chain, module: Module, modules: int) -> None:
    """Refuse to refold a chain into one of other modules, or of another number of them.

    Args:
        begins: The chain as it is folded at the beginning.
        module: The module that the other shape is made of.
        modules: Number of its modules.

    Raises:
        InputError: ``refold-differs``.
    """
    if module is begins.module and modules == len(begins):
        return
    got, expected = module.words.counted(modules), begins.module.words.counted(len(begins))
    differing = " that differ or follow each other in another order" if got == expected else ""
    raise InputError(
        "refold-differs",
        f"got a shape of {got}{differing}, expected {expected}, because the chain starts as "
        f"{begins.name!r}.",
    )
