"""Pictures: social pictures of folds, drawn in a child process.

Drawing needs compiled kernels, for which no page shall wait.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

from server.processes.children import Pool
from server.processes.scratch import CHAIN, PICTURE, Scratch

MAX_PICTURE_BYTES: Final = 8 * 2**20
"""Larger files of a child are cut off; a picture of 1200×630 pixels takes 0.1 MB. Chosen."""


class Pictures:
    """Has pictures drawn. Safe to use from many threads.

    Args:
        pool: Children that draw.
        scratch: Directories for one picture each.
    """

    def __init__(self, pool: Pool, scratch: Scratch) -> None:
        self._pool = pool
        self._scratch = scratch

    def close(self) -> None:
        """End the children."""
        self._pool.close()

    def drawn(self, chain: Path) -> bytes:
        """Return the picture of the chain in a file, as PNG.

        Raises:
            OSError: When the file cannot be read, or the disk is full.
            InputError: When it holds no chain.
            ChildError: When the child crashed or went beyond a limit.
        """
        with self._scratch.directory() as place:
            shutil.copyfile(chain, place / CHAIN)
            self._pool.call("picture", place)
            with open(place / PICTURE, "rb") as picture:
                return picture.read(MAX_PICTURE_BYTES)
