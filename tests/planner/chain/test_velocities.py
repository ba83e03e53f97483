from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.simulation.model import Material
from planner.simulation.reduced import State
from planner.simulation.segments import Segments
from tests.planner.chains import line, random_state

STEP = 1e-6


def poses_after(chain: Chain, state: State, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    later = state.copy()
    later.advance(seconds)
    poses = chain.poses(later.angles, later.position, wxyz_from_matrix(later.rotation))
    return poses.positions, poses.rotations


@pytest.mark.parametrize("modules", [3, 4, 10, 25])
def test_velocities_are_the_derivatives_of_poses(modules: int) -> None:
    chain = line(modules)
    segments = Segments(chain, Material())
    state = random_state(chain, modules, most=1.5)
    segments.place(state)
    before, after = poses_after(chain, state, -STEP), poses_after(chain, state, STEP)
    np.testing.assert_allclose(
        segments.velocities, (after[0] - before[0]) / (2 * STEP), atol=1e-7 * modules
    )
    # dR/dt = [ω]× R
    rate = (after[1] - before[1]) / (2 * STEP)
    cross = np.einsum("nij,nkj->nik", rate, segments.rotations)
    spins = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1)
    np.testing.assert_allclose(segments.spins, spins, atol=1e-7 * modules)
