"""Casings: what a module's cube is made of, and what the module weighs with servos in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from planner.errors import InputError

DENSITIES: Final = (1.0, 30_000.0)
"""Range of densities that may be asked for, in kg/m³."""
WALL_M: Final = 0.001
"""Wall of what is left of a solid cube when servos are in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Casing:
    """A cube with a wall all around, and as much of the same inside as ``fill`` says.

    Attributes:
        name: How it is asked for.
        density_kg_m3: Of the material.
        fill: Share of the inside that is material: 1 for a solid cube, 0 for an empty box.
        wall_m: Thickness of the wall.
        about: The material in words.
    """

    name: str
    density_kg_m3: float
    fill: float
    wall_m: float
    about: str

    def module_kg(self, pitch_m: float, servos_kg: float) -> float:
        """Mass of a module: that of the cube, but at least that of the servos in its wall alone."""
        inside = max(pitch_m - 2.0 * self.wall_m, 0.0) ** 3
        outside = pitch_m**3
        cube = self.density_kg_m3 * (outside - (1.0 - self.fill) * inside)
        wall = self.density_kg_m3 * (outside - inside)
        return max(cube, servos_kg + wall)

    @classmethod
    def weighing(cls, module_kg: float, pitch_m: float) -> Casing:
        """One that makes a module of this pitch weigh so much, servos included.

        Raises:
            InputError: ``bad-sizing``.
        """
        if not (module_kg > 0.0 and pitch_m > 0.0):
            raise InputError(
                "bad-sizing",
                f"got a module of {module_kg:g} kg and a pitch of {pitch_m:g} m, expected more "
                "than 0.",
                where="module_mass",
            )
        density = module_kg / pitch_m**3
        return cls(name="given", density_kg_m3=density, fill=1.0, wall_m=0.0, about="as given")


_PLA: Final = 1240.0
CASINGS: Final = {
    casing.name: casing
    for casing in (
        Casing(
            name="aluminium",
            density_kg_m3=2700.0,
            fill=1.0,
            wall_m=WALL_M,
            about="solid aluminium",
        ),
        Casing(name="steel", density_kg_m3=7850.0, fill=1.0, wall_m=WALL_M, about="solid steel"),
        Casing(name="pla", density_kg_m3=_PLA, fill=1.0, wall_m=WALL_M, about="solid PLA"),
        Casing(
            name="pla-20",
            density_kg_m3=_PLA,
            fill=0.2,
            wall_m=WALL_M,
            about="printed PLA, walls of 1 mm, filled by 20 %",
        ),
        Casing(
            name="pla-box",
            density_kg_m3=_PLA,
            fill=0.0,
            wall_m=WALL_M,
            about="printed PLA, walls of 1 mm and the servos",
        ),
    )
}
"""What may be asked for by name."""


def casing_named(name: str) -> Casing:
    """The one of this name, or one of so many kg/m³ all through.

    Raises:
        InputError: ``unknown-material``.
    """
    found = CASINGS.get(name.strip().lower())
    if found is not None:
        return found
    try:
        density = float(name)
    except ValueError:
        density = -1.0
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        raise InputError(
            "unknown-material",
            f"got the material {name!r}, expected {', '.join(CASINGS)}, or {DENSITIES[0]:g} to "
            f"{DENSITIES[1]:g} kg/m³.",
            where="material",
        )
    about = f"solid, {density:g} kg/m³"
    return Casing(name=name, density_kg_m3=density, fill=1.0, wall_m=WALL_M, about=about)
