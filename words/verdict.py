"""The verdict on a fold in words, and the reason why there is no verified plan."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, TypedDict

from foldback.planner.certificate.figures import CertificateFigures, Fault, FoldSummary
from foldback.planner.parameters.parameters import FLOATING
from foldback.planner.progress import STAGES
from foldback.words import certificate as certificate_words
from foldback.words.failures import collision, reason_words
from foldback.words.fold import ShownFold
from foldback.words.plan_choice import Choice, superlative
from foldback.words.quantities import NO_BREAK_SPACE, PRESET_LABELS, sentence, unbroken
from foldback.words.settings import in_a_line
from foldback.words.smoothing import smoothing_label

COVER_LOADING: Final = "Loading the view"
COVER_WAITING: Final = "Waiting for the first frame"
NO_DOWNLOADS: Final = "There is nothing to download."
NO_DOWNLOADS_YET: Final = "You can download the plan when the fold is finished."
WRITING: Final = "Writing the files …"
CANCELLED: Final = "Cancelled before it finished"
VIEW_FILES: Final = (
    ("standalone.html", "A single HTML file", "HTML: plays in any browser, without a server"),
    ("recording.viser", "Recording", ".viser: plays in viser, a 3D viewer"),
)
"""Files that show a fold's motion: name, label and hint."""

PICTURE_VERDICTS: Final = {
    "verified": ("Verified", "good"),
    "failed": ("Not verified", "bad"),
    "cancelled": ("Cancelled", "off"),
}
"""Text and colour class of the verdict in a fold's preview picture, by the fold's status."""
COMPUTING_VERDICT: Final = ("Computing", "busy")


class Verdict(TypedDict):
    """Result of a fold in words, and its colour."""

    tone: str
    text: str


class Problem(TypedDict):
    """Reason why there is no plan, or no verified one."""

    heading: str
    text: str


def verdict_of(
    row: ShownFold, summary: FoldSummary, certificate: CertificateFigures, choice: Choice | None
) -> Verdict:
    """Return the verdict on a fold, or its progress."""
    modules = row.counted.replace(" ", NO_BREAK_SPACE) if row.modules else None
    if row.status == "verified":
        strategy = (summary.get("explosion") or {}).get("strategy")
        safety = certificate_words.safety(certificate, row.counted.replace(" ", NO_BREAK_SPACE))
        best = choice and superlative(choice["prefer"], len(choice["plans"]))
        if not best and (smoothing := summary.get("smoothing")):
            best = smoothing_label(smoothing)
        baseline = certificate_words.baseline(strategy)
        if safety is not None:
            return _verdict("good", safety, baseline, best)
        headline = certificate_words.headline(certificate) or "verified"
        return _verdict("good", sentence(headline), baseline, best, modules)
    if row.status == "failed":
        if (crash := collision(summary)) is not None:
            return _verdict("bad", f"Not safe: {crash}", modules)
        reason = sentence(reason_words(row, summary) or "").removesuffix(".")
        return _verdict("bad", "Not verified", reason, modules)
    if row.status == "cancelled":
        return _verdict("off", CANCELLED)
    if row.status == "running" and row.stage == STAGES[-1]:
        return _verdict("busy", WRITING, modules)
    return _verdict("busy", "In the queue" if row.status == "queued" else "Computing", modules)


def _verdict(tone: str, *parts: str | None) -> Verdict:
    text = " · ".join(part for part in parts if part)
    return {"tone": tone, "text": unbroken(text)}


def problem_of(row: ShownFold, summary: FoldSummary) -> Problem | None:
    """Return the reason why a fold failed or was cancelled; None for others."""
    error = row.error or Fault()
    if row.status == "failed":
        text = sentence(reason_words(row, summary) or "No reason was recorded.")
        judged = error.get("code", "not-verified") == "not-verified" and "certificate" in summary
        heading = "This plan could not be verified" if judged else "This fold could not be computed"
        return {"heading": heading, "text": text}
    if row.status == "cancelled":
        return {"heading": "This fold was cancelled", "text": f"{CANCELLED}."}
    return None


def damage_of(heading: str, files: Iterable[str]) -> Problem:
    """Return the problem that a page reports for damaged files."""
    return {
        "heading": heading,
        "text": f"Damaged files: {', '.join(files)}. The motion cannot be shown. The operator of "
        "this service can restore the files from a backup.",
    }


def preset_of(row: ShownFold) -> str:
    """Return the preset of a fold with its world and its changed settings."""
    world = "" if row.world == FLOATING else ", on a table"
    return f"{PRESET_LABELS.get(row.preset, row.preset)}{world}{in_a_line(row.settings)}"


def origin_of(summary: FoldSummary) -> str | None:
    """Return the origin of a fold that came with the package; None for any other."""
    if (shipped := summary.get("shipped")) is None:
        return None
    return f"Included with foldback, computed with version {shipped['version']}"
