"""Results of the stages, and their JSON form: what the service stores and shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from planner.certificate.certificate import Certificate
from planner.motion.record import Record
from planner.pipeline.attempt import Candidates
from planner.plan.plan import Plan
from planner.playback.playback import Playback


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Result of ``read``.

    Attributes:
        candidates: Chains that may be folded.
        kind: ``path``, ``chain``, ``voxels``, ``mesh`` or ``plan``: what the input was.
        method: Method that found the paths; None for a plan.
        notes: Notes for users.
        knot: Verdict on the knot of the first candidate; None without one.
    """

    candidates: Candidates
    kind: str
    method: str | None = None
    notes: Sequence[str] = ()
    knot: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        chain = self.candidates.chains[0]
        return {
            "kind": self.kind,
            "method": self.method,
            "notes": list(self.notes),
            "knot": self.knot,
            "candidates": len(self.candidates.chains),
            "name": chain.name,
            "module": chain.module.name,
            "modules": len(chain),
            "joints": chain.joint_count,
            "hinges": len(chain.folded_rad),
            "pitch_m": chain.pitch_m,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exploded:
    """Result of ``explode``.

    Attributes:
        record: Record of the explosion that came farthest; None where nothing explodes.
        attempts: Number of attempts so far.
    """

    record: Record | None
    attempts: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        if self.record is None:
            return {"status": "none", "reason": "", "steps": 0, "frames": 0, "seconds": 0.0}
        return {**self.record.summary(), "attempts": self.attempts}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Played:
    """Result of ``play_back``.

    Attributes:
        playback: None when the chain was not straight after the explosion.
    """

    playback: Playback | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        if self.playback is not None:
            return self.playback.summary()
        return {
            "status": "skipped",
            "reason": "the chain was not straight after the explosion",
            "steps": 0,
            "seconds": 0.0,
            "rms_position_error": None,
            "max_angle_error_rad": None,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judged:
    """Result of ``certify``.

    Attributes:
        certificate: Certificate of the best attempt when nothing else is tried, else of this one.
        again: Stage that tries again; None when nothing else is tried.
    """

    certificate: Certificate
    again: Literal["explode", "play_back"] | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {**self.certificate.as_dict(), "again": self.again}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exported:
    """Result of ``export``.

    Attributes:
        plan: Plan of the fold.
    """

    plan: Plan

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return self.plan.summary()


StageResult = Reading | Exploded | Played | Judged | Exported
