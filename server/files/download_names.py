"""Names of downloaded files: what a fold is called, in any script."""

from __future__ import annotations

import unicodedata
from typing import Final

MAX_STEM_CHARACTERS: Final = 60
"""Maximum length of a fold's name within the name of a downloaded file, in characters; the rest is
cut off. A larger value could exceed the 255 bytes that file systems permit for the whole name.
Chosen."""


def download_stem(name: str) -> str:
    """Return a fold's name as the name of a file, without its ending.

    Letters, digits and combining marks of all scripts stay; everything else becomes a hyphen, so
    that no separator, quote or control character is left. Responses send what is not ASCII as
    ``filename*`` (RFC 6266).
    """
    composed = unicodedata.normalize("NFC", name)
    stem = "".join(c if c.isalnum() or unicodedata.combining(c) else "-" for c in composed)
    return stem[:MAX_STEM_CHARACTERS].strip("-") or "fold"
