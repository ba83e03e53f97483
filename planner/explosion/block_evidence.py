"""Block evidence: modules that block each other, and the directions in which they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.motion.stuck_figures import BlockFigures, MoveFigures, TurnFigures

MAX_NAMED_PAIRS: Final = 3
"""Maximum number of pairs, or modules, that a message lists; it counts the others. Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One hinge turned towards straight, alone, and the modules that then overlap.

    Attributes:
        hinge: Index into the joint angles.
        module: The module that carries its joint.
        turned_rad: Change of its angle, rad; its sign is that of the way towards straight.
        modules: Two modules that then overlap, and had not before.
        overlap: Depth of that overlap, in pitches.
    """

    hinge: int
    module: int
    turned_rad: float
    modules: tuple[int, int]
    overlap: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """One rigid move of the unit that a peeling releases next, and the modules it runs into.

    Attributes:
        direction: Lattice direction in the frame of the folded chain's module 0.
        moved: Distance of the move, in pitches.
        modules: A module of the unit and one of the core that then overlap.
        overlap: Depth of that overlap, in pitches.
    """

    direction: tuple[int, int, int]
    moved: float
    modules: tuple[int, int]
    overlap: float


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockEvidence:
    """Modules that block each other: no bent hinge can turn towards straight by itself.

    Attributes:
        module_size: Size at which modules overlap, as a fraction of the pitch: what is recorded
            keeps clear at it.
        bent_above_rad: Each hinge bent by more has its turn here.
        first_hinge: First hinge that is released; those before it belong to a peeling's core.
        turns: One turn of each bent hinge from ``first_hinge`` on.
        unit: First and last module of the unit that a peeling releases next; None if all are
            released, or the strategy is another one.
        moves: One move of that unit in each of the six directions; empty if one of them is free.
    """

    module_size: float
    bent_above_rad: float
    first_hinge: int
    turns: tuple[Turn, ...]
    unit: tuple[int, int] | None
    moves: tuple[Move, ...]

    @property
    def words(self) -> str:
        """Evidence as a phrase in plain English."""
        parts: list[str] = []
        if self.turns:
            modules = sorted({turn.module for turn in self.turns})
            one = len(self.turns) == 1
            what = (
                "the hinge"
                if one
                else f"the {len(self.turns)} hinges bent by more than "
                + (f"{np.rad2deg(self.bent_above_rad):.0f}°")
            )
            parts.append(
                f"{what} at {_listed(modules)} cannot straighten"
                f"{'' if one else ', each by itself'}: {_pairs(self.turns)}"
            )
        if self.moves and self.unit is not None:
            parts.append(
                f"modules {self.unit[0]} to {self.unit[1]}, which come next, cannot move in any of "
                f"the six directions: {_pairs(self.moves)}"
            )
        return f"{'; '.join(parts)} (at a module size of {self.module_size:g})"

    def as_dict(self) -> BlockFigures:
        """Return plain JSON values."""
        turns: list[TurnFigures] = [
            {
                "hinge": turn.hinge,
                "module": turn.module,
                "turned_rad": turn.turned_rad,
                "modules": list(turn.modules),
                "overlap": turn.overlap,
            }
            for turn in self.turns
        ]
        moves: list[MoveFigures] = [
            {
                "direction": list(move.direction),
                "moved": move.moved,
                "modules": list(move.modules),
                "overlap": move.overlap,
            }
            for move in self.moves
        ]
        return {
            "kind": "blocks",
            "module_size": self.module_size,
            "bent_above_rad": self.bent_above_rad,
            "first_hinge": self.first_hinge,
            "turns": turns,
            "unit": None if self.unit is None else list(self.unit),
            "moves": moves,
        }

    @classmethod
    def from_dict(cls, values: BlockFigures) -> BlockEvidence:
        """Build the evidence from the values of ``as_dict``."""
        return cls(
            module_size=values["module_size"],
            bent_above_rad=values["bent_above_rad"],
            first_hinge=values["first_hinge"],
            turns=tuple(
                Turn(
                    hinge=turn["hinge"],
                    module=turn["module"],
                    turned_rad=turn["turned_rad"],
                    modules=_pair(turn["modules"]),
                    overlap=turn["overlap"],
                )
                for turn in values["turns"]
            ),
            unit=None if values["unit"] is None else _pair(values["unit"]),
            moves=tuple(
                Move(
                    direction=(move["direction"][0], move["direction"][1], move["direction"][2]),
                    moved=move["moved"],
                    modules=_pair(move["modules"]),
                    overlap=move["overlap"],
                )
                for move in values["moves"]
            ),
        )


def _pair(values: Sequence[int]) -> tuple[int, int]:
    return (values[0], values[1])


def _listed(modules: Sequence[int]) -> str:
    if len(modules) == 1:
        return f"module {modules[0]}"
    if len(modules) > MAX_NAMED_PAIRS:
        some = ", ".join(map(str, modules[:MAX_NAMED_PAIRS]))
        return f"modules {some} and {len(modules) - MAX_NAMED_PAIRS} more"
    return f"modules {', '.join(map(str, modules[:-1]))} and {modules[-1]}"


def _pairs(found: Sequence[Turn] | Sequence[Move]) -> str:
    pairs = list(dict.fromkeys(each.modules for each in found))
    told = ", ".join(f"module {a} against {b}" for a, b in pairs[:MAX_NAMED_PAIRS])
    return told + (
        "" if len(pairs) <= MAX_NAMED_PAIRS else f", and {len(pairs) - MAX_NAMED_PAIRS} pairs more"
    )
