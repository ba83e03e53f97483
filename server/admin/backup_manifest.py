"""Manifest of a backup: size and digest of every file. It is written last.

A backup may come from an untrusted source, so names in a manifest are checked before use as paths.
"""

from __future__ import annotations

import re
from collections import Counter
from hashlib import file_digest
from io import BufferedReader
from typing import Final, Self

import msgspec
from msgspec import Struct

from server.admin.errors import AdminError

MANIFEST: Final = "manifest.json"
BACKUP_FORMAT: Final = 1
"""Version number of the format of backups, which is stored in each. Restoring a backup of another
version is refused; the number rises when an older foldback could not restore a new backup."""
DATABASE_NAME: Final = re.compile(r"rows\.(sqlite|dump)")
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
    bytes: int
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
        schema: Version of the rows' tables.
        storage: Kind of the stored files: ``directory`` or ``objects``.
        database: Dump of the database.
        files: Stored files.
    """

    foldback: str
    created_at: float
    schema: str
    storage: str
    database: BackupFile
    files: tuple[BackupFile, ...]

    def text(self) -> bytes:
        """Return the manifest as JSON."""
        return msgspec.json.format(msgspec.json.encode(self), indent=1)

    @classmethod
    def read(cls, text: bytes) -> Self:
        """Return the manifest of a JSON text.

        Raises:
            AdminError: If it is not a manifest of this format, or contains an invalid name.
        """
        try:
            found = msgspec.json.decode(text, type=cls)
        except (msgspec.DecodeError, RecursionError) as error:
            raise AdminError(
                f"got a {MANIFEST} that cannot be read ({error}), expected a file in "
                f"format {BACKUP_FORMAT}; create a backup with `foldback admin backup`."
            ) from None
        names = [one.name for one in (found.database, *found.files)]
        strange = [] if DATABASE_NAME.fullmatch(names[0]) else names[:1]
        strange += [name for name in names[1:] if not is_file_name(name)]
        strange += [name for name, count in Counter(names).items() if count > 1]
        if strange:
            raise AdminError(
                f"got a {MANIFEST} with the invalid or repeated file name {strange[0]!r}; use "
                "another backup, because this one was changed."
            )
        return found


def is_file_name(name: str) -> bool:
    """Return True if a name can be that of a stored file of a fold."""
    return FILE_NAMES.fullmatch(name) is not None
