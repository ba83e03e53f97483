"""Verdict on a figure: whether turns lead to it from straight, or from another figure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from foldback.planner.arrays import Array
from foldback.planner.core.structures import Levels
from foldback.planner.reachability.verdict_figures import (
    ExhaustionFigures,
    SequenceFigures,
    VerdictFigures,
    VerdictKind,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exhaustion:
    """Proof that no single turns at full size lead from a figure to a goal.

    The modules of a part of the chain alone cannot: whatever the whole chain does, its joints only
    make turns that are free for them, too.

    Attributes:
        first: First module of the part.
        modules: Number of modules of the part.
        states: (S, J) every state of its joints that can be reached, the figure's first.
        goal: (J,) state of its joints at the goal, which is not among them.
    """

    first: int
    modules: int
    states: Levels
    goal: Levels

    def figures(self) -> ExhaustionFigures:
        """Return the proof without its states."""
        return ExhaustionFigures(first=self.first, modules=self.modules, states=len(self.states))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sequence:
    """Turns from a goal to a figure.

    Attributes:
        rest_angles_rad: (T + 1, J) hinge angles before, between and after the turns; neighbours
            differ by one step of one joint, or of some that turn at once.
        size: Largest size of the modules at which all turns are free, at most 1. Each is scaled
            about its centre.
    """

    rest_angles_rad: Array
    size: float

    @property
    def turns(self) -> int:
        """Number of turns, of which some may be made at once."""
        return int((abs(self.rest_angles_rad[1:] - self.rest_angles_rad[:-1]) > 1e-9).sum())

    @property
    def moves(self) -> int:
        """Number of turns, those that are made at once counted once."""
        return len(self.rest_angles_rad) - 1

    def figures(self) -> SequenceFigures:
        """Return the numbers of turns and their size."""
        return SequenceFigures(size=self.size, turns=self.turns, moves=self.moves)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Verdict:
    """A decision whether turns lead to a figure.

    Attributes:
        kind: The best that is known.
        figure: (J,) levels of the figure: angles in steps.
        goal: (J,) levels of the goal.
        modules: Number of modules.
        at_full_size: Turns at full size, of one joint at a time or of several; None if there are
            none, or none was found.
        smaller: Turns of one joint at a time for smaller modules; None if not asked for or not
            found.
        is_largest: True if no size of the modules that is larger by 0.0002 or more allows single
            turns, which is proved.
        exhaustion: Proof that single turns at full size do not lead there.
        states: Number of states that were tried in all.
        tried: Number of turns that were tried in all.
    """

    kind: VerdictKind
    figure: Levels
    goal: Levels
    modules: int
    at_full_size: Sequence | None
    smaller: Sequence | None
    is_largest: bool
    exhaustion: Exhaustion | None
    states: int
    tried: int

    @property
    def sequence(self) -> Sequence | None:
        """The turns at the largest size for which some are known."""
        return self.at_full_size or self.smaller

    def figures(self) -> VerdictFigures:
        """Return the verdict without its turns and states."""
        full, smaller, proof = self.at_full_size, self.smaller, self.exhaustion
        return VerdictFigures(
            kind=self.kind,
            modules=self.modules,
            at_full_size=None if full is None else full.figures(),
            smaller=None if smaller is None else smaller.figures(),
            is_largest=self.is_largest,
            exhaustion=None if proof is None else proof.figures(),
            states=self.states,
            tried=self.tried,
        )

    def report(self) -> dict[str, Any]:
        """Return the verdict as JSON values."""
        sequence, proof = self.sequence, self.exhaustion
        return {
            "verdict": self.kind,
            "modules": self.modules,
            "turns": None if sequence is None else sequence.turns,
            "moves": None if sequence is None else sequence.moves,
            "largest_size": None if sequence is None else round(sequence.size, 4),
            "is_largest": self.is_largest,
            "no_single_turns": None
            if proof is None
            else {
                "first_module": proof.first,
                "modules": proof.modules,
                "states": len(proof.states),
            },
            "states": self.states,
            "tried": self.tried,
        }
