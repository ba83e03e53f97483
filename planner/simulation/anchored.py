"""Anchored: a window of a long chain, held at its first module, with a rod on its last.

What peeling simulates. Boxes that don't move stand for what is still folded, the rod for what is
straight already. Of MuJoCo it takes the contacts alone, which a model finds that knows nothing of
joints: as many free cubes and as many boxes as there ever are, of which those left over touch
nothing. It is compiled anew when more of them are wanted, and not when boxes or the rod change.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.kernels.articulated import NO_TAIL
from planner.kernels.segment_state import write_wxyzs
from planner.simulation.model import (
    SOLIMP,
    Material,
    add_module_geom,
    base_spec,
    compiled,
    exclude,
)
from planner.simulation.mujoco import mujoco
from planner.simulation.reduced import Acceleration, Found, ReducedChain, State

Array = NDArray[np.float64]
ROOM: Final = 32
"""Cubes and boxes more than are wanted that a model is made with."""
ROD: Final = "rod"


class ContactFinder:
    """Finds what touches among cubes, boxes and a rod.

    Args:
        chain: Of the kind of module that the cubes are.
        material: Of their surfaces.
    """

    def __init__(self, chain: Chain, material: Material) -> None:
        self._module = chain.module
        self._material = material
        self._cubes = self._boxes = 0
        self._centres = self._halves = np.zeros((0, 3))
        self.model: Any
        self.data: Any

    def set_boxes(self, centres: Array, halves: Array) -> None:
        """Tells the (B, 3) centres and half sides of the boxes along the world's axes."""
        self._centres, self._halves = centres, halves

    def set_contact_time_constant(self, seconds: float) -> None:
        """How fast contacts push back: ``solref[0]`` of every geom."""
        self.model.geom_solref[:, 0] = seconds

    def make_room(self, modules: int, rod: int) -> None:
        """Sees to it that there are enough cubes, and a rod of so many."""
        if modules > self._cubes or len(self._centres) > self._boxes:
            self._cubes = max(self._cubes, modules + ROOM)
            self._boxes = max(self._boxes, len(self._centres) + ROOM)
            self._compile()
        model, boxes = self.model, len(self._centres)
        model.body_pos[1 : boxes + 1] = self._centres
        self._set_halves(slice(1, boxes + 1), self._halves - self._shrink)
        self._set_halves(slice(-1, None), 0.5 * np.array([[rod or 1.0, 1.0, 1.0]]) - self._shrink)
        self._rod = rod
        self._lay_aside(modules)

    def _set_halves(self, bodies: slice, halves: Array) -> None:
        """Makes bodies boxes with (B, 3) half sides, for all that MuJoCo derives from them."""
        model = self.model
        geoms = model.body_geomadr[bodies]
        model.geom_size[geoms] = halves
        model.geom_rbound[geoms] = np.linalg.norm(halves, axis=1)
        model.geom_aabb[geoms, 3:] = halves
        model.bvh_aabb[model.body_bvhadr[bodies], 3:] = halves

    @property
    def _shrink(self) -> float:
        """How much smaller a box is on each side than what it stands for, as a module's hull is."""
        return 0.5 * (1.0 - self._material.geom_size)

    def _compile(self) -> None:
        hull, spec = self._material, base_spec()
        for _ in range(self._boxes):
            body = spec.worldbody.add_body()
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.5])
            geom.condim = 1
            geom.friction = [max(hull.friction, 1e-5), 0.0, 0.0]
            geom.solref, geom.solimp = [hull.contact_time_constant, 1.0], SOLIMP
        names = [*(f"module_{i}" for i in range(self._cubes)), ROD]
        for i, name in enumerate(names):
            body = spec.worldbody.add_body()
            body.name = name
            body.add_freejoint()
            add_module_geom(body, self._module, i, hull)
            body.explicitinertial = True
            body.mass, body.inertia = 1.0, [1.0, 1.0, 1.0]  # MuJoCo wants some of all that is free
        exclude(spec, names, pairwise(range(self._cubes)))
        self.model = model = compiled(spec)
        self.data = mujoco.MjData(model)
        # What touches a box is as if it touched the held module 0.
        self._of_geom = np.maximum(model.geom_bodyid - 1 - self._boxes, 0).astype(np.int64)

    def _lay_aside(self, modules: int) -> None:
        """Lets nothing touch what a window of so many modules does not need.

        However far away it were put, a long rod might get there. Module 0 lies in a box.
        """
        places, model, first = self.data.qpos.reshape(-1, 7), self.model, self._boxes + 1
        places[:, :3] = 0.0
        places[:, 3:] = (1.0, 0.0, 0.0, 0.0)
        touching = np.zeros(model.nbody, dtype=bool)
        touching[1 : len(self._centres) + 1] = touching[first + 1 : first + modules] = True
        touching[-1] = self._rod > 0
        model.body_contype[:] = model.body_conaffinity[:] = touching
        model.geom_contype[:] = model.geom_conaffinity[:] = touching[model.geom_bodyid]
        self._modules = modules
        self._of_geom[-1] = modules - 1

    def found(self, positions: Array, rotations: Array) -> Found | None:
        """The contacts of (m, 3) centres and (m, 3, 3) orientations of a window's modules."""
        count = self._modules
        places = self.data.qpos.reshape(-1, 7)
        places[1:count, :3] = positions[1:]
        wxyzs = np.empty((count - 1, 4))
        write_wxyzs(rotations, np.arange(1, count), wxyzs)
        places[1:count, 3:] = wxyzs
        if self._rod:
            along = rotations[-1][:, 0]
            places[-1, :3] = positions[-1] + 0.5 * (1.0 + self._rod) * along
            places[-1, 3:] = wxyzs[-1]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        return Found.of(self.model, self.data, self._of_geom)


class Anchored(ReducedChain):
    """A window: a chain whose module 0 is held.

    Args:
        chain: The window's modules.
        material: Of their joints.
        finder: Finds their contacts; its boxes are told.
        rod: Modules of the rod on the last one; 0 for none.
        heaviest_rod: Its mass and inertia are at most those of so many: what is far away shall not
            slow the simulation down.
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
        super().__init__(chain, material, root=0, fixed=True)
        self._finder = finder
        finder.make_room(len(chain), rod)
        mass = float(min(rod, heaviest_rod))
        across = mass * (1.0 + mass**2) / 12.0
        self._tail = np.array([mass, 0.5 + 0.5 * mass, mass / 6.0, across]) if rod else NO_TAIL

    def accelerations(self, state: State, forces: Array, end_torque: Array) -> Acceleration:
        """The acceleration of a state; ``place`` must have been called for it.

        Args:
            state: The reduced state.
            forces: (n, 3) at the modules' centres, in the world.
            end_torque: (3,) on the last module, in the world.

        Raises:
            SimulationError: When the numbers are bad.
        """
        self._end_torque = end_torque
        found = self._finder.found(self.positions, self.rotations)
        return self._held_accelerations(state, forces, found)
