"""Plans of windows: all stages and exports preserve their content."""

import json
import shutil
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import mujoco
import numpy as np
import pytest

from foldback.planner.certificate.certificate import certify
from foldback.planner.certificate.figures_store import Curves, Figures
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError, TimelineError
from foldback.planner.explosion.strategies import ranked_strategies
from foldback.planner.exports.mjcf import keys_of, mjcf
from foldback.planner.exports.mjcf_pieces import MODULES_PER_TREE, starts_of
from foldback.planner.motion.motion import PHASES, Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import Timeline, TimelineWriter
from foldback.planner.parameters.parameters import Parameters, preset
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.stages import run_stage, run_stages
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.playback.playback import Playback
from foldback.planner.verification.replay import replay
from foldback.planner.verification.verify import verify
from tests.case import case
from tests.planner.chains import shuffled
from tests.planner.folds import write_request
from tests.planner.peels import peel, snake
from tests.refusal import refused

BOX = (4, 4, 4)


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Directory of a box that was peeled, with all its files."""
    place = tmp_path_factory.mktemp("peeled")
    settings = "simulated_modules=50"
    run_stages(write_request(place, write_chain(snake(BOX)), strategy="peel", settings=settings))
    complete(place)
    return place


@pytest.fixture(scope="module")
def plan(directory: FilePath) -> Plan:
    return Plan.load(directory / "plan.npz")


@pytest.mark.slow
def test_peeled_plan_is_verified_and_read_back(directory: FilePath, plan: Plan) -> None:
    assert plan.certificate.verdict == "verified (kinematics only)"
    assert plan.explosion is not None and plan.explosion["strategy"] == "peel"
    assert plan.playback is not None and plan.playback["kind"] == "kinematic"
    assert [attempt["strategy"] for attempt in plan.attempts] == ["peel"]
    ends = plan.part(0, 1), plan.part(len(plan.motion) - 1, len(plan.motion))
    np.testing.assert_array_equal(ends[0].joint_angles_rad, 0.0)
    np.testing.assert_allclose(ends[1].joint_angles_rad[0], plan.chain.folded_rad, atol=1e-7)
    keys = keys_of(plan)
    assert [key.name for key in keys] == ["at_0", "at_25", "at_50", "at_75", "at_100"]
    np.testing.assert_allclose(keys[-1].angles_rad, plan.chain.folded_rad, atol=1e-7)
    bent = [np.abs(key.angles_rad).sum() for key in keys]
    assert bent == sorted(bent)
    np.testing.assert_array_equal(plan.unfolding().folding_rad[0], 0.0)
    data = plan.as_dict()
    assert (data["format"], data["motion"]) == ("foldback-plan/3", "windows")
    assert "joint_angles_rad" not in data
    verification = verify(directory)
    assert verification.problems == ()
    assert verification.certificate.min_clearance == plan.certificate.min_clearance
    assert verification.replay is not None and verification.replay.overlap == 0.0
    assert verification.replay.frames == 2 * len(plan.time_s) - 1


def test_timeline_holds_the_windows_of_record_and_playback(directory: FilePath, plan: Plan) -> None:
    timeline = Timeline.open(directory / "timeline")
    assert timeline.windowed and timeline.status == "complete"
    assert timeline.chain.folded_rad.tolist() == plan.chain.folded_rad.tolist()
    windows = timeline.windows()
    record = windows[np.flatnonzero(windows.phase == PHASES.index("explosion"))]
    played = windows[np.flatnonzero(windows.phase == PHASES.index("playback"))]
    for name in ("first", "offsets", "angles_rad"):
        np.testing.assert_array_equal(getattr(played, name), getattr(plan.motion, name))
        np.testing.assert_array_equal(getattr(record[::-1], name), getattr(played, name))
    for start, stop, stride in (
        (0, 7, 1),
        (5, 31, 3),
        (len(windows) - 2, len(windows), 1),
        (4, 4, 1),
    ):
        part = timeline.windows(start, stop, stride)
        expected = windows[start:stop:stride]
        for name, values in part.columns().items():
            np.testing.assert_array_equal(values, expected.columns()[name])
        np.testing.assert_array_equal(
            timeline.frames(start, stop, stride).joint_angles_rad, expected.angles(plan.chain)
        )


def test_timeline_takes_one_layout_only(tmp_path: FilePath) -> None:
    chain = snake((3, 3, 3))
    moving = peel(chain, width=8, step=2.0)
    with TimelineWriter.create(tmp_path / "a", chain, windowed=True) as writer:
        writer.append(moving[:4])
        with pytest.raises(TimelineError, match="got a dense motion, expected a windowed motion"):
            writer.append(moving.dense(chain))
        with pytest.raises(TimelineError, match="got frames of"):
            writer.append(replace(moving, first=moving.first + len(chain.folded_rad)))
        writer.flush()
        writer.append(moving[4:])
    with TimelineWriter.create(tmp_path / "b", chain) as writer:
        with pytest.raises(TimelineError, match="got a windowed motion, expected a dense motion"):
            writer.append(moving)
        writer.append(moving.dense(chain))
    a, b = Timeline.open(tmp_path / "a"), Timeline.open(tmp_path / "b")
    np.testing.assert_array_equal(a.frames().joint_angles_rad, b.frames().joint_angles_rad)
    np.testing.assert_allclose(
        a.windows().angles(chain), b.windows().angles(chain), rtol=0, atol=1e-7
    )
    assert [t.motion().is_windowed for t in (a, b)] == [True, False]
    with TimelineWriter.reopen(tmp_path / "a", frames=5) as writer:
        writer.append(moving[9:])
    second_timeline = Timeline.open(tmp_path / "a")
    assert second_timeline.id != a.id
    expected = Motion.joined([moving[:5], moving[9:]])
    np.testing.assert_array_equal(second_timeline.windows().angles(chain), expected.angles(chain))


def test_plan_with_invalid_windows_is_refused(directory: FilePath, tmp_path: FilePath) -> None:
    data = Plan.load(directory / "plan.npz").as_dict()
    for change in (
        *({"first": [3]}, {"offsets": [0, 1]}, {"angles_rad": [0.0]}, {"angles_rad": None}),
        {"phase": ["straight"]},
    ):
        (tmp_path / "plan.json").write_text(json.dumps({**data, **change}))
        with case(change), refused("not-a-plan"):
            Plan.load(tmp_path / "plan.json")


def test_forged_window_is_found(directory: FilePath, plan: Plan, tmp_path: FilePath) -> None:
    place = tmp_path / "forged"
    shutil.copytree(directory, place)
    windows = plan.motion
    angles = windows.angles_rad.copy()
    middle = int(np.argmax(np.diff(windows.offsets)))
    part = slice(int(windows.offsets[middle]), int(windows.offsets[middle + 1]))
    angles[part] = np.tile([1.5, 0.0], len(angles))[: len(angles[part])]
    forged = replace(plan, motion=replace(windows, angles_rad=angles))
    forged.save_npz(place / "plan.npz")
    with pytest.raises(InputError, match="not the motion of plan.npz"):
        verify(place)
    xml = (directory / "model.xml").read_text()
    assert replay(forged, xml).overlap > 0.1


def test_certify_refuses_windows_that_are_not_finite_or_out_of_range(
    directory: FilePath, plan: Plan
) -> None:
    playback = Playback.load(directory / "playback.npz")
    for name, value, words in (
        ("time_s", -1.0, "earlier time"),
        ("base_position", np.nan, "infinite or undefined"),
        ("first", 10**6, "cannot be checked"),
        ("angles_rad", np.inf, "cannot be checked"),
    ):
        column = np.array(playback.frames.columns()[name])
        column[-1] = value
        spoilt = replace(playback, frames=playback.frames.with_columns(**{name: column}))
        verdict = certify(plan.chain, None, spoilt, Parameters()).verdict
        assert verdict.startswith("failed") and words in verdict


def test_curves_agree_with_the_certificate(directory: FilePath, plan: Plan) -> None:
    curves = Curves.load(directory / "figures")
    with pytest.raises(TimelineError):
        Figures.load(directory / "figures")
    record = Record.load(directory / "record.npz")
    assert len(curves) == len(record.frames) + len(plan.motion)
    minimum = float(curves.min_clearance.min())
    assert plan.certificate.min_clearance - 1e-6 <= minimum < 0.06
    start = len(record.frames)
    assert np.isnan(curves.peak_torque_nm[:start]).all()
    assert plan.certificate.peak_torque_nm == pytest.approx(
        float(curves.peak_torque_nm[start:].max()), rel=1e-4
    )
    assert curves.hinges_moving[start + 1 :].mean() == pytest.approx(
        plan.certificate.hinges_moving_mean, rel=0.03
    )


def test_model_of_a_long_chain_is_cut_into_connected_trees(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foldback.planner.exports.mjcf.MAX_TREE_MODULES", 64)
    chain = snake((5, 5, 10))
    model = mujoco.MjModel.from_xml_string(mjcf(chain, module_size=0.95))
    data = mujoco.MjData(model)
    starts = starts_of(chain)
    assert model.neq == len(starts) - 1 == -(-len(chain) // MODULES_PER_TREE) - 1 > 0
    names = {model.joint(i).name for i in range(model.njnt)}
    assert names == {*chain.joint_names, *(f"root_{start}" for start in starts)}
    folded = chain.folded_poses
    for name, angles, position in (
        ("folded", chain.folded_rad, folded.positions[chain.root]),
        ("straight", np.zeros_like(chain.folded_rad), folded.positions.mean(axis=0)),
    ):
        mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
        mujoco.mj_forward(model, data)
        poses = chain.poses(angles, position, folded.wxyzs[chain.root])
        sites = np.array([data.site(f"module_{i}").xpos for i in range(len(chain))])
        np.testing.assert_allclose(sites, poses.positions, atol=1e-9)
        for start in starts[1:]:
            ghost, body = data.body(f"ghost_{start}_body"), data.body(f"module_{start}_body")
            np.testing.assert_allclose(ghost.xpos, body.xpos, atol=1e-9)
            np.testing.assert_allclose(ghost.xmat, body.xmat, atol=1e-9)
        assert data.ncon == 0
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9


def ranked(chain: Chain, wish: str, name: str = "default", *, refolds: bool = False) -> Any:
    return ranked_strategies(chain, replace(preset(name), strategy=wish), refolds=refolds)


def test_strategies_by_chain_and_preset() -> None:
    small, large = snake((3, 3, 3)), snake((10, 10, 10))
    bent = Chain.from_angles(small.module, np.full(6, 0.3))
    assert ranked(small, "auto") == ("simultaneous", "peel")
    assert ranked(snake((6, 6, 6)), "auto") == ("simultaneous", "blocks", "peel")
    assert ranked(large, "auto") == ("peel", "simultaneous", "blocks")
    # Chains that cannot be peeled explode simultaneously if that is fast enough.
    assert ranked(shuffled((8, 9, 10), 20, 0), "auto")[0] == "simultaneous"
    assert ranked(small, "peel") == ("peel",)
    assert ranked(large, "simultaneous") == ("simultaneous",)
    assert ranked(large, "auto", "paper") == ranked(large, "auto", "direct") == ("simultaneous",)
    assert ranked(bent, "auto") == ("simultaneous",)
    assert ranked(small, "turns") == ("turns",)
    # A refold is one simulation from end to end.
    assert ranked(small, "auto", refolds=True) == ("simultaneous",)
    assert ranked(large, "auto", refolds=True) == ("simultaneous", "blocks")


def test_unsuitable_strategy_is_refused(tmp_path: FilePath) -> None:
    small = snake((3, 3, 3))
    bent = Chain.from_angles(small.module, np.full(6, 0.3))
    for chain, wish, name in (
        (small, "peel", "paper"),
        (small, "one-by-one", "direct"),
        (bent, "blocks", "default"),
        (bent, "one-by-one", "default"),
        (small, "fastest", "default"),
    ):
        with pytest.raises(InputError, match="strategy"):
            ranked(chain, wish, name)
    with pytest.raises(InputError, match="strategy"):
        ranked(small, "peel", refolds=True)
    # The error is raised when the input is read, before anything is computed.
    with pytest.raises(InputError, match="expected one of: auto, simultaneous"):
        run_stage("read", write_request(tmp_path, strategy="blocks", preset="paper"))
