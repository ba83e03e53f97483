"""Attempt: one explosion or smoothing, and the result of it and of its playback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.verdict import MAX_VERIFIED_ERROR_PITCH, straight_error
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.explosion.diagnosis import Diagnosis, Kind, diagnose
from foldback.planner.motion.motion import PHASES
from foldback.planner.motion.record import Record, RecordStatus
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.preference import PlanFigures
from foldback.planner.playback.playback import Playback
from foldback.planner.reasons import Reason
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.storage.plain_values import from_plain

MAX_EXPLOSIONS: Final = 6
"""Maximum number of times that one fold explodes its chain (simulates how the folded chain comes
loose and straightens), each time with another path, strategy or seed."""

Cause = Kind | Literal["refused"]


@dataclass(frozen=True, slots=True)
class AttemptSpec:
    """Specification of an attempt: the explosion, or the plan that is smoothed.

    Attributes:
        candidate: Index of the path.
        seed: Seed of all randomness.
        strategy: Strategy of the explosion.
        other_end: True if the path is taken from its other end.
        gentle: True for half the force.
        plain: True for an explosion of all modules that is not calm, although ``auto`` chose it.
        roomy: True for turns with the most room alone, which ``auto`` looks for before it explodes.
        smooths: Index of the attempt whose verified plan is smoothed in place of
            an explosion; the strategy then is one of ``planner.smoothing.SMOOTHING_WAYS``. None for
            an explosion.
    """

    candidate: int
    seed: int
    strategy: str
    other_end: bool = False
    gentle: bool = False
    plain: bool = False
    roomy: bool = False
    smooths: int | None = None

    def with_strategy(self, strategy: str) -> AttemptSpec:
        """Return it with another strategy; only explosions of all modules can be plain."""
        plain = self.plain and strategy == "simultaneous"
        return replace(self, strategy=strategy, plain=plain, roomy=False)


@dataclass(frozen=True, slots=True)
class _CandidateValues:
    """Candidates as a file holds them."""

    chains: list[dict[str, Any]]
    two_ended: bool
    likenesses: tuple[Likeness, ...] = ()


@dataclass(frozen=True, slots=True)
class Candidates:
    """Chains through the same shape.

    Attributes:
        chains: The likeliest first.
        two_ended: True if they may start at their other end as well.
        likenesses: Likeness of each chain to the input; empty for paths and chains.
    """

    chains: tuple[Chain, ...]
    two_ended: bool
    likenesses: tuple[Likeness, ...] = ()

    def chain_of(self, spec: AttemptSpec) -> Chain:
        """Return the chain of a try."""
        chain = self.chains[spec.candidate]
        return chain.from_other_end() if spec.other_end else chain

    def likeness_of(self, chain: Chain) -> Likeness | None:
        """Return the likeness of one of the chains, from either end; None if it is not known."""
        attributes = chain_attributes(chain)
        for candidate, likeness in zip(self.chains, self.likenesses, strict=False):
            ends = (candidate, candidate.from_other_end()) if self.two_ended else (candidate,)
            if any(chain_attributes(end) == attributes for end in ends):
                return likeness
        return None

    def as_dict(self) -> dict[str, Any]:
        """Return them as plain JSON values."""
        chains = [chain_attributes(chain) for chain in self.chains]
        likenesses = [likeness.as_dict() for likeness in self.likenesses]
        values: dict[str, Any] = {"chains": chains, "two_ended": self.two_ended}
        return values | ({"likenesses": likenesses} if likenesses else {})

    @classmethod
    def from_values(cls, values: Any) -> Candidates:
        """Return the candidates that a file holds.

        Raises:
            ValueError: A value is missing, or has another type.
        """
        stored = from_plain(values, _CandidateValues)
        chains = tuple(chain_from_attributes(attributes) for attributes in stored.chains)
        return cls(chains, stored.two_ended, stored.likenesses)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """An attempt: one explosion, search for turns or smoothing, and its playback.

    Attributes:
        spec: Its specification.
        status: Status of its record; ``begun`` while there is none.
        reason: Reason why its record does not end straight.
        steps, frames, seconds: Figures of its record.
        diagnosis: Evidence why it did not end straight.
        finer: Factor on the number of frames of its playback.
        patience: Level of slowness near straight of its playback, see ``PlayBack``.
        verified: True if its plan is verified; None until its certificate exists.
        refusal: Reason why its plan is not verified.
        figures: Figures for comparison; None until its certificate exists.
        between: True if its frames are clear and only the way from one of the playback to the next
            is not.
        off_straight: True if the chain of a refold is not straight enough where its two shapes'
            motions meet.
        chosen: True if its plan is the fold's.
        played: True if it was played back. Not stored: a judged attempt was.
        unfolding_overlaps: True if a refold's closest place comes before it is straight. Not
            stored.
    """

    spec: AttemptSpec
    status: RecordStatus | Literal["begun", "none"]
    reason: Reason | None = None
    steps: int = 0
    frames: int = 0
    seconds: float = 0.0
    diagnosis: Diagnosis | None = None
    finer: int = 1
    patience: int = 0
    verified: bool | None = None
    refusal: Reason | None = None
    figures: PlanFigures | None = None
    between: bool = False
    off_straight: bool = False
    chosen: bool = False
    played: bool = False
    unfolding_overlaps: bool = False

    @classmethod
    def of_record(
        cls, spec: AttemptSpec, chain: Chain, record: Record | None, parameters: Parameters
    ) -> Attempt:
        """Return the attempt of an explosion that is over; ``none`` when there is nothing of it."""
        if record is None:
            return cls(spec=spec, status="none")
        return cls(
            spec=spec,
            status=record.status,
            reason=record.reason,
            steps=record.steps,
            frames=len(record.frames),
            seconds=record.seconds,
            diagnosis=diagnose(chain, record, parameters),
        )

    def unjudged(self, *, finer: int | None = None, patience: int | None = None) -> Attempt:
        """Return it without a verdict, to be played back as it was, or otherwise."""
        return replace(
            self,
            finer=self.finer if finer is None else finer,
            patience=self.patience if patience is None else patience,
            verified=None,
            refusal=None,
            figures=None,
            between=False,
            off_straight=False,
            played=False,
        )

    def judged(self, chain: Chain, certificate: Certificate, playback: Playback | None) -> Attempt:
        """Return it with the verdict on its playback.

        Args:
            chain: Chain that was folded.
            certificate: The verdict, and where the plan is narrowest.
            playback: Playback that was certified.
        """
        clearance, played = certificate.min_clearance, certificate.min_clearance_playback
        place = certificate.min_clearance_playback_at
        exploding_s = 0.0 if self.repeats else self.seconds
        playing_s = 0.0 if playback is None else playback.seconds
        return replace(
            self,
            played=True,
            verified=certificate.verified,
            refusal=certificate.reason,
            figures=PlanFigures.of(certificate.as_dict(), before_s=exploding_s + playing_s),
            between=clearance is not None
            and clearance >= 0.0
            and played is not None
            and played < 0.0
            and place is not None
            and not float(place.frame).is_integer(),
            off_straight=playback is not None
            and straight_error(chain, playback) > MAX_VERIFIED_ERROR_PITCH,
            unfolding_overlaps=_overlaps_unfolding(certificate, playback),
        )

    @property
    def repeats(self) -> bool:
        """True if it repeats the playback of the attempt before it, without an explosion."""
        return self.finer > 1 or self.patience > 0

    @property
    def failed(self) -> bool:
        """True if its explosion did not end straight."""
        return self.status not in ("straight", "none")

    @property
    def why(self) -> Cause:
        """Reason why it was not the last one."""
        if self.status == "straight":
            return "refused"
        return "limit" if self.diagnosis is None else self.diagnosis.kind

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values, as ``attempts.json`` and plans have them."""
        values: dict[str, Any] = {**asdict(self.spec), "status": self.status}
        if self.spec.smooths is None:
            del values["smooths"]
        for name in ("plain", "roomy"):
            if not values[name]:
                del values[name]
        if self.status == "begun":
            return values
        values["reason"] = self.reason and self.reason.as_dict()
        values |= {name: getattr(self, name) for name in ("steps", "frames", "seconds")}
        values["diagnosis"] = self.diagnosis and self.diagnosis.as_dict()
        if self.finer > 1:
            values["finer"] = self.finer
        if self.patience:
            values["patience"] = self.patience
        if self.verified is not None:
            refusal = self.refusal and self.refusal.as_dict()
            values |= {"verified": self.verified, "refusal": refusal, "between": self.between}
        if self.off_straight:
            values["off_straight"] = True
        if self.figures is not None:
            values["figures"] = self.figures.as_dict()
        if self.chosen:
            values["chosen"] = True
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Attempt:
        """Return the attempt in ``as_dict``; values that are not stored get defaults.

        Raises:
            ValueError: A value has another type.
            KeyError: A value is missing.
        """
        stored = from_plain(values, dict[str, Any])
        fields = {name: stored[name] for name in cls.__dataclass_fields__ if name in stored}
        diagnosis, figures = stored.get("diagnosis"), stored.get("figures")
        fields |= {
            "spec": from_plain(stored, AttemptSpec),
            "status": stored["status"],
            "diagnosis": None if diagnosis is None else Diagnosis.from_dict(diagnosis),
            "reason": Reason.from_dict(stored.get("reason")),
            "refusal": Reason.from_dict(stored.get("refusal")),
            "figures": None if figures is None else from_plain(figures, PlanFigures),
            "played": "verified" in stored,
        }
        return cls(**fields)


def latest_playback(history: Sequence[Attempt], number: int) -> int:
    """Return the index of the latest playback of an explosion, given by its own index."""
    while number + 1 < len(history) and history[number + 1].repeats:
        number += 1
    return number


def _overlaps_unfolding(certificate: Certificate, playback: Playback | None) -> bool:
    """Return True if a refold's closest place comes before it is straight."""
    if playback is None:
        return False
    straight = int((playback.frames.phase == PHASES.index("unfolding")).sum())
    return any(
        clearance is not None and clearance < 0.0 and place is not None and place.frame < straight
        for clearance, place in (
            (certificate.min_clearance, certificate.min_clearance_at),
            (certificate.min_clearance_playback, certificate.min_clearance_playback_at),
        )
    )
