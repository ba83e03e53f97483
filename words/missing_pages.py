"""Missing pages: headings and explanations in place of what was not found."""

from __future__ import annotations

from typing import Final, NamedTuple


class Missing(NamedTuple):
    """Heading and explanation of a page in place of what was not found."""

    heading: str
    explanation: str


GONE: Final = "The link may be incomplete, or the fold has been deleted."
NO_FOLD: Final = Missing("Fold not found", GONE)
NO_PAIR: Final = Missing("One of these folds was not found", GONE)
NO_INPUT: Final = Missing(
    "The file of this fold has expired",
    "Files are stored for a limited time. Upload the file again to change its options.",
)
NO_SHAPE: Final = Missing("Shape not found", "The gallery has no shape of this name.")
NO_PREVIEW: Final = Missing(
    "This preview has expired",
    "Previews are stored for a limited time. Upload the file again to get a new preview.",
)
