"""Process of a trial: makes one beside the fold's own process, in the folder that it is started in.

``planner.pipeline.attempt_pool.AttemptPool`` starts it. It ends when its standard input does:
its result is not needed any more, or the fold's process is gone.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path as FilePath

from planner.files import write_json
from planner.pipeline.attempt import Attempt, Trial
from planner.pipeline.attempt_pool import ATTEMPT_STOP_GRACE_S, write_made
from planner.pipeline.fold_layout import TIMELINE
from planner.pipeline.job import Watch
from planner.pipeline.steps import explode
from planner.pipeline.workspace import Workspace
from planner.progress import Progress


def main() -> None:
    """Run the attempt in its argument."""
    unwanted = threading.Event()
    threading.Thread(target=_listen, args=(unwanted,), daemon=True).start()
    place = FilePath.cwd()
    fold = Workspace(place.parent.parent)
    trial = Trial(**json.loads(sys.argv[1]))
    parameters, chain = fold.read_request().parameters(), fold.read_candidates().chain_of(trial)
    watch = Watch(progress=_tell, cancelled=unwanted.is_set, timeline=place / TIMELINE)
    record = explode(chain, trial, parameters, watch)
    write_made(place, record, Attempt.of_record(trial, chain, record, parameters))


def _tell(progress: Progress) -> None:
    write_json(FilePath("progress.json"), asdict(progress))


def _listen(unwanted: threading.Event) -> None:
    # Not sys.stdin: a thread that reads that holds it when the process ends.
    while os.read(0, 1):
        pass
    unwanted.set()
    time.sleep(ATTEMPT_STOP_GRACE_S)
    os._exit(1)


if __name__ == "__main__":
    main()
