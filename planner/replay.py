"""Replay: a plan's angles set in plain MuJoCo from the exported model, as an outsider would.

Nothing of foldback's own kinematics or collision is used here, so that the two can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.errors import InputError
from planner.plan import Plan
from planner.untyped import mujoco

Array = NDArray[np.float64]
CHUNK: Final = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """What plain MuJoCo says of a plan.

    Attributes:
        frames: Configurations set, halfway ones included.
        pose_difference: Largest distance of a site from where foldback's kinematics has the module.
        overlap: Deepest contact, in pitches; 0 when nothing touches.
        overlap_frame: Where that is; a half means between two frames.
    """

    frames: int
    pose_difference: float
    overlap: float
    overlap_frame: float | None


def replay(plan: Plan, xml: str) -> Replay:
    """Sets every frame of a plan, and every halfway one, in a model and looks for contacts.

    Args:
        plan: The plan.
        xml: The exported model, MJCF.

    Raises:
        InputError: When the model is not one of this plan.
    """
    try:
        model: Any = mujoco.MjModel.from_xml_string(xml)
    except ValueError as error:
        raise InputError("not-a-model", f"MuJoCo cannot load the model: {error}") from error
    data: Any = mujoco.MjData(model)
    try:
        addresses = [int(model.joint(name).qposadr[0]) for name in plan.chain.joint_names]
        root = int(model.joint("root").qposadr[0])
        sites = [int(model.site(f"module_{i}").id) for i in range(len(plan.chain))]
    except KeyError as error:
        raise InputError("not-a-model", f"the model is not one of this plan: {error}") from error
    difference, overlap, where = 0.0, 0.0, None
    count = 0
    for frame, angles, position, wxyz in _configurations(plan):
        data.qpos[addresses] = angles
        data.qpos[root : root + 3] = position
        data.qpos[root + 3 : root + 7] = wxyz
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        poses = plan.chain.poses(angles, position, wxyz)
        off = np.linalg.norm(data.site_xpos[sites] - poses.positions, axis=1)
        difference = max(difference, float(off.max()))
        if data.ncon and -float(data.contact.dist.min()) > overlap:
            overlap, where = -float(data.contact.dist.min()), frame
        count += 1
    return Replay(frames=count, pose_difference=difference, overlap=overlap, overlap_frame=where)


def _configurations(plan: Plan) -> Any:
    count = len(plan.motion)
    for start in range(0, count, CHUNK):
        part = plan.part(start, min(start + CHUNK + 1, count))
        angles, positions, wxyzs = part.joint_angles_rad, part.root_position, part.root_wxyz
        for k in range(min(CHUNK, count - start)):
            yield float(start + k), angles[k], positions[k], wxyzs[k]
            if k + 1 < len(angles):
                yield (
                    start + k + 0.5,
                    0.5 * (angles[k] + angles[k + 1]),
                    0.5 * (positions[k] + positions[k + 1]),
                    wxyzs[k],
                )
