"""Make the recording that plays on the landing page: web/featured.batch.

python examples/make_featured.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.storage.file_names import TIMELINE
from foldback.web.timeline.frame_batch import thinned
from foldback.web.timeline.view import TimelineView

SHAPE = Path(__file__).parent / "shapes" / "wrench-160.json"
BATCH = Path(__file__).parents[1] / "web" / "featured.batch"
EVERY = 4


def main() -> None:
    """Fold the shape and store every fourth frame."""
    with tempfile.TemporaryDirectory() as place:
        directory = Path(place)
        Workspace(directory).write_request(FoldRequest(filename=SHAPE.name), SHAPE.read_bytes())
        run_stages(directory)
        BATCH.write_bytes(thinned(TimelineView(directory / TIMELINE), EVERY))
    print(f"{BATCH.name}: {BATCH.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
