"""Block evidence: modules that block each other, and the directions in which they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.motion.stuck_figures import BlockFigures, MoveFigures, TurnFigures

MOST_NAMED: Final = 3
"""Pairs, and modules, that the words name one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One hinge turned towards straight, alone, and what it runs into.

    Attributes:
        hinge: Index into the joint angles.
        module: The module that carries its joint.
        turned_rad: By how much its angle was changed; the sign is that towards straight.
        modules: Two modules that then overlap, and had not before.
        overlap: How deep, in pitches.
    """

    hinge: int
    module: int
    turned_rad: float
    modules: tuple[int, int]
    overlap: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """The unit that a peeling has to let go next, moved as it is, and what it runs into.

    Attributes:
        direction: Along the lattice of the folded chain, whose module 0 is upright.
        moved: How far, in pitches.
        modules: A module of the unit and one of the core that then overlap.
        overlap: How deep, in pitches.
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
        first_hinge: Hinges before it are those of a peeling's core, which have none.
        turns: Of all the others that are bent.
        unit: First and last module of the unit that a peeling lets go next; None where nothing is
            left to let go, or no peeling.
        moves: Of that unit, in all six directions; none where it is free in one of them.
    """

    module_size: float
    bent_above_rad: float
    first_hinge: int
    turns: tuple[Turn, ...]
    unit: tuple[int, int] | None
    moves: tuple[Move, ...]

    @property
    def words(self) -> str:
        """The same in plain words."""
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
        """Plain JSON values."""
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
        """From ``as_dict``."""
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
    if len(modules) > MOST_NAMED:
        some = ", ".join(map(str, modules[:MOST_NAMED]))
        return f"modules {some} and {len(modules) - MOST_NAMED} more"
    return f"modules {', '.join(map(str, modules[:-1]))} and {modules[-1]}"


def _pairs(found: Sequence[Turn] | Sequence[Move]) -> str:
    pairs = list(dict.fromkeys(each.modules for each in found))
    told = ", ".join(f"module {a} against {b}" for a, b in pairs[:MOST_NAMED])
    return told + (
        "" if len(pairs) <= MOST_NAMED else f", and {len(pairs) - MOST_NAMED} pairs more"
    )
