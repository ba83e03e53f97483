"""Progress: how far a fold has come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

import httpx

OVER: Final = frozenset({"verified", "failed", "cancelled"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far a fold has come.

    Attributes:
        status: ``queued``, ``running``, ``verified``, ``failed``, ``cancelled`` or ``deleted``.
        stage: What is computed, or None.
        fraction: Of the stage, 0 to 1.
        steps: Of the simulation.
        steps_per_second: How fast they come.
        simulated_s: Simulated time of the stage; 0 where none is told.
        message: In words.
        modules: Of the chain.
        queue_position: 1 is next; 0 when it does not wait.
        paused: True if it made room for others that wait; it goes on by itself.
        frames: Frames that can be seen so far.
        remaining_s: About how long until it is over, by what like folds took there; 0 when it takes
            longer, None when nobody knows.
        told: All that the service said.
    """

    status: str
    stage: str | None = None
    fraction: float = 0.0
    steps: int = 0
    steps_per_second: float = 0.0
    simulated_s: float = 0.0
    message: str = ""
    modules: int = 0
    queue_position: int = 0
    paused: bool = False
    frames: int = 0
    remaining_s: float | None = None
    told: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Progress:
        """What an answer or an event says."""
        names = {each.name for each in fields(cls)} - {"told"}
        return cls(**{name: value for name, value in told.items() if name in names}, told=told)


def lines_of(answer: httpx.Response) -> Iterator[tuple[str, str] | None]:
    """Server-sent events as name and data; None for any other line, as a sign of life."""
    return _events(answer.iter_lines())


def _events(lines: Iterable[str]) -> Iterator[tuple[str, str] | None]:
    name, data = "message", list[str]()
    for line in lines:
        if not line and data:
            yield name, "\n".join(data)
            name, data = "message", []
            continue
        key, _, value = line.partition(":")
        if key == "event":
            name = value.strip()
        elif key == "data":
            data.append(value.removeprefix(" "))
        yield None
