"""Messages between the service and the client of a target stream, as JSON on a websocket.

The field ``do`` is the type of incoming messages, ``is`` that of outgoing ones. ``schema``
describes both; docs/robot.md explains their use.
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from foldback.server.target_streams.stream_clock import Reason

PLAY_FORMAT: Final = "foldback-play/1"
Error = Annotated[float, Meta(ge=0.0)]


class PlayOptions(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Playing options, from the query of the websocket's address.

    Attributes:
        speed: Rate of the clock; 1 keeps within the bounds below.
        max_speed: Bound of every joint's speed, in rad/s.
        max_acceleration: Bound of every joint's acceleration, in rad/s².
        threshold_rad: Joint error above which the clock stops.
        rate_hz: Number of targets per second.
        silence_s: Time without a report after which the clock stops, s.
        speeds: True if targets also have joint speeds.
    """

    speed: Annotated[float, Meta(ge=0.01, le=100.0)] = 1.0
    max_speed: Annotated[float, Meta(ge=1e-3, le=1e3)] = 1.0
    max_acceleration: Annotated[float, Meta(ge=1e-3, le=1e4)] = 2.0
    threshold_rad: Annotated[float, Meta(ge=1e-4, le=3.2)] = 0.05
    rate_hz: Annotated[float, Meta(ge=1.0, le=100.0)] = 50.0
    silence_s: Annotated[float, Meta(ge=0.1, le=30.0)] = 1.0
    speeds: bool = False


class Report(Struct, tag_field="do", tag="report", frozen=True, forbid_unknown_fields=True):
    """Report of the client: its largest joint error, or its joint angles.

    ``number`` is the number of the target that the report refers to. A client that sends it gets
    at most a few targets in advance. Without it, angles are compared with the last target, or with
    those of ``begin`` before the first target.
    """

    error_rad: Error | UnsetType = UNSET
    joint_angles_rad: list[float] | UnsetType = UNSET
    number: Annotated[int, Meta(ge=0)] | UnsetType = UNSET


class Pause(Struct, tag_field="do", tag="pause", frozen=True, forbid_unknown_fields=True):
    """Pause the motion until ``resume``."""


class Resume(Struct, tag_field="do", tag="resume", frozen=True, forbid_unknown_fields=True):
    """Continue after ``pause``."""


class Stop(Struct, tag_field="do", tag="stop", frozen=True, forbid_unknown_fields=True):
    """End the motion now."""


Incoming = Report | Pause | Resume | Stop


class Begin(Struct, tag_field="is", tag="begin", frozen=True, kw_only=True):
    """First message: the plan and the options of the motion.

    The client moves the joints of its robot to ``joint_angles_rad`` and sends reports. Targets
    follow when the reported joints are there.
    """

    schema: str
    fold: str
    joint_names: tuple[str, ...]
    frames: int
    duration_s: float
    deviation_rad: float
    joint_angles_rad: list[float]
    speed: float
    max_speed: float
    max_acceleration: float
    threshold_rad: float
    rate_hz: float
    silence_s: float


class Target(Struct, tag_field="is", tag="target", frozen=True, kw_only=True):
    """Joint angles to move to now; ``frame`` is the position in the plan."""

    number: int
    time_s: float
    frame: float
    joint_angles_rad: list[float]
    joint_speeds_rad_s: list[float] | UnsetType = UNSET


class Waiting(Struct, tag_field="is", tag="waiting", frozen=True, kw_only=True):
    """The clock has stopped, or slows down to a stop."""

    because: Reason
    time_s: float
    error_rad: float | None


class Running(Struct, tag_field="is", tag="going", frozen=True, kw_only=True):
    """The clock runs."""

    time_s: float


class StreamProblem(Struct, tag_field="is", tag="problem", frozen=True, kw_only=True):
    """An error: a message is refused, or the connection is about to close."""

    code: str
    detail: str


class End(Struct, tag_field="is", tag="end", frozen=True, kw_only=True):
    """Last message: the client has reached the last target, or was stopped."""

    because: Literal["folded", "stop"]
    time_s: float
    error_rad: float | None


Outgoing = Begin | Target | Waiting | Running | StreamProblem | End
DECODER: Final = msgspec.json.Decoder(Incoming)
ENCODER: Final = msgspec.json.Encoder()


def schema() -> dict[str, Any]:
    """Return JSON Schema of the question and of the messages of both directions."""
    kinds = (PlayOptions, Incoming, Outgoing)
    (options, incoming, outgoing), definitions = msgspec.json.schema_components(
        kinds, ref_template="#/$defs/{name}"
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": PLAY_FORMAT,
        "type": "object",
        "properties": {"query": options, "to_service": incoming, "to_client": outgoing},
        "$defs": definitions,
    }
