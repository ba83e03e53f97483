"""Likeness: how much the modules of a folded chain look like the input that they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from foldback.planner.storage.plain_values import from_plain


@dataclass(frozen=True, slots=True, kw_only=True)
class Likeness:
    """Overlap of the modules, which fill their cells, with the whole input.

    Attributes:
        iou: Intersection over union: volume of the overlap ÷ volume of what either covers, 0 to 1.
        missing: Share of the input's volume that no module covers, 0 to 1.
        added: Share of the modules' volume outside of the input, 0 to 1.
    """

    iou: float
    missing: float
    added: float

    def as_dict(self) -> dict[str, float]:
        """Return them as plain JSON values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any] | None) -> Self | None:
        """Return the likeness that a file holds; None without one.

        Raises:
            ValueError: A value is missing, or has another type.
        """
        return None if values is None else from_plain(values, cls)
