"""Convert cells to the angles of a chain, and back by forward kinematics."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.readers import read

SHAPES = FilePath(__file__).parent / "shapes"


def main() -> None:
    path = read((SHAPES / "wrench-160.json").read_bytes())
    assert isinstance(path, Path)
    chain = Chain.from_path(path)
    bent = np.count_nonzero(chain.folded_rad)
    print(f"{len(chain)} modules, {len(chain.joint_names)} hinges, {bent} of them bent by 90°")

    # The folded chain lies in the cells that it came from.
    distance = np.abs(chain.folded_poses.positions - path.cells).max()
    print(f"farthest module from its cell: {distance:.1e} pitches")

    # The same angles at a third of their size are a state during the fold.
    root = chain.root
    poses = chain.poses(chain.folded_rad / 3, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    span = np.linalg.norm(poses.positions[0] - poses.positions[-1])
    print(f"module {root} is the root; the ends of the half-folded chain are {span:.1f} apart")

    # A chain file holds the angles alone.
    read_chain_again = read(write_chain(chain))
    assert isinstance(read_chain_again, Chain)
    print(f"read back: {np.array_equal(read_chain_again.folded_rad, chain.folded_rad)}")


if __name__ == "__main__":
    main()
