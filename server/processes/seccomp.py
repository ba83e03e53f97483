"""Seccomp: a filter with which the kernel permits a process only listed system calls.

Landlock restricts files and, on newer kernels, TCP and signals. The filter refuses whatever else
affects more than the process itself, on all kernels.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Sequence
from typing import Final

from foldback.server.processes.landlock import no_new_rights
from foldback.server.processes.system_calls import (
    CALLS,
    FIRST_UNKNOWN_CALL,
    PROGRAM_CALLS,
    UNSUPPORTED_CALLS,
    Condition,
    conditions,
)

ARCHITECTURES: Final = {"x86_64": (0xC000003E, 317, 0), "aarch64": (0xC00000B7, 277, 1)}
"""Figures of each processor architecture for the seccomp filter: audit number (linux/audit.h),
number of the system call seccomp(2), and index of the architecture's numbers in the table of
system calls."""
LOAD, AND, EQUAL, AT_LEAST, RETURN = 0x20, 0x54, 0x15, 0x35, 0x06
NUMBER_AT, MARK_AT, ARGUMENTS_AT = 0, 4, 16
"""Offsets in ``struct seccomp_data`` (linux/seccomp.h), bytes. An argument has 8 bytes, the lower
half first on the architectures above."""
RETURN_ALLOW: Final = 0x7FFF0000
"""Return value with which a seccomp filter permits a system call (linux/seccomp.h)."""
RETURN_ERROR: Final = 0x00050000
"""Return value with which a seccomp filter makes a system call fail; its lowest bits are the error
number (linux/seccomp.h)."""
SET_FILTER, ALL_THREADS = 1, 1

Instruction = tuple[int, int, int, int]
"""Instruction of classic BPF: operation, numbers of instructions to skip if its condition is true
and if it is false, and operand."""
ALLOW: Final[Instruction] = (RETURN, 0, 0, RETURN_ALLOW)
REFUSE: Final[Instruction] = (RETURN, 0, 0, RETURN_ERROR | errno.EPERM)
UNSUPPORTED: Final[Instruction] = (RETURN, 0, 0, RETURN_ERROR | errno.ENOSYS)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def restrict(*, drawing: bool) -> None:
    """Permit this process and its descendants only the system calls of the table.

    On unknown architectures it does nothing.

    Args:
        drawing: True if the process draws with OpenGL and starts programs.

    Raises:
        OSError: If the kernel refuses.
    """
    architecture = ARCHITECTURES.get(platform.machine())
    if sys.platform != "linux" or architecture is None:
        return
    mark, seccomp, column = architecture
    instructions = program(mark, column, os.getpid(), drawing=drawing)
    filter_program = _Program(len(instructions) // 8, instructions)
    no_new_rights()
    libc = ctypes.CDLL(None, use_errno=True)
    call = (ctypes.c_long(seccomp), ctypes.c_long(SET_FILTER), ctypes.c_long(ALL_THREADS))
    if libc.syscall(*call, ctypes.byref(filter_program)):
        code = ctypes.get_errno() or errno.EAGAIN
        raise OSError(code, os.strerror(code))


def program(mark: int, column: int, pid: int, *, drawing: bool) -> bytes:
    """Return the filter of a process, as instructions of classic BPF."""
    limited = conditions(pid, drawing=drawing)
    code = [
        (LOAD, 0, 0, MARK_AT),
        # Another architecture: the 32-bit system calls have other numbers.
        *_otherwise(EQUAL, mark, [REFUSE]),
        (LOAD, 0, 0, NUMBER_AT),
    ]
    for name, numbers in {**CALLS, **(PROGRAM_CALLS if drawing else {})}.items():
        if (number := numbers[column]) is not None:
            code += _when(EQUAL, number, _allowed_if(limited.get(name, ())))
    for numbers in UNSUPPORTED_CALLS.values():
        if (number := numbers[column]) is not None:
            code += _when(EQUAL, number, [UNSUPPORTED])
    code += [*_when(AT_LEAST, FIRST_UNKNOWN_CALL, [UNSUPPORTED]), REFUSE]
    return b"".join(struct.pack("HBBI", *instruction) for instruction in code)


def _when(operation: int, value: int, then: Sequence[Instruction]) -> list[Instruction]:
    """Return instructions that run ``then`` if the loaded value fulfils the comparison."""
    return [(operation, 0, len(then), value), *then]


def _otherwise(operation: int, value: int, then: Sequence[Instruction]) -> list[Instruction]:
    """Return instructions that run ``then`` if the loaded value does not fulfil the comparison."""
    return [(operation, len(then), 0, value), *then]


def _allowed_if(required: Sequence[Condition]) -> list[Instruction]:
    """Return instructions that permit a call if its arguments meet all conditions."""
    code: list[Instruction] = []
    for condition in required:
        place = ARGUMENTS_AT + 8 * condition.argument + 4 * condition.upper
        for k, (mask, value) in enumerate(condition.patterns):
            # After a match, skip the other patterns, of 3 instructions each, and the refusal.
            skipped = 3 * (len(condition.patterns) - k - 1) + 1
            code += [(LOAD, 0, 0, place), (AND, 0, 0, mask), (EQUAL, skipped, 0, value)]
        code.append(REFUSE)
    return [*code, ALLOW]
