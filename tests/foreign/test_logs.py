"""MCAP, read by rosbags without the service's own definitions."""

from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader


def test_rosbags_reads_the_log_with_rising_stamps_and_qos(exported: Any) -> None:
    times: dict[str, list[int]] = {}
    angles: dict[int, np.ndarray] = {}
    with AnyReader([exported.directory / "joints.mcap"]) as reader:
        for connection in reader.connections:
            (profile,) = connection.ext.offered_qos_profiles
            assert profile.reliability.name == "RELIABLE"
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            times.setdefault(connection.topic, []).append(time_ns)
            if connection.topic == "/joint_states":
                stamp = message.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == time_ns
                assert list(message.name) == exported.joint_names
                angles[time_ns] = message.position
    for values in times.values():
        assert (np.diff(values) > 0).all()
    for time_s, expected in zip(exported.time_s, exported.angles_rad, strict=True):
        np.testing.assert_array_equal(angles[round(time_s * 1e9)], expected)
