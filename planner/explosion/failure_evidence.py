"""Failure evidence: data of a failed explosion that another program can test.

``planner/verification/failure_evidence.py`` is such a program. Positions are in pitches, in the
frame of the timeline's last frame of the explosion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, cast

import numpy as np

from foldback.planner.motion.failure_schemas import (
    BlockFigures,
    BudgetFigures,
    EvidenceFigures,
    KnotFigures,
    QuarterTurnFigures,
    SpentKind,
    StuckFigures,
)
from foldback.planner.reasons import PROGRAMS, Reader
from foldback.planner.storage.plain_values import from_plain, plain_lists

Point = tuple[float, float, float]
MAX_NAMED_PAIRS: Final = 3
"""Maximum number of modules, or of pairs of modules that block each other, that a failure message
names; further ones are only counted."""
USED_UP: Final[dict[SpentKind, str]] = {
    "steps": "the limit of {allowed} steps was reached",
    "pushes": "the limit of {allowed} random pushes in a row without progress was reached",
    "retries": "the simulation failed after {used} restarts from an earlier state",
    "snapshots": "the limit of {allowed} snapshots was reached",
    "refusals": "the torque limit was exceeded {used} times, but only {allowed} times are allowed",
    "turns": "the search for turns ended after it had tried those of {used} states",
    "turn_steps": "the turns that were found take {used} steps; {allowed} are allowed",
    "motion": "nothing moved any more after {used} of {allowed} steps",
}
Kind = Literal["knot", "buried", "contacts", "joints", "broken", "limit", "stopped", "blocked"]
STALL_TEXTS: Final[dict[str, str]] = {
    "knot": "the chain is knotted",
    "buried": "the next modules to move are covered by modules that move later",
    "contacts": "too many modules press against each other at once",
    "joints": "some joints could not turn",
    "broken": "the simulation failed",
    "limit": "the chain was still unfolding when the step limit was reached",
    "stopped": "the chain was still unfolding",
    "blocked": "no hinge can make a quarter turn by itself in the folded state",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Crossing of a diagram: one strand passes over another one.

    Attributes:
        over, under: Positions along the polygon, as edge plus fraction: 2.25 is a quarter of the
            way from vertex 2 to vertex 3.
        sign: 1 or −1, by the right-hand rule.
    """

    over: float
    under: float
    sign: int


