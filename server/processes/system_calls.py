"""System calls that a computing process may use; ``seccomp`` makes a filter of them.

The list holds the calls that folds, movies, pictures and trajectories were recorded to use, and
calls of the same kinds that other versions of Python, of the C library or of OpenGL drivers may
use. It holds no call that affects other processes, the network, devices or the machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

Numbers = tuple[int | None, int | None]
"""Numbers of a system call on x86_64 and on aarch64; None if an architecture has no such call."""

CALLS: Final[dict[str, Numbers]] = {
    # Files, in the directories that Landlock permits.
    "open": (2, None),
    "openat": (257, 56),
    "access": (21, None),
    "faccessat": (269, 48),
    "faccessat2": (439, 439),
    "stat": (4, None),
    "lstat": (6, None),
    "fstat": (5, 80),
    "newfstatat": (262, 79),
    "statx": (332, 291),
    "statfs": (137, 43),
    "fstatfs": (138, 44),
    "readlink": (89, None),
    "readlinkat": (267, 78),
    "getdents": (78, None),
    "getdents64": (217, 61),
    "getcwd": (79, 17),
    "chdir": (80, 49),
    "fchdir": (81, 50),
    "mkdir": (83, None),
    "mkdirat": (258, 34),
    "rmdir": (84, None),
    "unlink": (87, None),
    "unlinkat": (263, 35),
    "rename": (82, None),
    "renameat": (264, 38),
    "renameat2": (316, 276),
    # Open files.
    "read": (0, 63),
    "write": (1, 64),
    "pread64": (17, 67),
    "pwrite64": (18, 68),
    "readv": (19, 65),
    "writev": (20, 66),
    "preadv": (295, 69),
    "pwritev": (296, 70),
    "preadv2": (327, 286),
    "pwritev2": (328, 287),
    "lseek": (8, 62),
    "close": (3, 57),
    "close_range": (436, 436),
    "dup": (32, 23),
    "dup2": (33, None),
    "dup3": (292, 24),
    "fcntl": (72, 25),
    "flock": (73, 32),
    "ioctl": (16, 29),
    "ftruncate": (77, 46),
    "fallocate": (285, 47),
    "fadvise64": (221, 223),
    "readahead": (187, 213),
    "fsync": (74, 82),
    "fdatasync": (75, 83),
    "sync_file_range": (277, 84),
    "syncfs": (306, 267),
    "sendfile": (40, 71),
    "copy_file_range": (326, 285),
    "cachestat": (451, 451),
    # Pipes, and the pairs of sockets with which event loops wake up.
    "pipe": (22, None),
    "pipe2": (293, 59),
    "socketpair": (53, 199),
    "sendto": (44, 206),
    "recvfrom": (45, 207),
    "shutdown": (48, 210),
    "getsockopt": (55, 209),
    "getsockname": (51, 204),
    "getpeername": (52, 205),
    "poll": (7, None),
    "ppoll": (271, 73),
    "select": (23, None),
    "pselect6": (270, 72),
    "epoll_create": (213, None),
    "epoll_create1": (291, 20),
    "epoll_ctl": (233, 21),
    "epoll_wait": (232, None),
    "epoll_pwait": (281, 22),
    "epoll_pwait2": (441, 441),
    "eventfd": (284, None),
    "eventfd2": (290, 19),
    "signalfd": (282, None),
    "signalfd4": (289, 74),
    # Memory of the process.
    "brk": (12, 214),
    "mmap": (9, 222),
    "munmap": (11, 215),
    "mremap": (25, 216),
    "mprotect": (10, 226),
    "madvise": (28, 233),
    "mincore": (27, 232),
    "msync": (26, 227),
    "membarrier": (324, 283),
    "get_mempolicy": (239, 236),
    "mseal": (462, 462),
    "map_shadow_stack": (453, 453),
    "set_mempolicy": (238, 237),
    "mbind": (237, 235),
    # Threads and their locks.
    "clone": (56, 220),
    "set_tid_address": (218, 96),
    "set_robust_list": (273, 99),
    "rseq": (334, 293),
    "futex": (202, 98),
    "futex_waitv": (449, 449),
    "futex_wake": (454, 454),
    "futex_wait": (455, 455),
    "futex_requeue": (456, 456),
    "arch_prctl": (158, None),
    "prctl": (157, 167),
    "exit": (60, 93),
    "exit_group": (231, 94),
    "restart_syscall": (219, 128),
    "sched_yield": (24, 124),
    "sched_getaffinity": (204, 123),
    "sched_getparam": (143, 121),
    "sched_getscheduler": (145, 120),
    "sched_get_priority_max": (146, 125),
    "sched_get_priority_min": (147, 126),
    "sched_rr_get_interval": (148, 127),
    "getcpu": (309, 168),
    # Signals to itself.
    "kill": (62, 129),
    "tgkill": (234, 131),
    "rt_sigaction": (13, 134),
    "rt_sigprocmask": (14, 135),
    "rt_sigreturn": (15, 139),
    "rt_sigpending": (127, 136),
    "rt_sigsuspend": (130, 133),
    "rt_sigtimedwait": (128, 137),
    "sigaltstack": (131, 132),
    "pause": (34, None),
    "alarm": (37, None),
    "getitimer": (36, 102),
    "setitimer": (38, 103),
    # Clocks and timers.
    "time": (201, None),
    "gettimeofday": (96, 169),
    "clock_gettime": (228, 113),
    "clock_getres": (229, 114),
    "nanosleep": (35, 101),
    "clock_nanosleep": (230, 115),
    "times": (100, 153),
    "timer_create": (222, 107),
    "timer_settime": (223, 110),
    "timer_gettime": (224, 108),
    "timer_getoverrun": (225, 109),
    "timer_delete": (226, 111),
    "timerfd_create": (283, 85),
    "timerfd_settime": (286, 86),
    "timerfd_gettime": (287, 87),
    # Facts about the process and the machine.
    "getpid": (39, 172),
    "getppid": (110, 173),
    "gettid": (186, 178),
    "getpgid": (121, 155),
    "getpgrp": (111, None),
    "getsid": (124, 156),
    "getuid": (102, 174),
    "geteuid": (107, 175),
    "getgid": (104, 176),
    "getegid": (108, 177),
    "getresuid": (118, 148),
    "getresgid": (120, 150),
    "getgroups": (115, 158),
    "getpriority": (140, 141),
    "getrlimit": (97, 163),
    "prlimit64": (302, 261),
    "getrusage": (98, 165),
    "uname": (63, 160),
    "sysinfo": (99, 179),
    "getrandom": (318, 278),
    "capget": (125, 90),
    # Further restrictions of a thread.
    "landlock_create_ruleset": (444, 444),
    "landlock_add_rule": (445, 445),
    "landlock_restrict_self": (446, 446),
}
"""System calls that every computing process may use, some only with certain arguments."""
PROGRAM_CALLS: Final[dict[str, Numbers]] = {
    "fork": (57, None),
    "vfork": (58, None),
    "execve": (59, 221),
    "wait4": (61, 260),
    "waitid": (247, 95),
    "memfd_create": (319, 279),
}
"""System calls that only a process that draws movies may use: it starts the encoder, and OpenGL
drivers keep generated code in files in memory."""
UNSUPPORTED_CALLS: Final[dict[str, Numbers]] = {
    "clone3": (435, 435),
    "openat2": (437, 437),
}
"""System calls that fail with ``ENOSYS``, because a filter cannot see their arguments. Libraries
then use ``clone`` and ``openat`` instead."""
FIRST_UNKNOWN_CALL: Final = 470
"""First number after the system calls of Linux 6.18. Later ones fail with ``ENOSYS``, as on an
older kernel, so that new libraries use calls of the table instead. The numbers of the x32 ABI,
which repeat the calls of x86_64, are larger, too."""

ANY_BITS: Final = 0xFFFFFFFF
O_ACCMODE, O_RDONLY, O_WRONLY, O_RDWR, O_TRUNC = 0x3, 0x0, 0x1, 0x2, 0x200
AF_UNIX, SOCK_STREAM, SOCK_TYPE_MASK = 0x1, 0x1, 0xF
MSG_OOB, RENAME_NOREPLACE = 0x1, 0x1
CLONE_THREAD: Final = 0x10000
REFUSED_CLONE_FLAGS: Final = 0x7E02A000
"""Bit mask of flags of clone(2) that create namespaces (``CLONE_NEW…``), trace the new process
(``CLONE_PTRACE``) or give it another parent (``CLONE_PARENT``); see linux/sched.h."""
FCNTL_COMMANDS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 36, 37, 38, 1030)
"""Commands of fcntl(2) that copy descriptors (``F_DUPFD``, ``F_DUPFD_CLOEXEC``), read and set
flags, and lock files (linux/fcntl.h). Others make the kernel send a signal to any process
(``F_SETOWN`` with ``F_SETSIG``)."""
IOCTL_REQUESTS: Final = (0x5401, 0x802C542A, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)
"""Requests of ioctl(2): ``TCGETS``, ``TCGETS2`` and ``TIOCGWINSZ`` recognise a terminal,
``FIONREAD`` counts bytes, ``FIONBIO``, ``FIONCLEX`` and ``FIOCLEX`` set flags
(asm-generic/ioctls.h). Others can, for example, type into the operator's terminal."""
DRAWING_IOCTL_TYPES: Final = (0x6400, 0x4600, 0x4700, 0x6200, 0x3E00)
"""Types of requests of ioctl(2), in bits 8 to 15, that OpenGL drivers use: those of DRM, of NVIDIA,
of WSL, of shared buffers, and of fences."""
PRCTL_OPTIONS: Final = (15, 16, 23, 38, 39, 51, 64, 0x53564D41)
"""Options of prctl(2) that set or get the name of a thread, read its capabilities and the length of
its vectors, forbid new privileges, and name memory (linux/prctl.h)."""


