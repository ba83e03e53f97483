import numpy as np
import pytest

from foldback.web.pictures.camera import View
from foldback.web.pictures.ground_shadow import ground_shadow
from foldback.web.pictures.lighting import fill_light, key_light
from foldback.web.pictures.meshes import DISPLAYED_MODULE_SIZE
from foldback.web.pictures.occlusion import MAX_OCCLUDER_DISTANCE, face_light

VIEW = View(target=np.zeros(3), azimuth_rad=0.7, elevation_rad=0.4, distance=9.0)
UPWARDS = np.array([0.0, 0.0, 1.0])


def light_on_top(*light_directions: tuple[float, float, float]) -> tuple[float, float]:
    """Return the light on the upper face of a cube at the origin, with a light straight above."""
    positions = np.array([(0.0, 0.0, 0.0), *light_directions])
    middles = positions[:, None] + 0.465 * UPWARDS
    normals = np.tile(UPWARDS, (len(positions), 1, 1))
    sky, lit = face_light(middles, normals, positions, radius=0.56, towards_light=UPWARDS)
    return float(sky[0, 0]), float(lit[0, 0])


def test_light_is_reflected_evenly_upwards_and_sideways() -> None:
    assert light_on_top((0, 0, -1), (1, 0, -1)) == (1.0, 1.0)
    assert light_on_top((0, 0, 1)) == pytest.approx((0.0, 0.0), abs=0.05)
    heights = np.linspace(1.0, MAX_OCCLUDER_DISTANCE + 1.0, 200)
    sky, lit = np.array([light_on_top((0.0, 0.0, h)) for h in heights]).T
    for sky_light in (sky, lit):
        assert (np.diff(sky_light) >= -1e-6).all()
        assert np.abs(np.diff(sky_light)).max() < 0.1
        assert sky_light[-1] == 1.0
    lit = np.array([light_on_top((x, 0.0, 2.0))[1] for x in np.linspace(0.0, 3.0, 200)])
    assert lit[0] < 0.3
    assert lit[-1] == 1.0
    assert np.abs(np.diff(lit)).max() < 0.05


def test_shadow_lies_below_and_its_rim_is_lit() -> None:
    shadow = ground_shadow(np.array([[3.0, -2.0, 0.5]]), ground=0.0, lean=np.zeros(2))
    assert shadow.middle == pytest.approx([3.0, -2.0])
    middle = len(shadow.shade) // 2
    assert shadow.shade[middle, middle] == shadow.shade.max() > 0.4
    rim = np.concatenate([shadow.shade[[0, -1]].ravel(), shadow.shade[:, [0, -1]].ravel()])
    assert rim.max() < 0.005


def test_shadows_of_higher_modules_are_wider_fainter_and_lean() -> None:
    def weight_and_peak(height: float) -> tuple[float, float]:
        shadow = ground_shadow(np.array([[0.0, 0.0, height]]), ground=0.0, lean=np.zeros(2))
        density = -np.log1p(-shadow.shade)
        return float(density.mean() * shadow.side**2), float(shadow.shade.max())

    (low, sharp), (high, faint) = weight_and_peak(0.5), weight_and_peak(20.0)
    assert low == pytest.approx(DISPLAYED_MODULE_SIZE**2, rel=0.02)
    assert high == pytest.approx(DISPLAYED_MODULE_SIZE**2, rel=0.02)
    assert faint < sharp / 4
    lean = np.array([0.5, -0.25])
    shadow = ground_shadow(np.array([[0.0, 0.0, 4.0]]), ground=0.0, lean=lean)
    assert shadow.middle == pytest.approx(4.0 * lean)


def test_lights_go_with_the_camera() -> None:
    for light in (key_light(VIEW), fill_light(VIEW)):
        assert np.linalg.norm(light) == pytest.approx(1.0)
        assert light @ (VIEW.position - VIEW.target) > 0
    right = np.cross(UPWARDS, VIEW.position)
    assert key_light(VIEW) @ right < 0 < fill_light(VIEW) @ right
