"""Certificates of earlier versions: what their verdicts and figures mean.

No simulation is imported here, for pages that only show a certificate.
"""

from __future__ import annotations

from typing import Final, cast

from foldback.planner.certificate.figures import (
    KINEMATICS_ONLY,
    SIMULATED,
    CertificateFigures,
    FoldSummary,
    PlaybackFigures,
)

NOT_TOLD: Final = "verified (it is not known whether the playback was simulated)"
"""Verdict that replaces ``verified`` in certificates of earlier versions, which do not state if the
playback was simulated."""


def told_honestly(
    values: CertificateFigures, playback: PlaybackFigures | None = None
) -> CertificateFigures:
    """Return a certificate as a dict without figures that were reported without a simulation.

    Earlier versions called all plans ``verified``, and reported no errors for kinematic playbacks.
    Figures that they did not compute become None.

    Args:
        values: Plain values of a certificate; those of this version are returned unchanged.
        playback: Summary of the playback, as far as it is known.
    """
    if "robots" not in values and "verdict" in values:
        values = {**values, "robots": None}
    if "simulated" in values or "verdict" not in values:
        return values
    kind = (playback or {}).get("kind")
    off = values.get("max_angle_error_rad")
    simulated = None
    if kind is not None:
        simulated = kind == "dynamic"
    elif off:  # a kinematic playback never said that it was off
        simulated = True
    verdict = str(values.get("verdict", ""))
    if verdict.startswith("verified with gaps"):
        verdict = f"failed: {verdict.removeprefix('verified with gaps: ')}"
    elif verdict == "verified":
        verdict = {True: SIMULATED, False: KINEMATICS_ONLY, None: NOT_TOLD}[simulated]
    unknown = dict.fromkeys(name for name in _FIGURES_ADDED_LATER if name not in values)
    # What was proved then was of the plan alone.
    unproved = dict.fromkeys(_SIMULATION_FIGURES if simulated is False else ("clearance_bound",))
    if simulated is None:
        unproved |= dict.fromkeys(_SIMULATION_FIGURES)
    told = {**values, **unknown, **unproved, "verdict": verdict, "simulated": simulated}
    return cast(CertificateFigures, told)


def summary_told_honestly(summary: FoldSummary) -> FoldSummary:
    """Return a plan's summary without figures that were reported without a simulation."""
    told, playback = summary.copy(), summary.get("playback")
    if playback is not None and playback.get("kind") == "kinematic":
        nothing = dict.fromkeys(_DYNAMIC_PLAYBACK_FIGURES)
        told["playback"] = playback = cast(PlaybackFigures, {**playback, **nothing})
    if certificate := summary.get("certificate"):
        told["certificate"] = told_honestly(certificate, playback)
    return told


_DYNAMIC_PLAYBACK_FIGURES: Final = ("rms_position_error", "max_angle_error_rad")
"""Figures in a summary of a playback that only a dynamic simulation has; they become None for a
kinematic playback."""
_SIMULATION_FIGURES: Final = (
    "min_clearance_playback",
    "min_clearance_playback_at",
    "rms_position_error",
    "max_position_error",
    "max_angle_error_rad",
)
"""Figures of a certificate that only a simulated playback has; they become None for plans that were
not simulated."""
_FIGURES_ADDED_LATER: Final = (
    "exempt_pairs",
    "min_clearance_record_at",
    "frames",
    "plan_end_error_rad",
    "max_angle_rad",
    "max_angle_record_rad",
    "torque_source",
    "torque_frames",
)
"""Figures of a certificate that earlier versions did not compute; they become None when a
certificate of an earlier version is read."""
