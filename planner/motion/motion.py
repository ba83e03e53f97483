"""Motion: snapshots of a chain, with all of its angles or only with those of a window.

Simultaneous explosions move everything at once; their snapshots are ``Frames``. What comes off
piece by piece is kept as ``Windows``, whose size grows with what moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

from planner.motion.frames import Frames
from planner.motion.windows import Windows

Motion = Frames | Windows


def joined(parts: Sequence[Motion]) -> Motion:
    """Concatenate motions of one kind.

    Raises:
        TypeError: They are of two kinds.
    """
    kinds = {type(part) for part in parts}
    if kinds == {Frames}:
        return Frames.joined(cast("Sequence[Frames]", parts))
    if kinds == {Windows}:
        return Windows.joined(cast("Sequence[Windows]", parts))
    raise TypeError(f"got parts of {sorted(kind.__name__ for kind in kinds)}, expected one kind")


def motion_arrays(motion: Motion) -> dict[str, Any]:
    """Return the columns of a motion by name, to be written."""
    columns = {name: getattr(motion, name) for name in type(motion).__dataclass_fields__}
    return {name: values for name, values in columns.items() if values is not None}


def motion_from_arrays(arrays: Any) -> Motion:
    """Build a motion from a mapping of its columns, of either kind."""
    kind = Windows if "offsets" in arrays else Frames
    return kind(**{name: arrays[name] for name in kind.__dataclass_fields__ if name in arrays})