@dataclass(frozen=True, slots=True, kw_only=True)
class KnotEvidence:
    """The chain is knotted where its explosion stopped, with its ends drawn out of it.

    Attributes:
        determinant: |Δ(−1)| of the Alexander polynomial; None where only another value of the
            polynomial was computed.
        closings: Corners by which the last module is joined to the first one, for each way in which
            the ends were drawn out: the knot is the same for all. Without corners where they touch.
        polygon: Vertices of a closed polygon of that knot.
        sight: Direction from the diagram towards the viewer.
        diagram: Crossings of the polygon, seen in that direction.
    """

    determinant: int | None
    closings: tuple[tuple[Point, ...], ...]
    polygon: tuple[Point, ...]
    sight: Point
    diagram: tuple[Crossing, ...]

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the evidence as a phrase in plain English; it is the same for all readers."""
        del reader
        determinant = (
            ""
            if self.determinant in (None, 1)
            else f" (the knot's determinant is {self.determinant}; that of a chain without a knot "
            "is 1)"
        )
        return (
            f"the chain is knotted{determinant}: a drawing of the stalled chain, with both ends "
            f"extended outwards, has {len(self.diagram)} crossings"
        )

    def as_dict(self) -> KnotFigures:
        """Return plain JSON values."""
        values = {
            "kind": "knot",
            "determinant": self.determinant,
            "crossings": len(self.diagram),
            **plain_lists(asdict(self)),
        }
        return cast("KnotFigures", values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """One hinge turned alone, and the modules that then overlap.

    Attributes:
        hinge: Index into the joint angles.
        module: The module that carries its joint.
        turned_rad: Change of its angle, rad.
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

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the evidence as a phrase in plain English."""
        parts: list[str] = []
        if self.turns:
            modules = sorted({turn.module for turn in self.turns})
            places = _listed(modules, reader.first)
            cannot = (
                f"the hinge at {places} cannot straighten"
                if len(self.turns) == 1
                else f"none of the {len(self.turns)} hinges bent by more than "
                f"{np.rad2deg(self.bent_above_rad):.0f}° (at {places}) can straighten by itself"
            )
            parts.append(f"{cannot}, {_overlaps(self.turns, reader.first)}")
        if self.moves and self.unit is not None:
            first, last = (module + reader.first for module in self.unit)
            parts.append(
                f"the part that would unfold next (modules {first} to {last}) cannot move in any "
                f"of the six directions, {_overlaps(self.moves, reader.first)}"
            )
        return f"{'; '.join(parts)} (at a module size of {self.module_size:g})"

    def as_dict(self) -> BlockFigures:
        """Return plain JSON values."""
        return cast("BlockFigures", {"kind": "blocks", **plain_lists(asdict(self))})


@dataclass(frozen=True, slots=True, kw_only=True)
class QuarterTurnEvidence:
    """No hinge of the folded chain can make a quarter turn by itself.

    Attributes:
        module_size: Size at which modules overlap, as a fraction of the pitch.
        turns: Each quarter turn that a hinge's range allows, in the order of the hinges, negative
            ones first: an angle on its way at which two modules overlap.
    """

    module_size: float
    turns: tuple[Turn, ...]

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the evidence as a phrase in plain English."""
        return (
            f"none of the {len(self.turns)} quarter turns of single hinges is free in the folded "
            f"state, {_overlaps(self.turns, reader.first)} (at a module size of "
            f"{self.module_size:g})"
        )

    def as_dict(self) -> QuarterTurnFigures:
        """Return plain JSON values."""
        values = {"kind": "quarter_turns", **plain_lists(asdict(self))}
        return cast("QuarterTurnFigures", values)


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetEvidence:
    """Limit of an explosion that was used up before the chain was straight.

    Attributes:
        spent: Kind of the limit: simulation ``steps``; ``pushes``, pulses in a row without
            progress; ``retries``, returns to the last checkpoint before an error; ``snapshots``
            taken; on a table, ``refusals`` of frames that need more than the torque limit;
            or, as published, the ``motion`` itself, which came to rest; for turns, ``turns`` of
            states that were tried, or ``turn_steps`` of a sequence that was found.
        allowed, used: Limit and count. Where a count in a row is limited, the last one used is one
            too many.
        bent_hinges: Number of hinges still bent by more than a tenth of a radian.
        largest_bend_rad: Largest bend of all hinges, rad.
    """

    spent: SpentKind
    allowed: int
    used: int
    bent_hinges: int
    largest_bend_rad: float

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the evidence as a phrase in plain English; it is the same for all readers."""
        del reader
        limit = USED_UP[self.spent].format(allowed=_whole(self.allowed), used=_whole(self.used))
        hinges = "hinge was" if self.bent_hinges == 1 else "hinges were"
        bend_limit = (
            f"{self.bent_hinges} {hinges} still bent, by up to"
            if self.bent_hinges
            else ("no hinge was bent by more than")
        )
        return f"{limit}; {bend_limit} {np.rad2deg(self.largest_bend_rad):.0f}°"

    def as_dict(self) -> BudgetFigures:
        """Return plain JSON values."""
        return cast("BudgetFigures", {"kind": "budget", **plain_lists(asdict(self))})


Evidence = KnotEvidence | BlockEvidence | QuarterTurnEvidence | BudgetEvidence


def evidence_from(values: EvidenceFigures | None) -> Evidence | None:
    """Build evidence from ``as_dict``; None without evidence.

    Raises:
        ValueError: A value is missing, or has another type.
    """
    if values is None:
        return None
    kinds = {
        "knot": KnotEvidence,
        "blocks": BlockEvidence,
        "quarter_turns": QuarterTurnEvidence,
    }
    kind = from_plain(values, dict[str, Any])["kind"]
    return from_plain(values, kinds.get(str(kind), BudgetEvidence))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """Reason why a chain does not become straight.

    Attributes:
        kind: Kind of the reason, by which the next attempt is chosen: a ``knot``, a ``buried``
            unit, a cluster of ``contacts``, stuck ``joints``, a simulation that is ``broken`` off,
            or a ``limit`` that came first; ``stopped`` if the run was ended from outside;
            ``blocked`` if no hinge of the folded chain can turn by itself, whatever the seed.
        modules: Modules whose joint is still bent, some of them at least.
        evidence: The reason, as another program can test it; None if the run was ended from
            outside.
    """

    kind: Kind
    modules: tuple[int, ...]
    evidence: Evidence | None = None

    def text(self, reader: Reader = PROGRAMS) -> str:
        """Return the reason as a phrase in plain English."""
        return STALL_TEXTS[self.kind] if self.evidence is None else self.evidence.text(reader)

    def as_dict(self) -> StuckFigures:
        """Return plain JSON values."""
        return {
            "kind": self.kind,
            "modules": list(self.modules),
            "words": self.text(),
            "evidence": self.evidence and self.evidence.as_dict(),
        }

    @classmethod
    def from_dict(cls, values: Any) -> Diagnosis:
        """Build a diagnosis from ``as_dict``.

        Raises:
            ValueError: A value has another type.
            KeyError: A value is missing.
        """
        stored = from_plain(values, dict[str, Any])
        return cls(
            kind=cast("Kind", from_plain(stored["kind"], str)),
            modules=from_plain(stored["modules"], tuple[int, ...]),
            evidence=evidence_from(stored["evidence"]),
        )


def _whole(number: int) -> str:
    return f"{number:,}".replace(",", "\u00a0")


def _listed(modules: Sequence[int], first: int) -> str:
    """Return numbers of modules as text, counted from ``first``."""
    modules = [module + first for module in modules]
    if len(modules) == 1:
        return f"module {modules[0]}"
    if len(modules) > MAX_NAMED_PAIRS:
        named = ", ".join(map(str, modules[:MAX_NAMED_PAIRS]))
        return f"modules {named} and {len(modules) - MAX_NAMED_PAIRS} more"
    return f"modules {', '.join(map(str, modules[:-1]))} and {modules[-1]}"


def _overlaps(blocks: Sequence[Turn] | Sequence[Move], first: int) -> str:
    """Return the pairs of modules that block motions, counted from ``first``."""
    pairs = list(dict.fromkeys(block.modules for block in blocks))
    named = [f"modules {a + first} and {b + first}" for a, b in pairs[:MAX_NAMED_PAIRS]]
    if unnamed := len(pairs) - len(named):
        named.append(f"and {unnamed} more pair{'' if unnamed == 1 else 's'}")
    return f"because modules would overlap: {', '.join(named)}"
