"""Owner of folds, previews and movies, identified by the stored digest of a secret token."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass, field
from typing import Final

import sqlalchemy as sa
from sqlalchemy.orm import InstrumentedAttribute

from foldback.server.store.schema import FoldRow

MIN_TOKEN_CHARS: Final = 24
"""Minimum length of the secret token that proves the ownership of folds, in characters; a shorter
one counts as none."""
MAX_TOKEN_CHARS: Final = 200
"""Maximum length of the secret token that proves the ownership of folds, in characters; a longer
one counts as none."""
DigestColumn = InstrumentedAttribute[str] | InstrumentedAttribute[str | None]
"""Column with digests of owner tokens."""


@dataclass(frozen=True, slots=True)
class Owner:
    """Holder of an owner token.

    Attributes:
        digest: SHA-256 of the token, in hexadecimal digits.
    """

    digest: str

    @classmethod
    def from_token(cls, token: str) -> Owner:
        """Return the owner with this token."""
        return cls(hashlib.sha256(token.encode()).hexdigest())

    def owns(self, digest: str | None) -> bool:
        """Return True if a stored digest is this owner's; no owner has an empty one."""
        return bool(digest) and hmac.compare_digest(self.digest, digest)


@dataclass(frozen=True, slots=True)
class Claim:
    """Owner of the items that a request creates, with the token for the response.

    Attributes:
        token: The secret; only the response to the request contains it.
    """

    token: str = field(repr=False)

    @property
    def owner(self) -> Owner:
        """Owner with the token."""
        return Owner.from_token(self.token)

    @classmethod
    def new(cls) -> Claim:
        """Return the claim of a client without a token."""
        return cls(new_token())


def new_token() -> str:
    """Return a token that cannot be guessed."""
    return secrets.token_urlsafe(24)


def owned_by(owner: Owner, column: DigestColumn = FoldRow.owner) -> sa.ColumnElement[bool]:
    """Return the condition for a column to contain an owner's digest."""
    return column == owner.digest
