"""The sandbox's list of system calls, and what it refuses under old and new kernels."""

import errno
import json
import platform
import re
import struct
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from foldback.server.processes import landlock, seccomp, system_calls
from foldback.server.processes.system_calls import CALLS, PROGRAM_CALLS, UNSUPPORTED_CALLS
from tests.server.processes.test_children import WITHOUT_LIBRARIES
from tests.tools import LINUX_HEADERS

PID = 4321
"""Process id in filters that are only simulated."""
LAST_NUMBER = 600
"""System calls up to this number are tried; Linux 6.18 has 470."""
PROBE_CALLS = {335, 336}
"""Calls of x86_64 that the kernel does not filter: they end a process that the kernel does not
trace."""
PERMIT, REFUSE, UNSUPPORTED = "permit", "refuse", "unsupported"
OUTCOMES = {
    seccomp.RETURN_ALLOW: PERMIT,
    seccomp.RETURN_ERROR | errno.EPERM: REFUSE,
    seccomp.RETURN_ERROR | errno.ENOSYS: UNSUPPORTED,
}
X86_64, AARCH64 = seccomp.ARCHITECTURES.values()
I386_MARK = 0x40000003
needs_filter = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() not in seccomp.ARCHITECTURES,
    reason="a system without the filter",
)
CONFINED = f"""{WITHOUT_LIBRARIES}
import ctypes, json, os, sys
from pathlib import Path
from foldback.server.processes import landlock, sandbox

libc = ctypes.CDLL(None, use_errno=True)
libc.syscall.restype = ctypes.c_long

def system_call(*numbers):
    ctypes.set_errno(0)
    if libc.syscall(*map(ctypes.c_long, numbers)) >= 0:
        return 0
    return ctypes.get_errno()

def confine(place, *, drawing=False, version=None):
    kernel = landlock.version
    if version is not None:
        landlock.version = lambda: version
    sandbox.confine(sandbox.Allowed(writable=(Path(place),)), drawing=drawing)

def outcome(attempt):
    try:
        found = attempt()
    except Exception as error:
        return type(error).__name__
    return "done" if found in (None, 0) else str(found)
"""
"""Beginning of programs that confine themselves, without the planner's libraries."""
EVERY_OTHER_CALL = """
confine(sys.argv[1], drawing=sys.argv[2] == "drawing")
print(json.dumps({n: system_call(n, *[-1] * 6) for n in json.loads(sys.argv[3])}))
"""
SWAPPED_ENTRY = """
import mmap
page = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
page.write(bytes.fromhex("89f8cd80c3"))  # mov eax, edi; int 0x80; ret
address = ctypes.addressof(ctypes.c_char.from_buffer(page))
entry = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int)(address)
GETPID_32, GETPID, X32 = 20, 39, 0x40000000
print(entry(GETPID_32) == os.getpid(), flush=True)
confine(sys.argv[1])
print(json.dumps([entry(GETPID_32), system_call(X32 + GETPID)]), flush=True)
"""
"""Program that makes system calls of 32-bit programs and of the x32 ABI."""
ATTACK = """
import fcntl, resource, socket, signal, termios, threading

def checked(*numbers):
    if code := system_call(*numbers):
        raise OSError(code, "")

def attack(place, foreign, parent):
    own = Path(place) / "own"
    own.write_text("mine")
    def open_with(flags, path=foreign):
        os.close(os.open(path, flags))
    def exchange(kind):
        with socket.socket(kind):
            pass
    def ask_for_signal():
        with own.open() as file:
            fcntl.fcntl(file, fcntl.F_SETOWN, parent)
    def choose_signal():
        with own.open() as file:
            fcntl.fcntl(file, 10, signal.SIGKILL)  # F_SETSIG
    NUMBERS = json.loads(sys.argv[3])
    return {
        "foreign file": outcome(lambda: open_with(os.O_RDONLY)),
        "foreign file written": outcome(lambda: open_with(os.O_WRONLY)),
        "foreign file cut": outcome(lambda: os.truncate(foreign, 0)),
        "cut by opening": outcome(lambda: open_with(os.O_RDONLY | os.O_TRUNC)),
        "cut by opening for writing": outcome(lambda: open_with(os.O_WRONLY | os.O_TRUNC)),
        "cut by opening for nothing": outcome(lambda: open_with(os.O_ACCMODE | os.O_TRUNC)),
        "cut by opening for reading": outcome(lambda: open_with(os.O_RDONLY | os.O_TRUNC, own)),
        "moved out": outcome(lambda: own.rename(foreign)),
        "moved in": outcome(lambda: os.rename(foreign, own)),
        "removed": outcome(lambda: os.unlink(foreign)),
        "hard link": outcome(lambda: os.link(own, own.with_name("link"))),
        "link": outcome(lambda: os.symlink(foreign, own.with_name("link"))),
        "fifo": outcome(lambda: os.mkfifo(own.with_name("fifo"))),
        "mode": outcome(lambda: own.chmod(0o777)),
        "mode of new files": outcome(lambda: checked(NUMBERS["umask"], 0)),
        "attribute": outcome(lambda: os.setxattr(own, "user.a", b"")),
        "tcp": outcome(lambda: exchange(socket.AF_INET)),
        "unix": outcome(lambda: exchange(socket.AF_UNIX)),
        "netlink": outcome(lambda: exchange(socket.AF_NETLINK)),
        "datagrams": outcome(lambda: socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)),
        "signal": outcome(lambda: os.kill(parent, 0)),
        "signal to all": outcome(lambda: os.kill(-1, 0)),
        "signal to its group": outcome(lambda: os.kill(0, 0)),
        "signal to a thread": outcome(lambda: checked(NUMBERS["tgkill"], parent, parent, 0)),
        "signal by a file": outcome(ask_for_signal),
        "any signal by a file": outcome(choose_signal),
        "terminal": outcome(lambda: fcntl.ioctl(0, termios.TIOCSTI, b"x")),
        "limits of another": outcome(lambda: resource.prlimit(parent, resource.RLIMIT_NOFILE)),
        "program": outcome(lambda: os.execv("/bin/true", ["true"])),
        "process": outcome(os.fork),
        "traceable": outcome(lambda: checked(NUMBERS["prctl"], 4, 1, 0, 0, 0)),
        "namespace": outcome(lambda: checked(NUMBERS["clone"], 0x10000000, 0, 0, 0, 0)),
    }

def needs(place):
    def thread():
        thread = threading.Thread(target=int)
        thread.start()
        thread.join()
    def files():
        own = Path(place) / "needed"
        for mode in ("w", "r+", "a", "r"):
            own.open(mode).close()
        with own.open("r+") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            fcntl.lockf(file, fcntl.LOCK_EX)
            file.truncate(3)
            os.fsync(file.fileno())
        own.rename(own.with_name("renamed"))
    def loop():
        import asyncio
        asyncio.run(asyncio.to_thread(int))
    return {
        "thread": outcome(thread),
        "files": outcome(files),
        "event loop": outcome(loop),
        "own signal": outcome(lambda: os.kill(os.getpid(), 0)),
        "own thread": outcome(lambda: signal.pthread_kill(threading.get_ident(), 0)),
        "own limit": outcome(lambda: resource.getrlimit(resource.RLIMIT_NOFILE) and None),
        "further directory": outcome(lambda: sandbox.confine_thread(Path(place))),
    }

place, foreign = sys.argv[1:3]
import asyncio  # before files are refused
for version in json.loads(sys.argv[4]):
    own_place = Path(place) / str(version)
    own_place.mkdir()
    parent = os.getpid()
    if not os.fork():
        confine(own_place, version=version)
        found = {"attack": attack(own_place, foreign, parent), "needs": needs(own_place)}
        print(json.dumps(found), flush=True)
        os._exit(0)
    os.wait()
"""
"""Program that tries, for each version of Landlock's interface, what it may not and what it may."""


