"""Sizing: results worked out by hand, and consistency of the three questions."""

from itertools import permutations, product
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.errors import InputError
from foldback.planner.servos.module_materials import CASINGS, Casing, casing_named
from foldback.planner.servos.servos import Servo, servo_named, servos
from foldback.planner.servos.sizing import (
    HINGES_PER_MODULE,
    find_suitable_servos,
    largest_shape,
    least_pitch_m,
    suitable_pitches,
    total_turn_rad,
)
from tests.refusal import refused

GRAVITY = 9.81
SMALL = servo_named("XL330-M288-T")
BOX, ALUMINIUM = CASINGS["pla-box"], CASINGS["aluminium"]
SERVOS = st.sampled_from(servos())
MATERIALS = st.sampled_from(list(CASINGS.values()))
TORQUES = st.floats(0.5, 500.0)


def test_small_servo_in_a_printed_box() -> None:
    """Walls of 1 mm around 40 mm: 1240 kg/m³ · (40³ − 38³) mm³ = 11.3 g; two servos of 18 g."""
    (fit,) = find_suitable_servos(4.0, pitch_m=0.04, casing=BOX, among=[SMALL])
    assert fit.module_kg == pytest.approx(0.036 + 0.011319, abs=1e-6)
    assert fit.need_nm == pytest.approx(4.0 * 0.047319 * GRAVITY * 0.04, rel=1e-4)
    assert fit.gives_nm == pytest.approx(0.52 / 3.0)
    assert fit.margin == pytest.approx(2.334, abs=1e-3)
    # Two servos of 20 × 26 × 34 mm fit into a cube of 40 mm, and its walls take 2 mm more.
    assert not fit.has_room
    assert fit.against == ("too large",)
    (fit,) = find_suitable_servos(4.0, pitch_m=0.042, casing=BOX, among=[SMALL])
    assert fit.would_do


def test_servo_with_two_shafts_counts_for_two() -> None:
    double, single = servo_named("2XL430-W250-T"), servo_named("XL430-W250-T")
    assert CUBE.hinges_per_joint == HINGES_PER_MODULE
    assert least_pitch_m(double, BOX) == pytest.approx(0.0465 + 0.002)
    assert least_pitch_m(single, BOX) == pytest.approx(2 * 0.0285 + 0.002)
    two, first = find_suitable_servos(4.0, pitch_m=0.06, casing=BOX, among=[double, single])
    assert (two.servos_kg, first.servos_kg) == pytest.approx((0.0982, 0.1144))


@pytest.mark.parametrize("servo", servos()[::3], ids=lambda servo: servo.name)
def test_least_pitch_is_the_smallest_of_all_arrangements(servo: Servo) -> None:
    """Perpendicular servos are side by side along one axis, along which their sizes add."""
    minimum = inf
    for first, second in product(permutations(servo.size_m), repeat=2):
        for axis in range(3):
            extent = np.maximum(first, second)
            extent[axis] = first[axis] + second[axis]
            minimum = min(minimum, extent.max())
    if servo.axes == 1:
        assert least_pitch_m(servo, BOX) == pytest.approx(minimum + 2 * BOX.wall_m)


@given(SERVOS, TORQUES, MATERIALS)
def test_pitch_margin_and_largest_shape_agree(servo: Servo, torque: float, casing: Casing) -> None:
    pitches = suitable_pitches(servo, torque, casing)
    (fit,) = find_suitable_servos(torque, pitch_m=pitches.most_m, casing=casing, among=[servo])
    assert fit.margin == pytest.approx(1.0)
    assert fit.has_room == (not pitches.empty)
    reach = largest_shape(servo, {}, pitch_m=pitches.most_m, casing=casing)
    assert reach.torque_wp == pytest.approx(torque)
    for k, strong in ((0.99, True), (1.01, False)):
        (fit,) = find_suitable_servos(
            torque, pitch_m=k * pitches.most_m, casing=casing, among=[servo]
        )
        assert (fit.margin >= 1.0) == strong
        assert ("too weak" in fit.against) != strong


def test_torque_of_zero_has_no_bound() -> None:
    assert suitable_pitches(SMALL, 0.0, BOX).most_m == inf
    (fit,) = find_suitable_servos(0.0, pitch_m=1.0, casing=BOX, among=[SMALL])
    assert fit.would_do and fit.margin == inf
    assert fit.as_dict()["margin"] is None


def test_largest_shape_within_a_torque() -> None:
    figures = {"mallet-64": 7.4, "4x4x4": 12.0, "3x3x3": 3.6}
    reach = largest_shape(SMALL, figures, pitch_m=0.042, casing=BOX)
    assert reach.torque_wp == pytest.approx(8.672, abs=1e-3)
    assert reach.within == ("3x3x3", "mallet-64")
    assert reach.largest == "mallet-64"
    assert largest_shape(SMALL, figures, pitch_m=0.2, casing=ALUMINIUM).largest is None


def test_servos_that_suffice_come_first() -> None:
    fits = find_suitable_servos(4.0, pitch_m=0.06, casing=BOX)
    would = [fit.would_do for fit in fits]
    assert would == sorted(would, reverse=True) and {*would} == {True, False}
    (mg996r,) = (fit for fit in fits if fit.servo.name == "MG996R")
    assert mg996r.against == ("turns only 120°",)


def test_turned_rad_counts_the_fastest_hinge_of_each_step() -> None:
    frames = np.array([[0.0, 0.0], [0.3, -0.5], [0.3, -0.5], [1.0, -0.6]])
    assert total_turn_rad(frames) == pytest.approx(0.5 + 0.0 + 0.7)
    assert total_turn_rad(frames[:1]) == 0.0


def test_sizing_out_of_range_is_refused() -> None:
    for torque, pitch, share, joint_place in (
        (-1.0, 0.04, 0.3, "torque"),
        (float("nan"), 0.04, 0.3, "torque"),
        (1.0, 0.0, 0.3, "pitch"),
        (1.0, 0.04, 1.5, "share"),
        (1.0, 0.04, 0.0, "share"),
    ):
        with refused("bad-sizing", joint_place):
            find_suitable_servos(torque, pitch_m=pitch, casing=BOX, share=share)


def test_material_is_a_name_or_a_density() -> None:
    assert casing_named("Aluminium") is ALUMINIUM
    assert casing_named("1100").module_kg(0.1, 0.0) == pytest.approx(1.1)
    for wrong in ("wood", "-3", "nan", "1e9"):
        with refused("unknown-material"):
            casing_named(wrong)
    with pytest.raises(InputError):
        Casing.weighing(0.0, 0.04)
