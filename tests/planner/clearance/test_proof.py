"""Compiled proof of clearance, compared with its plain reference: decision 0012."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON, module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_file import with_pattern
from foldback.planner.clearance.sweep import CLEARANCE_CAP, EXTENDED_CLEARANCE_CAP, sweep
from foldback.planner.motion.motion import Motion, as_motion
from tests.conftest import examples
from tests.planner.chains import Array, coil, line, unvalidated
from tests.planner.clearance.reference import Interval, prove
from tests.planner.peels import windows_of

TOLERANCE = 1e-9
"""Maximum difference of two bounds due to rounding, in pitches. Measured: 4e-13."""


def _unit(vectors: Array) -> Array:
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    unit.flags.writeable = False  # as in all modules: otherwise the kernels are compiled again
    return unit


_RNG = np.random.default_rng(0)
_PIECE = TETRAHEDRON.pieces[0]
_PART = replace(
    _PIECE.parts[0],
    face_normals=_unit(_PIECE.parts[0].face_normals + _RNG.normal(0.0, 0.01, (4, 3))),
    edge_directions=_unit(_PIECE.parts[0].edge_directions + _RNG.normal(0.0, 0.01, (6, 3))),
)
SKEWED = replace(TETRAHEDRON, pieces=(replace(_PIECE, parts=(_PART,)),))
"""Tetrahedra with slightly rotated candidate axes. Linked tetrahedra are mirror images: two axes
have the same separation, rounding selects one of them, and the loss depends on it."""
TWISTED = with_pattern(module_named("snake-cube"), ["straight", "corner", "corner", "straight"])
"""Cubes whose joints follow each other in a pattern: twists through opposite or adjacent faces."""
MODULES = st.sampled_from([CUBE, SKEWED, TWISTED])
SEEDS = st.integers(0, 2**32 - 1)
STEPS_RAD = st.sampled_from([0.05, 0.3, 1.5])


def random_chain(module: Module, modules: int, rng: np.random.Generator) -> Chain:
    """Return a chain with a random folded configuration, which may overlap."""
    return unvalidated(module, rng.normal(0.0, 0.4, len(module.joint_names(modules))))


def reference(
    chain: Chain, motion: Array | Motion, size: float, *, cutoff: float
) -> tuple[float, float | None]:
    """Return the result of the reference for a motion."""
    motion = as_motion(motion)
    angles = motion.angles(chain)
    intervals: list[Interval] = []
    for k, start in enumerate(angles):
        end = angles[min(k + 1, len(angles) - 1)]
        if motion.is_windowed:
            low, high = moving_modules(chain, motion, k)
            ends = (low, low, high)
        else:
            ends = (chain.root, 0, len(chain) - 1)
        intervals.append(Interval(chain, size, start, end - start, *ends))
    return prove(intervals, cutoff)


def moving_modules(chain: Chain, windows: Motion, k: int) -> tuple[int, int]:
    """Return the first and last module that move relative to others from window k to the next."""
    hinges, rigid = chain.module.hinges_per_joint, chain.module.rigid_links
    first = int(windows.first[k : k + 2].min())
    last = max(int(windows.last[k : k + 2].max()), first + (first % hinges > 0))
    low = first // hinges + rigid
    return low, (last - 1) // hinges + rigid + 1 if last > first else low


def assert_same(chain: Chain, motion: Array | Motion, size: float, *, within: float = 0.0) -> bool:
    """Check that both prove the motion, with bounds in this ratio, or refuse it; True if proved."""
    swept = sweep(chain, motion, module_size=size)
    cutoff = (
        EXTENDED_CLEARANCE_CAP
        if swept.modules is None or swept.clearance >= CLEARANCE_CAP
        else CLEARANCE_CAP
    )
    clearance, bound = reference(chain, motion, size, cutoff=cutoff)
    assert (swept.bound > 0.0) == (bound is not None)
    if bound is None:
        return False
    assert swept.clearance == pytest.approx(clearance, abs=TOLERANCE)
    assert swept.bound == pytest.approx(bound, abs=TOLERANCE, rel=within)
    return True


@pytest.mark.slow
@examples(one_of=6)
@given(MODULES, st.integers(4, 8), SEEDS, STEPS_RAD, st.floats(0.5, 0.95))
def test_frames_have_the_bound_of_the_reference(
    module: Module, modules: int, seed: int, step: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(module, modules, rng)
    frames = rng.normal(0.0, 0.5, (1, len(chain.folded_rad)))
    steps = rng.uniform(-step, step, (2, len(chain.folded_rad)))
    assert_same(chain, np.cumsum(np.concatenate([frames, steps]), axis=0), size)


@pytest.mark.slow
@examples(one_of=6)
@given(st.sampled_from([CUBE, SKEWED]), st.integers(6, 10), SEEDS, STEPS_RAD, st.floats(0.4, 0.9))
def test_windows_have_the_bound_of_the_reference(
    module: Module, modules: int, seed: int, step: float, size: float
) -> None:
    rng = np.random.default_rng(seed)
    chain = random_chain(module, modules, rng)
    hinges = len(chain.folded_rad)
    first = rng.integers(0, hinges + 1, 2)
    last = [int(rng.integers(first_hinge, hinges + 1)) for first_hinge in first]
    start = chain.folded_rad + rng.uniform(-0.3, 0.3, hinges)
    angles = [start, start + rng.uniform(-step, step, hinges)]
    parts = [row[a:b] for row, a, b in zip(angles, first, last, strict=True)]
    assert_same(chain, windows_of(chain, [int(first_hinge) for first_hinge in first], parts), size)


def test_windows_of_a_pattern_have_the_bound_of_all_its_hinges() -> None:
    rng = np.random.default_rng(3)
    chain = random_chain(TWISTED, 9, rng)
    angles = [0.9 * chain.folded_rad[2:5], 0.8 * chain.folded_rad[2:5]]
    windows = windows_of(chain, [2, 2], angles)
    swept = sweep(chain, windows, module_size=0.5)
    whole = sweep(chain, windows.angles(chain), module_size=0.5)
    assert (swept.clearance, swept.bound) == (whole.clearance, whole.bound)
    assert_same(chain, windows.angles(chain), 0.5)


@pytest.mark.parametrize("module", [CUBE, SKEWED], ids=["cube", "skewed"])
def test_most_random_motions_are_proved_and_some_refused(module: Module) -> None:
    verdicts: list[bool] = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        chain = random_chain(module, 5, rng)
        start = rng.normal(0.0, 0.6, len(chain.folded_rad))
        motion = np.stack([start, start + rng.uniform(-1.5, 1.5, len(start))])
        verdicts.append(assert_same(chain, motion, 0.8))
    assert True in verdicts and False in verdicts


def test_real_tetrahedra_have_nearly_the_bound_of_the_reference() -> None:
    rng = np.random.default_rng(1)
    for _ in range(3):
        chain = random_chain(TETRAHEDRON, 8, rng)
        assert_same(chain, np.stack([chain.folded_rad, 0.9 * chain.folded_rad]), 0.8, within=0.1)


def test_sliding_modules_are_refused_by_both() -> None:
    chain = coil(8)
    motion = np.stack([chain.folded_rad, 0.99 * chain.folded_rad])
    assert sweep(chain, motion, module_size=0.95).bound > 0.0
    assert not assert_same(chain, motion, 1.0)


def test_chain_that_swings_has_the_bound_of_the_reference() -> None:
    # The ends move by more than a pitch: blocks of modules are compared, and then their modules.
    chain = line(40)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        start = rng.normal(0.0, 0.25, len(chain.folded_rad))
        motion = np.stack([start, start + rng.normal(0.0, 0.1, len(start))])
        assert assert_same(chain, motion, 0.95)


def test_motion_too_large_to_bound_is_refused_by_both() -> None:
    chain = line(80)
    rng = np.random.default_rng(0)
    turns = rng.uniform(-4e4, 4e4, len(chain.folded_rad))
    assert sweep(chain, np.stack([0.0 * turns, turns]), module_size=0.3).unbounded is not None
    assert not assert_same(chain, np.stack([0.0 * turns, turns]), 0.3)
