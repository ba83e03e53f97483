"""Texts about a certificate claim no more than it proves."""

from dataclasses import replace
from typing import Any

from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.parameters.explosion import Base
from foldback.words.certificate import (
    clearance,
    headline,
    linked,
    on_table,
    record,
    robot_in_mujoco,
    rows,
    safety,
    torque,
)
from tests.planner.certificate.test_table_certificate import LIFTED, line, swing

EXEMPT = {"apart": 2, "worst_overlap_bound": 0.2941, "relief_radius": 0.525, "relief_share": 0.219}
FINAL_ERROR = "Average position error at the end (root mean square)"
SIMULATED: dict[str, Any] = {
    "verified": True,
    "reason": None,
    "simulated": True,
    "min_clearance": 0.0489,
    "min_clearance_playback": 0.0481,
    "min_clearance_record": 0.049,
    "clearance_bound": 0.0319,
    "rms_position_error": 1e-12,
    "max_angle_error_rad": 0.0007,
    "peak_torque_nm": 0.0004,
    "torque_source": "simulation, every step",
    "frames": 4036,
}
FOLLOWED: dict[str, Any] = SIMULATED | {
    "simulated": False,
    "min_clearance_playback": None,
    "rms_position_error": None,
    "max_angle_error_rad": None,
    "torque_source": "inverse dynamics at 1210 of 4036 frames, accelerations smoothed",
    "torque_frames": 1210,
}


def test_headline_has_the_proved_clearance_rounded_down() -> None:
    assert headline(SIMULATED) == (
        "verified (simulated): modules stay at least 3.1 % of the spacing apart"
    )
    tight = SIMULATED | {"clearance_bound": 0.000019, "min_clearance_playback": 0.00029}
    assert headline(tight).endswith("stay at least 0.0019 % of the spacing apart")
    smaller = {**tight, "module_size": 0.8}
    assert headline(smaller).endswith(
        "modules that fill 80 % of the spacing stay at least 0.0019 % of it apart"
    )
    failed = SIMULATED | {"verified": False, "reason": {"code": "cancelled", "values": {}}}
    assert headline(failed) == "failed: the check was cancelled"


def test_only_a_proof_is_called_safe() -> None:
    proved = "the 12 tetrahedra never collide. Smallest gap: at least 3.1 % of the spacing"
    assert safety(SIMULATED, "12 tetrahedra") == f"Safe: {proved}"
    smaller = FOLLOWED | {"module_size": 0.8}
    assert safety(smaller, "12 tetrahedra") == (
        f"Safe at 80 % of full size: {proved}. Motors not simulated"
    )
    failed = {"verified": False, "reason": {"code": "cancelled", "values": {}}}
    for unproved in (failed, {"clearance_bound": None}, {"clearance_bound": 0.0}):
        assert safety(SIMULATED | unproved, "12 tetrahedra") is None


def test_negative_clearance_is_called_an_overlap() -> None:
    for value, words in (
        (0.0, "stay at least 0 %"),
        (-0.0042, "overlap by at most 0.5 %"),
        (-0.000019, "overlap by at most 0.0019 %"),
        (-2.0, "overlap by at most 200.0 %"),
    ):
        assert f"modules {words} of the" in str(clearance(SIMULATED | {"clearance_bound": value}))


def test_robot_in_mujoco_is_named_with_its_error_and_that_of_our_simulation() -> None:
    robots = [{"max_angle_error_rad": error} for error in (1.4e-4, 1.27e-4, 7e-5)]
    in_mujoco = {"robot": 1, "max_angle_error_rad": 1.34e-4, "max_difference_rad": 4.3e-5}
    text = robot_in_mujoco(SIMULATED | {"robots": robots, "mujoco_robot": in_mujoco})
    assert text == (
        "MuJoCo simulated robot 2 of 3 again, with the same imperfections. "
        "Largest joint error: 130 µrad (130 µrad in our simulation). "
        "Largest difference between the joint angles of both simulations: 43 µrad"
    )
    alone = robot_in_mujoco(SIMULATED | {"robots": None, "mujoco_robot": in_mujoco | {"robot": 0}})
    assert str(alone).startswith("MuJoCo simulated the robot again, with the same imperfections.")
    assert robot_in_mujoco(SIMULATED) is None


