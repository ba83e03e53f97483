"""URDF, SRDF and MJCF: poses agree, and self-collision finds nothing in a verified fold."""

from typing import Any
from xml.etree import ElementTree

import lxml.etree
import mujoco
import numpy as np
import pinocchio
import pybullet
import pytest
from pydrake.geometry import Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

PYBULLET_JOINTS = 121
"""Joints of which PyBullet reports states: 128 coordinates with the base's seven."""
PYBULLET_MARGIN_M = 0.002
"""PyBullet surrounds each of two convex meshes by 1 mm; boxes keep their size."""


def transform(position: Any, rotation: Any) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = position, np.reshape(rotation, (3, 3))
    return pose


def exempt(exported: Any) -> list[tuple[str, str]]:
    pairs = ElementTree.parse(exported.directory / "model.srdf").iter("disable_collisions")
    return [(pair.attrib["link1"], pair.attrib["link2"]) for pair in pairs]


@pytest.mark.parametrize("file", ["model.urdf", "model.xml"])
def test_drake_moves_the_model_as_the_plan_and_finds_no_contact(exported: Any, file: str) -> None:
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, 0.0)
    Parser(plant).AddModels(str(exported.directory / file))
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own_context = plant.GetMyContextFromRoot(context)
    urdf = file == "model.urdf"
    shapes = scene.model_inspector().GetAllGeometryIds(Role.kProximity)
    tetrahedra = "tetrahedron" in (exported.directory / "plan.json").read_text()[:4000]
    # Drake's parser of MJCF ignores MuJoCo's inline mesh of tetrahedra.
    assert len(shapes) == (0 if tetrahedra and not urdf else len(exported.centres_m))
    for frame in range(len(exported.time_s)):
        for name, angle in exported.joints(frame).items():
            plant.GetJointByName(name).set_angle(own_context, angle)
        if not (urdf or tetrahedra):
            # Drake misplaces the first of two hinges of a body in MJCF: README.md.
            continue
        links = []
        for i in range(len(exported.centres_m)):
            body = plant.GetBodyByName(f"module_{i}" if urdf else f"module_{i}_body")
            pose = plant.EvalBodyPoseInWorld(own_context, body).GetAsMatrix4()
            links.append(exported.centred(pose, i) if urdf else pose)
        exported.check(frame, links, scale=1.0 if urdf else exported.pitch_m)
        query = scene.get_query_output_port().Eval(scene.GetMyContextFromRoot(context))
        assert not query.ComputePointPairPenetration()


def test_mujoco_with_the_srdf_moves_the_urdf_as_the_plan(exported: Any) -> None:
    text = (exported.directory / "model.urdf").read_text()
    assets = {"module.obj": (exported.directory / "module.obj").read_bytes()}
    spec = mujoco.MjSpec.from_string(text, assets=assets)
    for first, second in exempt(exported):
        spec.add_exclude(bodyname1=first, bodyname2=second)
    model = spec.compile()
    data = mujoco.MjData(model)
    for frame in range(len(exported.time_s)):
        for name, angle in exported.joints(frame).items():
            data.joint(name).qpos[0] = angle
        mujoco.mj_fwdPosition(model, data)
        bodies = [data.body(f"module_{i}") for i in range(len(exported.centres_m))]
        links = [exported.centred(transform(b.xpos, b.xmat), i) for i, b in enumerate(bodies)]
        exported.check(frame, links)
        assert data.ncon == 0


def test_pybullet_with_the_srdf_moves_the_urdf_as_the_plan(exported: Any) -> None:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        flags = pybullet.URDF_USE_SELF_COLLISION
        path = str(exported.directory / "model.urdf")
        robot = pybullet.loadURDF(path, useFixedBase=True, flags=flags)
        links = {pybullet.getBodyInfo(robot)[0].decode(): -1}
        joints: dict[str, int] = {}
        for k in range(pybullet.getNumJoints(robot)):
            info = pybullet.getJointInfo(robot, k)
            joints[info[1].decode()], links[info[12].decode()] = k, k
        for first, second in exempt(exported):
            pybullet.setCollisionFilterPair(robot, robot, links[first], links[second], 0)
        has_all_joints = len(exported.joint_names) <= PYBULLET_JOINTS
        for frame in range(len(exported.time_s) if has_all_joints else 0):
            for name, angle in exported.joints(frame).items():
                pybullet.resetJointState(robot, joints[name], angle)
            poses = []
            for i in range(len(exported.centres_m)):
                k = links[f"module_{i}"]
                if k < 0:
                    pose = pybullet.getBasePositionAndOrientation(robot)
                else:
                    pose = pybullet.getLinkState(robot, k, computeForwardKinematics=True)[4:6]
                matrix = pybullet.getMatrixFromQuaternion(pose[1])
                poses.append(exported.centred(transform(pose[0], matrix), i))
            exported.check(frame, poses)
            pybullet.performCollisionDetection()
            deepest = min((point[8] for point in pybullet.getContactPoints()), default=0.0)
            assert deepest > -(1e-6 if exempt(exported) else PYBULLET_MARGIN_M)
    finally:
        pybullet.disconnect(client)


def test_pinocchio_moves_the_urdf_as_the_plan_and_reads_the_srdf(exported: Any) -> None:
    path = str(exported.directory / "model.urdf")
    model = pinocchio.buildModelFromUrdf(path)
    data = model.createData()
    shapes = pinocchio.buildGeomFromUrdf(
        model, path, pinocchio.GeometryType.COLLISION, package_dirs=[str(exported.directory)]
    )
    shapes.addAllCollisionPairs()
    pairs = len(shapes.collisionPairs)
    pinocchio.removeCollisionPairs(model, shapes, str(exported.directory / "model.srdf"))
    if exempt(exported):
        assert len(shapes.collisionPairs) < pairs
    q = pinocchio.neutral(model)
    for frame in range(len(exported.time_s)):
        for name, angle in exported.joints(frame).items():
            q[model.joints[model.getJointId(name)].idx_q] = angle
        pinocchio.framesForwardKinematics(model, data, q)
        links = [
            exported.centred(data.oMf[model.getFrameId(f"module_{i}")].homogeneous, i)
            for i in range(len(exported.centres_m))
        ]
        exported.check(frame, links)


def test_lxml_reads_descriptions_as_strings(exported: Any) -> None:
    for name in ("model.urdf", "model.srdf"):
        assert lxml.etree.fromstring((exported.directory / name).read_text()).tag == "robot"
