"""Chain seen from above: headings accumulate past full turns, and loops are detected."""

import numpy as np
import pytest

from foldback.planner.chain.table_projection import TableProjection, crosses_itself

UP = np.array([0.0, 0.0, 1.0])


def line(headings: np.ndarray, rise: float = 0.0) -> np.ndarray:
    """Return the (m, 3) centres of a chain whose links have the given headings, in radians."""
    steps = np.stack([np.cos(headings), np.sin(headings), np.full(len(headings), rise)], axis=1)
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])


def ends(headings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, last = ((np.cos(h), np.sin(h), 0.0) for h in (headings[0], headings[-1]))
    return np.array(first), np.array(last)


@pytest.mark.parametrize("round_and_round", [-2.5, -1.0, 1.0, 2.5])
def test_headings_are_counted_past_full_turns(round_and_round: float) -> None:
    headings = 0.7 + np.linspace(0.0, 2.0 * np.pi * round_and_round, 60)
    turned = TableProjection(UP).turned(line(headings), *ends(headings))
    assert len(turned) == len(headings)
    assert np.allclose(turned, headings - headings[0], atol=1e-9)


def test_closed_loops_cross_themselves() -> None:
    way_round = np.linspace(0.0, 2.0 * np.pi, 13)
    loop = np.concatenate([np.zeros(8), way_round, np.zeros(8)])
    assert crosses_itself(line(loop)[:, :2])
    assert not crosses_itself(line(loop[:14])[:, :2])
    assert not crosses_itself(line(np.sin(np.arange(20.0)))[:, :2])
