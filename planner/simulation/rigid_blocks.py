"""Blocks: a chain as one MuJoCo tree of rigid blocks of modules.

The tree is rooted at the block of the chain's middle module. The modules at both ends of a joint
between blocks are bodies of their own, without a joint, so that this one pair can be exempt from
contact: all other modules of two blocks collide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.core import chain_poses, chain_velocities
from foldback.planner.core.structures import ModuleStates
from foldback.planner.errors import InputError, SimulationError
from foldback.planner.simulation.contact_finder import boxes_around
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    SOLIMP,
    Material,
    add_next_body,
    add_previous_body,
    base_spec,
    compiled,
)
from foldback.planner.simulation.reduced_state import Acceleration, State


class Blocks:
    """Chain as rigid blocks, with the interface of ``Segments``, a MuJoCo model and its data.

    The state is that of all hinges; those within a block neither move nor accelerate.

    Args:
        chain: Chain whose modules fill cells.
        material: Material of its joints and surfaces.
        starts: First modules of the blocks, in ascending order from 0.

    Raises:
        InputError: ``no-blocks`` for modules that follow no paths, or a chain off the lattice.
    """

    def __init__(self, chain: Chain, material: Material, starts: Ints) -> None:
        self.chain = chain
        self.starts = np.asarray(starts, dtype=np.int64)
        n = len(chain)
        folded = chain.folded_poses
        if not chain.module.follows_paths:
            raise InputError(
                "no-blocks",
                f"got a chain of {chain.module.words.plural}, expected modules that fold "
                "along any path of cells; use a strategy other than blocks.",
            )
        stops = np.append(self.starts[1:], n)
        spec = base_spec()
        first = int(np.searchsorted(self.starts, chain.root, side="right")) - 1
        parts = _Parts(chain, material, folded.positions, folded.rotations)
        blocks = list(zip(self.starts.tolist(), stops.tolist(), strict=True))
        inner: dict[int, Any] = {}
        roots: list[tuple[int, int]] = []
        for k in [*range(first, len(blocks)), *range(first - 1, -1, -1)]:
            start, stop = blocks[k]
            if k == first:
                module = chain.root
                body = spec.worldbody.add_body()
                body.name = f"module_{module}"
                body.add_freejoint().name = "root"
            elif k > first:
                module = start
                body = add_next_body(inner[start - 1], chain, start, f"module_{start}", material)
            else:
                module = stop - 1
                body = add_previous_body(inner[stop], chain, stop - 1, f"module_{module}", material)
            ends = [start] * (start > 0) + [stop - 1] * (stop < n)
            inner.update(parts.fill(body, module, start, stop, ends))
            roots.append((k, module))
        for start in self.starts[1:].tolist():
            spec.add_exclude(bodyname1=inner[start - 1].name, bodyname2=inner[start].name)
        self.model: Any = compiled(spec)
        self._set_options()
        self.data: Any = mujoco.MjData(self.model)
        links = chain.module.joint_after(self.starts[1:] - 1)
        self.free = chain.hinges_of(links[links >= 0]).ravel()
        joints = [self.model.joint(chain.joint_names[h]) for h in self.free.tolist()]
        self._qpos = np.array([j.qposadr[0] for j in joints], dtype=np.int64)
        self._dofs = np.array([j.dofadr[0] for j in joints], dtype=np.int64)
        self._block = np.repeat(np.arange(len(blocks)), stops - self.starts)
        of_block = dict(roots)
        names = [f"module_{of_block[k]}" for k in range(len(blocks))]
        self._bodies = np.array([self.model.body(name).id for name in names])
        self.modules = ModuleStates.empty(n)
        """Poses and velocities of all modules, as placed last."""
        self.positions, self.rotations, self.velocities, self.spins = self.modules

    def _set_options(self) -> None:
        option = self.model.opt
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON
        option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
        option.iterations = 15
        option.tolerance = 1e-6
        option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)

    def set_contact_time_constant(self, seconds: float) -> None:
        """Set the time constant of all contacts, ``solref[0]``, s."""
        self.model.geom_solref[:, 0] = seconds

    def place(self, state: State) -> None:
        """Compute poses and velocities of all modules of a state."""
        module = self.chain.module
        chain_poses(
            state.angles,
            module.joint,
            self.chain.root,
            state.position,
            state.rotation,
            self.positions,
            self.rotations,
        )
        chain_velocities(
            state.angles,
            state.rates,
            module.joint,
            self.chain.root,
            state.velocity,
            state.rotation @ state.spin,
            self.modules,
        )

    def accelerations(self, state: State, forces: Array) -> Acceleration:
        """Return the acceleration of a state under forces on the modules.

        ``place`` must have been called for the same state.

        Args:
            state: The reduced state.
            forces: (n, 3) forces at the modules' centres, in the world frame.

        Raises:
            SimulationError: The accelerations are not finite.
        """
        model, data = self.model, self.data
        data.qpos[:3] = state.position
        data.qpos[3:7] = wxyz_from_matrix(state.rotation)
        data.qpos[self._qpos] = state.angles[self.free]
        data.qvel[:3] = state.velocity
        data.qvel[3:6] = state.spin
        data.qvel[self._dofs] = state.rates[self.free]
        mujoco.mj_fwdPosition(model, data)
        arms = self.positions - data.xipos[self._bodies][self._block]
        data.xfrc_applied[self._bodies, :3] = np.add.reduceat(forces, self.starts, axis=0)
        torques = np.cross(arms, forces)
        data.xfrc_applied[self._bodies, 3:] = np.add.reduceat(torques, self.starts, axis=0)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        acceleration = data.qacc
        if not np.isfinite(acceleration).all() or np.abs(acceleration).max() > 1e10:  # diverged
            raise SimulationError("the accelerations became infinite or undefined.")
        hinges = np.zeros_like(state.angles)
        hinges[self.free] = acceleration[self._dofs]
        return Acceleration(
            hinges=hinges,
            linear=acceleration[:3].copy(),
            angular=acceleration[3:6].copy(),
            contacts=int(data.ncon),
            depth=max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0,
        )


@dataclass(frozen=True, slots=True)
class _Parts:
    """Builder of the bodies of blocks."""

    chain: Chain
    material: Material
    positions: Array
    rotations: Array

    def fill(
        self, body: Any, module: int, start: int, stop: int, ends: list[int]
    ) -> dict[int, Any]:
        """Add the modules from ``start`` to ``stop`` to a body that is placed as one of them.

        Returns:
            A body for each of the modules ``ends``, whose contacts are exempted separately.
        """
        frame = self.rotations[module]
        places = (self.positions[start:stop] - self.positions[module]) @ frame
        cells = np.rint(places).astype(np.int64)
        if np.abs(places - cells).max() > 1e-3:
            raise InputError(
                "no-blocks",
                "got a folded chain whose modules lie between the cells of the cubic lattice, "
                "expected hinge angles of 0 or ±90°; use a strategy other than blocks.",
            )
        _set_inertia(body, places, float(self.chain.module.moments[0, 0]))
        inside = np.ones(stop - start, dtype=np.bool_)
        end_bodies: dict[int, Any] = {}
        for end in dict.fromkeys(ends):
            inside[end - start] = False
            part = body.add_body()
            part.name = f"end_{end}"
            part.pos = places[end - start].tolist()
            part.quat = wxyz_from_matrix(frame.T @ self.rotations[end]).tolist()
            part.explicitinertial = True
            part.mass = 1e-6
            part.inertia = [1e-6] * 3
            self._add_box(part, np.zeros(3), np.full(3, 0.5))
            end_bodies[end] = part
        for centre, half in zip(*boxes_around(cells[inside]), strict=True):
            self._add_box(body, centre, half)
        return end_bodies

    def _add_box(self, body: Any, centre: Array, half: Array) -> None:
        shrink = 0.5 * (1.0 - self.material.geom_size)
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=centre.tolist(),
            size=(half - shrink).tolist(),
            mass=0.0,
            condim=1,
            solref=[self.material.contact_time_constant, 1.0],
            solimp=SOLIMP,
            margin=0.0,
        )


def _set_inertia(body: Any, places: Array, inertia: float) -> None:
    """Set the inertia of a body to that of cubes of mass 1 with (m, 3) centres."""
    centre = places.mean(axis=0)
    arms = places - centre
    squares = (arms**2).sum()
    tensor = (squares + inertia * len(places)) * np.eye(3) - arms.T @ arms
    body.explicitinertial = True
    body.mass = float(len(places))
    body.ipos = centre.tolist()
    body.fullinertia = [tensor[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
