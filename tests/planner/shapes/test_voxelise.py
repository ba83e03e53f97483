from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from foldback.planner.errors import InputError, checked_fraction
from foldback.planner.shapes.bridges import bridged
from foldback.planner.shapes.layered_path import has_whole_layers
from foldback.planner.shapes.solid import Solid
from foldback.planner.shapes.solid_sampling import sample
from foldback.planner.shapes.voxelise import Voxels, voxelise
from tests.conftest import examples
from tests.planner.solids_made import Mesh, box, solid_of, torus

pytestmark = pytest.mark.slow

TURNS = trimesh.transformations


def grid_of(cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    grid = np.zeros(tuple(cells.max(axis=0) + 3), dtype=bool)
    grid[tuple((cells + 1).T)] = True
    return grid


def euler_characteristic(cells: NDArray[np.int64]) -> int:
    """Return corners − edges + faces − cells of the union of closed cubes."""
    total = 0
    doubled = {tuple(2 * c + 1 + s) for c in cells for s in np.ndindex(3, 3, 3)}
    for place in doubled:
        # Corners, edges, faces and centres of cells have coordinates of which 0, 1, 2 or 3 are
        # even.
        total += (-1) ** sum(p % 2 == 0 for p in place)
    return total


def count_pieces(cells: NDArray[np.int64]) -> int:
    return int(ndimage.label(grid_of(cells))[1])


def test_boxes_become_exactly_their_cells() -> None:
    for sides in ((3, 3, 3), (2, 3, 5), (1, 4, 6)):
        voxels = voxelise(solid_of(box(*(2.5 * s for s in sides))), cells=int(np.prod(sides)))
        assert len(voxels.shape) == np.prod(sides)
        assert (np.ptp(voxels.shape.cells, axis=0) + 1).tolist() == list(sides)
        assert voxels.iou == pytest.approx(1.0)
        assert voxels.pitch == pytest.approx(2.5)
        assert voxels.notes == ()
    voxels = voxelise(solid_of(box(3, 3, 3)), cells=70)
    assert (voxels.below, len(voxels.shape), voxels.above) == (27, 64, 125)
    voxels = voxelise(solid_of(box(3, 3, 3)), cells=39)
    assert voxels.below == 27
    assert "use fewer modules; then" in " ".join(voxels.notes)


@given(st.floats(0.1, 100), st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50)))
@examples(one_of=30)
def test_voxels_do_not_depend_on_size_and_place(scale: float, shift: tuple[float, ...]) -> None:
    mesh = torus()
    plain = voxelise(solid_of(mesh), cells=120)
    mesh.apply_scale(scale)
    mesh.apply_translation(np.array(shift) * scale)
    moved = voxelise(solid_of(mesh), cells=120)
    assert abs(len(moved.shape) - len(plain.shape)) <= 6
    assert moved.iou == pytest.approx(plain.iou, abs=0.03)
    assert moved.pitch / scale == pytest.approx(plain.pitch, rel=0.05)


def test_holes_and_volumes_are_those_of_the_solids() -> None:
    ball = voxelise(solid_of(trimesh.creation.icosphere(subdivisions=3)), cells=800)
    assert abs(len(ball.shape) - 800) <= 40
    assert ball.iou > 0.85
    size = 2.0 / ball.pitch
    assert len(ball.shape) == pytest.approx(np.pi / 6 * size**3, rel=0.03)
    assert euler_characteristic(ball.shape.cells) == 1
    ring = voxelise(solid_of(torus()), cells=300).shape
    assert euler_characteristic(ring.cells) == 0


def test_large_solids_get_whole_layers() -> None:
    ring = trimesh.creation.torus(3.0, 1.2)
    voxels = voxelise(solid_of(ring), cells=125)
    assert has_whole_layers(grid_of(voxels.shape.cells))
    assert voxels.iou > 0.65


def test_hollow_ball_stays_hollow() -> None:
    inner = trimesh.creation.icosphere(subdivisions=3, radius=0.6)
    inner.invert()
    mesh = trimesh.util.concatenate([trimesh.creation.icosphere(subdivisions=3), inner])
    voxels = voxelise(solid_of(mesh), cells=400)
    assert euler_characteristic(voxels.shape.cells) == 2
    assert voxels.unused == ()


def test_turned_box_is_turned_back() -> None:
    mesh = box(3, 5, 4)
    mesh.apply_transform(TURNS.rotation_matrix(0.4, [1, 2, 3]))
    assert not np.allclose(voxelise(solid_of(mesh), cells=200).rotation, np.eye(3))


