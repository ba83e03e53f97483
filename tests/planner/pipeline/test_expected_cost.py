"""Expected cost of folds of all kinds, compared with measurements."""

from typing import Any

from foldback.planner.pipeline.expected_cost import MAX_EXPECTED_S, expected_cost
from foldback.planner.pipeline.request import FoldRequest
from tests.case import case

STAGE_S = 1800.0
PAPER: dict[str, Any] = {"preset": "paper"}
MEASURED = [  # processor times, s, of whole folds and of published explosions
    (160, {}, 3.9),
    (160, {"settings": "robots=20"}, 15.9),
    (160, {"preset": "direct"}, 36.0),
    (64, {"preset": "direct"}, 5.0),
    (160, {"preset": "direct", "settings": "step_s=0.0001"}, 81.9),
    (1000, {"settings": "simulated_modules=2000,robots=1"}, 18.3),
    (64, PAPER, 19.0),
    (160, PAPER, 65.0),
    # On a table: docs/decisions/0026-tables.md
    (24, {"world": "table"}, 2.0),
    (64, {"world": "table"}, 62.0),
    (88, {"world": "table"}, 478.0),
    (96, {"world": "table"}, 355.0),
]
ENDLESS = [
    (1000, {**PAPER, "settings": "step_s=0.0001,radial_gain=0.001,repulsion_gain=0.001"}),
    (1000, {**PAPER, "settings": "step_s=0.001"}),
    (160, {**PAPER, "settings": "step_s=0.0001"}),
    (512, {**PAPER, "settings": "radial_gain=0,repulsion_gain=0,spring=0"}),
    (1000, {**PAPER, "settings": "damping=0.9"}),
    (600, {**PAPER, "settings": "snapshot_interval=1,steps_per_snapshot=1000"}),
    (600, {**PAPER, "settings": "density_kg_m3=100000,pitch_cm=10"}),
    (12_000, {"settings": "simulated_modules=20000,robots=20"}),
    (2000, {"world": "table"}),
]


def test_expected_cost_is_within_a_factor_of_three_of_measurements() -> None:
    for modules, options, measured_s in MEASURED:
        with case((modules, options)):
            cost = expected_cost(modules, FoldRequest(**options))
            assert measured_s / 3.0 < cost.expected_s < 3.0 * measured_s
            assert cost.least_s < STAGE_S


def test_expected_cost_of_endless_folds_is_above_the_limit() -> None:
    for modules, options in ENDLESS:
        with case((modules, options)):
            cost = expected_cost(modules, FoldRequest(**options))
            assert cost.least_s > STAGE_S
            assert cost.cause and cost.remedy.endswith(".")
            assert 0.0 < cost.expected_s <= MAX_EXPECTED_S


MAY_END = [
    (12_000, {"prefer": "time"}),
    (9_600, {"refold": True}),
    (160, {"smooth": True}),
    (1000, PAPER),
    (160, {**PAPER, "settings": "step_s=0.005"}),
    (160, {**PAPER, "settings": "radial_gain=0.05,damping=0.2"}),
    (1000, {"preset": "direct"}),
]


def test_expected_cost_of_folds_that_may_end_is_below_the_limit() -> None:
    for modules, options in MAY_END:
        with case((modules, options)):
            assert expected_cost(modules, FoldRequest(**options)).least_s < STAGE_S
