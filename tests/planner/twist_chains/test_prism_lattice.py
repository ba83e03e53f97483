"""Exact places of the prisms of a snake: known figures, overlaps, ends that meet."""

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.twist_chains.figures import snake_figures
from foldback.planner.twist_chains.prism_lattice import (
    check_overlap,
    closing_digit,
    code_of_quarters,
    places_of,
)
from foldback.planner.twist_chains.snake_code import SnakeCode
from tests.case import case
from tests.refusal import refused


def code(digits: str) -> SnakeCode:
    return SnakeCode(tuple(map(int, digits)))


def turn(axis: int, quarters: int) -> Array:
    """Return the rotation by quarter turns about x or y as a (4, 4) matrix."""
    matrix = np.eye(4)
    i, j = {0: (1, 2), 1: (2, 0)}[axis]
    cosine, sine = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters % 4]
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = cosine, -sine, sine, cosine
    return matrix


def shift(*by: float) -> Array:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def corners_by_moulds(digits: str) -> list[set[tuple[float, ...]]]:
    """Return the corners of the prisms by the frames of their moulds, two kinds of which alternate.

    Even joints are at y = 0 and odd ones at x = 0 of a prism with the corners 0, x, y, and z + 1.
    """
    corners = np.array([(x, y, z, 1) for x, y in ((0, 0), (1, 0), (0, 1)) for z in (0, 1)])
    pose, poses = np.eye(4), [np.eye(4)]
    for joint, digit in enumerate(map(int, digits)):
        if joint % 2 == 0:
            link = shift(0.5, 0, 0.5) @ turn(1, 2 - digit) @ turn(0, 2) @ shift(-0.5, 0, -0.5)
        else:
            link = shift(0, 0.5, 0.5) @ turn(0, 2 - digit) @ turn(1, 2) @ shift(0, -0.5, -0.5)
        pose = pose @ link
        poses.append(pose)
    return [set(map(tuple, np.rint(corners @ pose.T)[:, :3].tolist())) for pose in poses]


def test_known_figures_are_placed_as_by_the_frames_of_their_moulds() -> None:
    for figure in snake_figures():
        with case(figure.name):
            places = places_of(figure.code)
            corners = [set(map(tuple, prism.tolist())) for prism in (places.corners + 1) / 2]
            assert corners == corners_by_moulds(figure.code.text())
            assert sorted(places.bounding_cells) == sorted(figure.cells)
            assert places.first_overlap() is None
            assert (closing_digit(figure.code) is not None) == figure.closed


def test_a_mirrored_or_reversed_figure_has_the_same_size() -> None:
    for figure in snake_figures():
        with case(figure.name):
            for image in (figure.code.mirrored(), figure.code.from_other_end()):
                places = places_of(image)
                assert places.first_overlap() is None
                assert sorted(places.bounding_cells) == sorted(figure.cells)
                assert (closing_digit(image) is not None) == figure.closed


def test_prisms_share_a_cell_only_as_its_two_halves() -> None:
    def volume_points(places_corners: Ints) -> Array:
        """Return points inside a prism, as weighted means of its corners."""
        weights = np.random.default_rng(1).dirichlet(np.ones(6), 40)
        return weights @ places_corners

    for digits in ("2222", "1313131", "22022", "123123", "0202202", "33133", "31213121"):
        with case(digits):
            places = places_of(code(digits))
            pair = places.first_overlap()
            inside = {
                (i, j)
                for j in range(len(places.cells))
                for i in range(j)
                if (places.cells[i] == places.cells[j]).all()
                and (
                    (volume_points(places.corners[i]) - 2 * places.cells[j]) @ places.slants[j] < 0
                ).any()
            }
            assert pair == (min(inside, key=lambda p: p[::-1]) if inside else None)


def test_overlap_names_the_prisms() -> None:
    with refused("overlap", "prisms 0 and 4", match="would lie in one another"):
        check_overlap(code("2222"))
    check_overlap(code("222"))


def test_closing_digits() -> None:
    """Figures with 16 prisms whose 16th digit collections state in brackets."""
    for digits, closing in (
        ("131012103130321", 2),
        ("131012111320321", 2),
        ("131012112102131", 2),
        ("131012112302311", 2),
        ("222", 2),
        ("0000", None),
    ):
        with case(digits):
            assert closing_digit(code(digits)) == closing


def test_code_of_joint_angles() -> None:
    assert code_of_quarters(np.array([0, -1, 2, 5, -2, 3])).text() == "032123"
