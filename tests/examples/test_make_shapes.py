from examples import make_tetrahedra
from examples.make_gallery import drawings
from examples.make_shapes import DRAWINGS, SHAPES, make, merged_blocks, snake
from planner.chain.path import Path
from planner.readers import read
from tests.case import case


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
    made = [name for name, *_ in make_tetrahedra.SHAPES] + ["tetra-dodecahedron"]
    drawn = [*(shape.name for shape in (*DRAWINGS, *drawings())), *made]
    assert sorted(file.stem for file in SHAPES.glob("*.json")) == sorted(drawn)
    assert [len(shape.cells) for shape in DRAWINGS] == [
        *(24, 24, 64, 80, 80, 94, 160, 160, 192, 64, 216)
    ]
