"""Downloads: files with the name of their fold, and answers that browsers revalidate."""

from __future__ import annotations

import hashlib
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from fastapi import Request
from fastapi.responses import FileResponse, Response

MAX_STEM_CHARACTERS: Final = 60
"""Maximum length of a fold's name within the name of a downloaded file, in characters; the rest is
cut off. A larger value could exceed the 255 bytes that file systems permit for the whole name.
Chosen."""

BINARY_MEDIA_TYPE: Final = "application/octet-stream"


def download_stem(name: str) -> str:
    """Return a fold's name as the name of a file, without its ending.

    Letters, digits and combining marks of all scripts stay; everything else becomes a hyphen, so
    that no separator, quote or control character is left. Responses send what is not ASCII as
    ``filename*`` (RFC 6266).
    """
    composed = unicodedata.normalize("NFC", name)
    stem = "".join(c if c.isalnum() or unicodedata.combining(c) else "-" for c in composed)
    return stem[:MAX_STEM_CHARACTERS].strip("-") or "fold"


def download(
    path: Path,
    media_type: str,
    fold_name: str,
    ending: str,
    headers: Mapping[str, str] | None = None,
) -> FileResponse:
    """Return a file that a browser saves under the name of its fold.

    Args:
        path: The file.
        media_type: Its media type.
        fold_name: Name of the fold.
        ending: Rest of the file's name.
        headers: Headers besides.
    """
    filename = f"{download_stem(fold_name)}{ending}"
    return FileResponse(path, media_type=media_type, filename=filename, headers=headers)


def etag_of(data: bytes) -> str:
    """Return an entity tag that changes with the data, without its quotes."""
    return hashlib.sha256(data).hexdigest()[:20]


def revalidated(
    request: Request,
    data: bytes,
    media_type: str,
    headers: Mapping[str, str] | None = None,
    *,
    etag: str | None = None,
) -> Response:
    """Return data that browsers cache and revalidate, or 304 if the client has it.

    Args:
        request: The request.
        data: Body of the answer.
        media_type: Its media type.
        headers: Headers besides, or instead of ``Cache-Control: no-cache``.
        etag: Entity tag of the data; computed if None.
    """
    tag = f'"{etag or etag_of(data)}"'
    told = {"ETag": tag, "Cache-Control": "no-cache", **(headers or {})}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=told)
    return Response(data, media_type=media_type, headers=told)
