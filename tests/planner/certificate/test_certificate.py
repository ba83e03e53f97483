import json
import re
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest

from foldback.planner.certificate.certificate import Certificate, certify
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.motion.record import Record
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.playback.playback import Playback
from foldback.planner.progress import MARGINS_MESSAGE
from foldback.planner.reasons import Reason, ReasonCode
from tests.case import case
from tests.planner.chains import Array, anchored, chain_of, coil, line
from tests.planner.plans import turn_by_turn

PARAMETERS = Parameters()

STUCK = Reason.of(ReasonCode.AT_REST, steps=9)


def playback_of(plan: Array, *, frames: Array | None = None, **changes: Any) -> Playback:
    """Return a playback that ended as planned, or claims so."""
    done = plan if frames is None else frames
    values: dict[str, Any] = {"status": "folded", "reason": "", "steps": 100, "seconds": 1.0}
    values |= {"frames": anchored("playback", done, error_rad=np.zeros_like(done))}
    values |= {"rms_position_error": 0.0, "max_angle_error_rad": 0.0}
    values |= {"peak_torque": 1.0, "rms_torque": 0.5}
    return Playback(reference_rad=plan, **(values | changes))


def record_of(frames: Array) -> Record:
    return Record(
        status="straight", reason=None, frames=anchored("explosion", frames), steps=10, seconds=1.0
    )


def closing(steps: int = 40) -> tuple[Chain, Array]:
    """Return a line that closes to a C without collisions."""
    cells = [(1, 0, 0), (0, 0, 0), (0, 1, 0), (0, 2, 0), (1, 2, 0)]
    chain = chain_of(cells)
    return chain, np.linspace(0.0, 1.0, steps)[:, None] * chain.folded_rad


def verdict(chain: Chain, playback: Playback | None, record: Record | None = None) -> str:
    certificate = certify(chain, record, playback, PARAMETERS)
    # Every certificate must be serialisable.
    json.dumps(certificate.as_dict(), allow_nan=False)
    return certificate.verdict


def test_certificate_of_a_kinematic_playback() -> None:
    chain, plan = closing()
    followed = playback_of(plan, kind="kinematic", torque_frames=38)
    certificate = certify(chain, None, followed, PARAMETERS)
    assert certificate.verdict == "verified (kinematics only)"
    assert certificate.verified and certificate.simulated is False
    data = certificate.as_dict()
    for name in ("min_clearance_playback", "min_clearance_playback_at", "rms_position_error"):
        assert data[name] is None
    assert data["max_position_error"] is data["max_angle_error_rad"] is None
    assert certificate.plan_end_error_rad == 0.0
    source = "inverse dynamics at 38 of 40 frames, accelerations smoothed"
    assert certificate.torque_source == source


def test_verdict_is_reported_before_margins_are_computed() -> None:
    chain, plan = closing()
    colliding = plan.copy()
    colliding[20, :] = [np.pi / 2, 0.0, np.pi / 2, 0.0, np.pi / 2, 0.0]
    for angles, verified in ((plan, True), (colliding, False)):
        messages: list[str] = []
        certificate = certify(
            chain,
            None,
            playback_of(angles, kind="kinematic", torque_frames=38),
            PARAMETERS,
            progress=lambda report, messages=messages: messages.append(report.message),
        )
        assert certificate.verified == verified == (certificate.margins is not None)
        assert (messages[-1:] == [MARGINS_MESSAGE]) == verified


def test_clearance_bound_holds_for_plan_and_playback() -> None:
    chain, plan = closing()
    sound = certify(chain, record_of(plan[::-1]), playback_of(plan), PARAMETERS)
    assert sound.verdict == "verified (simulated)"
    assert sound.verified and sound.min_clearance > 0.0
    assert sound.rms_position_error == pytest.approx(0.0, abs=1e-12)
    assert sound.torque_source == "simulation, every step"
    done = plan.copy()
    done[10, 0] += 0.25
    off = certify(chain, None, playback_of(plan, frames=done), PARAMETERS)
    assert off.max_angle_error_rad == pytest.approx(0.25)  # whatever the playback reports
    done = plan.copy()
    done[38] = np.sign(chain.folded_rad) * np.deg2rad(91.5)
    closer = certify(chain, None, playback_of(plan, frames=done), PARAMETERS)
    assert closer.verified and closer.clearance_bound is not None
    assert closer.min_clearance_playback < closer.min_clearance
    assert 0.0 < closer.clearance_bound <= closer.min_clearance_playback
    # The bound is tight: it proves nearly all of the observed clearance.
    assert closer.clearance_bound > 0.85 * closer.min_clearance_playback


