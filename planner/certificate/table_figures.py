"""Table figures: the result of a table certificate, as plain values."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import Base
from foldback.planner.reasons import Reason, friction_text
from foldback.planner.storage.plain_values import from_plain, plain_lists

TABLE_FORMAT: Final = "foldback-table/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCertificate:
    """Static torques of the hinges in a motion on a table. Lengths in pitches, torques in w·p.

    1 w·p is the weight of a module times the pitch. F is the number of frames.

    Attributes:
        reason: First condition that the motion fails; None if it rests on the table.
        name: Name of the chain.
        modules: Number of its modules.
        on_table: True if the frames stand on the table as they are; else each was laid into its
            best resting pose.
        friction: μ between modules and table.
        base: ``clamped`` if the first module is clamped to the table, ``free`` if the chain lies
            free.
        module_size: Size of the modules at their corners, as a fraction of the pitch.
        module_kg: Mass of a module.
        pitch_m: Distance of neighbouring modules.
        unit_nm: 1 w·p in N·m.
        bound: Maximum allowed torque; None for any.
        torque: Largest torque of all frames that balance; None if none does.
        torque_nm: Largest torque in N·m.
        frame: Frame with that torque.
        unbalanced: Frames without an equilibrium.
        clearance: Height of the lowest corner above the table, over all frames; negative if it
            goes into the table.
        clearance_frame: Frame with that height.
        torques: (F,) smallest possible largest torque; None without an equilibrium.
        standing: (F,) modules that stand on the table.
        assumptions: Assumptions of the figures, in words.
        seconds: Wall time, s.
    """

    reason: Reason | None
    name: str
    modules: int
    on_table: bool
    friction: float
    base: Base
    module_size: float
    module_kg: float
    pitch_m: float
    unit_nm: float
    bound: float | None
    torque: float | None
    torque_nm: float | None
    frame: int | None
    unbalanced: tuple[int, ...]
    clearance: float
    clearance_frame: int
    torques: tuple[float | None, ...]
    standing: tuple[tuple[int, ...], ...]
    assumptions: tuple[str, ...]
    seconds: float

    @property
    def rests(self) -> bool:
        """True if the motion rests on a table in all frames, within the bound."""
        return self.reason is None

    @property
    def verdict(self) -> str:
        """Verdict as text; frames count from 0."""
        if self.reason is not None:
            return f"failed: {self.reason.text()}"
        torque = f"{self.torque:.3g} w·p in frame {self.frame}"
        return f"rests on a table within {torque} ({self.base_text})"

    @property
    def base_text(self) -> str:
        """Friction and base that all torques assume, as text."""
        return friction_text(self.friction, clamped=self.base == "clamped")

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        values = {**asdict(self), "reason": self.reason and self.reason.as_dict()}
        judgement = {"format": TABLE_FORMAT, "rests": self.rests, "verdict": self.verdict}
        return {**judgement, **plain_lists(values)}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TableCertificate:
        """Build a certificate from ``as_dict``.

        Raises:
            InputError: ``wrong-format``.
        """
        if values.get("format") != TABLE_FORMAT:
            raise InputError(
                "wrong-format",
                f"got the format {values.get('format')!r}, expected {TABLE_FORMAT!r}, "
                "which `foldback table` writes.",
            )
        return from_plain(values, cls)
