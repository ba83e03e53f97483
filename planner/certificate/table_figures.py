"""Table figures: what a table certificate tells, as plain values that anybody can read."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

from planner.errors import InputError
from planner.parameters.explosion import Base

FORMAT: Final = "foldback-table/1"
FRICTIONLESS: Final = "frictionless"


@dataclass(frozen=True, slots=True, kw_only=True)
class TableCertificate:
    """What a motion asks of the hinges on a table. Lengths in pitches, torques in w·p.

    1 w·p is the weight of a module times the pitch. What is of F frames has a value for each.

    Attributes:
        verdict: ``rests on a table within X w·p, …`` or ``failed: …``.
        name: Of the chain.
        modules: How many it has.
        on_table: Whether the frames stand on the table as they are; else each was laid into its
            best resting pose.
        friction: μ between modules and table.
        base: Whether the first module is ``clamped`` to the table or the chain lies ``free``.
        module_size: Where its corners are, as a fraction of the pitch.
        module_kg: Mass of a module.
        pitch_m: Distance of neighbouring modules.
        unit_nm: 1 w·p in N·m.
        bound: Largest torque that was allowed; None for any.
        torque: The largest of all frames that balance; None where none does.
        torque_nm: The same in N·m.
        frame: Where that is.
        unbalanced: Frames that nothing balances.
        clearance: Of the table: how high the lowest corner is in the frame where it is lowest;
            negative where it goes into the table.
        clearance_frame: Where that is.
        torques: (F,) smallest largest torque; None where nothing balances.
        standing: (F,) the modules that stand on the table.
        assumptions: All that the figures lean on, in words.
        seconds: Wall time.
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
        """Whether the motion rests on a table in all frames, within the bound."""
        return not self.verdict.startswith("failed")

    @property
    def told_friction(self) -> str:
        """What is said beside every figure: of friction, and of the base where that matters."""
        if self.friction == 0.0:
            return FRICTIONLESS
        return f"friction {self.friction:g}, {self.base} base"

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        lists = {name: list(values[name]) for name in ("unbalanced", "torques", "assumptions")}
        return {
            "format": FORMAT,
            **values,
            **lists,
            "standing": [list(each) for each in self.standing],
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TableCertificate:
        """The inverse of ``as_dict``.

        Raises:
            InputError: ``wrong-format``.
        """
        if values.get("format") != FORMAT:
            raise InputError(
                "wrong-format",
                f"got the format {values.get('format')!r}, expected {FORMAT!r}, as "
                "`foldback table` writes it.",
            )
        found: dict[str, Any] = {field.name: values[field.name] for field in fields(cls)}
        for name in ("unbalanced", "torques", "assumptions"):
            found[name] = tuple(found[name])
        found["standing"] = tuple(tuple(each) for each in found["standing"])
        return cls(**found)
