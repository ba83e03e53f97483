"""Servos: their figures are plausible, have sources, and match the makers' documents."""

from math import pi
from urllib.parse import urlsplit

import pytest

from docs.make_servos import PAGE, with_rows
from foldback.planner.servos.servos import KGF_CM_NM, servo_named, servos
from foldback.planner.servos.sizing import PERMANENT_TORQUE_SHARE
from tests.case import case
from tests.refusal import refused


def test_servo_names_are_unique_and_sorted_by_mass() -> None:
    assert len(servos()) >= 30
    assert len({servo.name.lower() for servo in servos()}) == len(servos())
    assert len({servo.maker for servo in servos()}) >= 5
    masses = [servo.mass_kg for servo in servos()]
    assert masses == sorted(masses)


def test_servo_figures_are_plausible_and_name_their_sources() -> None:
    for servo in servos():
        with case(servo.name):
            a, b, c = servo.size_m
            assert 0.005 < a <= b <= c < 0.1
            assert 600.0 < servo.mass_kg / (a * b * c) < 3500.0
            shafts_kg = servo.mass_kg / servo.axes
            assert 5.0 < servo.stall_nm / shafts_kg < 80.0
            # On the straight line from stall to no load, the power is largest at the midpoint.
            assert 5.0 < servo.stall_nm * servo.no_load_rad_s / 4.0 / shafts_kg < 250.0
            assert 2.0 < servo.no_load_rad_s < 50.0
            assert 3.0 < servo.volts <= 24.0
            assert servo.range_deg is None or 90.0 <= servo.range_deg <= 360.0
            assert servo.axes in (1, 2)
            assert len(servo.title) > 10 and len(servo.checked) > 20
            address = urlsplit(servo.url)
            assert address.scheme == "https" and "." in address.netloc and len(address.path) > 1


def test_servo_figures_are_converted_to_si_units() -> None:
    assert servo_named("xl330-m288-T").no_load_rad_s == pytest.approx(103.0 * 2.0 * pi / 60.0)
    feetech = servo_named("STS3215-C018")
    assert feetech.stall_nm == pytest.approx(2.942, abs=1e-3)
    assert feetech.no_load_rad_s == pytest.approx(4.717, abs=1e-3)
    assert feetech.rated_nm == pytest.approx(10.0 * KGF_CM_NM)
    assert servo_named("2XL430-W250-T").axes == 2


def test_permanent_torque_share_agrees_with_rated_torques() -> None:
    shares = [servo.rated_nm / servo.stall_nm for servo in servos() if servo.rated_nm is not None]
    assert len(shares) >= 4
    assert min(shares) > 0.9 * PERMANENT_TORQUE_SHARE
    assert max(shares) < 1.01 * PERMANENT_TORQUE_SHARE


def test_unknown_servo_is_refused_with_similar_names() -> None:
    with refused("unknown-servo", match="MX-28AT"):
        servo_named("mx28")


def test_table_of_the_page_is_up_to_date() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert with_rows(page) == page, "run `python -m docs.make_servos`"
