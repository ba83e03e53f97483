"""Module materials: materials of a module's cube, and masses of modules with servos in them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foldback.planner.chain.module import ALUMINIUM_KG_M3
from foldback.planner.errors import InputError

DENSITY_RANGE_KG_M3: Final = (1.0, 30_000.0)
"""Minimum and maximum density of a module's material that is accepted, in kg/m³; other values are
refused as implausible."""
WALL_M: Final = 0.001
"""Thickness, in m, of the solid wall of a module's cube around its servos, from which the module's
mass is computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Casing:
    """Cube with a wall all around, filled inside with the same material by ``fill``.

    Attributes:
        name: Name of the casing in requests.
        density_kg_m3: Density of the material.
        fill: Fraction of the inside that is material: 1 for a solid cube, 0 for an empty box.
        wall_m: Thickness of the wall.
        about: The material in words.
    """

    name: str
    density_kg_m3: float
    fill: float
    wall_m: float
    about: str

    def module_kg(self, pitch_m: float, servos_kg: float) -> float:
        """Return the mass of a module: that of the cube, at least that of its wall and servos."""
        inside = max(pitch_m - 2.0 * self.wall_m, 0.0) ** 3
        outside = pitch_m**3
        cube = self.density_kg_m3 * (outside - (1.0 - self.fill) * inside)
        wall = self.density_kg_m3 * (outside - inside)
        return max(cube, servos_kg + wall)

    @classmethod
    def weighing(cls, module_kg: float, pitch_m: float) -> Casing:
        """Return a casing with which a module of this pitch has a given mass, servos included.

        Raises:
            InputError: ``bad-sizing``.
        """
        if not (module_kg > 0.0 and pitch_m > 0.0):
            raise InputError(
                "bad-sizing",
                f"got a module of {module_kg:g} kg and a pitch of {pitch_m:g} m, expected a "
                "mass and a pitch above 0.",
                where="module_mass",
            )
        density = module_kg / pitch_m**3
        return cls(
            name="given", density_kg_m3=density, fill=1.0, wall_m=0.0, about="module mass as given"
        )


_PLA_KG_M3: Final = 1240.0
"""Density of PLA, the usual plastic of 3D printers, in kg/m³, as makers of filament publish it."""
CASINGS: Final = {
    casing.name: casing
    for casing in (
        Casing(
            name="aluminium",
            density_kg_m3=ALUMINIUM_KG_M3,
            fill=1.0,
            wall_m=WALL_M,
            about="solid aluminium",
        ),
        Casing(name="steel", density_kg_m3=7850.0, fill=1.0, wall_m=WALL_M, about="solid steel"),
        Casing(name="pla", density_kg_m3=_PLA_KG_M3, fill=1.0, wall_m=WALL_M, about="solid PLA"),
        Casing(
            name="pla-20",
            density_kg_m3=_PLA_KG_M3,
            fill=0.2,
            wall_m=WALL_M,
            about="printed PLA, 1 mm walls, 20 % infill",
        ),
        Casing(
            name="pla-box",
            density_kg_m3=_PLA_KG_M3,
            fill=0.0,
            wall_m=WALL_M,
            about="printed PLA, 1 mm walls, with the servos inside",
        ),
    )
}
"""Casings of a module (material and walls) that can be chosen to estimate its mass, by name."""


def casing_named(name: str) -> Casing:
    """Return the casing of this name, or a solid one if the name is a density in kg/m³.

    Raises:
        InputError: ``unknown-material``.
    """
    casing = CASINGS.get(name.strip().lower())
    if casing is not None:
        return casing
    try:
        density = float(name)
    except ValueError:
        density = -1.0
    if not DENSITY_RANGE_KG_M3[0] <= density <= DENSITY_RANGE_KG_M3[1]:
        raise InputError(
            "unknown-material",
            f"got the material {name!r}, expected {', '.join(CASINGS)}, or a density of "
            f"{DENSITY_RANGE_KG_M3[0]:g} to {DENSITY_RANGE_KG_M3[1]:g} kg/m³.",
            where="material",
        )
    about = f"solid, {density:g} kg/m³"
    return Casing(name=name, density_kg_m3=density, fill=1.0, wall_m=WALL_M, about=about)
