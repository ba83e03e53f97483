"""Joint errors: sampled sizes and errors hold for other robots, and are not much too small."""

from dataclasses import replace

import numpy as np
import pytest

from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.clearance.joint_errors import JointErrors, confidence, joint_errors
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.pipeline.fold import fold
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.plan.plan import Plan
from foldback.planner.verification.certificate_figures import ReportedFigures
from tests.planner.chains import COIL, Array
from tests.planner.clearance.reference import separation

ERROR_RAD = np.radians(0.3)
OTHER_ROBOTS = 100


@pytest.fixture(scope="module")
def plan() -> Plan:
    return fold(COIL, joint_error="0.3deg", settings="robots=0")


def _errors(plan: Plan) -> JointErrors:
    errors = plan.certificate.joint_errors
    assert errors is not None
    return errors


def _found(plan: Plan, error_rad: float | None = None) -> JointErrors:
    size = plan.certificate.module_size
    clearances = sweep(plan.chain, plan.motion, module_size=size).per_frame
    errors = joint_errors(
        plan.chain, plan.motion, module_size=size, clearances=clearances, error_rad=error_rad
    )
    assert errors is not None
    return errors


def _touches(plan: Plan, angles: Array, size: float) -> bool:
    """Return True if modules overlap in one configuration, by plain NumPy."""
    module, poses = plan.chain.module, forward_kinematics(plan.chain.module, angles)
    x, rotations = poses.positions, poses.rotations
    return any(
        separation(module.hull, size, x[j] - x[i], rotations[i], rotations[j])[0] < 0.0
        for i in range(len(x))
        for j in range(i + module.apart, len(x))
        if np.linalg.norm(x[j] - x[i]) < 2.0 * module.radius * size
    )


def _share(plan: Plan, error_rad: float, size: float) -> float:
    """Return the share of other robots whose folded shape touches itself."""
    random, angles = np.random.default_rng(7), plan.motion.angles_at(plan.chain, -1)
    robots = random.uniform(-error_rad, error_rad, (OTHER_ROBOTS, len(angles)))
    return float(np.mean([_touches(plan, angles + robot, size) for robot in robots]))


def test_margin_of_sampled_robots_holds_for_others_and_is_sharp(plan: Plan) -> None:
    errors, size = _errors(plan), plan.certificate.module_size
    margins = plan.certificate.margins
    assert margins is not None
    assert errors.tolerated_rad > 5.0 * margins.independent_rad.value
    assert _share(plan, errors.tolerated_rad, size) <= 0.05
    assert _share(plan, 1.5 * errors.tolerated_rad, size) > 0.05


def test_module_size_for_a_joint_error_holds_for_other_robots(plan: Plan) -> None:
    errors = _errors(plan)
    assert errors.error_rad == pytest.approx(ERROR_RAD)
    assert errors.module_size is not None
    assert _share(plan, ERROR_RAD, errors.module_size) <= 0.05
    assert _share(plan, ERROR_RAD, errors.module_size + 0.03) > 0.05
    assert confidence(errors.robots, errors.touching_at_size) > 0.999
    assert confidence(errors.robots, errors.touching_with_error) > 0.95


def test_error_that_no_module_size_tolerates_gets_none(plan: Plan) -> None:
    errors = _found(plan, error_rad=0.5)
    assert errors.module_size is None
    assert errors.tolerated_rad == _errors(plan).tolerated_rad


def test_estimate_without_a_joint_error_is_no_smaller_and_sharp(plan: Plan) -> None:
    size = plan.certificate.module_size
    estimate = _found(plan)
    assert not estimate.swept
    assert estimate.error_rad == pytest.approx(ERROR_RAD)
    assert estimate.tolerated_rad >= _errors(plan).tolerated_rad
    share = _share(plan, 1.5 * estimate.tolerated_rad, size)
    assert _share(plan, estimate.tolerated_rad, size) <= 0.05 < share


def test_plan_of_an_earlier_version_has_no_sampled_figures(plan: Plan) -> None:
    values = plan.certificate.as_dict()
    assert type(plan.certificate).from_dict(values) == plan.certificate
    del values["joint_errors"]
    assert type(plan.certificate).from_dict(values).joint_errors is None


@pytest.mark.parametrize("text", ["0.3", "0.3 grad", "deg", "0deg", "45deg", "1e-3rad", "-1deg"])
def test_joint_error_without_a_unit_or_out_of_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="write, for example, 0.3deg") as error:
        FoldRequest(joint_error=text).check()
    assert (error.value.code, error.value.where) == ("bad-joint-error", "joint_error")


def test_units_of_a_joint_error_mean_the_same() -> None:
    for text in ("0.3deg", "0.3 deg", ".3°", "0.00523599rad"):
        error_rad = FoldRequest(joint_error=text).parameters().joint_error_rad
        assert error_rad == pytest.approx(ERROR_RAD)


def test_forged_module_size_is_noticed(plan: Plan) -> None:
    errors = replace(_errors(plan), module_size=0.99)
    forged = replace(plan, certificate=replace(plan.certificate, joint_errors=errors))
    stated = ReportedFigures(forged, None, None)
    differences = list(stated.differences(plan.certificate, []))
    assert any("joint_errors.module_size" in difference for difference in differences)
