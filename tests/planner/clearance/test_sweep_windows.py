"""Sweeps of windows agree with those of dense frames, even with swinging tails."""

from dataclasses import replace

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.sweep import pair_clearance, sweep
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from tests.planner.chains import chain_of
from tests.planner.peels import peel, snake, windows_of


@pytest.mark.parametrize("size", [0.9, 0.98])
def test_sweep_of_peeled_windows_agrees_with_frames(size: float) -> None:
    chain = snake((4, 4, 5))
    windows = peel(chain, width=21, step=1.7)
    swept = sweep(chain, windows, module_size=size)
    dense = sweep(chain, windows.angles(chain), module_size=size)
    np.testing.assert_allclose(swept.per_frame, dense.per_frame, atol=1e-9)
    assert swept.clearance == pytest.approx(dense.clearance, abs=1e-6)
    assert swept.bound > 0.0 and dense.bound > 0.0
    assert swept.modules is not None


def swinging_rod(rod: int, *, post: bool) -> tuple[Chain, Motion, int]:
    """Return a rod that swings over a beam in two clear frames, and the hinge; a post may be in its
    way.
    """
    beam = [(x, 0, -1) for x in range(7, -2, -1)]
    cells = [*([(7, 0, 0)] if post else []), *beam, (-1, 0, 0), (0, 0, 0)]
    hinge = 2 * (len(cells) - 2)
    cells += [(0, y, 0) for y in range(1, rod + 1)]
    chain = chain_of(cells)
    turned = chain.folded_rad[hinge : hinge + 2]
    about = hinge + int(np.argmax(np.abs(turned)))
    angles = [np.array([-1.4]), np.array([1.1])]
    return chain, windows_of(chain, [about, about], angles), about


def test_rod_through_a_post_between_two_frames_is_found() -> None:
    chain, windows, _ = swinging_rod(3000, post=True)
    assert sweep(chain, windows, module_size=0.95).clearance < 0.0
    chain, windows, about = swinging_rod(40, post=True)
    angles = windows.angles(chain)
    assert np.ptp(angles[:, about]) > 2.4
    swept = sweep(chain, windows, module_size=0.95)
    assert min(swept.per_frame) > 0.04
    assert swept.clearance < 0.0
    assert swept.bound <= 0.0
    assert swept.modules is not None and swept.modules[0] == 0 and swept.modules[1] > about // 2
    poses = forward_kinematics(
        chain.module, (1.0 - swept.frame) * angles[0] + swept.frame * angles[1]
    )
    clearance = pair_clearance(chain.module, poses, swept.modules, module_size=0.95)
    assert clearance == pytest.approx(swept.clearance, abs=1e-9)


@pytest.mark.parametrize("rod", [40, 3000])
def test_rod_that_swings_clear_is_proved_clear(rod: int) -> None:
    chain, windows, _ = swinging_rod(rod, post=False)
    swept = sweep(chain, windows, module_size=0.95)
    assert swept.clearance == pytest.approx(0.05, abs=1e-6)
    assert 0.0 < swept.bound <= swept.clearance
    # Regardless of the rod's length, its distant modules are far from others: no bisections.
    assert swept.in_betweens < 5000


def test_windows_of_another_chain_are_refused() -> None:
    chain = snake((3, 3, 3))
    windows = peel(chain, width=9, step=3.0)
    lost = windows.angles_rad.copy()
    lost[4] = np.nan
    for wrong in (
        replace(windows, first=windows.first + 1),
        replace(windows, first=windows.first - 1),
        replace(windows, offsets=windows.offsets[:-1]),
        replace(windows, offsets=windows.offsets + 1),
        replace(windows, angles_rad=lost),
    ):
        with pytest.raises(InputError, match="windows|finite"):
            sweep(chain, wrong, module_size=0.9)
