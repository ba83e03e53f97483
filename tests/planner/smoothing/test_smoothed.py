"""Smoothed plans, made from verified ones: shorter, quieter, certified again."""

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.fold import smooth_plan
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.smoothing import SMOOTHED
from foldback.planner.smoothing.smoothed_plan import check_smoothable
from foldback.planner.verification.verify import verify
from tests.planner.conftest import Folded
from tests.planner.plans import with_values
from tests.refusal import refused

pytestmark = pytest.mark.slow
SIZE = 0.97
"""Module size for which a plan is smoothed, pitches; the plan was made for 0.95."""


def test_smoothed_plan_is_verified_and_better(folded: Folded, tmp_path: FilePath) -> None:
    folder = tmp_path / "smoothed"
    smooth_plan(folded.plan, directory=folder, module_size=SIZE)
    plan = Plan.load(folder / "plan.npz")
    assert plan.verified
    before, after = plan.smoothing["before"], plan.smoothing["after"]
    assert plan.smoothing["way"] == SMOOTHED
    assert plan.smoothing["seconds"] == folded.plan.certificate.fold_time_s
    for name, maximum in (
        ("frames", 0.9),
        ("fold_time_s", 0.8),
        ("length_rad", 0.8),
        ("peak_speed_rad_s", 0.8),
        ("peak_torque_nm", 1.0),
        ("travel_ratio", 0.95),
        ("reversals_mean", 0.7),
    ):
        assert after[name] <= maximum * before[name], name
    # The same figures as those of the certificates.
    for moment, certificate in ((before, folded.plan.certificate), (after, plan.certificate)):
        assert moment["travel_ratio"] == certificate.travel_ratio
        assert moment["reversals_mean"] == certificate.reversals_mean
    # Clearances are compared at one module size.
    frames = folded.plan.joint_angles_rad
    assert before["clearance"] == pytest.approx(
        sweep(folded.chain, frames, module_size=SIZE).clearance
    )
    assert 0.005 < before["clearance"] < folded.plan.certificate.min_clearance
    assert after["clearance"] > 0.005
    assert after["frames"] == len(plan.time_s)
    assert before["frames"] == len(folded.plan.time_s)
    assert np.abs(plan.joint_angles_rad[0]).max() < 1e-9
    np.testing.assert_allclose(plan.joint_angles_rad[-1], folded.chain.folded_rad, atol=1e-9)
    assert verify(folder).verified
    assert (Timeline.open(folder / "timeline").motion().phase == 1).all()
    assert Plan.load(folder / "plan.npz").smoothing == plan.smoothing
    assert plan.summary()["smoothing"] == plan.smoothing
    assert folded.plan.smoothing is folded.plan.summary()["smoothing"] is None


def test_cancelled_smoothing_fails(folded: Folded, tmp_path: FilePath) -> None:
    request = FoldRequest.smoothing(folded.plan, seed=0, module_size=None)
    data = write_chain(folded.plan.chain)
    Workspace(tmp_path).write_request(request, data, recorded=folded.plan)
    summary = run_stages(tmp_path, cancelled=lambda: True)
    assert summary["status"] == "failed"
    assert summary["smoothing"]["after"] is None


def test_unsuitable_plans_are_not_smoothed(folded: Folded, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, certificate = folded.plan, folded.plan.certificate
    unsuitable = {
        "smooth-not-verified": replace(certificate, reason=Reason.of(ReasonCode.PLAN_END)),
        "smooth-no-motion": replace(certificate, fold_time_s=0.0),
        "smooth-no-torques": replace(certificate, peak_torque_nm=None),
    }
    plans = {code: with_values(plan, certificate=second) for code, second in unsuitable.items()}
    monkeypatch.setattr("foldback.planner.smoothing.smoothed_plan.MAX_SMOOTHED_ANGLES", 1000)
    extra = {"smooth-refold": with_values(plan, start=folded.chain), "smooth-too-long": plan}
    for code, second in {**plans, **extra}.items():
        with refused(code):
            check_smoothable(second)
    for wish in ({"preset": "paper"}, {"strategy": "peel"}):
        with pytest.raises(InputError, match="runs no new explosion") as error:
            FoldRequest(smooth=True, **wish).check()  # pyright: ignore[reportArgumentType]
        assert error.value.where == next(iter(wish))
