"""Windows are swept like frames of all angles, and rods that swing too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.kinematics import forward_kinematics
from planner.chain.module import TETRAHEDRON
from planner.chain.path import Path
from planner.clearance.margins import largest_size
from planner.clearance.sweep import CLEARANCE_CAP, sweep
from planner.errors import InputError
from planner.kernels.clearance import pair_separation
from planner.motion.motion import Motion
from tests.planner.chains import coil
from tests.planner.peels import peel, snake, windows_of

Array = NDArray[np.float64]


def brute(chain: Chain, angles: Array, size: float) -> float:
    """The clearance of one configuration: every pair, nothing left out."""
    module = chain.module
    poses = forward_kinematics(module, angles)
    found = CLEARANCE_CAP
    for i in range(len(chain)):
        for j in range(i + module.apart, len(chain)):
            gap = poses.positions[j] - poses.positions[i]
            turns = (poses.rotations[i], poses.rotations[j])
            if np.linalg.norm(gap) - 2.0 * module.radius * size < found:
                found = min(found, pair_separation(gap, *turns, module.hull, size, found))
    return found


def test_largest_size_of_windows_is_that_of_their_frames() -> None:
    chain = snake((2, 2, 3))
    windows = peel(chain, width=21, step=1.7)
    motions = (windows, windows.angles(chain))
    of_windows, of_frames = (largest_size(chain, (m,), clear_at=0.9) for m in motions)
    assert 0.9 < of_windows < 1.0
    assert of_windows == pytest.approx(of_frames, abs=0.005)


@pytest.mark.parametrize("size", [0.9, 0.98])
def test_sweep_of_peeled_windows_agrees_with_frames(size: float) -> None:
    chain = snake((4, 4, 5))
    windows = peel(chain, width=21, step=1.7)
    found = sweep(chain, windows, size=size)
    dense = sweep(chain, windows.angles(chain), size=size)
    np.testing.assert_allclose(found.per_frame, dense.per_frame, atol=1e-9)
    assert found.clearance == pytest.approx(dense.clearance, abs=1e-6)
    assert found.bound > 0.0 and dense.bound > 0.0
    assert found.modules is not None


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.3, 1.5]), st.sampled_from([True, False]))
def test_sweep_of_random_windows_agrees_with_frames(seed: int, step: float, tetra: bool) -> None:
    chain = snail() if tetra else coil(16)
    rng = np.random.default_rng(seed)
    count = len(chain.folded_rad)
    first = rng.integers(0, count + 1, 2)
    last = [int(rng.integers(a, count + 1)) for a in first]
    begun = rng.uniform(-1.5, 1.5, count)
    ended = np.clip(begun + rng.uniform(-step, step, count), -1.6, 1.6)
    windows = windows_of(
        chain,
        [int(a) for a in first],
        [begun[first[0] : last[0]], ended[first[1] : last[1]]],
    )
    size = 0.9
    angles = windows.angles(chain)
    alone = np.array([brute(chain, row, size) for row in angles])
    between = min(
        brute(chain, (1 - s) * angles[0] + s * angles[1], size) for s in np.linspace(0, 1, 13)
    )
    for found in (sweep(chain, windows, size=size), sweep(chain, angles, size=size)):
        np.testing.assert_allclose(np.minimum(found.per_frame, CLEARANCE_CAP), alone, atol=1e-9)
        if between < -1e-6:
            assert found.clearance < 0.0 or found.bound <= 0.0
        if found.clearance >= 0.0:
            assert found.bound <= between + 1e-9
        if found.modules is not None and found.clearance < CLEARANCE_CAP:
            at = (1.0 - found.frame) * angles[0] + found.frame * angles[1]
            assert brute(chain, at, size) == pytest.approx(found.clearance, abs=1e-9)


def snail() -> Chain:
    """Tetrahedra; whether they lie in one another when folded does not matter here."""
    rng = np.random.default_rng(5)
    return Chain(
        name="snail",
        module=TETRAHEDRON,
        folded_rad=rng.choice([-np.pi / 2, 0.0, np.pi / 2], 12),
        folded_position=np.zeros(3),
        folded_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
    )


def swinging(rod: int, *, post: bool) -> tuple[Chain, Motion, int]:
    """A rod that swings over a beam in two frames; with a post in its way, clear in both.

    Also the hinge it swings about.
    """
    beam = [(x, 0, -1) for x in range(7, -2, -1)]
    cells = [*([(7, 0, 0)] if post else []), *beam, (-1, 0, 0), (0, 0, 0)]
    hinge = 2 * (len(cells) - 2)
    cells += [(0, y, 0) for y in range(1, rod + 1)]
    chain = Chain.from_path(Path.from_cells(cells, name="swing"))
    turned = chain.folded_rad[hinge : hinge + 2]
    about = hinge + int(np.argmax(np.abs(turned)))
    angles = [np.array([-1.4]), np.array([1.1])]
    return chain, windows_of(chain, [about, about], angles), about


def test_rod_through_a_post_between_two_frames_is_found() -> None:
    chain, windows, _ = swinging(3000, post=True)
    assert sweep(chain, windows, size=0.95).clearance < 0.0
    chain, windows, about = swinging(40, post=True)
    angles = windows.angles(chain)
    assert np.ptp(angles[:, about]) > 2.4
    found = sweep(chain, windows, size=0.95)
    assert min(found.per_frame) > 0.04
    assert found.clearance < 0.0
    assert found.bound <= 0.0
    assert found.modules is not None and found.modules[0] == 0 and found.modules[1] > about // 2
    at = (1.0 - found.frame) * angles[0] + found.frame * angles[1]
    assert brute(chain, at, 0.95) == pytest.approx(found.clearance, abs=1e-9)


@pytest.mark.parametrize("rod", [40, 3000])
def test_rod_that_swings_clear_is_proved_clear(rod: int) -> None:
    chain, windows, _ = swinging(rod, post=False)
    found = sweep(chain, windows, size=0.95)
    assert found.clearance == pytest.approx(0.05, abs=1e-6)
    assert 0.0 < found.bound <= found.clearance
    # As long as it is, its far modules are near nothing and are not halved for.
    assert found.in_betweens < 5000


def test_closest_modules_may_be_at_rest() -> None:
    chain = coil(20)
    count = len(chain.folded_rad)
    # Only the last module turns away, by a little, and back.
    ends = [chain.folded_rad[-2:] * share for share in (1.0, 0.9, 1.0)]
    found = sweep(chain, windows_of(chain, [count - 2] * 3, ends), size=0.9)
    np.testing.assert_allclose(found.per_frame[[0, 2]], 0.1, atol=1e-6)
    assert found.clearance <= 0.1 + 1e-9
    folded = sweep(chain, windows_of(chain, [count], [np.zeros(0)]), size=0.9)
    assert folded.clearance == pytest.approx(0.1, abs=1e-12)
    assert folded.modules is not None and folded.modules[1] - folded.modules[0] >= 2


def test_cancelled_sweep_of_windows_covers_nothing_more() -> None:
    chain = snake((3, 3, 3))
    found = sweep(chain, peel(chain, width=9, step=3.0), size=1.2, cancelled=lambda: True)
    assert found.in_betweens == 0
    assert found.clearance == CLEARANCE_CAP


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
            sweep(chain, wrong, size=0.9)
