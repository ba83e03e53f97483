from __future__ import annotations

from pathlib import Path as FilePath

import pytest

from planner.chain import Chain
from planner.paths import Path

SHAPES = FilePath(__file__).parents[2] / "examples" / "shapes"


@pytest.fixture
def hook() -> Path:
    """Five cells: along x, then y, then z."""
    cells = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 1, 1)]
    return Path.from_cells(cells, name="hook", pitch_m=0.02)


@pytest.fixture
def hook_chain(hook: Path) -> Chain:
    """The chain that folds into the hook."""
    return Chain.from_path(hook)


@pytest.fixture(params=sorted(SHAPES.glob("*.json")), ids=lambda path: path.stem)
def example(request: pytest.FixtureRequest) -> FilePath:
    """Each example shape's file."""
    return request.param
