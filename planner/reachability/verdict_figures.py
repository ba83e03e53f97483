"""Figures of a verdict, as files hold them; programs that only state it load nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

VerdictKind = Literal["one-joint", "several-joints", "smaller-modules", "no-sequence", "not-found"]
"""``one-joint``: one joint at a time leads there, at full size. ``several-joints``: some turns are
made by two or three joints at once. ``smaller-modules``: one joint at a time leads there for
smaller modules alone. ``no-sequence``: one joint at a time does not lead there, which is proved.
``not-found``: none of this is known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceFigures:
    """Figures of a sequence of turns.

    Attributes:
        size: Largest size of the modules at which all turns are free.
        turns: Number of turns, of which some may be made at once.
        moves: Number of turns, those that are made at once counted once.
    """

    size: float
    turns: int
    moves: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ExhaustionFigures:
    """Figures of a proof that no single turns lead to a figure.

    Attributes:
        first: First module of the part of the chain that cannot, counted from 0.
        modules: Number of its modules.
        states: Number of states that its joints can reach.
    """

    first: int
    modules: int
    states: int


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictFigures:
    """Figures of a verdict; see ``planner.reachability.verdict.Verdict`` for their meaning."""

    kind: VerdictKind
    modules: int
    at_full_size: SequenceFigures | None
    smaller: SequenceFigures | None
    is_largest: bool
    exhaustion: ExhaustionFigures | None
    states: int
    tried: int
