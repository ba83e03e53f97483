from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.playback.controllers import ComputedTorque, Servo
from planner.playback.setpoints import Target
from planner.simulation.model import Material
from planner.simulation.tree import Servos, Tree
from tests.planner.chains import line

Array = NDArray[np.float64]
CHAIN = line(7)
JOINTS = len(CHAIN.folded_rad)
KP, KV = 1e4, 1e3


def held(angles: Array) -> Target:
    zero = np.zeros(JOINTS)
    return Target(angles=angles, rates=zero, accelerations=zero, fraction=1.0)


def placed(step_s: float, motors: Servos | None = None) -> Tree:
    tree = Tree(CHAIN, Material(geom_size=0.3), step_s=step_s, motors=motors)
    tree.place(np.zeros(JOINTS), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return tree


@pytest.mark.parametrize("bandwidth", [1.0, 5.0])
def test_computed_torque_damps_errors_critically(bandwidth: float) -> None:
    # ë + 2w ė + w² e = 0 from rest: e = e₀ (1 + w t) exp(−w t), whatever the chain.
    tree = placed(2e-4)
    target = held(np.linspace(-0.2, 0.3, JOINTS))
    controller = ComputedTorque(bandwidth=bandwidth, encoder_rad=0.0)
    steps = 2000
    for _ in range(steps):
        tree.begin_step()
        controller.drive(tree, target)
        tree.end_step()
    wt = bandwidth * steps * 2e-4
    left = target.angles * (1.0 + wt) * np.exp(-wt)
    np.testing.assert_allclose(target.angles - tree.angles, left, atol=2e-3)


def test_published_servo_pulls_to_the_target_only() -> None:
    tree = placed(1e-4, Servos(stiffness=KP, damping=KV))
    angles = np.linspace(-0.01, 0.02, JOINTS)
    zero = np.zeros(JOINTS)
    target = Target(angles=angles, rates=zero + 5.0, accelerations=zero + 9.0, fraction=0.5)
    tree.begin_step()
    Servo().drive(tree, target)
    tree.end_step()
    np.testing.assert_allclose(tree.motor_torques, KP * angles, atol=1e-9)
