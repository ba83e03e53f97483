"""Disks: a small disk for one service, which can fill up, fail, and recover."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

from foldback.server.settings import MIB_BYTES

DISK_MIB: Final = 512
"""Size of the disk that the fault test mounts for the service under test, in MiB. It is larger than
the data of a whole run."""
RELEASE_TIMEOUT_S: Final = 10.0
"""Maximum time until killed processes have released the disk that the fault test mounted for them,
in s; beyond it the test ends with an error."""
INSIDE: Final = "FOLDBACK_LOAD_INSIDE"
"""Environment variable that marks a process as able to mount disks."""


class NoDiskError(RuntimeError):
    """Error raised if no disk can be mounted."""


def inside(arguments: list[str]) -> int | None:
    """Run Python again in a mount namespace of its own; return its exit code.

    Other processes would copy mounts of the common namespace into their own, which would keep the
    mounts in use.

    Returns:
        Exit code; None if this process already runs in such a namespace.

    Raises:
        NoDiskError: If no such namespace can be created.
    """
    if os.environ.get(INSIDE):
        return None
    for options in ("-m", "-Urm"):
        place = ["unshare", options]
        if _tried(*place, "mount", "-t", "tmpfs", "none", "/mnt"):
            repetition = [*place, sys.executable, *arguments]
            return subprocess.run(
                repetition, env={**os.environ, INSIDE: "1"}, check=False
            ).returncode
    raise NoDiskError("The fault test has to mount a disk, and may not even with `unshare -Urm`.")


class Disk:
    """A disk for one service, mounted at ``path``.

    It is an ext4 image, which can fail while processes write to it; unsynced data are then lost, as
    in a power cut. Where images cannot be mounted, it is a tmpfs, which can become read-only only
    while no file is open for writing, and which loses no data.
    """

    def __init__(self, place: Path) -> None:
        self.path = place / "disk"
        self._image = place / "disk.img"
        self._filler = self.path / "filler"
        self.path.mkdir(parents=True)
        self.real = self._mount_image()
        if not self.real:
            _run("mount", "-t", "tmpfs", "-o", f"size={DISK_MIB}m", "none", str(self.path))

    def _mount_image(self) -> bool:
        with open(self._image, "wb") as image:
            image.truncate(DISK_MIB * MIB_BYTES)
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
        """Fill the disk."""
        with open(self._filler, "ab", buffering=0) as file:
            free = shutil.disk_usage(self.path).free
            while free > MIB_BYTES:
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
        """Delete the file that fills the disk."""
        self._filler.unlink(missing_ok=True)

    def fail(self) -> None:
        """Make the disk read-only.

        An image fails at once, even while processes write to it; a tmpfs must have no writers.
        """
        _run("mount", "-o", "remount,abort" if self.real else "remount,ro", str(self.path))

    def come_back(self) -> None:
        """Check the file system and mount it again; no file may be open."""
        if not self.real:
            _run("mount", "-o", "remount,rw", str(self.path))
            return
        deadline = time.monotonic() + RELEASE_TIMEOUT_S
        while not _tried("umount", str(self.path)):
            if time.monotonic() > deadline:
                raise NoDiskError(
                    f"{self.path} is in use {RELEASE_TIMEOUT_S} s after all were killed."
                )
            time.sleep(0.1)  # killed processes take a moment to end
        _tried("e2fsck", "-p", str(self._image))
        _run("mount", "-o", "loop", *self._both)

    def close(self) -> None:
        """Unmount the disk and delete its image, once the last processes have ended."""
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
