from __future__ import annotations

from planner.folding import fold
from planner.paths import Path
from planner.warm_up import SMALL_SHAPE, warm_up


def test_warming_up_takes_the_whole_way() -> None:
    warm_up()
    plan = fold(Path.from_cells(SMALL_SHAPE, name="warm-up"))
    assert plan.certificate.verdict == "verified"
