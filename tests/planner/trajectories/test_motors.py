import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.trajectories.motors import Build, motor_requirements
from foldback.planner.trajectories.retiming import retimed
from foldback.planner.trajectories.trajectory import Trajectory
from tests.case import case
from tests.planner.chains import line
from tests.refusal import refused

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
    motors = motor_requirements(chain, trajectory, build)
    inertia = MASS * PITCH**2 * (1.0 + 1.0 / 6.0)  # a cube one edge from its hinge
    weight = MASS * gravity * PITCH
    assert motors.peak_torque_nm[0] == pytest.approx(2.0 * inertia + weight, rel=1e-6)
    # It accelerates for 0.5 s, then decelerates for as long, at constant rates.
    square = (2.0 * inertia + weight) ** 2 + (trajectory.duration_s - 1.0) * weight**2
    rms = np.sqrt(square / trajectory.duration_s)
    assert motors.rms_torque_nm[0] == pytest.approx(rms, rel=0.01)


def test_verdict_names_the_weakest_joint(pendulum: tuple[Chain, Trajectory]) -> None:
    chain, trajectory = pendulum
    need = float(motor_requirements(chain, trajectory, BUILD).peak_torque_nm[0])
    unnamed = motor_requirements(chain, trajectory, BUILD)
    assert unnamed.would_do is None
    weak = motor_requirements(chain, trajectory, BUILD, motor_torque_nm=0.9 * need)
    assert weak.would_do is False
    assert weak.text().startswith("No, a motor torque of ")
    assert f"joint_1_z needs the largest torque, {need:.3g} N·m at frame " in weak.text()
    strong = motor_requirements(chain, trajectory, BUILD, motor_torque_nm=1.1 * need)
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
        with case(wrong), refused("bad-build"):
            motor_requirements(*pendulum, Build(**values), motor_torque_nm=torque)
