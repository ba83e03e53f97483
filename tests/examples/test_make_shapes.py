from pathlib import Path as FilePath

import numpy as np
import pytest

from examples import make_robots, make_snakes, make_tetrahedra
from examples.make_gallery import drawings
from examples.make_shapes import DRAWINGS, SHAPES, make, merged_blocks, snake
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.readers import read
from foldback.planner.readers.gallery import gallery
from tests.case import case

CHAINS = [shape for shape in gallery() if shape.module == TETRAHEDRON.name]


def test_shape_files_visit_the_cells_of_their_drawings_and_are_up_to_date() -> None:
    for shape in DRAWINGS:
        with case(shape.name):
            data = (SHAPES / f"{shape.name}.json").read_bytes()
            path = read(data)
            assert isinstance(path, Path)
            assert {tuple(cell) for cell in path.cells.tolist()} == shape.cells
            # The solver's result may differ between its versions; our algorithms' may not.
            if shape.path in (merged_blocks, snake):
                assert make(shape) == data


def test_each_shape_file_has_a_drawing() -> None:
    shape_names = [name for name, *_ in make_tetrahedra.SHAPES] + ["tetra-dodecahedron"]
    chains = [*make_snakes.chains(), *make_robots.chains()]
    shape_names += [chain.name for chain, _, _ in chains]
    drawn = [*(shape.name for shape in (*DRAWINGS, *drawings())), *shape_names]
    assert sorted(file.stem for file in SHAPES.glob("*.json")) == sorted(drawn)


def test_tetrahedra_are_up_to_date(tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make_tetrahedra, "HERE", tmp_path)
    (tmp_path / "shapes").mkdir()
    make_tetrahedra.main()
    built_files = {file.name: file.read_bytes() for file in (tmp_path / "shapes").iterdir()}
    stored_files = {file.name: file.read_bytes() for file in SHAPES.glob("tetra-*.json")}
    assert built_files == stored_files
    assert len(stored_files) == len(CHAINS) >= 10


def test_tetrahedra_files_are_folded_chains_on_the_lattice() -> None:
    for shape in CHAINS:
        with case(shape.name):
            chain = read(shape.data, filename=shape.filename)
            assert isinstance(chain, Chain)
            assert len(chain) == shape.modules <= 400
            twice = 2.0 * chain.folded_poses.positions
            np.testing.assert_allclose(twice, np.rint(twice), atol=1e-9)
            assert "tetrahedra" in shape.tags
