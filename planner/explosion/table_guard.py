"""Guard: which frames of an explosion on a table may be kept.

A frame is kept if it stands on the table with no static torque above a bound, no module lies in the
table, and the released modules do not lie over each other. Refused frames are taken back; the bound
is raised only when frames are refused for their torque again and again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import Poses, forward_kinematics
from planner.explosion.from_above import crosses_itself
from planner.explosion.peeling import MIN_LAST_UNIT_MODULES
from planner.explosion.peeling_window import Peelable, WindowConfiguration
from planner.kernels.folded_core import FIXED
from planner.motion.record import TableRecord
from planner.parameters.explosion import TableParameters
from planner.statics.balance import Balance
from planner.statics.contacts import MAX_TABLE_PENETRATION_PITCH, floor_clearances
from planner.statics.friction import Friction

Array = NDArray[np.float64]
REJECTION_DECAY: Final = 0.2
"""Decrease of the count of refusals for each time that frames are kept. Larger values raise the
torque bound later. Chosen."""


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
        """Count of refused frames since the bound was raised, less ``REJECTION_DECAY`` each time
        that frames were kept."""
        self.taken_back = 0
        self.raised: list[tuple[float, float]] = []
        """Times at which the bound was raised, s, and the bounds from then on, w·p."""
        self.why = ""
        """Reason of the last refusal, as a phrase."""
        self._too_weak = False
        """True if that reason was a torque: for all others, stronger motors would not help."""

    def holds(
        self, before: WindowConfiguration | None, bends: Sequence[WindowConfiguration]
    ) -> bool:
        """Return True if snapshots of an explosion may be kept, one after the other.

        Args:
            before: The snapshot before them: folding goes there, and friction against it.
            bends: Snapshots in the order of the explosion.
        """
        earlier = None if before is None else self._placed(before)
        for bend in bends:
            placed = self._placed(bend)
            if not self._stands(placed, earlier):
                return False
            earlier = placed
        return True

    def loops(self, bend: WindowConfiguration) -> bool:
        """Return True if the released modules would lie over each other."""
        return self._loops(self._placed(bend))

    def _loops(self, placed: Placed) -> bool:
        if placed.first == 0 and self._stacked:
            return False
        return crosses_itself(placed.poses.positions[placed.first + FIXED - 1 :, :2])

    def refuse(self, time_s: float) -> bool:
        """Count frames that were taken back; return False if the bound is at its maximum."""
        p = self._parameters
        self.taken_back += 1
        if not self._too_weak:
            return True
        self.refused += 1.0
        if self.refused <= p.refusals:
            return True
        if self.bound >= p.most_torque:
            return False
        self.refused = 0.0
        self.bound = min(p.raised_by * self.bound, p.most_torque)
        self.raised.append((time_s, self.bound))
        return True

    def keep(self) -> None:
        """Count frames that were kept."""
        self.refused = max(0.0, self.refused - REJECTION_DECAY)

    def record(self) -> TableRecord:
        """Return the figures of the guard for the record."""
        return TableRecord(
            bound=self.bound,
            taken_back=self.taken_back,
            raised=tuple(self.raised),
            friction=self._parameters.friction,
        )

    def _placed(self, bend: WindowConfiguration) -> Placed:
        chain = self._chain
        angles = self._peelable.widened(bend, 0, len(chain.folded_rad))
        poses = forward_kinematics(
            chain.module,
            angles,
            root_position=chain.folded_position,
            root_wxyz=chain.folded_wxyz,
        )
        positions = poses.positions.copy()
        positions[:, 2] -= self._height
        return Placed(angles, Poses(positions=positions, rotations=poses.rotations), bend.first)

    def _stands(self, placed: Placed, earlier: Placed | None) -> bool:
        positions, rotations = placed.poses.positions, placed.poses.rotations
        lowest = float(floor_clearances(self._chain.module, positions, rotations))
        self._too_weak = False
        if lowest < -MAX_TABLE_PENETRATION_PITCH:
            self.why = f"a module would sink {-lowest:.3f} pitch into the table"
            return False
        if self._loops(placed):
            self.why = "the chain would lie across itself in a loop that cannot open"
            return False
        how: dict[str, Any] = {"clamped": 0} if self._parameters.base == "clamped" else {}
        if self._parameters.friction and earlier is not None:
            how["friction"] = Friction(
                coefficient=self._parameters.friction,
                positions=earlier.poses.positions,
                rotations=earlier.poses.rotations,
            )
        if not self._balance.within(self.bound, positions, rotations, placed.angles, **how):
            self._too_weak = True
            self.why = f"a hinge would need more than {self.bound:.2f} w·p"
            return False
        return True
