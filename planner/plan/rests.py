"""Rests: frames of a plan at which the whole chain rests, between two of its turns."""

from __future__ import annotations

from collections.abc import Mapping


def rest_frames(playback: Mapping[str, object] | None) -> tuple[int, ...]:
    """Return the frames of a plan at which the whole chain rests, in order; none if it never does.

    Args:
        playback: Summary of the plan's playback; None without one.
    """
    frames = (playback or {}).get("rest_frames")
    return tuple(map(int, frames)) if isinstance(frames, list | tuple) else ()
