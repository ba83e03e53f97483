"""Lifetimes in words: who can see a fold, and for how long it is stored."""

from __future__ import annotations

from typing import Final

from foldback.words.fold import ShownFold

TIME_UNITS: Final = ((86400.0, "day"), (3600.0, "hour"), (60.0, "minute"), (1.0, "second"))
LINK_ONLY: Final = "Only people with the link can see it."
PUBLIC_FOLD: Final = "This fold is in the gallery: everyone can see it, and it won't expire."


def kept_words(keep_days: float | None, *, limited: bool) -> str:
    """Return a sentence that states for how long a fold is stored.

    Args:
        keep_days: Days after which an unused fold is deleted; None if it is not.
        limited: True if the folds may occupy only a limited part of the disk.
    """
    if keep_days is not None:
        return f"A fold is stored for {time_words(86400.0 * keep_days)} after its last view."
    if limited:
        return (
            "A fold is stored while there is space; the folds that were viewed longest ago are "
            "deleted first."
        )
    return "A fold is stored until you delete it."


def who_and_how_long(fold: ShownFold | None, usual: str, *, cancelled_s: float) -> str:
    """Return who can see a fold and how long it is stored.

    Args:
        fold: The fold; None for the next one.
        usual: The result of ``kept_words``.
        cancelled_s: Seconds for which a cancelled fold is stored.
    """
    if fold is not None and fold.public:
        return PUBLIC_FOLD
    if fold is not None and fold.pinned:
        usual = "This fold is stored permanently."
    elif fold is not None and fold.status == "cancelled":
        usual = (
            f"This fold was cancelled. Its files will be deleted within {time_words(cancelled_s)}."
        )
    return f"{usual} {LINK_ONLY}"


def time_words(seconds: float) -> str:
    """Return a time in the largest unit that is accurate to a tenth: ``30 days``."""
    for length, name in TIME_UNITS:
        count = round(seconds / length)
        if count and abs(count * length - seconds) <= 0.1 * seconds:
            return f"{count} {name}{'' if count == 1 else 's'}"
    return f"{seconds:g} seconds"
