"""Landlock: denies a thread and its descendants access to files and TCP.

Requires Linux 5.13 or newer but no privileges; see landlock(7). It cannot be undone.
"""

from __future__ import annotations

import ctypes
import errno
import os
import stat
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
RULE_PATH_BENEATH: Final = 1
"""Type of a Landlock rule that permits access to a path and everything below it
(linux/landlock.h)."""
VERSION_FLAG: Final = 1
"""Flag with which landlock_create_ruleset(2) returns the version of the kernel's Landlock interface
(linux/landlock.h)."""
PR_SET_NO_NEW_PRIVS: Final = 38
"""Option of prctl(2) that forbids a thread to gain privileges, for example by a set-user-ID
program; Landlock requires it (linux/prctl.h)."""
O_PATH: Final = getattr(os, "O_PATH", 0)

EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
MAKE_CHAR, MAKE_SOCK, MAKE_FIFO, MAKE_BLOCK, MAKE_SYM = 1 << 6, 1 << 9, 1 << 10, 1 << 11, 1 << 12
TRUNCATE, IOCTL_DEV = 1 << 14, 1 << 15
READ_RIGHTS: Final = EXECUTE | READ_FILE | READ_DIR
REFUSED_RIGHTS: Final = MAKE_CHAR | MAKE_SOCK | MAKE_FIFO | MAKE_BLOCK | MAKE_SYM
"""Landlock rights to create devices, sockets, pipes and symbolic links. They are never granted, as
such files could mislead processes that read them later."""
FILE_RIGHTS: Final = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV
"""Landlock rights that a rule for a single file may grant; the kernel refuses all others in such a
rule."""
ALL_FILE_RIGHTS: Final = {1: (1 << 13) - 1, 2: (1 << 14) - 1, 3: (1 << 15) - 1, 5: (1 << 16) - 1}
"""Bit mask of all access rights to files that Landlock restricts, by the version of its interface
that introduced the mask (linux/landlock.h)."""
TCP_RIGHTS: Final = 0b11
"""Bit mask of the Landlock rights to bind (1) and to connect (2) TCP sockets. Confined processes
are denied both. Defined by linux/landlock.h for version 4 of the interface and later ones."""
SCOPES: Final = 0b11
"""Bit mask with which Landlock isolates a process from other processes' abstract Unix sockets and
from sending them signals, since version 6 of its interface (linux/landlock.h)."""
MIN_LANDLOCK_VERSION: Final = 2
"""Smallest version of the kernel's Landlock interface that confines a process. Version 1 forbids to
move a file into another directory, which the planner needs."""


class _Ruleset(ctypes.Structure):
    _fields_ = (
        ("handled_access_fs", ctypes.c_uint64),
        ("handled_access_net", ctypes.c_uint64),
        ("scoped", ctypes.c_uint64),
    )


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed_access", ctypes.c_uint64), ("parent_fd", ctypes.c_int32))


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowed:
    """Files and directories that a process may access, with everything below them.

    Missing paths are ignored.
    """

    readable: tuple[Path, ...] = ()
    writable: tuple[Path, ...] = ()


def version() -> int:
    """Return the version of the kernel's interface; 0 if it is missing or too old."""
    if sys.platform != "linux":
        return 0
    try:
        abi_version = _call(CREATE_RULESET, None, 0, VERSION_FLAG)
    except OSError:  # the kernel is older, or Landlock is disabled
        return 0
    return abi_version if abi_version >= MIN_LANDLOCK_VERSION else 0


def restrict(allowed: Allowed) -> None:
    """Deny the calling thread, and all that it starts later, other files and TCP.

    Raises:
        OSError: If the kernel refuses.
    """
    abi_version = version()
    handled = max(rights for since, rights in ALL_FILE_RIGHTS.items() if since <= abi_version)
    ruleset = _Ruleset(
        handled, TCP_RIGHTS if abi_version >= 4 else 0, SCOPES if abi_version >= 6 else 0
    )
    size = 8 if abi_version < 4 else 16 if abi_version < 6 else 24
    rules = _call(CREATE_RULESET, ctypes.byref(ruleset), size, 0)
    try:
        for path in allowed.readable:
            _allow(rules, path, READ_RIGHTS & handled)
        for path in allowed.writable:
            _allow(rules, path, handled & ~REFUSED_RIGHTS)
        no_new_rights()
        _call(RESTRICT_SELF, rules, 0)
    finally:
        os.close(rules)


def no_new_rights() -> None:
    """Prevent programs that the calling thread starts from gaining privileges."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)


def _allow(rules: int, path: Path, rights: int) -> None:
    try:
        place = os.open(path, O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(place).st_mode):
            rights &= FILE_RIGHTS
        rule = _PathBeneath(rights, place)
        _call(ADD_RULE, rules, RULE_PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(place)


def _call(number: int, *arguments: object) -> int:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    plain = [
        ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments
    ]
    answer = int(libc.syscall(ctypes.c_long(number), *plain))
    if answer < 0:
        code = ctypes.get_errno() or errno.ENOSYS
        raise OSError(code, os.strerror(code))
    return answer
