"""Replay: a plan's angles set in plain MuJoCo from the exported model.

No kinematics or collision of foldback's own is used here, so that the two can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.exports.mjcf import named_bodies
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.value_differences import Differences
from foldback.planner.simulation.lazy_mujoco import mujoco

MAX_REPLAYED_MODULES: Final = 5_000_000
"""Maximum number of module poses (frames × modules) that MuJoCo replays to verify a plan; of a
longer plan every n-th frame is replayed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """Result of a plan's replay in plain MuJoCo.

    Attributes:
        frames: Number of configurations, including halfway ones.
        pose_difference: Largest distance of a site from its module in foldback's kinematics,
            pitches.
        overlap: Deepest contact, pitches; 0 without contact.
        overlap_frame: Frame of the deepest contact; a half means between two frames.
    """

    frames: int
    pose_difference: float
    overlap: float
    overlap_frame: float | None


def stride_of(plan: Plan) -> int:
    """Return the step from frame to frame in the replay of a plan: 1 unless the plan is long."""
    return -(-len(plan.motion) * len(plan.chain) // MAX_REPLAYED_MODULES)


def replay(plan: Plan, xml: str, *, stride: int = 1) -> Replay:
    """Set every frame of a plan, and every halfway one, in a model and find contacts.

    Args:
        plan: The plan.
        xml: The exported model, MJCF.
        stride: Step from frame to frame; the halfway one after each is set, too.

    Raises:
        InputError: The model is not one of this plan.
    """
    loaded = _Loaded.of(plan, xml)
    difference, overlap, overlap_frame = 0.0, 0.0, None
    count = 0
    for frame, angles, position, wxyz in _configurations(plan, stride):
        loaded.place(angles, position, wxyz)
        data = loaded.data
        mujoco.mj_comPos(loaded.model, data)
        mujoco.mj_collision(loaded.model, data)
        poses = plan.chain.poses(angles, position, wxyz)
        off = np.linalg.norm(data.site_xpos[loaded.sites] - poses.positions, axis=1)
        difference = max(difference, float(off.max()))
        if data.ncon and -float(data.contact.dist.min()) > overlap:
            overlap, overlap_frame = -float(data.contact.dist.min()), frame
        count += 1
    return Replay(
        frames=count, pose_difference=difference, overlap=overlap, overlap_frame=overlap_frame
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loaded:
    """Model in plain MuJoCo, of one tree or of several that continue each other.

    Attributes:
        model, data: MuJoCo's model and data.
        hinges: Indices of the plan's angles among the coordinates.
        sites: Indices of the modules' sites.
        roots: Index of the first body's pose among the coordinates, by tree.
        bodies: Index of the first body, by tree.
        ends: Index of the body where the next tree begins, by tree but the last.
        root: Index of the body of the chain's root module.
    """

    model: Any
    data: Any
    hinges: list[int]
    sites: list[int]
    roots: list[int]
    bodies: list[int]
    ends: list[int]
    root: int

    @classmethod
    def of(cls, plan: Plan, xml: str) -> _Loaded:
        chain = plan.chain
        model = _checked_model(xml, chain)
        try:
            free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
            bodies = [int(model.jnt_bodyid[joint]) for joint in free]
            ends = [model.body(body).name.replace("module", "ghost", 1) for body in bodies[1:]]
            return cls(
                model=model,
                data=mujoco.MjData(model),
                hinges=[int(model.joint(name).qposadr[0]) for name in chain.joint_names],
                sites=[int(model.site(f"module_{i}").id) for i in range(len(chain))],
                roots=[int(model.jnt_qposadr[joint]) for joint in free],
                bodies=bodies,
                ends=[int(model.body(name).id) for name in ends],
                root=int(model.body(f"module_{chain.root}_body").id),
            )
        except KeyError as error:
            raise InputError(
                "not-a-model", f"the model does not belong to this plan: {error}"
            ) from error

    def place(self, angles: Array, position: Array, wxyz: Array) -> None:
        """Set a configuration: hinge angles, and trees one behind the other."""
        data = self.data
        data.qpos[self.hinges] = angles
        for address in self.roots:
            data.qpos[address : address + 7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        mujoco.mj_kinematics(self.model, data)
        places = [(np.zeros(3), np.eye(3))]
        for end in self.ends:
            places.append(_moved(places[-1], data.xpos[end], data.xmat[end].reshape(3, 3)))
        tree = self.bodies.index(int(self.model.body_rootid[self.root]))
        at, turn = _moved(places[tree], data.xpos[self.root], data.xmat[self.root].reshape(3, 3))
        flat_rotation = np.empty(9)
        mujoco.mju_quat2Mat(flat_rotation, np.asarray(wxyz, dtype=np.float64))
        rotation_matrix = flat_rotation.reshape(3, 3) @ turn.T
        for address, (origin, rotation) in zip(self.roots, places, strict=True):
            data.qpos[address : address + 3] = position + rotation_matrix @ (origin - at)
            mujoco.mju_mat2Quat(
                data.qpos[address + 3 : address + 7], (rotation_matrix @ rotation).ravel()
            )
        mujoco.mj_kinematics(self.model, data)


def _checked_model(xml: str, chain: Chain) -> Any:
    """Load the model, with all pairs of modules colliding that the module's data does not exempt.

    Exclusions in the model file are not trusted: tetrahedra that share a hinge are checked, too.
    """
    exempt = {
        frozenset((f"module_{i}_body", f"module_{j}_body"))
        for i, j in chain.module.exempt_pairs(len(chain))
    }
    try:
        spec: Any = mujoco.MjSpec.from_string(named_bodies(xml))
        for pair in list(spec.excludes):
            if frozenset((pair.bodyname1, pair.bodyname2)) not in exempt:
                spec.delete(pair)
        model = spec.compile()
    except ValueError as error:
        raise InputError("not-a-model", f"MuJoCo cannot load the model: {error}") from error
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    return model


def _moved(place: tuple[Array, Array], position: Array, rotation: Array) -> tuple[Array, Array]:
    """Return a pose that is given in the frame of another."""
    return place[0] + place[1] @ position, place[1] @ rotation


def _configurations(plan: Plan, stride: int) -> Any:
    count = len(plan.motion)
    for start in range(0, count, stride):
        part = plan.part(start, min(start + 2, count))
        angles, positions, wxyzs = part.joint_angles_rad, part.root_position, part.root_wxyz
        yield float(start), angles[0], positions[0], wxyzs[0]
        if len(angles) > 1:
            yield start + 0.5, angles.mean(axis=0), positions.mean(axis=0), wxyzs[0]


def replay_differs(result: Replay) -> Differences:
    """Yield the differences of a replay from the plan, and overlaps."""
    if not result.pose_difference <= 1e-6:  # pitches: rounding
        yield f"model.xml: poses differ from the plan's by {result.pose_difference:.2g} pitch"
    if not result.overlap <= 1e-9:  # pitches: rounding
        yield (
            f"plan.npz: MuJoCo finds an overlap of {result.overlap:.2g} pitch at frame "
            f"{result.overlap_frame:g}"
        )
