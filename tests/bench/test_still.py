"""Stills: modules at any position, without a background."""

import numpy as np
import pytest

from bench.reproduction.still import still
from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.module import Module
from foldback.web.palette import MAX_ERROR_RGB, NO_ERROR_RGB, STALLED_RGB
from foldback.web.pictures.camera import AZIMUTH_RAD, ELEVATION_RAD

POSITIONS = np.array([(x, 0.0, 0.0) for x in range(6)])
UPRIGHT = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))


def pixels(colours: np.ndarray, **still_options: object) -> np.ndarray:
    module = still_options.pop("module", CUBE)
    assert isinstance(module, Module)
    picture = still(module, POSITIONS, UPRIGHT, colours, size=(240, 150), **still_options)  # type: ignore[arg-type]
    assert (picture.size, picture.mode) == ((240, 150), "RGBA")
    return np.asarray(picture).astype(int)


@pytest.mark.parametrize("module", [CUBE, TETRAHEDRON])
def test_only_modules_are_drawn_and_none_is_cut_off(module: Module) -> None:
    drawn = pixels(np.tile(np.array(NO_ERROR_RGB, np.uint8), (6, 1)), module=module)
    alpha = drawn[..., 3]
    edge = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
    assert edge.max() == 0 and 0.03 < (alpha == 255).mean() < 0.8
    assert np.ptp(drawn[alpha == 255][:, :3], axis=1).max() < 40  # grey


def test_colours_are_those_of_the_modules_and_a_part_is_seen_larger() -> None:
    colours = np.tile(np.array(NO_ERROR_RGB, np.uint8), (6, 1))
    colours[2], colours[3] = STALLED_RGB, MAX_ERROR_RGB
    whole_pixels = pixels(colours)
    near = pixels(colours, around=POSITIONS[2:4])
    for minimum, maximum in ((0.4, 1.0), (0.0, 0.3)):  # of green in orange, and in red
        coloured_count, count = (
            (
                (p[..., 3] == 255)
                & (p[..., 0] - p[..., 2] > 60)
                & (p[..., 1] >= minimum * p[..., 0])
                & (p[..., 1] <= maximum * p[..., 0])
            ).sum()
            for p in (whole_pixels, near)
        )
        assert 20 < coloured_count < count / 2


def test_flat_shape_is_not_shown_edge_on() -> None:
    """The camera looks along a flat wall by default."""
    grey = np.tile(np.array(NO_ERROR_RGB, np.uint8), (36, 1))
    distance = np.array([np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD), 0.0])
    out = np.cos(ELEVATION_RAD) * distance + [0.0, 0.0, np.sin(ELEVATION_RAD)]
    along = np.array([-np.sin(AZIMUTH_RAD), np.cos(AZIMUTH_RAD), 0.0])
    wall = np.array([x * out + y * along for x in range(6) for y in range(6)])
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (36, 1))
    alpha = np.asarray(still(CUBE, wall, upright, grey, size=(240, 150)))[..., 3]
    rows, columns = np.nonzero(alpha)
    assert min(np.ptp(rows), np.ptp(columns)) > 75
