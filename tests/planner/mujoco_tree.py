"""Accelerations of a chain as one MuJoCo tree."""

from typing import Any

import mujoco
import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.simulation.mujoco_models import Material, tree_spec
from foldback.planner.simulation.reduced_state import Acceleration, State
from tests.planner.chains import Array


def solve_exactly(model: Any) -> Any:
    """Return a model with exact contacts, whose solver iterates to convergence."""
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
    model.opt.iterations = 100
    model.opt.tolerance = 0.0  # relative to inertias, some of which are huge
    return model


def scale_masses(model: Any, masses: Array) -> None:
    """Multiply the masses of the modules."""
    for i, mass in enumerate(masses):
        body = model.body(f"module_{i}").id
        model.body_mass[body] *= mass
        model.body_inertia[body] *= mass


def tree_with(chain: Chain, size: float, masses: Array) -> Any:
    """Return one tree of modules of a size, with masses as multiples of the default."""
    model: Any = tree_spec(chain, Material(geom_size=size)).compile()
    scale_masses(model, masses)
    return model


def accelerate(
    model: Any,
    chain: Chain,
    state: State,
    *,
    forces: Array | None = None,
    torques: Array | None = None,
) -> Acceleration:
    """Return the accelerations of a tree under module forces and hinge torques."""
    data: Any = mujoco.MjData(model)
    data.joint("root").qpos[:] = [*state.position, *wxyz_from_matrix(state.rotation)]
    data.joint("root").qvel[:] = [*state.velocity, *state.spin]
    for j, name in enumerate(chain.joint_names):
        data.joint(name).qpos[0], data.joint(name).qvel[0] = state.angles[j], state.rates[j]
        if torques is not None:
            data.qfrc_applied[model.joint(name).dofadr[0]] = torques[j]
    if forces is not None:
        for i, force in enumerate(forces):
            data.xfrc_applied[model.body(f"module_{i}").id, :3] = force
    mujoco.mj_forward(model, data)
    root = data.joint("root").qacc
    return Acceleration(
        hinges=np.array([data.joint(name).qacc[0] for name in chain.joint_names]),
        linear=root[:3],
        angular=root[3:],
        contacts=int(data.ncon),
        depth=0.0,
    )