def run(code: str, *arguments: object) -> list[str]:
    """Return the lines that a confined program prints."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", CONFINED + code, *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@cache
def instructions(
    architecture: tuple[int, int, int], *, drawing: bool
) -> list[tuple[int, int, int, int]]:
    """Return the filter of an architecture."""
    mark, _, column = architecture
    return [*struct.iter_unpack("HBBI", seccomp.program(mark, column, PID, drawing=drawing))]


def decide(
    architecture: tuple[int, int, int], number: int, *arguments: int, mark: int = 0, drawing: bool
) -> str:
    """Return what the filter does with a system call: a simulation of classic BPF."""
    own_mark = architecture[0]
    code = instructions(architecture, drawing=drawing)
    data = struct.pack(
        "<IIQ6Q", number, mark or own_mark, 0, *arguments, *[0] * (6 - len(arguments))
    )
    at, loaded = 0, 0
    while True:
        operation, yes, no, value = code[at]
        at += 1
        if operation == seccomp.LOAD:
            (loaded,) = struct.unpack_from("<I", data, value)
        elif operation == seccomp.AND:
            loaded &= value
        elif operation == seccomp.EQUAL:
            at += yes if loaded == value else no
        elif operation == seccomp.AT_LEAST:
            at += yes if loaded >= value else no
        else:
            assert operation == seccomp.RETURN
            return OUTCOMES[value]


def numbers(column: int, *, drawing: bool) -> set[int]:
    """Return the numbers of all calls that the table permits."""
    tables = {**CALLS, **(PROGRAM_CALLS if drawing else {})}
    return {number for pair in tables.values() if (number := pair[column]) is not None}


def header_numbers(header: Path) -> dict[str, int]:
    """Return the numbers of system calls in a header of the kernel, by name."""
    pairs = re.findall(r"^#define __NR(?:3264)?_(\w+)\s+(\d+)$", header.read_text(), re.MULTILINE)
    generic = {"fstatat": "newfstatat"}
    call_numbers = {generic.get(name, name): int(number) for name, number in pairs}
    call_numbers.pop("syscalls", None)  # how many there are
    return call_numbers


def test_numbers_of_the_table_are_those_of_the_kernel() -> None:
    places = Path(LINUX_HEADERS.get())
    headers = {1: places / "asm-generic/unistd.h"}
    if platform.machine() == "x86_64":
        headers[0] = next(places.glob("**/asm/unistd_64.h"))
    all_calls = {**CALLS, **PROGRAM_CALLS, **UNSUPPORTED_CALLS}
    for column, header in headers.items():
        expected = header_numbers(header)
        newest = max(expected.values())
        for name, call_numbers in all_calls.items():
            number = call_numbers[column]
            if number is None or number <= newest:
                assert expected.get(name) == number, name
    # Since number 424, all architectures have the same numbers.
    assert all(x == a for x, a in all_calls.values() if x is not None and x >= 424)


@pytest.mark.parametrize("drawing", [False, True])
@pytest.mark.parametrize("architecture", [X86_64, AARCH64], ids=["x86_64", "aarch64"])
def test_only_listed_calls_are_permitted(architecture: tuple[int, int, int], drawing: bool) -> None:
    limited = system_calls.conditions(PID, drawing=drawing)
    column = architecture[2]
    free = numbers(column, drawing=drawing) - {CALLS[name][column] for name in limited}
    for number in range(LAST_NUMBER):
        decision = decide(architecture, number, *[2**64 - 1] * 6, drawing=drawing)
        if number in free:
            assert decision == PERMIT
        elif number >= 470 or (number, number) in UNSUPPORTED_CALLS.values():
            assert decision == UNSUPPORTED
        else:
            assert decision == REFUSE, number
        assert decide(architecture, number, mark=I386_MARK, drawing=drawing) == REFUSE
        x32 = 0x40000000 + number
        assert decide(architecture, x32, drawing=drawing) == UNSUPPORTED


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        ("kill", (PID, 9), PERMIT),
        ("kill", (PID + 1, 0), REFUSE),
        ("kill", (2**64 - PID, 0), REFUSE),
        ("tgkill", (PID, 77, 6), PERMIT),
        ("tgkill", (1, 1, 9), REFUSE),
        ("clone", (0x3D0F00,), PERMIT),  # pthread_create
        ("clone", (0x1200011,), REFUSE),  # fork
        *(("clone", (0x3D0F00 | 1 << bit,), REFUSE) for bit in (13, 15, 17, *range(25, 31))),
        ("fcntl", (3, 1030, 0), PERMIT),
        *(("fcntl", (3, command, 1), REFUSE) for command in (8, 10, 15, 1024, 1026)),
        ("ioctl", (0, 0x5401), PERMIT),
        *(("ioctl", (0, request), REFUSE) for request in (0x5412, 0x541C, 0x8901, 0x6401)),
        ("prctl", (15,), PERMIT),
        *(("prctl", (option,), REFUSE) for option in (1, 4, 8, 22, 35, 36, 62, 0x59616D61)),
        ("openat", (3, 0, 0x241), PERMIT),
        ("openat", (3, 0, 0x200), REFUSE),
        ("openat", (3, 0, 0x3), REFUSE),
        ("openat", (3, 0, 0x203), REFUSE),
        ("socketpair", (1, 0x80801), PERMIT),
        ("socketpair", (1, 2), REFUSE),
        ("socketpair", (1, 5), REFUSE),
        ("socketpair", (2, 1), REFUSE),
        ("renameat2", (3, 0, 3, 0, 1), PERMIT),
        ("renameat2", (3, 0, 3, 0, 4), REFUSE),
        ("sendto", (3, 0, 1, 0x4000), PERMIT),
        ("sendto", (3, 0, 1, 0x4001), REFUSE),
        ("recvfrom", (3, 0, 1, 1), REFUSE),
        ("prlimit64", (0, 7, 0, 5000), PERMIT),
        ("prlimit64", (0, 7, 5000, 0), REFUSE),
        ("prlimit64", (0, 7, 5000 << 32, 0), REFUSE),
        ("prlimit64", (PID, 7, 0, 5000), REFUSE),
    ],
)
@pytest.mark.parametrize("architecture", [X86_64, AARCH64], ids=["x86_64", "aarch64"])
def test_arguments_are_limited(
    architecture: tuple[int, int, int], name: str, arguments: tuple[int, ...], expected: str
) -> None:
    number = CALLS[name][architecture[2]]
    assert number is not None
    assert decide(architecture, number, *arguments, drawing=False) == expected


def test_drawing_process_may_start_programs_and_ask_drivers() -> None:
    number, clone = CALLS["ioctl"][0], CALLS["clone"][0]
    assert number is not None and clone is not None
    assert decide(X86_64, number, 4, 0xC0106444, drawing=True) == PERMIT
    assert decide(X86_64, number, 0, 0x5412, drawing=True) == REFUSE
    assert decide(X86_64, clone, 0x1200011, drawing=True) == PERMIT
    assert decide(X86_64, clone, 0x11200011, drawing=True) == REFUSE


@needs_filter
@pytest.mark.processes
@pytest.mark.parametrize("drawing", [False, True])
def test_kernel_refuses_every_other_call(tmp_path: Path, drawing: bool) -> None:
    column = seccomp.ARCHITECTURES[platform.machine()][2]
    listed = numbers(column, drawing=drawing)
    other_numbers = sorted(set(range(LAST_NUMBER)) - listed - PROBE_CALLS)
    (line,) = run(
        EVERY_OTHER_CALL, tmp_path, "drawing" if drawing else "", json.dumps(other_numbers)
    )
    call_results: dict[str, int] = json.loads(line)
    assert len(call_results) == len(other_numbers) > 300
    assert set(call_results.values()) == {errno.EPERM, errno.ENOSYS}
    assert call_results["435"] == errno.ENOSYS  # clone3
    refused = {number for number, code in call_results.items() if code == errno.EPERM}
    assert len(refused) > 150


@needs_filter
@pytest.mark.processes
@pytest.mark.skipif(platform.machine() != "x86_64", reason="only x86_64 has these entries")
def test_entries_of_other_programs_are_refused(tmp_path: Path) -> None:
    with_entry, answers = run(SWAPPED_ENTRY, tmp_path)
    assert with_entry == "True"
    assert json.loads(answers) == [-errno.EPERM, errno.ENOSYS]


@needs_filter
@pytest.mark.processes
@pytest.mark.skipif(not landlock.version(), reason="a kernel without Landlock")
def test_every_version_of_landlock_holds_what_is_promised(tmp_path: Path) -> None:
    """Each version that a kernel may report, from that of Linux 5.19 to this kernel's own."""
    column = seccomp.ARCHITECTURES[platform.machine()][2]
    named = {name: CALLS[name][column] for name in ("tgkill", "prctl", "clone")}
    named["umask"] = (95, 166)[column]
    foreign, place = tmp_path / "foreign", tmp_path / "place"
    foreign.write_text("theirs")
    place.mkdir()
    versions = list(range(landlock.MIN_LANDLOCK_VERSION, landlock.version() + 1))
    lines = run(ATTACK, place, foreign, json.dumps(named), json.dumps(versions))
    assert len(lines) == len(versions) > 0
    for version, line in zip(versions, lines, strict=True):
        call_results: dict[str, Any] = json.loads(line)
        assert set(call_results["attack"].values()) == {"PermissionError"}, (
            version,
            call_results["attack"],
        )
        assert set(call_results["needs"].values()) == {"done"}, (version, call_results["needs"])
        assert foreign.read_text() == "theirs"
