"""Table replay: frames of a motion on a table, put into plain MuJoCo and let go.

Nothing of the statics is used here: gravity, the table and contacts are MuJoCo's, and every hinge
is held by a brake, which slips beyond a torque a little larger than what was certified. A frame
that rests stays; one that asks for more sinks. Frames are best those of a simulated playback, whose
modules touch where they bear: others settle until they do.

Units are natural: module mass, pitch and gravity are 1, time is in √(pitch / gravity).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import Poses
from planner.motion.motion import Motion
from planner.simulation.model import STIFF, Material, compiled, tree_spec
from planner.simulation.mujoco import mujoco

Array = NDArray[np.float64]
SPARE: Final = 1.1
"""Torque of the brakes, of what was certified."""
LEAST_TORQUE: Final = 0.1
"""w·p that the brakes have at least."""
GEOM_SIZE: Final = 0.99
"""Collision hull as a fraction of the full module: full ones would overlap between cells. The
smaller it is the farther modules sink until they touch, and long tails with them."""
STEP: Final = 0.01
TOLERANCE: Final = 1e-10
"""Of MuJoCo's solver: at its own, what is left over drives a long tail on a frictionless table."""
DURATION: Final = 20.0
"""Time for which a frame is left alone."""
SETTLES: Final = 0.1
"""Pitches that a module of a frame that holds may go until what bears touches …"""
STILL: Final = 0.02
"""… and in the last half of the time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableReplay:
    """What plain MuJoCo says of a motion on a table. Lengths in pitches, torques in w·p.

    Attributes:
        frames: Those that were let go.
        drifts: How far the module went that went farthest, of each.
        still_drifts: The same of the last half of the time alone.
        torque_limit: Of the brakes.
        friction: μ between modules and table.
    """

    frames: tuple[int, ...]
    drifts: tuple[float, ...]
    still_drifts: tuple[float, ...]
    torque_limit: float
    friction: float

    @property
    def holds(self) -> bool:
        """Whether all frames settled soon and then held still."""
        return max(self.drifts) <= SETTLES and max(self.still_drifts) <= STILL


def table_replay(
    chain: Chain,
    frames: Motion,
    *,
    torque: float,
    friction: float = 0.0,
    count: int = 8,
    also: Sequence[int] = (),
    spare: float = SPARE,
    duration: float = DURATION,
) -> TableReplay:
    """Lets sampled frames go, the first module held where it is.

    Args:
        chain: The chain; folded, it stands on the table with its lowest modules, z up.
        frames: F of a motion on that table.
        torque: What was certified, in w·p.
        friction: μ between modules and table.
        count: How many frames, evenly spread.
        also: Frames that are let go besides, as the one that asks most.
        spare: Torque of the brakes, of what was certified.
        duration: Time for which each is left alone.
    """
    limit = max(spare * torque, LEAST_TORQUE)
    spread = np.linspace(0, len(frames) - 1, count).round().astype(int)
    numbers = np.union1d(spread, np.array(also, dtype=int))
    model = _model(chain, limit, friction)
    found = [_let_go(chain, model, frames, int(k), duration) for k in numbers]
    return TableReplay(
        frames=tuple(int(k) for k in numbers),
        drifts=tuple(drift for drift, _ in found),
        still_drifts=tuple(late for _, late in found),
        torque_limit=limit,
        friction=friction,
    )


def _let_go(
    chain: Chain, model: Any, frames: Motion, number: int, duration: float
) -> tuple[float, float]:
    """How far modules go at most, and in the last half of the time."""
    one = frames.dense(chain, number, number + 1)
    poses = chain.poses(one.joint_angles_rad[0], one.root_position[0], one.root_wxyz[0])
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7] = one.root_position[0], one.root_wxyz[0]
    for name, angle in zip(chain.joint_names, one.joint_angles_rad[0], strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    _hold_first(data, poses)
    bodies = [model.body(f"module_{i}").id for i in range(len(chain))]
    steps = int(duration / STEP)
    middle = poses.positions
    for k in range(steps):
        if k == steps // 2:
            middle = data.xpos[bodies].copy()
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    end = data.xpos[bodies]
    return _farthest(end - poses.positions), _farthest(end - middle)


def _farthest(ways: Array) -> float:
    return float(np.linalg.norm(ways, axis=1).max())


def _hold_first(data: Any, poses: Poses) -> None:
    data.mocap_pos[0] = poses.positions[0]
    data.mocap_quat[0] = poses.wxyzs[0]


def _model(chain: Chain, limit: float, friction: float) -> Any:
    spec = tree_spec(chain, Material(geom_size=GEOM_SIZE, contact_time_constant=2.0 * STEP))
    spec.option.gravity = [0.0, 0.0, -1.0]
    spec.option.timestep, spec.option.tolerance = STEP, TOLERANCE
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        pos=[0.0, 0.0, chain.table_height + (1.0 - GEOM_SIZE) * chain.module.inner_radius],
        condim=3 if friction > 0.0 else 1,
        friction=[max(friction, 1e-5), 0.0, 0.0],
        solref=[2.0 * STEP, 1.0],
        priority=1,
    )
    spec.worldbody.add_body(name="holder", mocap=True)
    weld = spec.add_equality()
    weld.type = mujoco.mjtEq.mjEQ_WELD
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.name1, weld.name2 = "holder", "module_0"
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
    weld.solref, weld.solimp = STIFF
    for name in chain.joint_names:
        brake = spec.joint(name)
        brake.frictionloss = limit
        brake.solref_friction, brake.solimp_friction = [2.0 * STEP, 1.0], STIFF[1]
    return compiled(spec)
