"""Tasks of sweeps that end in all ways in which a fold may end."""

import ctypes
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from foldback.planner.progress import Cancelled
from foldback.planner.sweeps.case import Outcome, Row


def empty(cancelled: Cancelled) -> Row:
    return {"verdict": "empty"}


def fail(cancelled: Cancelled) -> Row:
    raise ValueError("got a fold, expected none")


def end_program(cancelled: Cancelled) -> Row:
    sys.exit(3)


def end_process(cancelled: Cancelled) -> Row:
    os._exit(7)


def end_process_well(cancelled: Cancelled) -> Row:
    os._exit(0)


def crash(cancelled: Cancelled) -> Row:
    ctypes.string_at(0)
    raise AssertionError("still there")


def hang(cancelled: Cancelled) -> Row:
    """Hang in native code that holds the interpreter's lock."""
    ctypes.PyDLL(None).sleep(600)
    raise AssertionError("still there")


def take_memory(cancelled: Cancelled) -> Row:
    arrays: list[object] = []
    while True:
        arrays.append(np.ones(2**20))


def spin(cancelled: Cancelled) -> Row:
    while not cancelled():
        pass
    return {"verdict": "ended by itself"}


def ignore_limit(cancelled: Cancelled) -> Row:
    while True:
        pass


def start_program(cancelled: Cancelled) -> Row:
    """Leave a program behind that holds this process's files."""
    subprocess.Popen(["sleep", "600"], close_fds=False)
    return {"verdict": "started"}


def return_an_array(cancelled: Cancelled) -> Row:
    return {"steps": np.int64(3)}  # pyright: ignore[reportReturnType]


def write_temporary(cancelled: Cancelled) -> Outcome:
    return Outcome(row={}, files={"place": tempfile.mkstemp()[1].encode()})


class OtherAnswer:
    """Answer of a worker with another version of a package, which cannot be unpickled here."""

    def __reduce__(self) -> Any:
        return (import_module, ("package_of_another_version",))


def answer_of_another_version(**options: object) -> OtherAnswer:
    return OtherAnswer()


def load_a_module(cancelled: Cancelled) -> Row:
    loaded = "colorsys" in sys.modules
    import colorsys

    return {"loaded": loaded, "red": colorsys.hsv_to_rgb(0, 1, 1)[0]}


def _note_start(witness: Path) -> int:
    """Note this process in a file; return the number of starts."""
    with witness.open("a") as file:
        file.write(f"{os.getpid()}\n")
    return len(witness.read_text().splitlines())


@dataclass(frozen=True)
class KillAncestorOnce:
    """Note each start in a file; at the first one, kill an ancestor of this process.

    Attributes:
        witness: The file.
        generation: 1 for the forker, 2 for the worker.
    """

    witness: Path
    generation: int

    def __call__(self, cancelled: Cancelled) -> Row:
        ancestor = psutil.Process().parents()[self.generation - 1]
        if _note_start(self.witness) == 1:
            ancestor.kill()
            time.sleep(600)
        return {"verdict": "computed"}


@dataclass(frozen=True)
class NoteAndHang:
    """Note each start in a file, and hang in native code."""

    witness: Path

    def __call__(self, cancelled: Cancelled) -> Row:
        _note_start(self.witness)
        return hang(cancelled)


@dataclass(frozen=True)
class Note:
    """Note each start in a file."""

    witness: Path

    def __call__(self, cancelled: Cancelled) -> Row:
        _note_start(self.witness)
        return {"verdict": "noted"}
