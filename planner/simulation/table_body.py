"""Table body: a chain on a table, under gravity, with motors of limited torque.

Units are natural: a module's mass, the pitch and gravity are 1. Torques are then in w·p, the weight
of a module times the pitch, and time is in √(pitch / gravity): 32 ms for a pitch of 1 cm.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.corners import lowest_corners
from foldback.planner.errors import SimulationError
from foldback.planner.parameters.playback import TablePlaybackParameters
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    SOLIMP,
    STIFF_SOLREF_SOLIMP,
    Material,
    add_module_geoms,
    add_next_body,
    add_part_meshes,
    base_spec,
    compiled,
    exclude,
    set_inertia,
)

BAD_NUMBER_WARNINGS: Final = ("mjWARN_BADQPOS", "mjWARN_BADQVEL", "mjWARN_BADQACC")


class TableBody:
    """Chain on a table.

    Motors are constraints, as in ``planner.simulation.mujoco_tree.RateMotors``: a hinge turns
    at the wanted rate as long as its torque suffices, and yields beyond. No torque is above the
    limit.

    Args:
        chain: The chain; folded, it stands on the table, z up.
        parameters: Parameters of the simulation.
        height: Height of the table's top, along z, pitches.
        torque_limit: Largest torque of every motor, w·p; 0 for no motors.
        friction: Coefficient of friction μ between modules and table; there is none among modules.
        clamped: True if the first module is clamped to the table; else the chain lies freely.
    """

    def __init__(
        self,
        chain: Chain,
        parameters: TablePlaybackParameters,
        *,
        height: float,
        torque_limit: float,
        friction: float = 0.0,
        clamped: bool = True,
    ) -> None:
        self.chain = chain
        spec = _spec(chain, parameters, height, torque_limit, friction)
        if not clamped:
            spec.body("module_0").add_freejoint()
        self.model: Any = compiled(spec)
        self.model.opt.timestep = parameters.step
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        # Nearly every hinge moves nearly every contact: three times as fast as sparse.
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data: Any = mujoco.MjData(self.model)
        self._planned: Any = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in chain.joint_names]
        self._qpos = np.array([joint.qposadr[0] for joint in joints], dtype=np.int64)
        self._dofs = np.array([joint.dofadr[0] for joint in joints], dtype=np.int64)
        self._bodies = np.array([self.model.body(f"module_{i}").id for i in range(len(chain))])
        self._hinge_of_dof = np.zeros(self.model.nv, dtype=np.int64)
        self._hinge_of_dof[self._dofs] = np.arange(len(self._dofs))
        # The composite inertia about a hinge of all beyond it is on the diagonal, a row's last one.
        self._diagonal = (self.model.M_rowadr + self.model.M_rownnz - 1)[self._dofs]
        self._gain, self._braking = parameters.gain, parameters.braking_share * torque_limit
        self._work = np.empty(self.model.nv)
        self._torques = np.zeros(len(self._dofs))

    @property
    def angles(self) -> Array:
        """(J,) a copy of the hinge angles, rad."""
        return self.data.qpos[self._qpos]

    @property
    def torques(self) -> Array:
        """(J,) a copy of the motors' torques in the last step, w·p."""
        return self._torques.copy()

    @property
    def poses(self) -> tuple[Array, Array]:
        """(n, 3) centres, pitches, and (n, 4) orientations of the modules."""
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.xpos[self._bodies], self.data.xquat[self._bodies]

    def place(self, angles: Array) -> None:
        """Set a configuration at rest, its first module placed as in the folded chain."""
        data = self.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[self._qpos] = angles
        self._torques[:] = 0.0

    def step(self, rates: Array, errors: Array, expected: Array) -> None:
        """Integrate one step in which the motors turn at given rates and correct errors.

        Corrections are no faster than a fraction of the torque can stop the modules carried.

        Args:
            rates: (J,) rates of the plan, rad per unit of time.
            errors: (J,) remaining angles to the targets, rad.
            expected: (J,) torques of the plan, w·p, with which motors yield less.

        Raises:
            SimulationError: MuJoCo warns of bad numbers.
        """
        model, data = self.model, self.data
        mujoco.mj_step1(model, data)
        carried = data.M[self._diagonal]
        stopping = np.sqrt(2.0 * self._braking / carried * np.abs(errors))
        rates = rates + np.sign(errors) * np.minimum(self._gain * np.abs(errors), stopping)
        rows = np.flatnonzero(data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF))
        hinges = self._hinge_of_dof[data.efc_id[rows]]
        # A row's reference acceleration is −b (J q̇): that of a rate w is −b (J q̇ − w).
        data.efc_aref[rows] += data.efc_KBIP[rows, 1] * rates[hinges]
        # Its force is (a_ref − a) / R, up to the limit: this torque needs no error.
        data.efc_aref[rows] += data.efc_R[rows] * expected[hinges]
        mujoco.mj_step2(model, data)
        self._torques[hinges] = data.efc_force[rows]
        for name in BAD_NUMBER_WARNINGS:
            if data.warning[int(getattr(mujoco.mjtWarning, name))].number:
                raise SimulationError("the simulated state became infinite or undefined.")

    def inertial_torques(self, angles: Array, rates: Array, accelerations: Array) -> Array:
        """Return (J,) torques of a motion without gravity and contacts, the first module held."""
        model, data = self.model, self._planned
        data.qpos[self._qpos] = angles
        data.qvel[self._dofs] = rates
        data.qacc[self._dofs] = accelerations
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        gravity = model.opt.gravity.copy()
        model.opt.gravity[:] = 0.0
        mujoco.mj_rne(model, data, 1, self._work)
        model.opt.gravity[:] = gravity
        return self._work[self._dofs]


