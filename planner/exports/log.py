"""Log: the fold as MCAP with messages of ROS 2, for Foxglove, rosbag and robots' own programs.

Topics: ``/joint_states`` (sensor_msgs/JointState, a message a frame), ``/joint_trajectory``
(trajectory_msgs/JointTrajectory, the whole fold in one message at its start), ``/tf`` (the root
module's frame in ``world``, in metres) and, where it needs no file besides, ``/robot_description``
(the URDF). Time counts from the fold's start; angles are in radians.
"""

from __future__ import annotations

from io import BytesIO
from typing import Final

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.exports import urdf
from planner.exports.cdr import SECOND_NS, Cdr
from planner.exports.motion import require_frames
from planner.exports.names import clean_name
from planner.motion.frames import Frames
from planner.plan.plan import Plan

Array = NDArray[np.float64]
WORLD: Final = "world"
RULE: Final = "\n" + "=" * 80 + "\n"
TIME: Final = "int32 sec\nuint32 nanosec"
HEADER: Final = (
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
    f"{RULE}MSG: builtin_interfaces/Time\n{TIME}"
)
DEFINITIONS: Final = {
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\n"
        "float64[] position\nfloat64[] velocity\nfloat64[] effort"
        f"{RULE}{HEADER}"
    ),
    "trajectory_msgs/msg/JointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/JointTrajectoryPoint[] points"
        f"{RULE}MSG: trajectory_msgs/JointTrajectoryPoint\n"
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        "builtin_interfaces/Duration time_from_start"
        f"{RULE}MSG: builtin_interfaces/Duration\n{TIME}"
        f"{RULE}{HEADER}"
    ),
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms"
        f"{RULE}MSG: geometry_msgs/TransformStamped\n"
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
        f"{RULE}MSG: geometry_msgs/Transform\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
        f"{RULE}MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
        f"{RULE}MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
        f"{RULE}{HEADER}"
    ),
    "std_msgs/msg/String": "string data",
}
"""As ROS 2 (common_interfaces) defines them, with what they are made of."""
TOPICS: Final = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
}


def write(plan: Plan) -> bytes:
    """The fold as MCAP, compressed by zstd.

    Raises:
        InputError: ``no-frames``.
    """
    require_frames(plan)
    times_ns = np.round(plan.time_s * SECOND_NS).astype(np.int64).tolist()
    file = BytesIO()
    writer = Writer(file)
    writer.start(profile="ros2", library="foldback")
    channels: dict[str, int] = {}

    def add(topic: str, time_ns: int, message: bytes) -> None:
        if topic not in channels:
            kind = TOPICS[topic]
            schema = writer.register_schema(kind, "ros2msg", DEFINITIONS[kind].encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic], log_time=time_ns, data=message, publish_time=time_ns)

    if plan.chain.module.geom == "box":
        add("/robot_description", times_ns[0], bytes(Cdr().string(urdf.write(plan).decode())))
    add("/joint_trajectory", times_ns[0], joint_trajectory(plan, times_ns))
    names = plan.chain.joint_names
    # Names and lengths are the same in every frame, only the time before them is not.
    start = bytes(Cdr().time(0))
    same = bytes(Cdr().time(0).string("").strings(names).count(len(names)))[len(start) :]
    frames = plan.whole()
    for k, time_ns in enumerate(times_ns):
        state = Cdr(bytes(Cdr().time(time_ns)) + same).doubles(frames.joint_angles_rad[k])
        add("/joint_states", time_ns, bytes(state.count(0).count(0)))
        add("/tf", time_ns, root_transform(plan.chain, frames, k, time_ns))
    writer.add_metadata("foldback", about(plan))
    writer.finish()
    return file.getvalue()


def joint_trajectory(plan: Plan, times_ns: list[int]) -> bytes:
    """The whole fold as one JointTrajectory: positions only, a point a frame."""
    message = Cdr().time(times_ns[0]).string("").strings(plan.chain.joint_names)
    message.count(len(times_ns))
    for time_ns, angles in zip(times_ns, plan.joint_angles_rad, strict=True):
        message.count(len(angles)).doubles(angles).count(0).count(0).count(0)
        message.time(time_ns - times_ns[0])
    return bytes(message)


def root_transform(chain: Chain, frames: Frames, frame: int, time_ns: int) -> bytes:
    """Where the root module's frame is in the world, as a TFMessage."""
    w, x, y, z = frames.root_wxyz[frame]
    metres = frames.root_position[frame] * chain.pitch_m
    message = Cdr().count(1).time(time_ns).string(WORLD).string(f"module_{chain.root}")
    return bytes(message.doubles(metres).doubles(np.array([x, y, z, w])))


def about(plan: Plan) -> dict[str, str]:
    """What the log is of."""
    return {
        "name": clean_name(plan.chain.name),
        "module": plan.chain.module.name,
        "modules": str(len(plan.chain)),
        "pitch_m": repr(plan.chain.pitch_m),
        "preset": clean_name(plan.preset),
        "seed": str(plan.seed),
        "verdict": clean_name(plan.certificate.verdict),
    }
