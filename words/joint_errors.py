"""Joint errors in words: how exact the hinges of a robot have to be, and what is that exact."""

from __future__ import annotations

import math
from typing import Final, TypedDict

from foldback.planner.certificate.figures import CertificateFigures, JointErrorFigures
from foldback.planner.parameters.joint_error import MIN_SIZE
from foldback.words.certificate import degrees_down, filled

SERVOS_DEG: Final = (
    (2.0, "hobby servos (1° to 2°)"),
    (1.0, "the best hobby servos (1°)"),
    (0.3, "good servos (0.3°)"),
    (0.05, "an encoder at each joint (0.05°)"),
)
"""Joint errors within which common hinges stay, in degrees, largest first, and their names."""
QUESTION: Final = "Could I build this?"
HURDLES: Final = (
    (
        "Gravity",
        "The chain floats unless it was folded on a table. Long chains are too heavy for their own "
        "hinges.",
        "properties",
    ),
    (
        "Edges",
        "Linked cubes turn about a joint between them. Their edges must be rounded there.",
        "properties",
    ),
    ("Motors", "Each hinge needs a motor that is strong enough and fits inside.", "downloads"),
    ("Cables", "No room is left for cables. Run them through the joints.", "module"),
    (
        "Play and wear",
        "Gears have play, and modules bend. Both grow with time. Count them as errors of hinges.",
        "properties",
    ),
)
"""What else stands between a plan and a robot: name, explanation, and the tab with its figures."""


class BuildWords(TypedDict):
    """Answer to whether a robot could follow a plan.

    Attributes:
        answer: How exact its hinges have to be.
        size: Size of modules that tolerates usual hinges; what is known without it.
        sample: How both were found; empty if they are proved.
    """

    answer: str
    size: str
    sample: str


def build_words(certificate: CertificateFigures) -> BuildWords | None:
    """Return how exact the hinges of a robot that follows a plan have to be; None if unknown."""
    if (errors := certificate.get("joint_errors")) is not None:
        return {
            "answer": _answer(errors),
            "size": size_words(errors),
            "sample": _sample(errors),
        }
    margins = certificate.get("margins")
    if not certificate.get("verified") or margins is None:
        return None
    proved = degrees_down(margins["independent_rad"]["value"])
    return {
        "answer": f"It is proved for hinges that are exact to {proved}.",
        "size": "Most robots tolerate at least ten times as much.",
        "sample": "",
    }


def again_label(size: float) -> str:
    """Return the label of the button that folds again with the size that a joint error allows."""
    return f"Fold again with modules of {filled(size)}\N{NO-BREAK SPACE}%"


def size_words(errors: JointErrorFigures) -> str:
    """Return the largest module size with which robots tolerate a joint error."""
    error, size = f"{math.degrees(errors['error_rad']):.3g}°", errors["module_size"]
    if size is None:
        return (
            f"Servos of {error} are not exact enough, even with modules of "
            f"{100 * MIN_SIZE:.0f} % of the spacing."
        )
    return (
        f"For servos of {error}, modules may be at most {_about(errors)}{filled(size)} % of the "
        "spacing wide."
    )


def _about(errors: JointErrorFigures) -> str:
    return "" if errors.get("swept", True) else "about "


def _answer(errors: JointErrorFigures) -> str:
    """Return the error that the plan tolerates at its own size, and hinges that are as exact."""
    tolerated_rad, about = errors["tolerated_rad"], _about(errors)
    if tolerated_rad <= 0.0:
        return "No: any error of the hinges makes modules touch."
    degrees = f"{about}{degrees_down(tolerated_rad)}"
    for limit_deg, servos in SERVOS_DEG:
        if math.degrees(tolerated_rad) >= limit_deg:
            yes = "Probably" if about else "Yes"
            return f"{yes}, with {servos}: hinges may be off by {degrees}."
    return f"Not with common parts: each hinge must be exact to {degrees}."


def _sample(errors: JointErrorFigures) -> str:
    """Return how errors and module sizes were found."""
    robots, with_error = errors["robots"], errors["touching_with_error"]
    touching = (
        f"touched themselves with the largest error, and at most {errors['touching_at_size']} with "
        "the largest modules."
    )
    if _about(errors):
        return (
            f"Estimated from the folded shape of {robots} robots with random hinge errors: at most "
            f"{with_error} of them {touching}"
        )
    return (
        f"Sampled: {robots} robots with random hinge errors were followed through the whole "
        f"motion. At most {with_error} of them {touching}"
    )
