"""Progress of a fold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Final

import httpx

FINAL_STATUSES: Final = frozenset({"verified", "failed", "cancelled"})
"""Statuses of a fold that has ended; no further progress follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """Progress of a fold.

    Attributes:
        status: ``queued``, ``running``, ``verified``, ``failed``, ``cancelled`` or ``deleted``.
        stage: Current stage, or None.
        fraction: Progress of the stage, 0 to 1.
        steps: Simulation steps of the stage.
        steps_per_second: Simulation steps per second of wall time.
        simulated_s: Simulated time of the stage, in s; 0 if unknown.
        message: Short text for people.
        modules: Number of modules of the chain.
        queue_position: Position in the queue, from 1; 0 if the fold does not wait.
        paused: True if the fold is paused for waiting folds; it continues by itself.
        frames: Number of frames that can be displayed so far.
        remaining_s: Estimated time until the end from similar folds, in s; 0 if the fold takes
            longer than these, None if unknown.
        all_fields: All fields that the service reported.
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
    all_fields: Mapping[str, Any] = field(default_factory=dict[str, Any], repr=False)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Progress:
        """Return the progress in a response or an event."""
        names = {field.name for field in fields(cls)} - {"all_fields"}
        return cls(
            **{name: value for name, value in values.items() if name in names}, all_fields=values
        )


def lines_of(answer: httpx.Response) -> Iterator[tuple[str, str] | None]:
    """Yield server-sent events as name and data, and None for each other line (keep-alive)."""
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
