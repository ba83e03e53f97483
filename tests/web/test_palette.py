import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE
from foldback.web.palette import (
    MAX_ERROR_RGB,
    NO_ERROR_RGB,
    UNKNOWN_ERROR_RGB,
    error_colours,
    error_ramp,
    error_scale,
    instance_colours,
    linear_from_srgb,
    module_errors,
    srgb_from_linear,
)


def redness(colours: np.ndarray) -> np.ndarray:
    colours = colours.astype(float)
    return colours[..., 0] - colours[..., 1:].mean(axis=-1)


def test_linear_light_of_known_greys() -> None:
    # 18 % grey is 118 in sRGB; black and white are fixed.
    assert linear_from_srgb(np.array([0.0, 118 / 255, 1.0])) == pytest.approx(
        [0.0, 0.181, 1.0], abs=1e-3
    )
    values = np.linspace(0.0, 1.0, 50)
    assert srgb_from_linear(linear_from_srgb(values)) == pytest.approx(values, abs=1e-6)
    assert instance_colours(np.array([[0, 118, 255]], np.uint8)).tolist() == [[0, 46, 255]]


def test_more_error_is_more_red() -> None:
    colours = error_colours(np.linspace(0.0, 2e-3, 50), 2e-3)
    assert (np.diff(redness(colours)) > 0).all()
    assert tuple(colours[0]) == NO_ERROR_RGB
    assert tuple(colours[-1]) == MAX_ERROR_RGB
    edges = error_colours(np.array([5.0, np.nan, 0.0]), 1e-3)
    assert [tuple(rgb) for rgb in edges] == [MAX_ERROR_RGB, UNKNOWN_ERROR_RGB, NO_ERROR_RGB]
    assert np.allclose(np.diff(linear_from_srgb(error_ramp(5) / 255.0), 2, axis=0), 0.0, atol=0.01)


def test_scale_ends_at_the_peak_but_does_not_exaggerate_tiny_errors() -> None:
    assert error_scale(0.0163) == 0.0163
    assert error_scale(1e-9) == error_scale(0.0) == error_scale(float("nan")) == 1e-5


def test_cube_shows_the_error_of_the_joint_that_it_carries() -> None:
    # Five modules: joints at modules 1, 2 and 3, two hinges each.
    errors = np.array([1.0, -2.0, 3.0, 0.0, np.nan, np.nan])
    error_colours = module_errors(errors, CUBE, 5)
    assert error_colours[:3].tolist() == [2.0, 2.0, 3.0]
    assert np.isnan(error_colours[3:]).all()
