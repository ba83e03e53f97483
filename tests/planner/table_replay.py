"""Table replay: frames of a motion on a table are placed in plain MuJoCo and released.

foldback's own statics are not used: gravity, the table and contacts are MuJoCo's, and every hinge
has a brake, which slips beyond a torque a little larger than the certified one. A stable frame
stays in place; one that needs more torque sinks. Frames of a simulated playback are most suitable,
as their modules touch where they carry load; others first settle until they do.

Units are natural: module mass, pitch and gravity are 1, time is in √(pitch / gravity).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import (
    STIFF_SOLREF_SOLIMP,
    Material,
    compiled,
    tree_spec,
)
from tests.planner.chains import Array

BRAKE_TORQUE_RATIO: Final = 1.1
"""Torque with which simulated brakes hold the hinges when a frame on a table is checked, as a
multiple of the largest torque in the certificate."""
MIN_BRAKE_TORQUE_WP: Final = 0.1
"""Minimum torque with which simulated brakes hold the hinges when a frame on a table is checked, in
w·p (module weight × pitch), for plans that need hardly any torque."""
REPLAY_GEOM_SIZE: Final = 0.99
"""Size of the collision hulls where frames on a table are simulated, as a fraction of the module:
full hulls of neighbouring cells would overlap by rounding."""
REPLAY_STEP: Final = 0.01
"""Time step of the simulation that checks frames on a table, in √(pitch / gravity)."""
SOLVER_TOLERANCE: Final = 1e-10
"""Tolerance of MuJoCo's constraint solver where frames on a table are simulated. With its default
of 1e-8, the solver's residual moves a long tail on a frictionless table."""
REPLAY_DURATION: Final = 20.0
"""Duration of the simulation of one frame on a table, in √(pitch / gravity)."""
MAX_SETTLING_PITCH: Final = 0.1
"""A frame of a fold on a table is simulated under gravity with braked hinges. Maximum distance,
pitches, between the first and last position of a module (gaps at contacts close at first); beyond
it the frame counts as unstable."""
MAX_LATE_DRIFT_PITCH: Final = 0.02
"""Maximum distance, in pitches, that a module of a simulated frame on a table may move in the
second half of the simulation; a frame that moves further counts as not resting."""


@dataclass(frozen=True, slots=True)
class TableReplay:
    """Result of a replay on a table. Lengths in pitches, torques in w·p.

    Attributes:
        frames: Numbers of the released frames.
        drifts: Largest distance of a module from its start, by frame.
        still_drifts: Largest distance of a module in the last half of the time, by frame.
    """

    frames: tuple[int, ...]
    drifts: tuple[float, ...]
    still_drifts: tuple[float, ...]

    @property
    def holds(self) -> bool:
        """True if all frames settled soon and then remained at rest."""
        return (
            max(self.drifts) <= MAX_SETTLING_PITCH
            and max(self.still_drifts) <= MAX_LATE_DRIFT_PITCH
        )


def table_replay(
    chain: Chain,
    frames: Motion,
    *,
    torque: float,
    count: int = 8,
    also: Sequence[int] = (),
    spare: float = BRAKE_TORQUE_RATIO,
) -> TableReplay:
    """Release sampled frames on a table without friction, with the first module fixed.

    Args:
        chain: Chain; when folded it stands on the table with its lowest modules, z up.
        frames: F frames of a motion on that table.
        torque: Certified torque, w·p.
        count: Number of frames, evenly spread.
        also: Additional frames, such as the one with the largest torque.
        spare: Torque of the brakes as a multiple of the certified one.
    """
    spread = np.linspace(0, len(frames) - 1, count).round().astype(int)
    numbers = np.union1d(spread, np.array(also, dtype=int))
    model = _model(chain, max(spare * torque, MIN_BRAKE_TORQUE_WP))
    releases = [_release(chain, model, frames, int(k)) for k in numbers]
    return TableReplay(tuple(numbers.tolist()), *zip(*releases, strict=True))


def _release(chain: Chain, model: Any, frames: Motion, number: int) -> tuple[float, float]:
    """Return the largest displacements of a module: overall and in the second half of the time."""
    first = frames.dense(chain, number, number + 1)
    poses = chain.poses(first.joint_angles_rad[0], first.root_position[0], first.root_wxyz[0])
    data = mujoco.MjData(model)
    data.qpos[:3], data.qpos[3:7] = first.root_position[0], first.root_wxyz[0]
    for name, angle in zip(chain.joint_names, first.joint_angles_rad[0], strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    data.mocap_pos[0], data.mocap_quat[0] = poses.positions[0], poses.wxyzs[0]
    bodies = [model.body(f"module_{i}").id for i in range(len(chain))]
    steps = int(REPLAY_DURATION / REPLAY_STEP)
    middle = poses.positions
    for k in range(steps):
        if k == steps // 2:
            middle = data.xpos[bodies].copy()
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    end = data.xpos[bodies]
    return _largest(end - poses.positions), _largest(end - middle)


def _largest(ways: Array) -> float:
    return float(np.linalg.norm(ways, axis=1).max())


def _model(chain: Chain, limit: float) -> Any:
    spec = tree_spec(
        chain, Material(geom_size=REPLAY_GEOM_SIZE, contact_time_constant=2.0 * REPLAY_STEP)
    )
    spec.option.gravity = [0.0, 0.0, -1.0]
    spec.option.timestep, spec.option.tolerance = REPLAY_STEP, SOLVER_TOLERANCE
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.worldbody.add_geom(
        name="table",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        pos=[0.0, 0.0, chain.table_height + (1.0 - REPLAY_GEOM_SIZE) * chain.module.inner_radius],
        condim=1,
        friction=[1e-5, 0.0, 0.0],
        solref=[2.0 * REPLAY_STEP, 1.0],
        priority=1,
    )
    spec.worldbody.add_body(name="holder", mocap=True)
    weld = spec.add_equality()
    weld.type = mujoco.mjtEq.mjEQ_WELD
    weld.objtype = mujoco.mjtObj.mjOBJ_BODY
    weld.name1, weld.name2 = "holder", "module_0"
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
    weld.solref, weld.solimp = STIFF_SOLREF_SOLIMP
    for name in chain.joint_names:
        brake = spec.joint(name)
        brake.frictionloss = limit
        brake.solref_friction = [2.0 * REPLAY_STEP, 1.0]
        brake.solimp_friction = STIFF_SOLREF_SOLIMP[1]
    return compiled(spec)
