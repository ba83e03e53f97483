import io
import json
from base64 import b64decode
from pathlib import Path as FilePath
from typing import Any
from zlib import decompress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from numpy.typing import NDArray

from foldback.planner.motion.angle_encoding import (
    PLAN_STEP_RAD,
    decode_frames,
    decode_windows,
    encode_frames,
    encode_windows,
    packed_frames,
    plan_columns,
    plane_metadata,
    quantised,
    to_step_counts,
    unpacked_bytes,
    unpacked_frames,
)
from foldback.planner.motion.motion import Motion
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.plan.plan import Plan
from tests.planner.chains import anchored, line
from tests.planner.plans import unverified

ANGLES = st.floats(-1.6, 1.6)
SHAPES = st.tuples(st.integers(1, 9), st.integers(1, 5))
FRAMES = arrays_of.arrays(np.float64, SHAPES, elements=ANGLES)
SPANS = st.tuples(st.integers(0, 4), st.integers(0, 4)).map(sorted)


@given(FRAMES)
def test_angles_are_read_as_they_were_written(angles: NDArray[np.float64]) -> None:
    near = quantised(angles)
    assert np.abs(near - angles).max() <= PLAN_STEP_RAD / 2 * (1 + 1e-9)
    planes = encode_frames(near)
    assert planes is not None
    second_frames = decode_frames(planes, plane_metadata(near.shape, windowed=False))
    assert second_frames.tobytes() == near.tobytes(), "a claim's digest is that of the bytes"
    single = near.astype(np.float32)
    steps = to_step_counts(single)
    np.testing.assert_array_equal((steps * PLAN_STEP_RAD).astype(np.float32), single)


def test_angles_not_in_whole_steps_are_not_rounded() -> None:
    for spoilt in (1e-7, np.nan, np.inf, 8.0):
        assert encode_frames(np.array([[0.0, spoilt]])) is None
    angles = np.random.default_rng(0).normal(size=(600, 500))
    assert packed_frames("a", angles) == {"a": angles}
    angles = large_plan(windowed=False).joint_angles_rad
    packed = packed_frames("reference_rad", angles)
    assert set(packed) == {"reference_rad_planes", "reference_rad_told"}
    np.testing.assert_array_equal(unpacked_frames(packed, "reference_rad"), angles)


def test_no_angle_is_beyond_its_limit() -> None:
    limit = 100.3 * PLAN_STEP_RAD
    np.testing.assert_array_equal(
        quantised(np.array([1.0, -1.0, np.nan]), np.array([-limit, limit])) / PLAN_STEP_RAD,
        [100.0, -100.0, np.nan],
    )


@given(st.data())
def test_windows_are_read_as_they_were_written(data: st.DataObject) -> None:
    folded = np.array([np.pi / 2, 0.0, -np.pi / 2, np.pi / 2])
    spans = data.draw(st.lists(SPANS, min_size=1, max_size=8))
    first = np.array([low for low, _ in spans])
    offsets = np.concatenate([[0], np.cumsum([high - low for low, high in spans])])
    drawn = data.draw(arrays_of.arrays(np.float64, int(offsets[-1]), elements=ANGLES))
    angles = quantised(drawn).astype(np.float32)
    planes = encode_windows(first, offsets, angles, folded)
    assert planes is not None
    meta = plane_metadata(angles.shape, windowed=True)
    second_windows = decode_windows(planes, meta, first, offsets, folded)
    assert second_windows.tobytes() == angles.tobytes()


def large_plan(*, windowed: bool) -> Plan:
    """Return a plan with too many angles for plain numbers: waves on a chain of 200 cubes."""
    chain = line(200)
    rows, hinges = np.ogrid[:800, : len(chain.folded_rad)]
    rng = np.random.default_rng(0)
    frames = anchored("playback", quantised(np.sin(rows / 50.0 + hinges)))
    frames = frames.with_columns(root_position=rng.normal(size=(800, 3)))
    return unverified(chain, frames.windowed(chain) if windowed else frames, Parameters())


@pytest.mark.parametrize("windowed", [False, True])
@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_large_plan_is_read_back_exactly(windowed: bool, suffix: str, tmp_path: FilePath) -> None:
    plan = large_plan(windowed=windowed)
    path = tmp_path / f"plan.{suffix}"
    plan.save_json(path) if suffix == "json" else plan.save_npz(path)
    assert path.stat().st_size < 4 * 800 * 396  # plain text needs some eighty bytes per hinge
    second_plan = Plan.load(path)
    columns = second_plan.motion.columns()
    for name, own_column in plan.motion.columns().items():
        np.testing.assert_array_equal(columns[name], own_column, err_msg=name)
    if suffix == "npz":
        assert unpacked_bytes(path) > 8 * 800 * 396
        read = Motion.from_angles(**plan_columns(path, plan.chain.folded_rad))
        assert read.layout == plan.motion.layout
        np.testing.assert_array_equal(read.angles_rad, plan.motion.angles_rad)


def test_documented_recipe_reads_both_forms_with_numpy_alone() -> None:
    """The recipe is that of docs/robot.md."""
    plan = large_plan(windowed=False)

    def angles_of(meta: dict[str, Any], planes: NDArray[np.uint8]) -> NDArray[np.float64]:
        codes = np.ascontiguousarray(planes.T).view("<u4").astype("i8")
        steps = ((codes >> 1) ^ -(codes & 1)).reshape(meta["shape"])
        for _ in range(meta["differences"]):
            steps = steps.cumsum(axis=0)
        return steps * meta["step_rad"]

    file = io.BytesIO()
    np.savez_compressed(file, **plan.npz_arrays())
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        meta = json.loads(str(arrays["plan"]))["angles"]
        np.testing.assert_array_equal(
            angles_of(meta, arrays["angle_planes"]), plan.joint_angles_rad
        )
    meta = json.loads(plan.json_bytes())["angles"]
    planes = np.frombuffer(decompress(b64decode(meta["data"])), np.uint8).reshape(4, -1)
    np.testing.assert_array_equal(angles_of(meta, planes), plan.joint_angles_rad)