def test_overlapping_bodies_are_joined() -> None:
    solid = solid_of(join_boxes(((2, 2, 2), (0, 0, 0)), ((2, 2, 2), (1, 1, 1))))
    voxels = voxelise(solid, cells=15 * 8)
    assert voxels.unused == ()
    assert any("crosses itself" in note for note in voxels.remarks)
    assert len(voxels.shape) * voxels.pitch**3 == pytest.approx(15, rel=0.1)


def test_thin_bar_is_kept() -> None:
    ends = ((3, 3, 3), (-4, 0.1, 0.1)), ((3, 3, 3), (4, -0.1, -0.1))
    mesh = join_boxes(*ends, ((9, 0.45, 0.45), (0, 0, 0)))
    voxels = voxelise(solid_of(mesh), cells=60)
    assert count_pieces(voxels.shape.cells) == 1
    assert voxels.unused == ()
    assert np.ptp(voxels.shape.cells[:, 0]) * voxels.pitch > 8
    assert any("added to keep thin parts" in note for note in voxels.remarks)


@given(st.integers(0, 2**32 - 1), st.integers(5, 200))
@examples(one_of=15)
def test_voxels_are_in_one_piece(seed: int, cells: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(8, 3)) * rng.uniform(0.05, 1, 3)
    voxels = voxelise(solid_of(trimesh.convex.convex_hull(points)), cells=cells, seed=seed)
    assert count_pieces(voxels.shape.cells) == 1
    assert 0 < voxels.iou <= 1
    assert voxels.below is None or voxels.below < cells
    assert voxels.above is None or voxels.above > cells


def test_winding_and_votes_agree_on_closed_meshes() -> None:
    solid = solid_of(torus())
    voted = Solid(name="t", vertices=solid.vertices, faces=solid.faces, oriented=False)
    turn = TURNS.rotation_matrix(0.5, [1, 1, 0])[:3, :3]
    first, two = (sample(s, pitch=0.4, size=4, rotation=turn) for s in (solid, voted))
    np.testing.assert_array_equal(first.inside, two.inside)
    assert first.volume == pytest.approx(torus().volume, rel=0.01)


def test_bridges_follow_the_fullest_cells_and_specks_are_dropped() -> None:
    filled = np.zeros((9, 3, 3))
    filled[:3] = filled[6:] = 1.0
    filled[3:6, 0, 0] = 0.1
    filled[3:6, 2, 2] = 0.3
    filled[4, 0, 2] = 0.9
    computed_bridged = bridged(filled >= 0.5, filled)
    assert (computed_bridged.parts, computed_bridged.added, computed_bridged.dropped) == (3, 3, 1)
    assert computed_bridged.cells[3:6, 2, 2].all()
    assert not computed_bridged.cells[4, 0, 2]


@pytest.mark.parametrize("cells", [0, -5, 200_001])
def test_counts_out_of_range_are_refused(cells: int) -> None:
    with pytest.raises(InputError, match="expected 1 to"):
        voxelise(solid_of(box(1, 1, 1)), cells=cells)


def test_sheet_without_thickness_is_refused() -> None:
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), x.ravel() * y.ravel() + y.ravel()])
    rows = np.arange(81).reshape(9, 9)
    a, b, c, d = (r.ravel() for r in (rows[:-1, :-1], rows[1:, :-1], rows[1:, 1:], rows[:-1, 1:]))
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    sheet = Solid(name="s", vertices=points, faces=faces, closed=False, oriented=False)
    with pytest.raises(InputError, match="encloses no volume"):
        voxelise(sheet, cells=100)


def join_boxes(*parts: tuple[tuple[float, ...], tuple[float, ...]]) -> Mesh:
    """Return boxes as one mesh, each given by its sides and its centre."""
    boxes: list[Mesh] = []
    for sides, middle in parts:
        boxes.append(box(*sides))
        boxes[-1].apply_translation(middle)
    return trimesh.util.concatenate(boxes)


TABLE = [
    ((10.0, 6.0, 0.3), (0.0, 0.0, 0.0)),
    *(((0.3, 0.3, 6.0), (x, y, -3.0)) for x in (-4.8, 4.8) for y in (-2.8, 2.8)),
]


MESHES: dict[str, Callable[[], Mesh]] = {
    "table": lambda: join_boxes(*TABLE),
    "open box": lambda: Mesh(box(2, 2, 2).vertices, box(2, 2, 2).faces[1:], process=False),
    "two boxes": lambda: join_boxes(((2, 2, 2), (0, 0, 0)), ((1, 1, 1), (5, 0, 0))),
    "torus": lambda: trimesh.creation.torus(3, 1),
    "capsule": lambda: trimesh.creation.capsule(height=4, radius=1),
    "slab": lambda: box(9, 7, 0.4),
}


