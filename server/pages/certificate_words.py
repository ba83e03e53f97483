"""A certificate in words, as pages and the command line show it.

What is proved is rounded to the side that claims less.
"""

from __future__ import annotations

import math
from typing import Final

from planner.certificate.figures import CertificateFigures
from server.pages.quantities import quantity

DIGITS: Final = 2
NOT_SIMULATED: Final = "not simulated"
NOT_KNOWN: Final = "not known: made by an earlier version"
BASELINE: Final = "one joint at a time (a baseline)"
LEAST_SHOWN: Final = 1e-9
"""Overlaps of less, in pitches, are the rounding of a touch."""


def headline(certificate: CertificateFigures) -> str:
    """The verdict; of what is verified, also what clearance is proved, beside what was seen."""
    verdict = str(certificate.get("verdict") or "")
    told = clearance(certificate)
    return f"{verdict}: {told}" if told and verdict.startswith("verified") else verdict


def clearance(certificate: CertificateFigures) -> str | None:
    """What is proved of the clearance, and the least that was seen; None where nothing is known."""
    bound, seen = certificate.get("clearance_bound"), _seen(certificate)
    if bound is None or seen is None:
        return None
    return f"clearance at least {rounded_down(bound)} of a pitch, least seen {rounded_down(seen)}"


def rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """What a certificate says of the motion, as labels and values."""
    return [
        ("Module size", quantity(certificate.get("module_size"), "pitch")),
        ("Clearance, proved", _at_least(certificate.get("clearance_bound"))),
        ("Least clearance seen, plan", _pitches(certificate.get("min_clearance"))),
        ("Same, simulated playback", _of_simulation(certificate, "min_clearance_playback")),
        ("Same, record", _pitches(certificate.get("min_clearance_record"))),
        ("Robots", robots(certificate)),
        ("Final position error, RMS", _of_simulation(certificate, "rms_position_error", DIGITS)),
        ("Largest joint error", _of_simulation(certificate, "max_angle_error_rad", DIGITS, "rad")),
        ("Largest joint step", quantity(certificate.get("max_joint_step_rad"), "rad")),
        ("Hinges moving, most", quantity(certificate.get("hinges_moving_most"))),
        torque(certificate),
        ("On a table, statics", on_table(certificate)),
        ("Time to fold", quantity(certificate.get("fold_time_s"), "s")),
        ("at a joint speed of", quantity(certificate.get("joint_speed_limit_rad_s"), "rad/s")),
    ]


def on_table(certificate: CertificateFigures) -> str | None:
    """What a fold on a table asks at most; None of one that floats, or that does not rest."""
    table = certificate.get("table")
    if table is None or table["torque"] is None:
        return None
    friction = "frictionless" if table["friction"] == 0.0 else f"friction {table['friction']:g}"
    return f"{table['torque']:.3g} w·p, {table['torque_nm']:.3g} N·m ({friction})"


def robots(certificate: CertificateFigures) -> str | None:
    """How many robots with faults folded the plan, and how the least clear of them fared."""
    found = certificate.get("robots")
    if not found:
        return None
    least = min(one["min_clearance"] for one in found)
    return (
        f"{len(found)} with faults of their own, the one that is off most is shown; clear by "
        f"{rounded_down(least)} of a pitch or more"
    )


def torque(certificate: CertificateFigures) -> tuple[str, str | None]:
    """The largest torque: a peak only where every step of a simulation was looked at."""
    value = quantity(certificate.get("peak_torque_nm"), "N·m", DIGITS)
    source = str(certificate.get("torque_source") or "")
    if value is None or source.startswith("simulation"):
        return "Peak torque", value
    of = certificate.get("torque_frames"), certificate.get("frames")
    where = f"at {of[0]} of {of[1]} frames" if None not in of else "frames looked at are not known"
    return "Largest torque seen", f"{value}, {where}"


def linked(certificate: CertificateFigures) -> str | None:
    """Which modules are not checked against each other, and what a real one lacks for it."""
    exempt = certificate.get("exempt_pairs")
    if exempt is None:
        return None
    if exempt["apart"] < 2:
        return "All modules are checked against each other, linked ones too."
    told = "Linked modules share a joint and are not checked against each other"
    if (radius := exempt["relief_radius"]) is None:
        return f"{told}."
    if (bound := exempt["worst_overlap_bound"]) is not None:
        told += f": full cubes would overlap by up to {math.ceil(bound * 100) / 100:.2f} of a pitch"
    return (
        f"{told}. Real modules must lack their edges beyond {radius:g} of a pitch from the joint, "
        f"{100 * exempt['relief_share']:.0f} % of their volume."
    )


def record(certificate: CertificateFigures, *, limit_rad: float | None = None) -> str | None:
    """What is wrong with the recording that the plan was made of; None where nothing is."""
    told: list[str] = []
    least = certificate.get("min_clearance_record")
    if least is not None and least < -LEAST_SHOWN:
        told.append(f"overlaps by {quantity(-least, 'pitch', DIGITS)}")
    bent = certificate.get("max_angle_record_rad")
    if bent is not None and limit_rad is not None and bent > limit_rad + 1e-6:
        told.append(
            f"bends a joint to {math.degrees(bent):.1f}°, beyond its range of "
            f"±{math.degrees(limit_rad):.4g}°"
        )
    if not told:
        return None
    plan = (
        "; the plan made of it does not"
        if str(certificate.get("verdict")).startswith("verified")
        else ""
    )
    return f"The recording itself {' and '.join(told)}{plan}."


def baseline(strategy: object) -> str | None:
    """What is said of a plan that ended as the baseline; None of others."""
    return BASELINE if strategy == "one-by-one" else None


def _of_simulation(
    certificate: CertificateFigures, key: str, digits: int = 3, unit: str = "pitch"
) -> str | None:
    """A figure of the simulated playback, or that there was none."""
    simulated = certificate.get("simulated")
    if simulated is False:
        return NOT_SIMULATED
    value = certificate.get(key)
    if value is None and simulated is None and certificate.get("min_clearance") is not None:
        return NOT_KNOWN
    return quantity(value, unit, digits)


def _seen(certificate: CertificateFigures) -> float | None:
    known = [certificate.get(name) for name in ("min_clearance", "min_clearance_playback")]
    return min((float(value) for value in known if value is not None), default=None)


def _pitches(value: float | None) -> str | None:
    return quantity(value, "pitch")


def _at_least(value: float | None) -> str | None:
    return None if value is None or value <= 0.0 else f"at least {rounded_down(value)} pitch"


def rounded_down(value: float, digits: int = 3) -> str:
    """A length, down to so many decimals or, nearer to 0 than one of them, to two digits."""
    if value == 0.0:
        return "0"
    if abs(value) < 10**-digits:
        digits = 1 - math.floor(math.log10(abs(value)))
    # What is written as 0.049 shall stay that, whatever its last bit.
    return f"{math.floor(value * 10**digits + 1e-9) / 10**digits:.{digits}f}"
