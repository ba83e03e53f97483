import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

PLANS = ("short", "wrench-24", "ring", "mallet-64", "refold")
ATOL = 1e-6


@dataclass
class Exported:
    """Exported files of a plan, and poses of the modules by its own forward kinematics."""

    directory: Path
    angles_rad: np.ndarray
    joint_names: list[str]
    positions_m: np.ndarray
    rotations: np.ndarray
    centres_m: np.ndarray
    root: int
    pitch_m: float
    time_s: np.ndarray

    def joints(self, frame: int) -> dict[str, float]:
        return dict(zip(self.joint_names, self.angles_rad[frame].tolist(), strict=True))

    def check(self, frame: int, links: list[np.ndarray], *, scale: float = 1.0) -> None:
        """Compare (4, 4) transforms of module centres, relative to the root's, with the plan."""
        to_root = np.linalg.inv(links[self.root])
        turn = self.rotations[frame, self.root].T
        for i, link in enumerate(links):
            link_pose = to_root @ link
            offset = self.positions_m[frame, i] - self.positions_m[frame, self.root]
            np.testing.assert_allclose(link_pose[:3, 3] * scale, turn @ offset, atol=ATOL)
            np.testing.assert_allclose(
                link_pose[:3, :3], turn @ self.rotations[frame, i], atol=ATOL
            )

    def centred(self, link: np.ndarray, index: int) -> np.ndarray:
        shift = np.eye(4)
        shift[:3, 3] = self.centres_m[index]
        return link @ shift


@pytest.fixture(params=PLANS)
def exported(request: pytest.FixtureRequest) -> Exported:
    directory = Path(os.environ["FOREIGN_PLANS"]) / request.param
    with np.load(directory / "poses.npz") as file:
        values = dict(file)
    return Exported(
        directory=directory,
        joint_names=values.pop("joint_names").tolist(),
        root=int(values.pop("root")),
        pitch_m=float(values.pop("pitch_m")),
        **values,
    )