def test_stored_certificate_states_its_verdict_as_values() -> None:
    chain, plan = closing()
    sound = certify(chain, None, playback_of(plan), PARAMETERS).as_dict()
    assert (sound["verified"], sound["reason"]) == (True, None)
    failed = certify(chain, None, None, PARAMETERS).as_dict()
    assert (failed["verified"], failed["reason"]) == (False, {"code": "no-playback", "values": {}})
    unknown, empty = {"code": "no-such", "values": {}}, {"code": "overlap", "values": {}}
    for wrong in (
        {**sound, "verified": False},
        {**failed, "verified": True},
        {**failed, "verified": 1},
        {**failed, "reason": None},
        {**failed, "reason": unknown},
        {**failed, "reason": empty},
        {**failed, "reason": "failed: it overlaps"},
    ):
        with pytest.raises((ValueError, KeyError)):
            Certificate.from_dict(wrong)


def test_certificate_is_read_with_all_of_its_figures_or_not() -> None:
    chain, plan = closing()
    values = certify(chain, None, playback_of(plan), PARAMETERS).as_dict()
    assert Certificate.from_dict(values).as_dict() == values
    for name in values.keys() - {"joint_errors"}:  # missing in plans of earlier versions
        other_entries = {key: value for key, value in values.items() if key != name}
        with pytest.raises(ValueError, match=f"without {name}"):
            Certificate.from_dict(other_entries)


# The tests below attack the verdict: none of these plans may pass.


@pytest.mark.slow
def test_moments_that_cannot_be_bounded_are_refused_by_their_frame() -> None:
    # Modules of full size always touch, so that nothing can be proved.
    chain, plan = closing()
    found_verdict = certify(
        chain, None, playback_of(plan), replace(PARAMETERS, module_size=1.0)
    ).verdict
    assert re.fullmatch(r"failed: in the plan, .*\(frame [\d.]+ of the plan\)", found_verdict)
    # All hinges make many turns at once, so that the bisection does not converge.
    far = line(100)
    jump = np.zeros((2, len(far.folded_rad)))
    jump[1] = np.linspace(-60.0, 60.0, len(far.folded_rad))
    swept = sweep(far, jump, module_size=0.001)
    assert swept.bound <= 0.0 and swept.unbounded is not None


def test_contact_is_no_overlap() -> None:
    # The poses of this coil put modules 0 and 7 nearer than a pitch, by the rounding error.
    chain = coil(8)
    touching = sweep(chain, chain.folded_rad[None], module_size=1.0)
    assert (touching.clearance, touching.bound, touching.per_frame.tolist()) == (0.0, 0.0, [0.0])
    assert sweep(chain, chain.folded_rad[None], module_size=1.001).clearance == pytest.approx(
        -0.001
    )
    turns = turn_by_turn(chain, 1)
    plan = np.concatenate([np.linspace(*pair, 8, endpoint=False) for pair in pairwise(turns)])
    full = replace(PARAMETERS, module_size=1.0)
    found_verdict = certify(
        chain, None, playback_of(np.append(plan, turns[-1:], axis=0)), full
    ).verdict
    assert re.fullmatch(
        r"failed: in the plan, modules \d and \d touch \(frame [\d.]+ .*\)", found_verdict
    )


def test_collisions_are_refused() -> None:
    chain, plan = closing()
    done = plan.copy()
    done[20, :] = [np.pi / 2, 0.0, np.pi / 2, 0.0, np.pi / 2, 0.0]
    found_verdict = verdict(chain, playback_of(done))
    assert found_verdict.startswith("failed: in the plan, modules 0 and 4 overlap by")
    assert "(frame 20 of the plan)" in found_verdict
    found_verdict = verdict(chain, playback_of(plan, frames=done))
    assert found_verdict.startswith("failed: in the simulated playback, modules 0 and 4 overlap")
    # A coil is folded by moving all hinges at once, without intermediate frames.
    chain = coil(16)
    found_verdict = verdict(
        chain, playback_of(np.stack([np.zeros_like(chain.folded_rad), chain.folded_rad]))
    )
    assert found_verdict.startswith("failed: in the plan, modules")


def test_plan_with_other_ends_or_beyond_its_joints_is_refused() -> None:
    chain, plan = closing()
    assert "does not end in the folded shape" in verdict(chain, playback_of(-plan))
    found_verdict = verdict(chain, playback_of(plan, frames=0.9 * plan))
    assert found_verdict.startswith("failed: the playback ends")
    done = plan.copy()
    done[20, 0] = -np.deg2rad(92.5)
    found_verdict = verdict(chain, playback_of(plan, frames=done))
    assert "the simulated playback bends joint_1_z to -92.5°" in found_verdict
    assert found_verdict.endswith("(frame 20 of the simulated playback)")
    for error_place, value, words in (
        (0, 0.01, "does not start straight"),
        (-1, 0.01, "does not end in the folded shape"),
        (20, np.deg2rad(92.5), "beyond its range"),
    ):
        other_plan = plan.copy()
        other_plan[error_place, 1] += value
        assert words in verdict(chain, playback_of(other_plan))