def test_margins_are_rounded_down_and_name_their_limit() -> None:
    place = {"frame": 41.5, "modules": [0, 158]}
    margins = {
        "module_size": {"value": 0.99589, "limited_by": place},
        "one_hinge_rad": {"value": 0.00298, "limited_by": place},
        "independent_rad": {"value": 3.845e-5, "limited_by": place},
        "failure_probability": 0.05,
    }
    limit = "beyond that, modules 1 and 159 may touch near frame 43 of the plan"
    shown_rows = dict(rows(SIMULATED | {"margins": margins}))
    assert shown_rows["Tolerated module size (proved)"] == (
        f"modules may fill up to 99.5 % of the spacing; {limit}"
    )
    assert (
        shown_rows["Tolerated error of one hinge (proved)"]
        == f"up to 0.17° if all other hinges are exact; {limit}"
    )
    assert str(shown_rows["Tolerated errors of all hinges (proved)"]).startswith(
        "up to 0.0022° in all hinges; "
    )
    assert "5 of 100 robots" in str(shown_rows["Tolerated errors of all hinges (proved)"])
    assert "Tolerated error of one hinge (proved)" not in dict(rows(SIMULATED))


def test_errors_of_sampled_robots_are_no_proof() -> None:
    errors = {"tolerated_rad": 6.3e-4, "robots": 300, "touching_with_error": 8}
    for swept, kind in ((True, "sampled"), (False, "estimated")):
        shown_rows = dict(rows(SIMULATED | {"joint_errors": errors | {"swept": swept}}))
        row = str(shown_rows[f"Tolerated errors of all hinges ({kind})"])
        assert row.startswith("up to 0.036° in all hinges") and "8 of 300 robots" in row


def test_kinematic_certificate_has_no_figures_of_a_simulation() -> None:
    simulated, followed = dict(rows(SIMULATED)), dict(rows(FOLLOWED))
    for label in ("Smallest clearance of the simulated robots", FINAL_ERROR, "Largest joint error"):
        assert simulated[label] and simulated[label] != "not simulated"
        assert followed[label] == "not simulated"


def test_torque_is_called_peak_only_if_every_step_was_simulated() -> None:
    assert torque(SIMULATED) == ("Peak torque", "400 µN·m in the simulated motors")
    assert torque(FOLLOWED) == ("Largest torque found", "400 µN·m, checked at 1210 of 4036 frames")


def test_text_about_linked_modules() -> None:
    """tests/server/contract compares the texts for known overlaps and for none."""
    text = linked({"exempt_pairs": EXEMPT | {"worst_overlap_bound": None}})
    assert text is not None and "not checked against each other. Round the edges of real" in text
    assert linked({}) is None


def test_text_about_a_record_that_overlaps() -> None:
    assert record(SIMULATED, limit_rad=1.6057) is None
    for changes, words in (
        (
            {"min_clearance_record": -0.0042},
            "modules overlap by 0.42 % of the spacing. This does not happen in the plan.",
        ),
        ({"max_angle_record_rad": 1.62}, "a joint turns to 92.8°, beyond its limit of ±92°. This"),
    ):
        assert words in str(record(SIMULATED | changes, limit_rad=1.6057))


def test_text_about_the_base_on_a_table() -> None:
    chain = line(7)
    motion = swing(chain, 1, -LIFTED)
    cases: tuple[tuple[float, Base, str, str], ...] = (
        (0.0, "free", "without friction", "in the simulation, the first module is fixed"),
        (0.2, "free", "μ = 0.2 and no clamped module", "not clamped; the chain may drift"),
        (0.2, "clamped", "and a clamped first module", "the first module is clamped"),
    )
    for friction, base, words, is_fixed in cases:
        computed_table_certificate = table_certificate(chain, motion, friction=friction, base=base)
        text = on_table({"table": computed_table_certificate.as_dict()}, None)
        assert words in text["text"]
        assert is_fixed in dict(text["rows"])["Base"]
    computed_table_certificate = table_certificate(chain, motion, friction=0.2, base="free")
    for wp, pitch_m, words in ((12, 0.05, "least 5"), (12, 0.1, "most 7"), (1e4, 0.1, "however")):
        table = replace(computed_table_certificate, torque=wp, pitch_m=pitch_m).as_dict()
        assert words in on_table({"table": table}, None)["servos"]
