"""An outsider's replay: MuJoCo, the exported model and the plan's numbers, and nothing of foldback.

``planner.verification.replay`` is what ``foldback verify`` runs; this is written apart from it, so
that neither can hide a fault of the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pose = tuple[Array, Array]
"""A position and a quaternion."""
ORIGIN: Pose = (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """A moment of a plan: its frame, and what the plan says of it."""

    frame: float
    angles: Array
    position: Array
    wxyz: Array


def moment_at(frames: Any, frame: float) -> Configuration:
    """A frame, or a moment between two: joints turn evenly."""
    k = int(frame)
    share, ahead = frame - k, min(k + 1, len(frames) - 1)
    angles, positions, wxyzs = frames.joint_angles_rad, frames.root_position, frames.root_wxyz
    wxyz = (1 - share) * wxyzs[k] + share * wxyzs[ahead] * np.sign(wxyzs[k] @ wxyzs[ahead])
    return Configuration(
        frame=frame,
        angles=(1 - share) * angles[k] + share * angles[ahead],
        position=(1 - share) * positions[k] + share * positions[ahead],
        wxyz=wxyz / np.linalg.norm(wxyz),
    )


def moments(frames: Any, parts: int) -> Iterator[Configuration]:
    """Every frame, and so many moments less one between it and the next."""
    for step in range(parts * (len(frames) - 1) + 1):
        yield moment_at(frames, step / parts)


class Outsider:
    """The exported model, in whose joints one sets what a plan says.

    Args:
        xml: The model.
        names: Of the joints, in the order of the plan's angles.
        root: Number of the module whose pose the plan says.
    """

    def __init__(self, xml: str, names: list[str], root: int) -> None:
        self.model: Any = mujoco.MjModel.from_xml_string(xml)
        self.data: Any = mujoco.MjData(self.model)
        self.hinges = [int(self.model.joint(name).qposadr[0]) for name in names]
        sites = sum(self.model.site(i).name.startswith("module_") for i in range(self.model.nsite))
        self.sites = [int(self.model.site(f"module_{i}").id) for i in range(sites)]
        self.root = f"module_{root}_body"
        free = np.flatnonzero(self.model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        # Of each tree: where its pose is among the coordinates, and what its first body is called.
        self.trees = [
            (int(self.model.jnt_qposadr[j]), self.model.body(int(self.model.jnt_bodyid[j])).name)
            for j in free
        ]

    def put(self, moment: Configuration) -> None:
        """Sets a moment; a model in pieces is put together end to end."""
        self.data.qpos[self.hinges] = moment.angles
        first = ORIGIN
        for _ in range(2):
            for number, (address, name) in enumerate(self.trees):
                at, turn = first if not number else self.pose(name.replace("module_", "ghost_"))
                self.data.qpos[address : address + 3] = at
                self.data.qpos[address + 3 : address + 7] = turn
                mujoco.mj_kinematics(self.model, self.data)
            first = between(self.pose(self.root), (moment.position, moment.wxyz), first)

    def pose(self, body: str) -> Pose:
        """Where a body is."""
        found = self.data.body(body)
        return found.xpos.copy(), found.xquat.copy()

    @property
    def positions(self) -> Array:
        """(n, 3) centres of the modules."""
        return self.data.site_xpos[self.sites]

    def overlap(self) -> float:
        """How deep the deepest contact is; 0 without one."""
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return max(0.0, -float(self.data.contact.dist.min())) if self.data.ncon else 0.0

    def distance(self, one: int, other: int) -> float:
        """Between the hulls of two modules."""
        geoms = [self.model.body(f"module_{i}_body").geomadr[0] for i in (one, other)]
        return float(mujoco.mj_geomDistance(self.model, self.data, *geoms, 10.0, None))


def between(now: Pose, wanted: Pose, first: Pose) -> Pose:
    """Where the first tree has to be for the root, which is there now, to be where it is wanted."""
    back, turn, wxyz, at = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(back, now[1])
    mujoco.mju_mulQuat(turn, wanted[1], back)
    mujoco.mju_mulQuat(wxyz, turn, first[1])
    mujoco.mju_rotVecQuat(at, first[0] - now[0], turn)
    return at + wanted[0], wxyz
