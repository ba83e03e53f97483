"""Guard: test of the frames of an explosion on a table before they are recorded.

A frame is accepted if it stands on the table with no static torque above a bound, no module lies in
the table, and the released modules do not lie over each other. The bound is raised only when frames
are refused for their torque again and again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.table_projection import crosses_itself
from foldback.planner.core import FIXED
from foldback.planner.explosion.loop.recorder import Refusal
from foldback.planner.explosion.peeling.window import (
    MIN_LAST_UNIT_MODULES,
    Peelable,
    WindowConfiguration,
)
from foldback.planner.motion.record import TableRecord
from foldback.planner.parameters.explosion import TableParameters
from foldback.planner.statics.balance import Balance
from foldback.planner.statics.contacts import MAX_TABLE_PENETRATION_PITCH, floor_clearances
from foldback.planner.statics.friction import Friction

REJECTION_DECAY: Final = 0.2
"""Amount by which the count of rejected frames falls each time that frames are accepted. Frames
that need more motor torque than permitted are rejected; when the count reaches a limit, more torque
is permitted."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A configuration on the table, whose top is z = 0.

    Attributes:
        angles: (J,) angles of all hinges, rad.
        poses: Poses of all modules.
        first: First module of the window: those after the next one are released.
    """

    angles: Array
    poses: Poses
    first: int


class Guard:
    """Judge of frames on a table: it accepts or refuses them, and counts refusals.

    Args:
        chain: The chain; folded, it stands on the table with its lowest modules.
        peelable: Kinematics of its windows.
        parameters: First torque bound and its growth.
    """

    def __init__(self, chain: Chain, peelable: Peelable, parameters: TableParameters) -> None:
        self._chain = chain
        self._peelable = peelable
        self._parameters = parameters
        self._balance = Balance(chain)
        self._height = chain.table_height
        heights = chain.folded_poses.positions[: MIN_LAST_UNIT_MODULES + FIXED, 2]
        self._stacked = bool(np.ptp(heights) > 0.5)
        """True if the last unit lies over itself while it is folded."""
        self.bound = parameters.first_bound
        self.refused = 0.0
        """Count of refused frames since the bound was raised, less ``REJECTION_DECAY`` at each
        checkpoint."""
        self.taken_back = 0
        self.raised: list[tuple[float, float]] = []
        """Times at which the bound was raised, s, and the bounds from then on, w·p."""
        self.is_exhausted = False
        """True if the last refusal would have raised the bound beyond its maximum."""

    def refusal(
        self, before: WindowConfiguration | None, configurations: Sequence[WindowConfiguration]
    ) -> Refusal | None:
        """Return why snapshots of an explosion may not be recorded, one after the other.

        Args:
            before: The snapshot before them: folding goes there, and friction against it.
            configurations: Snapshots in the order of the explosion.
        """
        earlier = None if before is None else self._placed(before)
        for configuration in configurations:
            placed = self._placed(configuration)
            refusal = self._refusal_of(placed, earlier)
            if refusal is not None:
                return refusal
            earlier = placed
        return None

    def loops(self, configuration: WindowConfiguration) -> bool:
        """Return True if the released modules would lie over each other."""
        return self._loops(self._placed(configuration))

    def _loops(self, placed: Placed) -> bool:
        if placed.first == 0 and self._stacked:
            return False
        return crosses_itself(placed.poses.positions[placed.first + FIXED - 1 :, :2])

    def count(self, refusal: Refusal, time_s: float) -> None:
        """Count a refusal, and raise the bound if there were too many for their torque.

        Args:
            refusal: Reason why frames were taken back.
            time_s: Time from which a raised bound counts, s.
        """
        p = self._parameters
        self.taken_back += 1
        self.is_exhausted = False
        if not refusal.is_torque:
            return
        self.refused += 1.0
        if self.refused <= p.refusals:
            return
        if self.bound >= p.table_torque:
            self.is_exhausted = True
            return
        self.refused = 0.0
        self.bound = min(p.raised_by * self.bound, p.table_torque)
        self.raised.append((time_s, self.bound))

    def count_checkpoint(self) -> None:
        """Count frames that were recorded."""
        self.refused = max(0.0, self.refused - REJECTION_DECAY)

    def record(self) -> TableRecord:
        """Return the figures of the guard for the record."""
        return TableRecord(
            bound=self.bound,
            taken_back=self.taken_back,
            raised=tuple(self.raised),
            friction=self._parameters.table_friction,
        )

    def _placed(self, configuration: WindowConfiguration) -> Placed:
        chain = self._chain
        angles = self._peelable.widened(configuration, 0, len(chain.folded_rad))
        poses = forward_kinematics(
            chain.module,
            angles,
            root_position=chain.folded_position,
            root_wxyz=chain.folded_wxyz,
        )
        positions = poses.positions.copy()
        positions[:, 2] -= self._height
        return Placed(
            angles, Poses(positions=positions, rotations=poses.rotations), configuration.first
        )

    def _refusal_of(self, placed: Placed, earlier: Placed | None) -> Refusal | None:
        """Return why a configuration may not follow another one; None if it may."""
        positions, rotations = placed.poses.positions, placed.poses.rotations
        lowest = float(floor_clearances(self._chain.module, positions, rotations))
        if lowest < -MAX_TABLE_PENETRATION_PITCH:
            return Refusal(f"a module would sink {-lowest:.3f} pitch into the table")
        if self._loops(placed):
            return Refusal("the chain would cross over itself in a loop that cannot open")
        options: dict[str, Any] = {"clamped": 0} if self._parameters.table_base == "clamped" else {}
        if self._parameters.table_friction and earlier is not None:
            options["friction"] = Friction(
                coefficient=self._parameters.table_friction,
                positions=earlier.poses.positions,
                rotations=earlier.poses.rotations,
            )
        if self._balance.within(self.bound, positions, rotations, placed.angles, **options):
            return None
        return Refusal(
            f"a hinge would need a torque of more than {self.bound:.2f} w·p (module weight × "
            "pitch)",
            is_torque=True,
        )