@given(st.sampled_from(sorted(MESHES)), st.integers(1, 150), st.integers(0, 3))
@examples(one_of=30)
def test_offered_counts_can_be_had(name: str, cells: int, seed: int) -> None:
    solid = solid_of(MESHES[name]())
    voxels = voxelise(solid, cells=cells, seed=seed)
    voxel_dimensions = len(voxels.shape)
    for offered in (voxels.below, voxels.above):
        if offered is not None:
            second_voxels = voxelise(solid, cells=offered, seed=seed)
            assert len(second_voxels.shape) == offered
            # No offered count contradicts the result for this one.
            assert abs(offered - cells) >= abs(voxel_dimensions - cells)
    assert voxels.below is None or voxels.below < voxel_dimensions
    assert voxels.above is None or voxels.above > voxel_dimensions


@pytest.mark.parametrize("name", ["open box", "slab", "two boxes"])
def test_counts_come_within_a_tenth_and_others_are_offered(name: str) -> None:
    voxels = voxelise(solid_of(MESHES[name]()), cells=20)
    assert abs(len(voxels.shape) - 20) <= 2
    assert voxels.below is not None
    assert voxels.above is not None


def brute_iou(v: Voxels, turn: NDArray[np.float64]) -> float:
    """Return the IoU with the rotated table, from random points and its boxes' own sides."""
    sides, middles = (np.array(column) for column in zip(*TABLE, strict=True))
    low, high = (middles - sides / 2).min(axis=0), (middles + sides / 2).max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, size=(20_000, 3))
    near = np.abs(points[:, None] - middles) <= sides / 2
    inside = near.all(axis=2).any(axis=1)
    volume = float(np.prod(high - low) * inside.mean())
    turned = points[inside] @ turn.T @ v.rotation.T
    floor = np.floor(turned / v.pitch + v.offset).astype(int)
    cells = {tuple(c) for c in v.shape.cells.tolist()}
    floor_volume = volume * np.mean([tuple(c) in cells for c in floor.tolist()])
    return float(floor_volume / (volume + len(cells) * v.pitch**3 - floor_volume))


def test_notes_name_lost_parts_of_a_thin_solid() -> None:
    turn = TURNS.rotation_matrix(0.4, [1, 2, 3])
    turned = join_boxes(*TABLE)
    turned.apply_transform(turn)
    voxels = voxelise(solid_of(turned), cells=20)
    assert np.linalg.det(voxels.rotation) == pytest.approx(1)
    assert voxels.shape.cells.min(axis=0).tolist() == [0, 0, 0]
    assert voxels.iou == pytest.approx(brute_iou(voxels, turn[:3, :3]), abs=0.03)
    assert voxels.iou > 0.12
    legs_kept = np.ptp(voxels.shape.cells, axis=0).min() * voxels.pitch > 4
    assert legs_kept or any("left out" in note for note in voxels.notes)
    notes = [note for note in voxels.notes if "se more modules" in note]
    assert len(notes) == (voxels.iou < 0.5)


def test_largest_body_is_voxelised_as_if_it_were_alone() -> None:
    alone = voxelise(solid_of(box(2, 2, 2)), cells=125)
    beside = voxelise(solid_of(MESHES["two boxes"]()), cells=125)
    volume = 2.0**3 / (2.0**3 + 1.0)
    assert (alone.unused, beside.unused) == ((), pytest.approx((1.0 - volume,)))
    assert "2 separate bodies" in beside.notes[0]
    assert beside.iou == pytest.approx(alone.iou * volume)
    assert beside.pitch == pytest.approx(alone.pitch)


def test_voxelise_thin_fins_reports_figures_in_range() -> None:
    # A full cell of 32 samples per side does not fit into int16.
    middles = (np.arange(24) + 0.5) * 4.0 / 24
    fin = [((0.02, 4.0, 2.0), (x, 2.0, 3.0)) for x in middles]
    sink = [((4.0, 4.0, 2.0), (2.0, 2.0, 1.0)), *fin]
    voxels = voxelise(solid_of(join_boxes(*sink)), cells=18)
    assert 0.3 < voxels.iou <= 1.0
    assert not any("inf" in note or "-" in note for note in voxels.notes)


@pytest.mark.parametrize("value", [-0.12, 1.01, float("nan")])
def test_checked_fraction_out_of_range_is_an_error(value: float) -> None:
    with pytest.raises(ArithmeticError, match="expected 0 to 1"):
        checked_fraction(value, "share")
