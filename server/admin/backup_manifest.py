"""Manifest of a backup: size and digest of every file. It is written last.

A backup may come from an untrusted source, so names in a manifest are checked before use as paths.
"""

from __future__ import annotations

import re
from collections import Counter
from hashlib import file_digest
from io import BufferedReader
from typing import Annotated, Final, Literal, Self

import msgspec
from msgspec import Meta, Struct

from foldback.server.admin.errors import AdminError

MANIFEST: Final = "manifest.json"
BACKUP_FORMAT: Final = 2
"""Version number of the format of backups, which is stored in each. Restoring a backup of another
version is refused; the number rises when an older foldback could not restore a new backup."""
ROWS: Final = "rows.jsonl"
"""Name of the file with the rows."""
MAX_MANIFEST_BYTES: Final = 256 << 20
"""Maximum size of a manifest, in bytes: about two million files."""
Words = Annotated[str, Meta(pattern=r"\A[0-9A-Za-z.+_-]{1,64}\Z")]
"""Short text that can be shown on a terminal."""
FILE_NAMES: Final = re.compile(
    r"folds/[0-9A-Za-z]{1,32}(/(?!\.)[^/\\\x00-\x1f]{1,255}){1,32}"
    r"|movies/[0-9A-Za-z]{1,32}/(?!\.)[^/\\\x00-\x1f]{1,255}"
)
"""Pattern of the names of stored files: the id of a fold, then parts without a leading dot.
Temporary files have one and are not backed up."""


class BackupFile(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One file of a backup.

    Attributes:
        name: Path below the backup's directory.
        bytes: Size.
        sha256: Digest of the content, in hexadecimal digits.
    """

    name: str
    bytes: Annotated[int, Meta(ge=0, le=2**53)]
    sha256: str

    @classmethod
    def of(cls, name: str, file: BufferedReader) -> Self:
        """Read a file to its end and describe it."""
        return cls(name=name, sha256=file_digest(file, "sha256").hexdigest(), bytes=file.tell())


class Manifest(
    Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="format",
    tag=BACKUP_FORMAT,
):
    """Content of a backup.

    Attributes:
        foldback: Version of the foldback that created it.
        created_at: Time of its start, in seconds since 1970.
        schema: Version of the schema of the rows.
        storage: Kind of the stored files: ``directory`` or ``objects``.
        rows: Rows of the database.
        files: Stored files.
    """

    foldback: Words
    created_at: Annotated[float, Meta(ge=0, le=1e11)]
    schema: Words
    storage: Literal["directory", "objects"]
    rows: BackupFile
    files: tuple[BackupFile, ...]

    def text(self) -> bytes:
        """Return the manifest as JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=1)

    @property
    def total_bytes(self) -> int:
        """Size of all files of the backup."""
        return sum(file.bytes for file in (self.rows, *self.files))

    @classmethod
    def read(cls, text: bytes) -> Self:
        """Return the manifest of a JSON text.

        Raises:
            AdminError: If it is not a manifest of this format, or contains an invalid name.
        """
        if len(text) > MAX_MANIFEST_BYTES:
            raise AdminError(
                f"got a {MANIFEST} of more than {MAX_MANIFEST_BYTES >> 20} MiB; use another backup."
            )
        try:
            version = msgspec.json.decode(text, type=_Version)
            if version.format == BACKUP_FORMAT:
                manifest = msgspec.json.decode(text, type=cls)
                _check_names(manifest)
                return manifest
        except (msgspec.DecodeError, RecursionError) as error:
            raise AdminError(
                f"got a {MANIFEST} that cannot be read ({str(error)!r}), expected a file in "
                f"format {BACKUP_FORMAT}; create a backup with `foldback admin backup`."
            ) from None
        raise AdminError(
            f"got a backup in format {version.format}, expected format {BACKUP_FORMAT}; restore it "
            "with the version of foldback that made it."
        )


class _Version(Struct, frozen=True):
    """The part of a manifest that all formats have in common."""

    format: int


def _check_names(manifest: Manifest) -> None:
    keys = ("folds/",) if manifest.storage == "directory" else ("folds/", "movies/")
    names = [file.name for file in manifest.files]
    strange = [] if manifest.rows.name == ROWS else [manifest.rows.name]
    strange += [name for name in names if not (is_file_name(name) and name.startswith(keys))]
    strange += [name for name, count in Counter(names).items() if count > 1]
    if strange:
        raise AdminError(
            f"got a {MANIFEST} with the invalid or repeated file name {strange[0]!r}; use another "
            "backup, because this one was changed."
        )


def is_file_name(name: str) -> bool:
    """Return True if a name can be that of a stored file of a fold."""
    return FILE_NAMES.fullmatch(name) is not None
