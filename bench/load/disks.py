"""Disks: a small one of its own for a service, that can be full, fail, and come back."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

MIB: Final = 2**20
SIZE_MIB: Final = 512
ENDING_S: Final = 10.0
INSIDE: Final = "FOLDBACK_LOAD_INSIDE"


class NoDiskError(RuntimeError):
    """Nothing can be mounted here."""


def inside(arguments: list[str]) -> int | None:
    """Runs Python where it may mount without anybody else seeing it; None when it is there.

    Other processes would get copies of what is mounted, and hold on to it.

    Raises:
        NoDiskError: When that can't be had.
    """
    if os.environ.get(INSIDE):
        return None
    for options in ("-m", "-Urm"):
        place = ["unshare", options]
        if _tried(*place, "mount", "-t", "tmpfs", "none", "/mnt"):
            again = [*place, sys.executable, *arguments]
            return subprocess.run(again, env={**os.environ, INSIDE: "1"}, check=False).returncode
    raise NoDiskError("The fault test has to mount a disk, and may not even with `unshare -Urm`.")


class Disk:
    """A disk that is mounted at ``path`` and belongs to nobody else.

    It is an image with ext4, which can break under those who write to it and forgets then what was
    not written through, as in a power cut. Where images can't be mounted it is memory, which can
    only be made read-only while nobody has a file open for writing, and forgets nothing.
    """

    def __init__(self, place: Path) -> None:
        self.path = place / "disk"
        self._image = place / "disk.img"
        self._filler = self.path / "filler"
        self.path.mkdir(parents=True)
        self.real = self._mount_image()
        if not self.real:
            _run("mount", "-t", "tmpfs", "-o", f"size={SIZE_MIB}m", "none", str(self.path))

    def _mount_image(self) -> bool:
        with open(self._image, "wb") as image:
            image.truncate(SIZE_MIB * MIB)
        make = ["mkfs.ext4", "-q", "-m", "0", "-F", str(self._image)]
        try:
            return _tried(*make) and _tried("mount", "-o", "loop", *self._both)
        finally:
            if not os.path.ismount(self.path):
                self._image.unlink()

    @property
    def _both(self) -> tuple[str, str]:
        return str(self._image), str(self.path)

    def fill(self) -> None:
        """Leaves no room."""
        with open(self._filler, "ab", buffering=0) as file:
            free = shutil.disk_usage(self.path).free
            while free > MIB:
                try:
                    os.posix_fallocate(file.fileno(), file.tell(), free)
                    file.seek(0, os.SEEK_END)
                    break
                except OSError:
                    free = free * 3 // 4
            try:
                while True:
                    file.write(bytes(4096))
            except OSError:
                return

    def free(self) -> None:
        """Makes room again."""
        self._filler.unlink(missing_ok=True)

    def fail(self) -> None:
        """Nothing can be written from now on.

        On a real disk this is so at once, whoever writes; else nobody may be writing.
        """
        _run("mount", "-o", "remount,abort" if self.real else "remount,ro", str(self.path))

    def come_back(self) -> None:
        """As after a repair; nobody may have a file open."""
        if not self.real:
            _run("mount", "-o", "remount,rw", str(self.path))
            return
        deadline = time.monotonic() + ENDING_S
        while not _tried("umount", str(self.path)):
            if time.monotonic() > deadline:
                raise NoDiskError(f"{self.path} is in use {ENDING_S} s after all were killed.")
            time.sleep(0.1)  # processes that were killed take a moment to end
        _tried("e2fsck", "-p", str(self._image))
        _run("mount", "-o", "loop", *self._both)

    def close(self) -> None:
        """Takes it away for good; what still ends on it has it until then."""
        _run("umount", "--lazy", str(self.path))
        self._image.unlink(missing_ok=True)


def _tried(*command: str) -> bool:
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoDiskError(f"`{' '.join(command)}` failed: {done.stderr.strip()}")