def _spec(
    chain: Chain, p: TablePlaybackParameters, height: float, limit: float, friction: float
) -> Any:
    spec = base_spec()
    spec.option.gravity = [0.0, 0.0, -1.0]
    module, n = chain.module, len(chain)
    masses = module.masses(n).tolist()
    material = Material(
        geom_size=p.geom_size,
        contact_time_constant=p.contact_time,
        armature=p.armature,
        stops_early_rad=p.stops_early_rad,
        stiff_stops=True,
    )
    add_part_meshes(spec, module, p.geom_size)
    names = [f"module_{i}" for i in range(n)]
    body = spec.worldbody.add_body()
    body.name = names[0]
    # Modules are smaller than a pitch: the table is raised so that the folded chain stands on it.
    poses = chain.folded_poses
    lowest = lowest_corners(module, poses.positions, poses.rotations, module_size=p.geom_size)
    top = height - chain.table_height + float(lowest.min())
    body.pos = chain.folded_position.tolist()
    body.quat = chain.folded_wxyz.tolist()
    for i in range(n):
        if i:
            body = add_next_body(body, chain, i, names[i], material)
        set_inertia(body, chain, i, masses[i])
        for geom in add_module_geoms(body, module, i, material):
            geom.solimp = [p.module_hardness, p.module_hardness, *SOLIMP[2:]]
    exclude(spec, names, module.exempt_pairs(n))
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        pos=[0.0, 0.0, top],
        condim=3 if friction > 0.0 else 1,
        friction=[max(friction, 1e-5), 0.0, 0.0],
        solref=[p.contact_time, 1.0],
        solimp=[p.table_hardness, p.table_hardness, *SOLIMP[2:]],
        priority=1,
    )
    if limit > 0.0:
        for name in chain.joint_names:
            hinge = spec.joint(name)
            hinge.frictionloss = limit
            hinge.solref_friction = [2.0 * p.step, 1.0]
            hinge.solimp_friction = [p.firmness, p.firmness, *STIFF_SOLREF_SOLIMP[1][2:]]
    return spec
