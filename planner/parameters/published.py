"""Parameters of the published method."""

from __future__ import annotations

from dataclasses import dataclass

from foldback.planner.chain.module import DEFAULT_DENSITY_KG_M3, Module
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.setting import setting, shared


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperExplosionParameters:
    """Parameters of the published explosion: constant gains, step and snapshot interval.

    The figures of the paper have no units; read as centimetres, grams and seconds they are
    consistent (decision 0002). The ``source`` of each setting says whether the paper gives its
    value, only names it, or does not have it.

    Attributes:
        radial_gain: λ of equation 1; its d is the diameter of one module, one pitch.
        repulsion_gain: γ of equation 3.
        damping: Fraction of its velocity that the chain loses in each step.
        friction: Coefficient of friction of contacts.
        step_s: Time step.
        pitch_cm: Distance of neighbouring modules, the paper's "diameter".
        density_kg_m3: Density of a solid module.
        snapshot_interval: Number of steps between two snapshots.
        repulsion_cutoff: Distance in pitches above which modules do not repel each other.
        spring: Stiffness of the hinge springs, which pull towards straight, in g·cm²/s².
        stop_deg: Angle of the hinges' stops.
        geom_size: Size of the collision hull.
        max_steps: Number of steps after which the explosion gives up.
    """

    radial_gain: float = setting(
        0.1,
        label="Radial force gain λ",
        help="Strength of the force that pushes modules away from the chain's centre: λ in "
        "equation 1 of the paper that foldback is based on.",
        unit="dyn",
        source="published",
        range=(0.0, 1e3),
    )
    repulsion_gain: float = setting(
        1.0,
        label="Repulsion force gain γ",
        help="Strength of the repulsion between modules that are not linked: γ in equation 3 of "
        "the paper.",
        unit="dyn·cm²",
        source="published",
        range=(0.0, 1e3),
    )
    damping: float = setting(
        0.1,
        label="Damping",
        help="Fraction of the chain's velocity that is lost in a step, in explosion and playback.",
        unit="of the speed per step",
        source="published",
        range=(0.0, 0.9),
        direct=True,
    )
    friction: float = setting(
        0.1,
        label="Friction",
        help="Coefficient of Coulomb friction between modules.",
        source="published",
        range=(0.0, 2.0),
        direct=True,
    )
    step_s: float = setting(
        0.01,
        label="Step size",
        help="Time step of the explosion and of the playback.",
        unit="s",
        source="published",
        range=(1e-4, 0.02),
        direct=True,
    )
    pitch_cm: float = setting(
        1.0,
        label="Module diameter",
        help="Diameter of a module. Diameter and density determine the mass of a module.",
        unit="cm",
        source="published",
        range=(0.1, 100.0),
    )
    density_kg_m3: float = setting(
        DEFAULT_DENSITY_KG_M3,
        label="Density",
        help="Density of a module. Density and diameter determine the mass of a module.",
        unit="kg/m³",
        source="published",
        range=(1.0, 1e5),
        direct=True,
    )
    snapshot_interval: int = setting(
        10,
        label="Snapshot interval",
        help="Number of explosion steps between two snapshots.",
        unit="steps",
        source="named",
        range=(1, 1000),
        is_whole=True,
    )
    repulsion_cutoff: float = setting(
        2.5,
        label="Repulsion cutoff",
        help="Modules farther apart than this distance do not repel each other.",
        unit="pitches",
        source="named",
        range=(1.0, 10.0),
    )
    spring: float = setting(
        1.0,
        label="Hinge spring",
        help="Stiffness of the springs that straighten the hinges. The tension in the chain is "
        "up to a hundred times larger than the forces of these springs.",
        unit="g·cm²/s²",
        range=(0.0, 1e3),
    )
    stop_deg: float = setting(
        90.0,
        label="Largest hinge angle",
        help="Largest angle of a hinge in the explosion, in both directions.",
        unit="°",
        range=(90.0, 92.0),
    )
    geom_size: float = shared(0.99, ExplosionParameters)
    max_steps: int = shared(400_000, ExplosionParameters)

    def module_mass_g(self, module: Module) -> float:
        """Return the mass of a module in grams."""
        return 1e-3 * self.density_kg_m3 * module.volume * self.pitch_cm**3
