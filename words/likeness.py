"""Likeness in words: how much folded modules look like the input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from foldback.planner.certificate.figures import LikenessFigures

LIKENESS_MEANING = "overlap of both, divided by what either covers"
"""Meaning of the percentage that states a likeness."""


def likeness_words(likeness: LikenessFigures | None) -> str | None:
    """Return a likeness in words; None if it is unknown, as for chains that are folded as given."""
    if likeness is None:
        return None
    iou, missing, added = (percent(likeness[key]) for key in ("iou", "missing", "added"))
    parts = [
        f"{missing} of the model is missing" if likeness["missing"] else "",
        f"{added} of the modules' volume is outside of it" if likeness["added"] else "",
    ]
    parts = [part for part in parts if part]
    details = f"; {', '.join(parts)}" if parts else ""
    return f"{iou} like the model ({LIKENESS_MEANING}){details}"


def reach_words(reach: Sequence[Mapping[str, float | int | None]], max_modules: int) -> str:
    """Return about how many modules reach each likeness, in words.

    Args:
        reach: From ``planner.pipeline.prepare.Preparation.report``.
        max_modules: Largest number of modules.
    """
    texts = [
        f"about {entry['modules']} for {percent(entry['likeness'] or 0.0)}"
        if entry["modules"]
        else f"more than {max_modules} for {percent(entry['likeness'] or 0.0)}"
        for entry in reach
    ]
    return ", ".join(texts)


def percent(share: float) -> str:
    """Return a share as a whole percentage; one above 0 is never 0 %, one below 1 never 100 %."""
    if 0.0 < share < 0.01:
        return "less than 1 %"
    return f"{min(round(100.0 * share), 99) if share < 1.0 else 100} %"
