from pathlib import Path

import numpy as np
import pytest

from examples import make_tetrahedra
from planner.chain.chain import Chain
from planner.chain.module import TETRAHEDRON
from planner.readers import read
from planner.readers.gallery import gallery
from tests.case import case

SHAPES = Path(make_tetrahedra.__file__).parent / "shapes"
CHAINS = [shape for shape in gallery() if shape.module == TETRAHEDRON.name]


def test_tetrahedra_files_are_up_to_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_tetrahedra, "HERE", tmp_path)
    (tmp_path / "shapes").mkdir()
    make_tetrahedra.main()
    made = {file.name: file.read_bytes() for file in (tmp_path / "shapes").iterdir()}
    there = {file.name: file.read_bytes() for file in SHAPES.glob("tetra-*.json")}
    assert made == there
    assert len(there) == len(CHAINS) >= 10


def test_tetrahedra_files_are_folded_chains_on_the_lattice() -> None:
    for shape in CHAINS:
        with case(shape.name):
            chain = read(shape.data, filename=shape.filename)
            assert isinstance(chain, Chain)
            assert len(chain) == shape.modules <= 400
            twice = 2.0 * chain.folded_poses.positions
            np.testing.assert_allclose(twice, np.rint(twice), atol=1e-9)
            assert "tetrahedra" in shape.tags
