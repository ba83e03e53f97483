"""Evidence: data of a failed explosion that another program can test.

``planner/verification/reasons.py`` is such a program. Positions are in pitches, in the frame of the
timeline's last frame of the explosion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from planner.explosion.block_evidence import BlockEvidence
from planner.motion.stuck_figures import (
    BudgetFigures,
    EvidenceFigures,
    KnotFigures,
    SpentKind,
)

Point = tuple[float, float, float]
USED_UP: Final[dict[SpentKind, str]] = {
    "steps": "the limit of {allowed} steps was reached",
    "pushes": "{allowed} random pushes in a row, the limit, made no progress",
    "retries": "the simulation failed after {used} restarts from an earlier state",
    "snapshots": "the limit of {allowed} snapshots was reached",
    "refusals": "the torque limit was exceeded {used} times; {allowed} times are allowed",
    "motion": "nothing moved any more after {used} of {allowed} steps",
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

    @property
    def words(self) -> str:
        """Evidence as a phrase in plain English."""
        which = "" if self.determinant is None else f" (determinant {self.determinant})"
        return (
            f"the chain is knotted{which}: drawn as it stalled, with its ends extended outwards, "
            f"it has {len(self.diagram)} crossings"
        )

    def as_dict(self) -> KnotFigures:
        """Return plain JSON values."""
        return {
            "kind": "knot",
            "determinant": self.determinant,
            "crossings": len(self.diagram),
            "closings": [[list(corner) for corner in corners] for corners in self.closings],
            "polygon": [list(vertex) for vertex in self.polygon],
            "sight": list(self.sight),
            "diagram": [
                {"over": each.over, "under": each.under, "sign": each.sign} for each in self.diagram
            ],
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class BudgetEvidence:
    """Limit of an explosion that was used up before the chain was straight.

    Attributes:
        spent: Kind of the limit: simulation ``steps``; ``pushes``, pulses in a row without
            progress; ``retries``, returns to the last checkpoint before an error; ``snapshots``
            that are kept; on a table, ``refusals`` of frames that need more than the torque limit;
            or, as published, the ``motion`` itself, which came to rest.
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

    @property
    def words(self) -> str:
        """Evidence as a phrase in plain English."""
        told = USED_UP[self.spent].format(allowed=_whole(self.allowed), used=_whole(self.used))
        hinges = "hinge was" if self.bent_hinges == 1 else "hinges were"
        left = (
            f"{self.bent_hinges} {hinges} still bent, by up to"
            if self.bent_hinges
            else ("no hinge was bent by more than")
        )
        return f"{told}; {left} {np.rad2deg(self.largest_bend_rad):.0f}°"

    def as_dict(self) -> BudgetFigures:
        """Return plain JSON values."""
        return {
            "kind": "budget",
            "spent": self.spent,
            "allowed": self.allowed,
            "used": self.used,
            "bent_hinges": self.bent_hinges,
            "largest_bend_rad": self.largest_bend_rad,
        }


Evidence = KnotEvidence | BlockEvidence | BudgetEvidence


def evidence_from(values: EvidenceFigures | None) -> Evidence | None:
    """Build evidence from ``as_dict``; None if an earlier version wrote none."""
    if values is None:
        return None
    if values["kind"] == "knot":
        return KnotEvidence(
            determinant=values["determinant"],
            closings=tuple(tuple(map(_point, corners)) for corners in values["closings"]),
            polygon=tuple(map(_point, values["polygon"])),
            sight=_point(values["sight"]),
            diagram=tuple(Crossing(**crossing) for crossing in values["diagram"]),
        )
    if values["kind"] == "blocks":
        return BlockEvidence.from_dict(values)
    return BudgetEvidence(
        spent=values["spent"],
        allowed=values["allowed"],
        used=values["used"],
        bent_hinges=values["bent_hinges"],
        largest_bend_rad=values["largest_bend_rad"],
    )


def _point(values: Sequence[float]) -> Point:
    return (values[0], values[1], values[2])


def _whole(number: int) -> str:
    return f"{number:,}".replace(",", "\u00a0")
