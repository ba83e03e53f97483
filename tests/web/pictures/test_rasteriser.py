import numpy as np

from foldback.web.pictures.rasteriser import draw_triangles

RED, BLUE = (250.0, 10.0, 10.0), (10.0, 10.0, 250.0)


def draw(*triangles: tuple[list[tuple[float, float, float]], tuple[float, ...]]) -> np.ndarray:
    picture = np.full((40, 60, 3), 200, np.uint8)
    corners = np.array([corners for corners, _ in triangles], np.float32)
    colours = np.array([[colour] * 3 for _, colour in triangles], np.float32)
    draw_triangles(picture, corners, colours)
    return picture


LEFT_TURN = [(10.0, 30.0, 5.0), (50.0, 30.0, 5.0), (10.0, 10.0, 5.0)]


def test_triangle_covers_its_area_from_the_front_alone() -> None:
    red = (draw((LEFT_TURN, RED)) == (250, 10, 10)).all(axis=-1)
    assert abs(red.sum() - 400) <= 20
    rows, columns = np.nonzero(red)
    assert (rows.min(), rows.max(), columns.min()) == (10, 29, 10)
    assert (draw((LEFT_TURN[::-1], RED)) == 200).all()  # invisible from behind


def test_nearest_triangle_is_seen_in_any_order() -> None:
    farther = [(x, y, 9.0) for x, y, _ in LEFT_TURN]
    for triangles in (((LEFT_TURN, RED), (farther, BLUE)), ((farther, BLUE), (LEFT_TURN, RED))):
        assert not (draw(*triangles) == (10, 10, 250)).all(axis=-1).any()


def test_triangles_may_cross_and_leave_the_picture() -> None:
    sloped = [(x, y, 2.0 if x == 10.0 else 20.0) for x, y, _ in LEFT_TURN]
    picture = draw((LEFT_TURN, RED), (sloped, BLUE))
    row = picture[28, 10:45].astype(int)
    assert (row[0] == (10, 10, 250)).all() and (row[-1] == (250, 10, 10)).all()
    assert np.abs(np.diff(row[:, 0])).astype(bool).sum() == 1
    # A triangle larger than the picture is clipped.
    picture = draw(([(-500.0, 500.0, 1.0), (500.0, 500.0, 1.0), (0.0, -500.0, 1.0)], RED))
    assert (picture == (250, 10, 10)).all()
