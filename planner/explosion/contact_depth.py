"""Contact depth: how deep modules may press into each other while a chain is let go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

LEAST: Final = 0.002
BACK_OFF: Final = 0.7


@dataclass(frozen=True, slots=True)
class ContactDepth:
    """Depths in pitches.

    Attributes:
        most: A run goes back when a contact is deeper.
        back_off: From here on the tension falls.
    """

    most: float
    back_off: float

    @classmethod
    def within(cls, room: float, deepest: float) -> ContactDepth:
        """For what the module size to verify leaves between hulls, never more than ``deepest``."""
        most = float(np.clip(room, LEAST, deepest))
        return cls(most, BACK_OFF * most)
