from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from planner.motion.motion import Motion
from planner.motion.record import Record


def some_record() -> Record:
    rng = np.random.default_rng(0)
    frames = Motion.from_frames(
        phase="explosion",
        time_s=np.arange(4.0),
        joint_angles_rad=rng.normal(size=(4, 6)),
        root_position=rng.normal(size=(4, 3)),
        root_wxyz=rng.normal(size=(4, 4)),
    )
    return Record(
        status="stalled", reason="it hangs — at 3°.", frames=frames, steps=77, seconds=1.5
    )


def test_record_is_read_back(tmp_path: FilePath) -> None:
    record = some_record()
    record.save(tmp_path / "record.npz")
    again = Record.load(tmp_path / "record.npz")
    assert again.summary() == record.summary()
    for name, mine in record.frames.columns().items():
        theirs = again.frames.columns()[name]
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype
    assert [p.name for p in tmp_path.iterdir()] == ["record.npz"]
