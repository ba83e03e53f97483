from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.errors import InputError
from planner.exports.mjcf import mjcf
from planner.robot.motors import Build, motor_table
from planner.robot.retiming import retime, retimed
from planner.robot.trajectory import Trajectory
from planner.simulation.lazy_mujoco import mujoco
from tests.case import case
from tests.planner.chains import line

MASS, PITCH, GRAVITY = 0.2, 0.05, 9.81
BUILD = Build(module_mass_kg=MASS, pitch_m=PITCH, gravity_m_s2=GRAVITY)


@pytest.fixture
def pendulum() -> tuple[Chain, Trajectory]:
    """Chain of three cubes: the root, a fixed one, and one that swings by its z hinge."""
    chain = line(3)
    frames = np.zeros((40, 2))
    frames[:, 0] = np.linspace(0.0, 1.2, 40)
    return chain, retimed(frames, chain.joint_names, 1.0, 2.0)


@pytest.mark.parametrize("gravity", [0.0, GRAVITY])
def test_torque_of_a_pendulum(pendulum: tuple[Chain, Trajectory], gravity: float) -> None:
    chain, trajectory = pendulum
    build = Build(module_mass_kg=MASS, pitch_m=PITCH, gravity_m_s2=gravity)
    table = motor_table(chain, trajectory, build)
    inertia = MASS * PITCH**2 * (1.0 + 1.0 / 6.0)  # a cube one edge from its hinge
    weight = MASS * gravity * PITCH
    assert table.peak_torque_nm[0] == pytest.approx(2.0 * inertia + weight, rel=1e-6)
    # It accelerates for 0.5 s, then decelerates for as long, at constant rates.
    square = (2.0 * inertia + weight) ** 2 + (trajectory.duration_s - 1.0) * weight**2
    rms = np.sqrt(square / trajectory.duration_s)
    assert table.rms_torque_nm[0] == pytest.approx(rms, rel=0.01)


def test_torques_agree_with_mujoco_inverse_dynamics(folded: Callable[..., Any]) -> None:
    plan = folded("wrench-24").plan
    trajectory = retime(plan, 1.0, 2.0)
    unit, weight = MASS * PITCH**2, MASS * PITCH
    model = mujoco.MjModel.from_xml_string(mjcf(plan.chain, module_size=0.95))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in plan.chain.joint_names]
    positions = [joint.qposadr[0] for joint in joints]
    dofs = [joint.dofadr[0] for joint in joints]
    t = np.linspace(0.0, trajectory.duration_s, 400)
    needs = np.zeros((len(t), len(joints)))
    for k, states in enumerate(zip(*trajectory.at(t), strict=True)):
        data.qpos[positions], data.qvel[dofs], data.qacc[dofs] = states
        torques = []
        for direction in (np.zeros(3), *np.eye(3)):
            model.opt.gravity = direction
            data.qacc[:6] = data.qvel[:6] = 0.0
            mujoco.mj_inverse(model, data)
            torques.append(data.qfrc_inverse[dofs].copy())
        # A torque is linear in gravity: along the worst direction it is the norm of its row.
        pull = np.linalg.norm(np.array(torques[1:]) - torques[0], axis=0)
        needs[k] = unit * np.abs(torques[0]) + weight * GRAVITY * pull
    table = motor_table(plan.chain, trajectory, BUILD)
    assert (table.peak_torque_nm >= needs.max(axis=0) * (1.0 - 1e-3)).all()
    most = needs.max(axis=0).argmax()
    assert table.neediest == most
    assert table.peak_torque_nm[most] == pytest.approx(needs[:, most].max(), rel=0.03)
    assert table.rms_torque_nm == pytest.approx(np.sqrt((needs**2).mean(axis=0)), rel=0.03)


def test_verdict_names_the_weakest_joint(pendulum: tuple[Chain, Trajectory]) -> None:
    chain, trajectory = pendulum
    need = float(motor_table(chain, trajectory, BUILD).peak_torque_nm[0])
    rows = motor_table(chain, trajectory, BUILD)
    assert rows.would_do is None
    weak = motor_table(chain, trajectory, BUILD, motor_torque_nm=0.9 * need)
    assert weak.would_do is False
    assert weak.verdict.startswith(f"No: joint_1_z needs {need:.3g} N·m at frame ")
    strong = motor_table(chain, trajectory, BUILD, motor_torque_nm=1.1 * need)
    assert strong.would_do is True
    row = strong.as_dict()["joints"][0]
    assert row["margin"] == pytest.approx(1.1, rel=1e-4)
    lines = strong.as_csv().splitlines()
    assert len(lines) == 3
    assert lines[1].split(",")[0] == "joint_1_z"


def test_motors_out_of_range_are_refused(pendulum: tuple[Chain, Trajectory]) -> None:
    for wrong in (
        {"module_mass_kg": 0.0},
        {"module_mass_kg": np.nan},
        {"pitch_m": -1.0},
        {"gravity_m_s2": -9.81},
        {"held": False},
        *({"torque": torque} for torque in (0.0, -1.0, np.nan, np.inf)),
    ):
        values = {"module_mass_kg": MASS, "pitch_m": PITCH, **wrong}
        torque = values.pop("torque", None)
        with case(wrong), pytest.raises(InputError) as refused:
            motor_table(*pendulum, Build(**values), motor_torque_nm=torque)
        assert refused.value.code == "bad-build"
