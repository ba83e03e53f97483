"""Owner tokens: dependencies that read them from requests and pass on only digests."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from msgspec import Meta

from foldback.server.errors import Forbidden, Unidentified
from foldback.server.store.owner import MAX_TOKEN_CHARS, MIN_TOKEN_CHARS, Claim, Owner

bearer = HTTPBearer(auto_error=False, description="The owner token of a fold.")
Bearer = Annotated[HTTPAuthorizationCredentials | None, Depends(bearer)]
"""Token of a request; an owner's, or the operator's for metrics."""
NewToken = Annotated[
    str,
    Meta(pattern=r"^[!-~]*(?!\n)$", min_length=MIN_TOKEN_CHARS, max_length=MAX_TOKEN_CHARS),
]
"""Owner token (the secret with which a client proves that folds are its own) that the client
chooses itself: printable ASCII characters without spaces."""


async def _optional_claim(credentials: Bearer) -> Claim | None:
    if credentials is None:
        return None
    token = credentials.credentials
    return Claim(token) if MIN_TOKEN_CHARS <= len(token) <= MAX_TOKEN_CHARS else None


async def _claim(claim: Annotated[Claim | None, Depends(_optional_claim)]) -> Claim:
    return claim or Claim.new()


async def _optional_owner(
    claim: Annotated[Claim | None, Depends(_optional_claim)],
) -> Owner | None:
    return None if claim is None else claim.owner


async def _required_owner(owner: Annotated[Owner | None, Depends(_optional_owner)]) -> Owner:
    if owner is not None:
        return owner
    raise Unidentified(
        "no-owner-token",
        "This request needs the fold's owner token as 'Authorization: Bearer …'; the response to "
        "the upload contained the token.",
    )


AnyClaim = Annotated[Claim, Depends(_claim)]
"""Claim with the request's token, or with a new one."""
OptionalOwner = Annotated[Owner | None, Depends(_optional_owner)]
"""Owner with the request's token; None without a token."""
RequiredOwner = Annotated[Owner, Depends(_required_owner)]
"""Owner with the request's token; a request without a token is refused."""


def not_owner(detail: str) -> Forbidden:
    """Return the refusal of a token that belongs to another owner, or to none."""
    return Forbidden("not-owner", detail)
