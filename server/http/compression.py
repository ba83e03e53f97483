"""Compression: files that are the same for all are compressed once.

Answers that are made for one question are left to what stands in front of the service. Where a
secret and a stranger's words share an answer, its packed length tells of the secret; what is packed
here holds neither.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Self

from fastapi import Request
from fastapi.responses import Response

from server.http.downloads import etag_of, revalidated

MAX_COMPRESSED_FRACTION: Final = 0.9
"""Largest size of a gzipped answer, as a fraction of the original size, at which the gzipped form
is sent; otherwise the original is sent. A larger value makes browsers unpack for little gain.
Chosen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asset:
    """File that does not change while the service runs.

    Attributes:
        data: The uncompressed bytes.
        packed: The bytes compressed by gzip; None if they are hardly smaller.
        kind: Its media type.
        etag: Changes with its content.
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
            packed=packed if len(packed) < MAX_COMPRESSED_FRACTION * len(data) else None,
            kind=kind,
            etag=etag_of(data),
        )

    def response(self, request: Request, headers: Mapping[str, str] | None = None) -> Response:
        """Return the answer, or 304 if the client has it; with ``headers`` besides its own."""
        takes = "gzip" in request.headers.get("accept-encoding", "")
        packed = self.packed if takes else None
        vary = {} if self.packed is None else {"Vary": "Accept-Encoding"}
        told = {**vary, **(headers or {})}
        if packed is None:
            return revalidated(request, self.data, self.kind, told, etag=self.etag)
        answer = revalidated(request, packed, self.kind, told, etag=f"{self.etag}-gzip")
        if answer.status_code == 200:
            answer.headers["Content-Encoding"] = "gzip"
        return answer
