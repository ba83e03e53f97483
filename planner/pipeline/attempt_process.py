"""Attempt process: the program that computes one explosion for an ``AttemptPool``."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path as FilePath

from foldback.planner.pipeline.attempt import Attempt, AttemptSpec
from foldback.planner.pipeline.attempt_pool import (
    ATTEMPT_STOP_GRACE_S,
    OUTCOME_FILE,
    PROGRESS_FILE,
)
from foldback.planner.pipeline.exploding import explode
from foldback.planner.pipeline.search import Watch
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.storage.file_names import RECORD, TIMELINE
from foldback.planner.storage.files import write_json


def compute_attempt() -> None:
    """Compute the attempt in this process's argument, in the folder that it is started in.

    The process ends when its standard input does: its result is not needed any more, or the fold's
    process is gone.
    """
    unwanted = threading.Event()
    threading.Thread(target=_wait_for_end, args=(unwanted,), daemon=True).start()
    place = FilePath.cwd()
    fold = Workspace(place.parent.parent)
    spec = AttemptSpec(**json.loads(sys.argv[1]))
    chain = fold.read_candidates().chain_of(spec)
    parameters = fold.read_request().parameters(chain.module)
    watch = Watch(
        progress=lambda progress: write_json(place / PROGRESS_FILE, asdict(progress)),
        cancelled=unwanted.is_set,
        timeline=place / TIMELINE,
    )
    record = explode(chain, spec, parameters, watch)
    record.save(place / RECORD)
    write_json(place / OUTCOME_FILE, Attempt.of_record(spec, chain, record, parameters).as_dict())


def _wait_for_end(unwanted: threading.Event) -> None:
    # Not sys.stdin: a thread that reads that holds it when the process ends.
    while os.read(0, 1):
        pass
    unwanted.set()
    time.sleep(ATTEMPT_STOP_GRACE_S)
    os._exit(1)


if __name__ == "__main__":
    compute_attempt()
