"""Log: the fold as MCAP with messages of ROS 2, for Foxglove, rosbag and robots' own programs.

Topics: ``/joint_states`` (sensor_msgs/JointState, a message a frame), ``/joint_trajectory``
(trajectory_msgs/JointTrajectory, the whole fold in one message at its start), ``/tf`` (the root
module's frame in ``world``, in metres) and, where it needs no file besides, ``/robot_description``
(the URDF). Time counts from the fold's start, rises strictly, and is the same in a message's header
and in the log; angles are in radians. Each channel states the quality of service that
``ros2 bag play`` offers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from typing import Final

import numpy as np
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import Writer
from mcap_ros2._dynamic import serialize_dynamic

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.exports import urdf
from foldback.planner.exports.export import export_name, require_frames, rising
from foldback.planner.motion.motion import Motion
from foldback.planner.plan.plan import Plan

SECOND_NS: Final = 1_000_000_000
"""Number of nanoseconds in a second; ROS 2 logs state times in nanoseconds."""
WRITER_LIBRARY: Final = "foldback"
WORLD_FRAME: Final = "world"
SEPARATOR: Final = "\n" + "=" * 80 + "\n"
TIME_DEFINITION: Final = "int32 sec\nuint32 nanosec"
HEADER_DEFINITION: Final = (
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
    f"{SEPARATOR}MSG: builtin_interfaces/Time\n{TIME_DEFINITION}"
)
MESSAGE_DEFINITIONS: Final = {
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\n"
        "float64[] position\nfloat64[] velocity\nfloat64[] effort"
        f"{SEPARATOR}{HEADER_DEFINITION}"
    ),
    "trajectory_msgs/msg/JointTrajectory": (
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/JointTrajectoryPoint[] points"
        f"{SEPARATOR}MSG: trajectory_msgs/JointTrajectoryPoint\n"
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        "builtin_interfaces/Duration time_from_start"
        f"{SEPARATOR}MSG: builtin_interfaces/Duration\n{TIME_DEFINITION}"
        f"{SEPARATOR}{HEADER_DEFINITION}"
    ),
    "tf2_msgs/msg/TFMessage": (
        "geometry_msgs/TransformStamped[] transforms"
        f"{SEPARATOR}MSG: geometry_msgs/TransformStamped\n"
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
        f"{SEPARATOR}MSG: geometry_msgs/Transform\n"
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
        f"{SEPARATOR}MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
        f"{SEPARATOR}MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
        f"{SEPARATOR}{HEADER_DEFINITION}"
    ),
    "std_msgs/msg/String": "string data",
}
"""Definitions of the ROS 2 message types in an exported log, from ROS 2's common_interfaces; each
is followed by the definitions of the types that it contains, as the MCAP format requires."""
TOPIC_TYPES: Final = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/robot_description": "std_msgs/msg/String",
}
TRANSIENT_LOCAL, VOLATILE = 1, 2
"""Codes of durability in ``rmw_qos_durability_policy_t``: late subscribers get the last message, or
only new ones."""
QOS_TEMPLATE: Final = """\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service of a topic in an exported log, in the YAML that ROS 2's rosbag2 reads when it
replays the log: keep last, reliable, automatic liveliness, no time limits."""


class _Log:
    """A log of ROS 2 messages that is being written.

    Args:
        writer: Started.
    """

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._channels: dict[str, int] = {}

    def add(self, topic: str, time_ns: int, message: Mapping[str, object]) -> None:
        """Write a message at a time since the start."""
        kind = TOPIC_TYPES[topic]
        if topic not in self._channels:
            schema = self._writer.register_schema(
                kind, SchemaEncoding.ROS2, MESSAGE_DEFINITIONS[kind].encode()
            )
            latched = topic == "/robot_description"
            qos = QOS_TEMPLATE.format(
                depth=1 if latched else 10, durability=TRANSIENT_LOCAL if latched else VOLATILE
            )
            self._channels[topic] = self._writer.register_channel(
                topic, MessageEncoding.CDR, schema, {"offered_qos_profiles": qos}
            )
        self._writer.add_message(
            self._channels[topic],
            log_time=time_ns,
            publish_time=time_ns,
            data=_encoder(kind)(message),
        )


@cache
def _encoder(kind: str) -> Callable[[object], bytes]:
    return serialize_dynamic(kind, MESSAGE_DEFINITIONS[kind])[kind]


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """A JointTrajectoryPoint; its list of numbers exists only while it is written."""

    angles_rad: Array
    time_ns: int

    @property
    def positions(self) -> list[float]:
        return self.angles_rad.tolist()

    @property
    def time_from_start(self) -> dict[str, int]:
        return time_of(self.time_ns)


def write(plan: Plan) -> bytes:
    """Return the fold as MCAP, compressed by zstd.

    Raises:
        InputError: ``no-frames``.
    """
    require_frames(plan)
    rounded = np.round(plan.time_s * SECOND_NS).astype(np.int64)
    rising_frames = rising(rounded)
    times_ns: list[int] = rounded[rising_frames].tolist()
    names = list(plan.chain.joint_names)
    frames = plan.whole()[rising_frames]
    file = BytesIO()
    writer = Writer(file)
    writer.start(Profile.ROS2, WRITER_LIBRARY)
    log = _Log(writer)
    if not any(urdf.needs_mesh(piece) for piece in plan.chain.module.pieces):
        log.add("/robot_description", times_ns[0], {"data": urdf.write(plan).decode()})
    points = [
        _Point(angles, time_ns - times_ns[0])
        for angles, time_ns in zip(frames.joint_angles_rad, times_ns, strict=True)
    ]
    header = {"stamp": time_of(times_ns[0])}
    message = {"header": header, "joint_names": names, "points": points}
    log.add("/joint_trajectory", times_ns[0], message)
    for k, time_ns in enumerate(times_ns):
        header = {"stamp": time_of(time_ns)}
        positions = frames.joint_angles_rad[k].tolist()
        log.add("/joint_states", time_ns, {"header": header, "name": names, "position": positions})
        log.add("/tf", time_ns, {"transforms": [root_transform(plan.chain, frames, k, time_ns)]})
    writer.add_metadata("foldback", about(plan))
    writer.finish()
    return file.getvalue()


def time_of(time_ns: int) -> dict[str, int]:
    """Return a ``builtin_interfaces`` Time or Duration."""
    seconds, remainder_ns = divmod(time_ns, SECOND_NS)
    return {"sec": seconds, "nanosec": remainder_ns}


def root_transform(chain: Chain, frames: Motion, frame: int, time_ns: int) -> dict[str, object]:
    """Return the pose of the root module's frame in the world, as a TransformStamped."""
    turn = dict(zip("wxyz", frames.root_wxyz[frame].tolist(), strict=True))
    metres = (frames.root_position[frame] * chain.pitch_m).tolist()
    return {
        "header": {"stamp": time_of(time_ns), "frame_id": WORLD_FRAME},
        "child_frame_id": f"module_{chain.root}",
        "transform": {"translation": dict(zip("xyz", metres, strict=True)), "rotation": turn},
    }


def about(plan: Plan) -> dict[str, str]:
    """Return the metadata of a log: the plan's chain, preset, seed and verdict."""
    return {
        "name": export_name(plan.chain.name),
        "module": plan.chain.module.name,
        "modules": str(len(plan.chain)),
        "pitch_m": repr(plan.chain.pitch_m),
        "preset": export_name(plan.preset),
        "seed": str(plan.seed),
        "verdict": export_name(plan.certificate.verdict),
    }
