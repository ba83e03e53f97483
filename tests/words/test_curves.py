"""Labels of the curves that a page plots."""

from dataclasses import fields

from foldback.planner.certificate.figures_store import Curves
from foldback.words.curves import CURVE_LABELS, EXTREMES


def test_each_curve_has_a_label() -> None:
    curves = {field.name for field in fields(Curves)}
    assert CURVE_LABELS.keys() == curves | {"table_torque"}
    assert {*EXTREMES} <= curves
