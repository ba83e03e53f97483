import json
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any
from zlib import compress

import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.motion.angle_encoding import encode_frames, plan_columns
from foldback.planner.plan.plan import PLAN_FORMAT, Plan
from tests.case import case
from tests.planner.plans import with_values

ARRAYS = ("time_s", "joint_angles_rad", "root_position", "root_wxyz", "max_error_rad")


@pytest.fixture(scope="module")
def plan(folded: Any) -> Plan:
    return folded.plan


def test_plan_is_read_back_from_documented_fields(plan: Plan, tmp_path: FilePath) -> None:
    plan.save_json(tmp_path / "plan.json")
    plan.save_npz(tmp_path / "plan.npz")
    for loaded_plan in map(Plan.load, tmp_path.iterdir()):
        for name in ARRAYS:
            np.testing.assert_array_equal(
                getattr(loaded_plan, name), getattr(plan, name), strict=True
            )
        assert loaded_plan.certificate == plan.certificate
        assert loaded_plan.summary() == plan.summary()
        assert loaded_plan.parameters == json.loads(json.dumps(plan.parameters))
        np.testing.assert_array_equal(loaded_plan.chain.folded_rad, plan.chain.folded_rad)
    assert {path.name for path in tmp_path.iterdir()} == {"plan.json", "plan.npz"}
    values = json.loads(json.dumps(plan.as_dict(), allow_nan=False))
    assert values["format"] == PLAN_FORMAT
    assert {"python", "foldback", "mujoco", "numpy"} <= set(values["versions"])
    with np.load(tmp_path / "plan.npz", allow_pickle=False) as arrays:
        assert {*ARRAYS, "plan", "phase", "joint_names"} == set(arrays.files)
        assert all(arrays[name].dtype != object for name in arrays.files)
    # Only angles in whole steps are marked as such.
    assert plan.rest()["angles"] is not None
    moved = with_values(plan, joint_angles_rad=plan.joint_angles_rad + 1e-9)
    assert moved.rest()["angles"] is None


def test_invalid_plan_is_refused(plan: Plan, tmp_path: FilePath) -> None:
    path, plan_values = tmp_path / "plan.json", plan.as_dict()
    changes: tuple[tuple[str, Callable[[Any], Any] | None], ...] = (
        ("format", lambda _: "foldback-plan/99"),
        ("certificate", None),
        ("certificate", lambda data: {**data, "beauty": 1}),
        ("joint_angles_rad", lambda rows: [row[:-1] for row in rows]),
        ("time_s", lambda times: [*times[:3], "soon", *times[4:]]),
        ("time_s", lambda times: times[:-1]),
        ("chain", lambda data: {**data, "module": "sphere"}),
        ("motion", lambda _: "jumps"),
    )
    for number, (at, change) in enumerate(changes):
        changed_values = dict(plan_values)
        value = changed_values.pop(at)
        path.write_text(
            json.dumps({**changed_values, at: change(value)} if change else changed_values)
        )
        with case(number), pytest.raises(InputError, match=path.name):
            Plan.load(path)


def test_plan_of_another_format_is_refused_with_both_formats_named() -> None:
    with pytest.raises(InputError) as refused:
        Plan.of_values({"format": "foldback-plan/4"}, "plan.npz")
    assert refused.value.code == "wrong-format"
    for text in ("'foldback-plan/4' in plan.npz", f"expected {PLAN_FORMAT!r}", "version"):
        assert text in refused.value.detail


def test_plan_with_angles_in_two_forms_is_refused(plan: Plan, tmp_path: FilePath) -> None:
    """Readers of one form would see another motion than readers of the other."""
    planes = encode_frames(plan.joint_angles_rad)
    assert planes is not None
    values = plan.as_dict()
    values["angles"]["data"] = b64encode(compress(planes.tobytes())).decode()
    (tmp_path / "plan.json").write_text(json.dumps(values))
    np.savez(tmp_path / "plan.npz", **plan.npz_arrays(), angle_planes=planes)
    for path in tmp_path.iterdir():
        with pytest.raises(InputError, match="got the angles twice"):
            Plan.load(path)
    with pytest.raises(ValueError, match="got the angles twice"):
        plan_columns(tmp_path / "plan.npz", plan.chain.folded_rad)


@pytest.mark.parametrize("suffix", ["json", "npz"])
def test_damaged_files_are_refused(plan: Plan, suffix: str, tmp_path: FilePath) -> None:
    path = tmp_path / f"plan.{suffix}"
    plan.save_json(path) if suffix == "json" else plan.save_npz(path)
    stored_bytes = path.read_bytes()
    middle = len(stored_bytes) // 2
    spoilt = stored_bytes[:600] + b"\x00" * 64 + stored_bytes[664:]
    for data in (b"", b"\x00" * 50, stored_bytes[:middle], spoilt, b"[" * 100_000, b"[{}]"):
        path.write_bytes(data)
        with pytest.raises(InputError, match=path.name):
            Plan.load(path)
    with pytest.raises(InputError, match="not-there"):
        Plan.load(tmp_path / f"not-there.{suffix}")