@dataclass(frozen=True, slots=True)
class Condition:
    """Condition that an argument of a system call must meet.

    Attributes:
        argument: Position of the argument, from 0.
        patterns: Pairs of a bit mask and a value. The masked argument must equal one of the values.
        upper: True for the upper 32 bits of the argument instead of the lower ones.
    """

    argument: int
    patterns: tuple[tuple[int, int], ...]
    upper: bool = False


def _equal(argument: int, *values: int) -> Condition:
    return Condition(argument, tuple((ANY_BITS, value) for value in values))


def _opened(argument: int) -> Condition:
    """Return the condition on the flags of open(2).

    Before Linux 6.2, Landlock does not restrict truncation, and any file could be truncated that is
    opened for reading only, or for neither reading nor writing.
    """
    allowed_modes = (O_RDONLY, O_WRONLY, O_RDWR, O_WRONLY | O_TRUNC, O_RDWR | O_TRUNC)
    return Condition(argument, tuple((O_ACCMODE | O_TRUNC, flags) for flags in allowed_modes))


def conditions(pid: int, *, drawing: bool) -> dict[str, tuple[Condition, ...]]:
    """Return the conditions under which a process may use some of its system calls.

    Args:
        pid: Id of the process; it may send signals only to itself.
        drawing: True if it draws with OpenGL and may start programs; otherwise it may start only
            threads.
    """
    driver = tuple((0xFF00, kind) for kind in DRAWING_IOCTL_TYPES if drawing)
    thread = 0 if drawing else CLONE_THREAD
    return {
        "open": (_opened(1),),
        "openat": (_opened(2),),
        # Without exchanging files, and without leaving devices in their place.
        "renameat2": (_equal(4, 0, RENAME_NOREPLACE),),
        "fcntl": (_equal(1, *FCNTL_COMMANDS),),
        "ioctl": (Condition(1, (*_equal(1, *IOCTL_REQUESTS).patterns, *driver)),),
        "prctl": (_equal(0, *PRCTL_OPTIONS),),
        "clone": (Condition(0, ((REFUSED_CLONE_FLAGS | thread, thread),)),),
        "kill": (_equal(0, pid),),
        "tgkill": (_equal(0, pid),),
        # Python's event loops need pairs of stream sockets.
        "socketpair": (_equal(0, AF_UNIX), Condition(1, ((SOCK_TYPE_MASK, SOCK_STREAM),))),
        # Out-of-band data, which event loops do not send, is a rarely used part of the kernel.
        "sendto": (Condition(3, ((MSG_OOB, 0),)),),
        "recvfrom": (Condition(3, ((MSG_OOB, 0),)),),
        # Only its own limits, and only with a null pointer instead of new ones.
        "prlimit64": (_equal(0, 0), _equal(2, 0), Condition(2, ((ANY_BITS, 0),), upper=True)),
    }
