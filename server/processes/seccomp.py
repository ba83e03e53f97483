"""Seccomp: a filter with which the kernel refuses system calls of a process.

Landlock restricts only TCP. The filter refuses all kinds of sockets and calls that bypass either of
them. It also refuses calls that Landlock permits: changes to modes and times of other files, and to
limits and priorities of other processes.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import socket
import struct
import sys
from typing import Final

from server.processes.landlock import no_new_rights

ARCHITECTURES: Final = {"x86_64": (0xC000003E, 317, 0), "aarch64": (0xC00000B7, 277, 1)}
"""Figures of each processor architecture for the seccomp filter: audit number (linux/audit.h),
number of the system call seccomp(2), and index of the architecture's numbers in the tables of
system calls."""
REFUSED_CALLS: Final[dict[str, tuple[int, int | None]]] = {
    "socket": (41, 198),
    "connect": (42, 203),
    "bind": (49, 200),
    "listen": (50, 201),
    # io_uring can create sockets, too.
    "io_uring_setup": (425, 425),
    "io_uring_enter": (426, 426),
    "io_uring_register": (427, 427),
    # Memory and files of other processes of the same user.
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "pidfd_getfd": (438, 438),
    # Calls that bypass Landlock, which restricts `truncate` only since Linux 6.2.
    "truncate": (76, 45),
    "open_by_handle_at": (304, 265),
    # Scheduling of other processes.
    "setpriority": (141, 140),
    "sched_setparam": (142, 118),
    "sched_setscheduler": (144, 119),
    "sched_setaffinity": (203, 122),
    "sched_setattr": (314, 274),
    "ioprio_set": (251, 30),
    # Modes, owners, times and attributes of files, which Landlock does not restrict.
    "chmod": (90, None),
    "fchmod": (91, 52),
    "fchmodat": (268, 53),
    "fchmodat2": (452, 452),
    "chown": (92, None),
    "fchown": (93, 55),
    "lchown": (94, None),
    "fchownat": (260, 54),
    "utime": (132, None),
    "utimes": (235, None),
    "futimesat": (261, None),
    "utimensat": (280, 88),
    "setxattr": (188, 5),
    "lsetxattr": (189, 6),
    "fsetxattr": (190, 7),
    "setxattrat": (463, 463),
    "removexattr": (197, 14),
    "lremovexattr": (198, 15),
    "fremovexattr": (199, 16),
    "removexattrat": (466, 466),
    "file_setattr": (469, 469),
    # Large parts of the kernel that computing processes do not need.
    "unshare": (272, 97),
    "setns": (308, 268),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "userfaultfd": (323, 282),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
}
"""System calls that the seccomp filter refuses a computing process, with their numbers on x86_64
and on aarch64; None if an architecture has no such call."""
PRLIMIT_CALLS: Final = (302, 261)
"""Numbers of the system call prlimit(2) on x86_64 and on aarch64. The seccomp filter permits a
process to read and lower its own limits only."""
SOCKETPAIR_CALLS: Final = (53, 199)
"""Numbers of the system call socketpair(2) on x86_64 and on aarch64. The seccomp filter permits
pairs of stream sockets only, which Python's event loops need."""
FIRST_X32_CALL: Final = 0x40000000
"""Smallest number of the system calls of the x32 ABI, which duplicate those of x86_64. The seccomp
filter refuses them all, as they would bypass it."""

LOAD, AND, EQUAL, AT_LEAST, RETURN = 0x20, 0x54, 0x15, 0x35, 0x06
NUMBER_AT, MARK_AT, FIRST_ARGUMENT_AT, SECOND_ARGUMENT_AT = 0, 4, 16, 24
RETURN_ALLOW: Final = 0x7FFF0000
"""Return value with which a seccomp filter permits a system call (linux/seccomp.h)."""
RETURN_REFUSE: Final = 0x00050000 | errno.EACCES
"""Return value with which a seccomp filter makes a system call fail with the error ``EACCES``
(linux/seccomp.h)."""
SET_FILTER, ALL_THREADS = 1, 1


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def refuse_calls() -> None:
    """Apply the filter to this process and its descendants, unless the architecture is unknown.

    Raises:
        OSError: If the kernel refuses.
    """
    found = ARCHITECTURES.get(platform.machine())
    if sys.platform != "linux" or found is None:
        return
    mark, seccomp, column = found
    instructions = program(mark, column)
    given = _Program(len(instructions) // 8, instructions)
    no_new_rights()
    libc = ctypes.CDLL(None, use_errno=True)
    call = (ctypes.c_long(seccomp), ctypes.c_long(SET_FILTER), ctypes.c_long(ALL_THREADS))
    if libc.syscall(*call, ctypes.byref(given)):
        code = ctypes.get_errno() or errno.EAGAIN
        raise OSError(code, os.strerror(code))


def program(mark: int, column: int) -> bytes:
    """Return the filter, as instructions of classic BPF."""
    numbers = [number for pair in REFUSED_CALLS.values() if (number := pair[column]) is not None]
    # Jump offsets are numbers of skipped instructions, if the condition is true and if it is false.
    own = [
        (LOAD, 0, 0, FIRST_ARGUMENT_AT),
        (EQUAL, 0, 1, 0),
        (RETURN, 0, 0, RETURN_ALLOW),
        (RETURN, 0, 0, RETURN_REFUSE),
    ]
    stream = [
        (LOAD, 0, 0, SECOND_ARGUMENT_AT),
        (AND, 0, 0, 0xF),
        (EQUAL, 0, 1, int(socket.SOCK_STREAM)),
        (RETURN, 0, 0, RETURN_ALLOW),
        (RETURN, 0, 0, RETURN_REFUSE),
    ]
    last = len(numbers) + 4
    head = [
        (LOAD, 0, 0, MARK_AT),
        (EQUAL, 0, last + 1, mark),
        (LOAD, 0, 0, NUMBER_AT),
        (AT_LEAST, last - 1, 0, FIRST_X32_CALL),
        *((EQUAL, last - 2 - i, 0, number) for i, number in enumerate(numbers)),
        (EQUAL, 3 + len(own), 0, SOCKETPAIR_CALLS[column]),
        (EQUAL, 2, 0, PRLIMIT_CALLS[column]),
        (RETURN, 0, 0, RETURN_ALLOW),
        (RETURN, 0, 0, RETURN_REFUSE),
    ]
    return b"".join(struct.pack("HBBI", *one) for one in [*head, *own, *stream])
