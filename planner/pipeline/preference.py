"""Preference: the choice among several verified plans, and the figures that decide it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import Any, Final, Literal

from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.errors import InputError
from foldback.planner.parameters.option import Choice

Preference = Literal["computing", "time", "torque", "clearance", "margin", "calm"]
COMPUTING: Final = "computing"
"""Value of a request's preference that asks for the least computation: the first verified plan is
taken, and no better one is searched for."""
CALM: Final = "calm"
"""Value of a request's preference that asks for the calmest motion."""
PREFERENCES: Final[Mapping[Preference, Choice]] = {
    COMPUTING: Choice(
        label="First plan that works",
        note="the first verified plan",
        hint="Quickest to compute: takes the first plan that passes all checks.",
    ),
    "time": Choice(
        label="Shortest folding time",
        note="the fastest of several plans",
        hint="Tries several plans and chooses the one that folds fastest.",
    ),
    "torque": Choice(
        label="Least torque",
        note="the least torque for the same folding time",
        hint="Tries several plans and chooses the one that needs the least torque for the same "
        "folding time.",
    ),
    "clearance": Choice(
        label="Most clearance",
        note="the most clearance",
        hint="Tries several plans and chooses the one with the most clearance.",
    ),
    "margin": Choice(
        label="Largest allowed hinge error",
        note="the largest allowed error in one hinge",
        hint="Tries several plans and chooses the one that tolerates the largest angle error of "
        "a single hinge before modules could touch.",
    ),
    CALM: Choice(
        label="Calmest motion",
        note="the calmest motion",
        hint="Tries several plans, one of them in quarter turns, and chooses the one whose hinges "
        "move least, with the fewest at once.",
    ),
}
"""Goals of the choice among several verified plans."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFigures:
    """Figures by which plans are compared.

    Attributes:
        fold_time_s: Time that the fold takes at the joints' speed limit; None where nothing moves.
        peak_torque_nm: Largest torque of a hinge in that time; None where it is not known.
        clearance_bound: Clearance that is proved, in pitches; None where nothing is.
        frames: Frames of the plan.
        seconds: Computing: of the explosion or smoothing, the playback and the certificate.
        one_hinge_rad: Margin of one hinge, see ``Margins``; None where it is not known.
        travel_ratio: Travel of all hinges, see ``MotionFigures``; None where it is not known.
        hinges_moving_mean: Mean number of hinges that move at once; None where it is not known.
        reversals_mean: Mean number of reversals of a hinge; None where it is not known.
        size_with_errors: Module size that tolerates the requested joint error, see
            ``JointErrors``, 0 if none does; None where no error is requested.
    """

    fold_time_s: float | None
    peak_torque_nm: float | None
    clearance_bound: float | None
    frames: int
    seconds: float
    one_hinge_rad: float | None = None
    travel_ratio: float | None = None
    hinges_moving_mean: float | None = None
    reversals_mean: float | None = None
    size_with_errors: float | None = None

    @classmethod
    def of(cls, certificate: CertificateFigures, *, before_s: float = 0.0) -> PlanFigures:
        """Return the figures of a plan.

        Args:
            certificate: Certificate of the plan, as plain values.
            before_s: Seconds that were computed before it was looked at.
        """
        margins, errors = certificate.get("margins"), certificate.get("joint_errors")
        return cls(
            fold_time_s=certificate.get("fold_time_s"),
            peak_torque_nm=certificate.get("peak_torque_nm"),
            clearance_bound=certificate.get("clearance_bound"),
            frames=certificate.get("frames") or 0,
            seconds=before_s + certificate.get("seconds", 0.0),
            one_hinge_rad=margins and margins["one_hinge_rad"]["value"],
            travel_ratio=certificate.get("travel_ratio"),
            hinges_moving_mean=certificate.get("hinges_moving_mean"),
            reversals_mean=certificate.get("reversals_mean"),
            size_with_errors=(
                (errors["module_size"] or 0.0) if errors and errors["swept"] else None
            ),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, without the size if no joint error is requested."""
        values = asdict(self)
        if self.size_with_errors is None:
            del values["size_with_errors"]
        return values

    def torque_in(self, seconds: float) -> float | None:
        """Largest torque of a hinge in newton-metres, when the fold takes so many seconds.

        Torques fall with the square of the duration, since without gravity all are of inertia.
        """
        if self.peak_torque_nm is None or not self.fold_time_s:
            return None
        return self.peak_torque_nm * (self.fold_time_s / seconds) ** 2

    def score(self, prefer: Preference) -> float:
        """Return the score for a preference: the more the better; −∞ where that is not known.

        Torques are compared at one duration for all. A plan that may take its time needs hardly
        any torque, which any other plan could have as well by going as slowly.

        The calmest plan has the least product of travel, number of hinges that move at once, and
        number of times that a hinge changes its direction, the first motion included. All three are
        hard to follow; with a sum, a unit of one would have to be weighed against one of another.
        """
        if prefer == "time":
            return -inf if not self.fold_time_s else -self.fold_time_s
        if prefer == "torque":
            torque = self.torque_in(1.0)
            return -inf if torque is None else -torque
        if prefer == "margin" and self.size_with_errors is not None:
            return self.size_with_errors
        if prefer == "margin":
            return -inf if self.one_hinge_rad is None else self.one_hinge_rad
        if prefer == CALM:
            travel, moving, reversals = (
                self.travel_ratio,
                self.hinges_moving_mean,
                self.reversals_mean,
            )
            if travel is None or moving is None or reversals is None:
                return -inf
            return -travel * moving * (1.0 + reversals)
        return -inf if self.clearance_bound is None else self.clearance_bound


def preference_named(name: str) -> Preference:
    """Return the preference of that name.

    Raises:
        InputError: ``unknown-prefer``.
    """
    if name not in PREFERENCES:
        raise InputError(
            "unknown-prefer",
            f"got the preference {name!r}, expected one of: {', '.join(PREFERENCES)}.",
        )
    return name


Rank = tuple[bool, float, bool, float, int]


def rank(
    certificate: CertificateFigures | None,
    *,
    straight: bool,
    bent: float,
    number: int,
    prefer: Preference,
) -> Rank:
    """Return how far an attempt came: verified, how good then, straight, bends removed, and when.

    Of equal plans that are verified the earlier one is better: it was there for less computing. Of
    equal failures it is the later one, which was tried for what the earlier one lacked.

    Args:
        certificate: Figures of its certificate; None where there is none.
        straight: True if its explosion ended straight.
        bent: Fraction of the folded chain's bends that the explosion has left; ∞ without a frame.
        number: Index of its explosion.
        prefer: Preference among verified plans.
    """
    verified, clearance = judgement(certificate)
    if certificate is not None and verified and prefer != COMPUTING:
        return True, PlanFigures.of(certificate).score(prefer), True, 0.0, -number
    return verified, clearance, straight, -bent, number


def judgement(certificate: CertificateFigures | None) -> tuple[bool, float]:
    """Return True for a verified plan, and its least clearance; −∞ where that is not known."""
    if certificate is None:
        return False, -inf
    plan, playback = (certificate.get(n) for n in ("min_clearance", "min_clearance_playback"))
    clearances = [float(value) for value in (plan, playback) if isinstance(value, (int, float))]
    return bool(certificate.get("verified")), -inf if plan is None else min(clearances)
