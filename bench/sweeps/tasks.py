"""Tasks of the sweeps that are measured, which compute almost nothing."""

from __future__ import annotations

import ctypes
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.progress import Cancelled
from foldback.planner.readers.gallery import Gallery
from foldback.planner.sweeps.case import Row


def empty(cancelled: Cancelled) -> Row:
    return {"verdict": "empty"}


def fold(cancelled: Cancelled) -> Row:
    """Fold a small shape, so that everything that a fold needs is loaded."""
    shape = min(Gallery().shapes(), key=lambda shape: len(shape.data))
    with tempfile.TemporaryDirectory() as place:
        Workspace(Path(place)).write_request(FoldRequest(filename=shape.filename), shape.data)
        certificate = run_stages(Path(place), until="export", cancelled=cancelled)
    return {"verdict": certificate["verdict"]}


def crash(cancelled: Cancelled) -> Row:
    ctypes.string_at(0)
    return {}


def hang(cancelled: Cancelled) -> Row:
    """Hang in native code that holds the interpreter's lock."""
    ctypes.PyDLL(None).sleep(3600)
    return {}


def take_memory(cancelled: Cancelled) -> Row:
    arrays: list[object] = []
    while True:
        arrays.append(np.ones(2**20))


@dataclass(frozen=True, slots=True)
class NoteStart:
    """Note the start of a case in a file, and take some time.

    Attributes:
        witness: The file.
        name: Name of the case.
        seconds: Time that it takes, s.
    """

    witness: Path
    name: str
    seconds: float

    def __call__(self, cancelled: Cancelled) -> Row:
        with self.witness.open("a", encoding="utf-8") as file:
            file.write(f"{self.name}\n")
        time.sleep(self.seconds)
        return {"verdict": "noted"}