def test_failed_or_missing_stages_are_refused() -> None:
    chain, plan = closing()
    for status in ("missed", "diverged", "cancelled", "timeout"):
        found_verdict = verdict(chain, playback_of(plan, status=status, reason=None))
        assert found_verdict == f"failed: the playback {status}"
    for status in ("stalled", "diverged", "cancelled", "timeout"):
        record = replace(record_of(plan[::-1]), status=status, reason=STUCK)
        for playback in (playback_of(plan), None):
            found_verdict = verdict(chain, playback, record)
            assert found_verdict == f"failed: {STUCK}"
    for record in (None, record_of(plan)):
        assert verdict(chain, None, record) == "failed: there is no playback"
    failed = certify(line(5), None, None, PARAMETERS)
    text = json.dumps(failed.as_dict(), allow_nan=False)
    assert Certificate.from_dict(json.loads(text)) == failed
    assert not failed.verified


def test_numbers_that_are_not_finite_are_refused() -> None:
    chain, plan = closing()
    for column_index, (bad, frame) in product(range(6), ((np.nan, 0), (np.inf, 17), (-np.inf, -1))):
        record = record_of(plan[::-1].copy())
        playback = playback_of(plan.copy(), frames=plan.copy())
        frames = playback.frames
        arrays = (playback.reference_rad, frames.joint_angles_rad, record.frames.joint_angles_rad)
        (*arrays, frames.root_position, frames.root_wxyz, frames.time_s)[column_index][frame] = bad
        with case((column_index, bad, frame)):
            assert verdict(chain, playback, record).startswith("failed: the")


def test_arrays_of_other_shapes_and_times_are_refused() -> None:
    chain, plan = closing()
    assert "shape" in verdict(chain, playback_of(plan[:20], frames=plan))
    assert "shape" in verdict(chain, playback_of(plan[:, :4]))
    assert verdict(chain, playback_of(plan[:0])).startswith("failed")
    assert verdict(chain, playback_of(plan[:1])).startswith("failed")
    assert verdict(line(9), playback_of(plan)).startswith("failed")
    playback = playback_of(plan)
    playback.frames.time_s[10] = 3.0
    assert "earlier time" in verdict(chain, playback)
    for size in (np.nan, np.inf, 0.0, -1.0):
        with pytest.raises(InputError, match="module size"):
            certify(chain, None, playback_of(plan), replace(PARAMETERS, module_size=size))


def test_cancelled_certificate_fails() -> None:
    # A cancelled certificate fails, because parts of the motion were never checked.
    chain, plan = closing(200)
    for times in (1, 3):
        answers = iter([False] * (times - 1) + [True])
        cancelled = partial(next, answers, False)
        arguments = record_of(plan), playback_of(plan), PARAMETERS
        certificate = certify(chain, *arguments, cancelled=cancelled)
        assert certificate.verdict == "failed: the check was cancelled"
        data = certificate.as_dict()
        places = [name for name in data if "clearance" in name]
        assert len(places) == 7 and {data[name] for name in places} == {None}
        assert certificate.in_betweens == 0


def test_gravity_torques_in_newton_metres() -> None:
    # 1 cm cubes of 2700 kg/m³: m g L = 2.65e-4 N·m. A straight line of 11 modules, held in the
    # middle, hangs 1 + 2 + … + 5 of them on the root's hinge.
    chain = line(11)
    assert chain.pitch_m == 0.01
    plan = np.zeros((3, len(chain.folded_rad)))
    certificate = certify(chain, None, playback_of(plan), PARAMETERS)
    weight = 2700.0 * 1e-6 * GRAVITY_M_S2 * 0.01
    assert weight == pytest.approx(2.65e-4, rel=1e-3)
    assert certificate.gravity_torque_straight_nm == pytest.approx(15 * weight)
    assert certificate.gravity_torque_folded_nm == pytest.approx(15 * weight)


def test_speed_limit_sets_the_fold_time_and_the_torque() -> None:
    chain, plan = closing(41)
    # 40 s for a quarter turn: the fastest hinge rotates at π/80 rad/s.
    slow, fast = (
        certify(chain, None, playback_of(plan), replace(PARAMETERS, joint_speed_limit_rad_s=limit))
        for limit in (0.5, 1.0)
    )
    assert slow.fold_time_s == pytest.approx(np.pi)
    assert fast.fold_time_s == pytest.approx(np.pi / 2)
    assert fast.peak_torque_nm == pytest.approx(4.0 * slow.peak_torque_nm)
    assert slow.max_joint_step_rad == pytest.approx(np.pi / 80)
    assert slow.hinges_moving_most == np.count_nonzero(chain.folded_rad)
