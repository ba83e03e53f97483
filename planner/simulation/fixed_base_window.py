"""Fixed-base window: modules of a long chain between a held one and a straight tail.

Peeling simulates it. Static boxes represent the modules that are still folded; the tail is one
rigid lump.
"""

from __future__ import annotations

from foldback.planner.chain.chain import Chain
from foldback.planner.core.structures import Lumps
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.engine import SpringChain, build_chain_model
from foldback.planner.simulation.mujoco_models import Material


class FixedBaseWindow(SpringChain):
    """Window: a chain whose module 0 is held.

    Args:
        chain: Modules of the window.
        material: Material of their joints.
        finder: Finder of their contacts, with its boxes set.
        rod: Number of modules of the tail; 0 for none.
        heaviest_rod: Maximum number of modules whose mass and inertia the tail has: a heavier one
            slows the simulation down.
    """

    def __init__(
        self,
        chain: Chain,
        material: Material,
        finder: ContactFinder,
        *,
        rod: int,
        heaviest_rod: int,
    ) -> None:
        finder.allocate(len(chain), rod, boxed=1)
        lumps = Lumps.none()
        mass = float(min(rod, heaviest_rod))
        if rod:
            across = mass * (1.0 + mass**2) / 12.0
            lumps.masses[1] = mass
            lumps.centres[1, 0] = 0.5 + 0.5 * mass
            lumps.moments[1] = mass / 6.0, across, across
        model = build_chain_model(chain, root=0, fixed_base=True, lumps=lumps)
        super().__init__(chain, material, model)
