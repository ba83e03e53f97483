"""Downloads: files named after their fold, and responses that browsers revalidate.

Files that are the same for all visitors are compressed once. Compressing responses to individual
requests is left to the reverse proxy: if a response contains both a secret and text of a stranger,
its compressed length reveals the secret. Files that are compressed here contain neither.
"""

from __future__ import annotations

import gzip
import hashlib
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from fastapi import Request
from fastapi.responses import FileResponse, Response

MAX_STEM_CHARACTERS: Final = 60
"""Maximum length of a fold's name within the name of a downloaded file, in characters; the rest is
cut off. A larger value could exceed the 255 bytes that file systems permit for the whole name."""

FILE_POLICY: Final = "sandbox; default-src 'none'; style-src 'unsafe-inline'"
"""Content security policy of downloads: a page that a browser displays instead of saving it would
otherwise run as one of the service's origin."""
BINARY_MEDIA_TYPE: Final = "application/octet-stream"


def download_stem(name: str) -> str:
    """Return a fold's name as the name of a file, without its ending.

    Letters, digits and combining marks of all scripts stay; all other characters become hyphens, so
    that no separator, quote or control character remains. Responses send names that are not ASCII
    as ``filename*`` (RFC 6266).
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
    """Return a response that a browser saves as a file named after its fold.

    Args:
        path: The file.
        media_type: Media type of the file.
        fold_name: Name of the fold.
        ending: Rest of the file's name.
        headers: Additional headers.
    """
    filename = f"{download_stem(fold_name)}{ending}"
    headers = {"Content-Security-Policy": FILE_POLICY, **(headers or {})}
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
        headers: Additional headers; may replace ``Cache-Control: no-cache``.
        etag: Entity tag of the data; computed if None.
    """
    tag = f'"{etag or etag_of(data)}"'
    header_fields = {"ETag": tag, "Cache-Control": "no-cache", **(headers or {})}
    if request.headers.get("if-none-match") == tag:
        return Response(status_code=304, headers=header_fields)
    return Response(data, media_type=media_type, headers=header_fields)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asset:
    """File that does not change while the service runs.

    Attributes:
        data: The uncompressed bytes.
        packed: The gzip-compressed bytes; None if they are hardly smaller.
        kind: Media type.
        etag: Entity tag, which changes with the content.
    """

    data: bytes
    packed: bytes | None
    kind: str
    etag: str

    @classmethod
    def of(cls, data: bytes, kind: str) -> Self:
        """Return the asset with its compressed form."""
        packed = gzip.compress(data, mtime=0)
        return cls(
            data=data,
            packed=packed if len(packed) < 0.9 * len(data) else None,
            kind=kind,
            etag=etag_of(data),
        )

    def response(self, request: Request, headers: Mapping[str, str] | None = None) -> Response:
        """Return the response, or 304 if the client has the file; ``headers`` are added."""
        takes = "gzip" in request.headers.get("accept-encoding", "")
        packed = self.packed if takes else None
        vary = {} if self.packed is None else {"Vary": "Accept-Encoding"}
        header_fields = {**vary, **(headers or {})}
        if packed is None:
            return revalidated(request, self.data, self.kind, header_fields, etag=self.etag)
        answer = revalidated(request, packed, self.kind, header_fields, etag=f"{self.etag}-gzip")
        if answer.status_code == 200:
            answer.headers["Content-Encoding"] = "gzip"
        return answer
