"""Write a timeline while a chain explodes, and follow its end as a viewer does."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path as FilePath

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.readers import read

SHAPES = FilePath(__file__).parent / "shapes"


def compute(chain: Chain, writer: TimelineWriter) -> None:
    with writer:
        explode(chain, ExplosionParameters(), sink=writer.append)


def main() -> None:
    path = read((SHAPES / "box-4x4x4.json").read_bytes())
    assert isinstance(path, Path)
    chain = Chain.from_path(path)
    with tempfile.TemporaryDirectory() as directory:
        timeline_path = FilePath(directory) / "timeline"
        writer = TimelineWriter.create(timeline_path, chain)
        worker = threading.Thread(target=compute, args=(chain, writer))
        worker.start()
        timeline = Timeline.open(timeline_path)
        while timeline.status == "growing":
            if timeline.refresh():
                print(f"{len(timeline)} frames, {timeline.status}")
            time.sleep(0.05)
        worker.join()
        last = timeline.frames(len(timeline) - 1)
        poses = chain.poses(last.joint_angles_rad, last.root_position, last.root_wxyz)
        print(f"the last frame has {poses.positions.shape[1]} modules in a row")


if __name__ == "__main__":
    main()
