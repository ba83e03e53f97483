"""Explode a folded chain: forces pull it straight, and every snapshot is recorded."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.progress import Progress
from foldback.planner.readers import read

SHAPES = FilePath(__file__).parent / "shapes"


def show(progress: Progress) -> None:
    print(f"  {progress.fraction:4.0%}  {progress.steps} steps  {progress.message}")


def main() -> None:
    path = read((SHAPES / "mallet-64.json").read_bytes())
    assert isinstance(path, Path)
    record = explode(Chain.from_path(path), ExplosionParameters(), seed=0, progress=show)
    print(f"{record.status} after {record.steps} steps and {record.seconds:.1f} s")

    # The chain folds by the record in reverse.
    frames = record.frames
    for k in np.linspace(len(frames) - 1, 0, 6).astype(int):
        bent = np.rad2deg(np.abs(frames.joint_angles_rad[k]).max())
        print(f"  snapshot {k:4d}: the most bent hinge is at {bent:5.1f}°")


if __name__ == "__main__":
    main()
