"""Contact finder: contacts among modules, static boxes and a straight tail, by MuJoCo.

Its model knows nothing of joints: it has as many free modules and boxes as were ever needed, those
left over touching nothing. It is compiled anew only when more of them are needed.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.core import box_cover, write_free_bodies
from foldback.planner.core.structures import DetectedContacts, FreeBodies, PairContacts
from foldback.planner.simulation.engine import detected_contacts, found_contacts
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    MIN_LIMITED_MEMORY_MODULES,
    MODULE_MEMORY_BYTES,
    SOLIMP,
    Material,
    add_module_geoms,
    add_part_meshes,
    base_spec,
    compiled,
    exclude,
)

TAIL: Final = "tail"


class ContactFinder:
    """Finder of contacts among modules, boxes and a straight tail.

    Args:
        chain: Chain of the same kind of module.
        material: Material of the surfaces.
    """

    def __init__(self, chain: Chain, material: Material) -> None:
        self._module = chain.module
        self._material = material
        self._cubes = self._boxes = 0
        self._centres = self._halves = np.zeros((0, 3))
        self.model: Any
        self.data: Any

    def set_boxes(self, centres: Array, halves: Array) -> None:
        """Set the (B, 3) centres and half sides of boxes along the axes of the world, pitches."""
        self._centres, self._halves = centres, halves

    def allocate(self, modules: int, tail: int = 0, *, boxed: int = 0) -> None:
        """Allocate the model for a number of modules, the boxes that are set, and a tail.

        Args:
            modules: Number of modules.
            tail: Number of modules of the tail, along the x axis of the last module; 0 for none.
            boxed: Number of modules at the start that lie within boxes and touch nothing.
        """
        if modules > self._cubes or len(self._centres) > self._boxes:
            spare = 32 if len(self._centres) else 0
            self._cubes = max(self._cubes, modules + spare)
            self._boxes = max(self._boxes, len(self._centres) + spare)
            self._compile()
        model, boxes = self.model, len(self._centres)
        model.body_pos[1 : boxes + 1] = self._centres
        self._set_halves(slice(1, boxes + 1), self._halves - self._shrink)
        self._set_halves(slice(-1, None), 0.5 * np.array([[tail or 1.0, 1.0, 1.0]]) - self._shrink)
        self._tail = tail
        self._enable(modules, boxed)

    def _set_halves(self, bodies: slice, halves: Array) -> None:
        """Set the (B, 3) half sides of box bodies, with all that MuJoCo derives from them."""
        model = self.model
        geoms = model.body_geomadr[bodies]
        model.geom_size[geoms] = halves
        model.geom_rbound[geoms] = np.linalg.norm(halves, axis=1)
        model.geom_aabb[geoms, 3:] = halves
        model.bvh_aabb[model.body_bvhadr[bodies], 3:] = halves

    @property
    def _shrink(self) -> float:
        """Distance by which a box is smaller on each side than its cells, as a module's hull is."""
        return 0.5 * (1.0 - self._material.geom_size)

    def _compile(self) -> None:
        spec = base_spec()
        if self._cubes > MIN_LIMITED_MEMORY_MODULES:
            spec.memory = MODULE_MEMORY_BYTES * self._cubes
        add_part_meshes(spec, self._module, self._material.geom_size)
        for _ in range(self._boxes):
            self._add_box(spec.worldbody.add_body())
        names = [*(f"module_{i}" for i in range(self._cubes)), TAIL]
        for i, name in enumerate(names):
            body = spec.worldbody.add_body()
            body.name = name
            body.add_freejoint()
            if name == TAIL:
                self._add_box(body)
            else:
                add_module_geoms(body, self._module, i, self._material)
            body.explicitinertial = True
            body.mass, body.inertia = 1.0, [1.0, 1.0, 1.0]  # MuJoCo needs some for a free body
        exclude(spec, names, pairwise(range(self._cubes)))
        self.model = model = compiled(spec)
        self.data = mujoco.MjData(model)
        # A contact with a box counts as one with module 0, which is rigidly connected to it.
        self._of_geom = np.maximum(model.geom_bodyid - 1 - self._boxes, 0).astype(np.int64)

    def _add_box(self, body: Any) -> None:
        surface = self._material
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.5])
        geom.condim = 1
        geom.friction = [max(surface.friction, 1e-5), 0.0, 0.0]
        geom.solref, geom.solimp = [surface.contact_time_constant, 1.0], SOLIMP

    def _enable(self, modules: int, boxed: int) -> None:
        """Let exactly the given modules, boxes and tail touch.

        Bodies that are merely put far away could be reached by a long tail.
        """
        poses, model, first = self.data.qpos.reshape(-1, 7), self.model, self._boxes + 1
        poses[:, :3] = 0.0
        poses[:, 3:] = (1.0, 0.0, 0.0, 0.0)
        touching = np.zeros(model.nbody, dtype=bool)
        touching[1 : len(self._centres) + 1] = True
        touching[first + boxed : first + modules] = True
        touching[-1] = self._tail > 0
        model.body_contype[:] = model.body_conaffinity[:] = touching
        model.geom_contype[:] = model.geom_conaffinity[:] = touching[model.geom_bodyid]
        self.bodies = FreeBodies(self.data.qpos, boxed, self._tail)
        """Modules and tail in MuJoCo's state."""
        self._of_geom[-1] = modules - 1

    def find(self, positions: Array, rotations: Array) -> DetectedContacts | None:
        """Return the contacts of (m, 3) centres and (m, 3, 3) orientations; None if there are none.

        Args:
            positions: (m, 3) centres of the modules in the frame of the boxes, pitches.
            rotations: (m, 3, 3) their orientations in that frame.
        """
        write_free_bodies(positions, rotations, self.bodies)
        self._collide()
        return detected_contacts(self.model, self.data, self._of_geom)

    def find_placed(self) -> PairContacts | None:
        """Return the contacts of modules that were placed as ``bodies``; None if there are none."""
        self._collide()
        return found_contacts(self.data, self._of_geom)

    def _collide(self) -> None:
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)


def robot_contacts(chain: Chain, *, geom_size: float, step_s: float) -> ContactFinder:
    """Return a finder of the contacts of robots.

    Args:
        chain: The chain.
        geom_size: Size of the colliding modules as a fraction of the pitch.
        step_s: Time step of the robots, s.
    """
    contact_time_constant = 2.0 * step_s  # the hardest contacts that MuJoCo permits
    return ContactFinder(
        chain, Material(geom_size=geom_size, contact_time_constant=contact_time_constant)
    )


def boxes_around(cells: Ints) -> tuple[Array, Array]:
    """Return (B, 3) centres and half sides of boxes that hold exactly the (k, 3) cells."""
    if not len(cells):
        return np.zeros((0, 3)), np.zeros((0, 3))
    low = cells.min(axis=0)
    grid = np.full(cells.max(axis=0) - low + 1, -1, dtype=np.int32)
    grid[tuple((cells - low).T)] = 0
    boxes = np.empty((len(cells), 6), dtype=np.int64)
    count = box_cover(grid, 0, boxes)
    corners = boxes[:count].astype(np.float64)
    half = 0.5 * corners[:, 3:]
    return corners[:, :3] + low - 0.5 + half, half
