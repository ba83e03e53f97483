"""Table figures: the result of a table certificate, as plain values."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import Base
from foldback.planner.storage.plain_values import from_plain, plain_lists

TABLE_FORMAT: Final = "foldback-table/1"
FRICTIONLESS: Final = "frictionless"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCertificate:
    """Static torques of the hinges in a motion on a table. Lengths in pitches, torques in w·p.

    1 w·p is the weight of a module times the pitch. F is the number of frames.

    Attributes:
        verdict: ``rests on a table within X w·p, …`` or ``failed: …``.
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

    verdict: str
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
        return not self.verdict.startswith("failed")

    @property
    def told_friction(self) -> str:
        """Label of every figure: the friction, and the base if that matters."""
        if self.friction == 0.0:
            return FRICTIONLESS
        return f"friction {self.friction:g}, {self.base} base"

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {"format": TABLE_FORMAT, **plain_lists(asdict(self))}

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
