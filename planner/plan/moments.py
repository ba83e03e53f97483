"""Moments: places of a fold's motion that are worth showing, apart from those of its certificate.

They are found once, when the plan is written. Nothing here needs what finds them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from foldback.planner.errors import InputError
from foldback.planner.storage.plain_values import from_plain, plain_lists

MOMENTS_FORMAT: Final = "foldback-moments/1"
CONTACT_PITCH: Final = 0.1
"""Distance of two modules, in pitches, below which they count as having met, when a fold's page
names the first moment at which parts of the chain meet."""
CONTACT_LINKS: Final = 3
"""Minimum number of links along the chain between two modules for them to count when the first
moment is searched at which parts of the chain meet: nearer ones are always close to each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Meeting:
    """Two modules at a frame of the timeline.

    Attributes:
        frame: Frame of the timeline, counted from 0.
        modules: Their numbers, counted from 0.
    """

    frame: int
    modules: tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldModule:
    """Pose of a module that is held still during a step, in the frame of the folded shape.

    Attributes:
        module: The module, counted from 0.
        position: Its centre, in pitches.
        wxyz: Its orientation, a unit quaternion.
    """

    module: int
    position: tuple[float, float, float]
    wxyz: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class StepMoment:
    """Step of a plan that rests between steps.

    Attributes:
        start: Frame of the timeline at which the chain rests before the step, counted from 0.
        end: Frame at which it rests after the step.
        text: What to do, as a sentence.
        joints: Modules at whose hinges the chain turns, counted from 0.
        moving: First and last modules of the parts that move; all others are held still.
        held: Pose of a module that is held still; None in files without it.
    """

    start: int
    end: int
    text: str
    joints: tuple[int, ...]
    moving: tuple[tuple[int, int], ...]
    held: HeldModule | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Moments:
    """Moments of a fold. Frames are those of the timeline, counted from 0; None where unknown.

    Attributes:
        plan: First frame of the plan.
        straight: First frame at which the chain is straight and begins to fold.
        frames: Number of frames.
        contact: First frame at which two modules are closer than ``CONTACT_PITCH`` that are at
            least ``CONTACT_LINKS`` links apart.
        torque: Frame with the largest hinge torque in the figures, and the modules of that hinge.
        knot: Frame at which the chain is knotted, as at the end, and was not at the frame before.
        determinant: Determinant of the knot at the end; None if it was not computed.
        direct: Frame at which the plan is as far folded as the chain with all hinges turned evenly
            when two of its modules first overlap, and these modules.
        direct_percent: Share of each hinge's turn at that overlap, whole per cent.
        steps: Steps of a plan that rests between steps.
    """

    plan: int
    straight: int
    frames: int
    contact: Meeting | None = None
    torque: Meeting | None = None
    knot: int | None = None
    determinant: int | None = None
    direct: Meeting | None = None
    direct_percent: int | None = None
    steps: tuple[StepMoment, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        values = {"format": MOMENTS_FORMAT, **asdict(self)}
        if not self.steps:  # as in files of plans that do not rest
            del values["steps"]
        return plain_lists(values)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Moments:
        """Build moments from ``as_dict``.

        Raises:
            InputError: ``wrong-format``.
        """
        if values.get("format") != MOMENTS_FORMAT:
            raise InputError(
                "wrong-format",
                f"got the format {values.get('format')!r}, expected {MOMENTS_FORMAT!r}.",
            )
        return from_plain(values, cls)
