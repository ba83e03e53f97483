"""Modules are data: files, moments, frames, and how pieces follow each other."""

import copy
import json
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import (
    CUBE,
    MODULE_NAMES,
    TETRAHEDRON,
    module_named,
    module_of,
    module_value,
)
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module_file import module_schema, read_module, with_pattern
from foldback.planner.chain.polyhedron import Polyhedron, volume_moments
from foldback.planner.chain.rotations import axis_rotation
from foldback.planner.errors import InputError
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.readers.chain_json import read_chain
from foldback.planner.readers.limits import Source


def prism_document() -> dict[str, Any]:
    """Return the description of the snake's prism, to be changed."""
    return copy.deepcopy(module_named("snake-prism").document)


def test_moments_of_the_two_modules_are_exact() -> None:
    assert (CUBE.volume, CUBE.pieces[0].inertia.tolist()) == (1.0, [1.0 / 6.0] * 3)
    assert (TETRAHEDRON.volume, TETRAHEDRON.pieces[0].inertia.tolist()) == (
        2.0 / 3.0,
        [0.2, 0.15, 0.15],
    )


def test_frame_of_a_piece_lies_at_its_centre_along_its_principal_axes() -> None:
    piece = module_named("snake-prism").pieces[0]
    moments = volume_moments(piece.parts)
    np.testing.assert_allclose(moments.centre, 0.0, atol=1e-15)
    np.testing.assert_allclose(moments.inertia, np.diag(piece.inertia), atol=1e-15)
    np.testing.assert_allclose(sorted(piece.inertia), [1 / 9, 1 / 9, 1 / 6], atol=1e-15)


def test_rod_of_prisms_is_a_staircase_in_a_plane() -> None:
    chain = Chain.from_angles(module_named("snake-prism"), np.zeros(5))
    positions = chain.folded_poses.positions
    steps = np.diff(positions, axis=0)
    # Prisms two links apart have the same orientation, one edge along each of two directions on.
    np.testing.assert_allclose(steps[2:], steps[:-2], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(positions[2] - positions[0]), np.sqrt(2), atol=1e-12)
    assert np.linalg.matrix_rank(positions - positions[0], tol=1e-9) == 2


def test_pattern_says_which_piece_a_module_is() -> None:
    pieces = ["straight", "corner", "corner", "straight"]
    snake = with_pattern(module_named("snake-cube"), pieces)
    assert [snake.piece(k).name for k in range(5)] == [*pieces, "straight"]
    # The exit of a corner is at a right angle to its entry.
    assert snake.link(0).anchor @ snake.link(1).anchor == 0.0
    with pytest.raises(InputError, match="'bend'"):
        with_pattern(snake, ["bend"])


def test_rest_shape_is_the_angle_zero() -> None:
    prism = module_named("snake-prism")
    rest = [90.0, 0.0, -90.0]
    resting, link = with_pattern(prism, ["prism"] * 3, rest), prism.link(0)
    for k, angle in enumerate(np.deg2rad(rest)):
        turned = axis_rotation(link.axes[0], angle) @ link.turn
        np.testing.assert_allclose(resting.link(k).turn, turned, atol=1e-15)


def test_ranges_are_relative_to_the_rest_shape() -> None:
    document = prism_document()
    document["pieces"][0]["joint"]["hinges"][0]["range_deg"] = [-90, 120]
    document |= {"pattern": ["prism"] * 2, "rest_deg": [30, 0]}
    degrees = np.rad2deg(read_module(document).ranges_rad[:, 0])
    np.testing.assert_allclose(degrees, [[-120, 90], [-90, 120]], atol=1e-12)


def test_files_hold_a_name_or_a_description() -> None:
    for name in MODULE_NAMES:
        assert module_value(module_named(name)) == name
        assert module_of(name) is module_named(name)
    document = {**prism_document(), "name": "wedge"}
    module = module_of(document)
    assert module_of(module_value(module)) is module
    with pytest.raises(InputError, match="another name"):
        module_of({**document, "name": "cube"})


def test_chain_with_a_described_module_is_written_and_read() -> None:
    snake = module_of(
        with_pattern(module_named("snake-cube"), ["straight", "corner", "straight"]).document
    )
    chain = Chain.from_angles(snake, np.deg2rad([90.0, 180.0]))
    again = read_chain(json.loads(write_chain(chain)), Source(name="", max_cells=100))
    assert again.module is snake
    np.testing.assert_array_equal(again.folded_rad, chain.folded_rad)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("pieces", 0, "parts", 0, "corners", 1), [0.3, 0.3, 0.5], r"corners\[1\].*convex"),
        (
            ("pieces", 0, "parts", 0, "corners"),
            [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]],
            "plane",
        ),
        (("pieces", 0, "exit", "y"), [0, 1, 0], "exit.y.*right angle"),
        (("pieces", 0, "joint", "hinges", 0, "axis"), [0, 0, 0], "length 0"),
        (("pieces", 0, "joint", "hinges", 0, "range_deg"), [90, -90], "smaller one first"),
        (("pieces", 0, "entry", "at"), [0, 0, 1e9], r"pieces\[0\].entry.at\[2\]"),
        (("pieces", 0, "weight"), 3, "weight"),
        (("pattern",), ["wedge"], "'wedge'"),
        (("rest_deg",), [0, 0], "2 angles"),
        (("format",), "foldback-module/9", "format"),
        (("name",), "../cube", "name"),
        (("name",), "cube\n", "name"),
        (("pieces", 0, "joint", "hinges", 0, "name"), "z\n", "name"),
        (("words", "plural"), "\u202esebuc", "words.plural.*show nothing"),
        (("words", "singular"), "two\nlines", "words.singular.*show nothing"),
    ],
)
def test_faults_of_a_file_are_named(place: tuple[Any, ...], value: Any, message: str) -> None:
    document = prism_document()
    inner: Any = document
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    with pytest.raises(InputError, match=message):
        read_module(document)


def test_schema_describes_the_format() -> None:
    schema = module_schema()
    values = schema["$defs"]["ModuleValues"]
    assert set(module_named("cube").document) <= set(values["properties"])
    assert {"format", "name", "words", "pieces", "pattern"} == set(values["required"])


def test_faces_have_any_number_of_corners() -> None:
    prism = module_named("snake-prism").pieces[0].parts[0]
    assert sorted(len(loop) for loop in prism.loops) == [3, 3, 4, 4, 4]
    for loop in prism.loops:
        a, b, c = (prism.corners[k] for k in loop[:3])
        assert np.cross(b - a, c - a) @ a > 0.0, "faces turn counterclockwise seen from outside"


def test_points_on_edges_are_no_corners() -> None:
    cube = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    with pytest.raises(ValueError, match="within the hull"):
        Polyhedron.of_corners(np.array([*cube, [0.5, 0, 0]], dtype=float))
