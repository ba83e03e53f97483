"""Attempt: one explosion or smoothing that may be made, and what came of it and its playback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

from planner.explosion.diagnosis import Diagnosis, Kind
from planner.motion.record import RecordStatus
from planner.pipeline.preference import PlanFigures

Reason = Kind | Literal["refused"]
MOST: Final = 6
"""Explosions of one fold, at most."""


@dataclass(frozen=True, slots=True)
class Try:
    """One explosion that may be made.

    Attributes:
        candidate: Which of the paths.
        seed: What randomness starts from.
        strategy: How the chain is let go.
        other_end: Whether the path is taken from its other end.
        gentle: Whether it is let go with half the force.
        smooths: The attempt, by its place among all, whose verified plan is smoothed in place of
            an explosion; the strategy then is one of ``planner.robot.SMOOTHING_WAYS``. None for an
            explosion.
    """

    candidate: int
    seed: int
    strategy: str
    other_end: bool = False
    gentle: bool = False
    smooths: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """What came of an explosion, and of its playback.

    Attributes:
        todo: Which explosion it is.
        status: Of its record; ``begun`` while there is none.
        reason: Of its record: why it is not straight.
        steps, frames, seconds: Of its record.
        diagnosis: Why it did not end straight.
        finer: How many times as many frames its playback records as usual. More than 1 repeats the
            playback of the attempt before it, and explodes nothing.
        verdict: Of its certificate; None until that is there.
        figures: What it is compared by; None until its certificate is there.
        between: Whether its frames are clear and only the way from one of the playback to the next
            is not.
        chosen: Whether its plan is the fold's.
    """

    todo: Try
    status: RecordStatus | Literal["begun"]
    reason: str = ""
    steps: int = 0
    frames: int = 0
    seconds: float = 0.0
    diagnosis: Diagnosis | None = None
    finer: int = 1
    verdict: str | None = None
    figures: PlanFigures | None = None
    between: bool = False
    chosen: bool = False

    @property
    def verified(self) -> bool:
        """Whether its plan may be trusted."""
        return self.verdict is not None and self.verdict.startswith("verified")

    @property
    def why(self) -> Reason:
        """Why it was not the last one."""
        if self.status == "straight":
            return "refused"
        return "limit" if self.diagnosis is None else self.diagnosis.kind

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, as ``attempts.json`` and plans have them."""
        values: dict[str, Any] = {**asdict(self.todo), "status": self.status}
        if self.todo.smooths is None:
            del values["smooths"]
        if self.status == "begun":
            return values
        values |= {name: getattr(self, name) for name in ("reason", "steps", "frames", "seconds")}
        values["diagnosis"] = self.diagnosis and self.diagnosis.as_dict()
        if self.finer > 1:
            values["finer"] = self.finer
        if self.verdict is not None:
            values |= {"verdict": self.verdict, "between": self.between}
        if self.figures is not None:
            values["figures"] = asdict(self.figures)
        if self.chosen:
            values["chosen"] = True
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Attempt:
        """From ``as_dict``; what an older version did not write is as it was then."""
        found = values.get("diagnosis")
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        known["diagnosis"] = found and Diagnosis.from_dict(found)
        figures = values.get("figures")
        known["figures"] = figures and PlanFigures(**figures)
        todo = {name: values[name] for name in Try.__dataclass_fields__ if name in values}
        return cls(**known, todo=Try(**todo))
