"""Schemas of a failed explosion as plain JSON values: reason, modules, and evidence."""

from __future__ import annotations

from typing import Literal, TypedDict


class CrossingFigures(TypedDict):
    """``planner.explosion.failure_evidence.Crossing``."""

    over: float
    under: float
    sign: int


class KnotFigures(TypedDict):
    """``planner.explosion.failure_evidence.KnotEvidence``."""

    kind: Literal["knot"]
    determinant: int | None
    crossings: int
    closings: list[list[list[float]]]
    polygon: list[list[float]]
    sight: list[float]
    diagram: list[CrossingFigures]


class TurnFigures(TypedDict):
    """``planner.explosion.failure_evidence.Turn``."""

    hinge: int
    module: int
    turned_rad: float
    modules: list[int]
    overlap: float


class MoveFigures(TypedDict):
    """``planner.explosion.failure_evidence.Move``."""

    direction: list[int]
    moved: float
    modules: list[int]
    overlap: float


class BlockFigures(TypedDict):
    """``planner.explosion.failure_evidence.BlockEvidence``."""

    kind: Literal["blocks"]
    module_size: float
    bent_above_rad: float
    first_hinge: int
    turns: list[TurnFigures]
    unit: list[int] | None
    moves: list[MoveFigures]


class QuarterTurnFigures(TypedDict):
    """``planner.explosion.failure_evidence.QuarterTurnEvidence``."""

    kind: Literal["quarter_turns"]
    module_size: float
    turns: list[TurnFigures]


SpentKind = Literal[
    "steps", "pushes", "retries", "snapshots", "motion", "refusals", "turns", "turn_steps"
]
"""Name of a limit that can end an explosion."""


class BudgetFigures(TypedDict):
    """``planner.explosion.failure_evidence.BudgetEvidence``."""

    kind: Literal["budget"]
    spent: SpentKind
    allowed: int
    used: int
    bent_hinges: int
    largest_bend_rad: float


EvidenceFigures = KnotFigures | BlockFigures | QuarterTurnFigures | BudgetFigures


class StuckFigures(TypedDict):
    """``planner.explosion.diagnosis.Diagnosis``."""

    kind: str
    modules: list[int]
    words: str
    evidence: EvidenceFigures | None
