"""Export: one format that plans are exported to, and what several of them need."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Final

from foldback.planner.chain.display_names import clean_name
from foldback.planner.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from foldback.planner.plan.plan import Plan

Write = Callable[["Plan"], bytes]
FONT_FILE: Final = Path(__file__).with_name("dejavu-sans.ttf")
"""Font of leaflets and of texts in pictures: the Latin, Greek and Cyrillic letters of DejaVu Sans,
with punctuation and some signs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """One format that a plan can be exported to.

    Attributes:
        name: Short stable word for programs and addresses.
        label: Label for people.
        hint: Its format, what reads it, its units.
        media_type: Media type of the file.
        filename: Name of the file in a separate directory.
        write: Makes the file; ``InputError`` when the plan lacks what it needs.
        moving: True if it shows the motion, so that a plan without frames has none.
        resting: True if it shows steps, so that a plan that does not rest between steps has none.
        coded: True if it is of snakes and snake cubes, so that other plans have none.
        shared: True if other files refer to it, so that it must keep its name.
        package: Package of the extra ``exports`` that it needs, as it is imported; None if none.
    """

    name: str
    label: str
    hint: str
    media_type: str
    filename: str
    write: Write
    moving: bool = False
    resting: bool = False
    coded: bool = False
    shared: bool = False
    package: str | None = None

    @property
    def is_available(self) -> bool:
        """True if the package that it needs is installed."""
        return self.package is None or find_spec(self.package) is not None


def require_frames(plan: Plan) -> None:
    """Refuse a plan whose chain never moved.

    Raises:
        InputError: ``no-frames``.
    """
    if not len(plan.time_s):
        raise InputError(
            "no-frames",
            "the plan has no frames, because its fold failed before the playback; fold the "
            "shape again.",
        )


def export_name(text: str) -> str:
    """Return a clean name, or another text on one line, for a file; ``fold`` if it is empty."""
    return clean_name(text, max_length=100) or "fold"


def identifier(name: str) -> str:
    """Return a name as ASCII letters, digits, ``_`` and ``-``, beginning with a letter.

    Robot models are named so: ROS, Drake and MoveIt make topics, scoped names and file names of it.
    """
    plain = unicodedata.normalize("NFKD", export_name(name)).encode("ascii", "ignore").decode()
    words = re.sub(r"[^A-Za-z0-9-]+", "_", plain).strip("_-")
    if not words:
        return "fold"
    return words if words[0].isalpha() else f"fold_{words}"


def rising(times: NDArray[np.generic]) -> NDArray[np.intp]:
    """Return the indices of the frames to write, so that their times rise strictly.

    Of frames with equal times the last one is written: nothing moves between them.

    Args:
        times: (F,) times in the units and the precision of the file.
    """
    import numpy as np

    earliest_later = np.minimum.accumulate(times[:0:-1])[::-1]
    return np.append(np.flatnonzero(times[:-1] < earliest_later), len(times) - 1)


def write_json(plan: Plan) -> bytes:
    """Return the plan as JSON text, in the format ``foldback-plan/3``."""
    return plan.json_bytes()


def write_npz(plan: Plan) -> bytes:
    """Return the arrays that ``Plan.save_npz`` writes; needs no pickle to read."""
    import numpy as np

    file = BytesIO()
    np.savez_compressed(file, **plan.npz_arrays())
    return file.getvalue()
