"""Joint errors in words: how exact the hinges of a robot have to be, and what is that exact."""

from __future__ import annotations

import math
from typing import Final

from foldback.planner.certificate.figures import CertificateFigures, JointErrorFigures
from foldback.planner.parameters.joint_error import MIN_SIZE
from foldback.words.certificate import degrees_down, rounded_down

GOOD_SERVO: Final = "0.3deg"
"""Joint error of good servos, as an option of a fold."""
SERVOS_DEG: Final = (
    (2.0, "hobby servos (1° to 2°)"),
    (1.0, "the best hobby servos (1°)"),
    (0.3, "good servos (0.3°)"),
    (0.05, "an encoder at each joint (0.05°)"),
)
"""Joint errors that common hinges stay within, in degrees, and what they are called; the values are
typical of backlash and dead band in the makers' data sheets."""
QUESTION: Final = "Could I build this?"


def build_words(certificate: CertificateFigures) -> str | None:
    """Return how accurate the hinges of a robot that follows a plan have to be; None if unknown."""
    errors = certificate.get("joint_errors")
    if errors is not None:
        return f"{_needed(errors)} {size_words(errors)}"
    margins = certificate.get("margins")
    if not certificate.get("verified") or margins is None:
        return None
    proved = degrees_down(margins["independent_rad"]["value"])
    return (
        f"It is proved for hinge errors of up to {proved}. Most robots tolerate about ten times as "
        f"much: fold again with a joint error of {_degrees(GOOD_SERVO)}, and foldback samples "
        "robots."
    )


def size_words(errors: JointErrorFigures) -> str:
    """Return the largest module size with which robots tolerate a joint error."""
    error, size = f"{math.degrees(errors['error_rad']):.3g}°", errors["module_size"]
    if size is None:
        return (
            f"With hinge errors of {error}, even modules that fill only {100 * MIN_SIZE:.0f} % of "
            "the cell would touch."
        )
    return (
        f"With hinge errors of {error}, modules may fill at most {rounded_down(100 * size, 1)} % "
        "of the cell."
    )


def sample_words(errors: JointErrorFigures) -> str:
    """Return how the figures were found."""
    return (
        f"Sampled: {errors['robots']} robots with random hinge errors were followed through the "
        f"whole motion. At most {errors['touching_with_error']} of them touched themselves with "
        f"the largest error, and at most {errors['touching_at_size']} with the largest modules."
    )


def _needed(errors: JointErrorFigures) -> str:
    """Return the error that the plan tolerates at its own size, and hinges that are as exact."""
    tolerated = errors["tolerated_rad"]
    if tolerated <= 0.0:
        return "No: any error of the hinges makes modules touch."
    text = degrees_down(tolerated)
    for limit_deg, servos in SERVOS_DEG:
        if math.degrees(tolerated) >= limit_deg:
            return f"Yes, with {servos}: hinges may be off by {text}."
    return f"Not with usual servos: each hinge must be exact to {text}."


def _degrees(text: str) -> str:
    return text.replace("deg", "°")
