"""The bound of a smeared star, against its Fisher information over a frame that holds it all."""

import numpy as np
import pytest

import losbench as lb

CAMERA = lb.Camera(focal_mm=36.6, pixel_um=10.0, shape=(120, 140))
REST = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.0, 0.0]), 0.025)


def by_differences(at, flux, sigma, detector, background):
    """Errors of x and y by the information of place and flux, with slopes by central differences."""
    step = 1e-4

    def light(dx, dy):
        return lb.render_spots([[at[0] + dx, at[1] + dy]], 1.0, sigma, CAMERA.shape)

    by_x = (light(step, 0.0) - light(-step, 0.0)) / (2.0 * step)
    by_y = (light(0.0, step) - light(0.0, -step)) / (2.0 * step)
    image = light(0.0, 0.0)
    dark = max(
        float(detector.variance_dn(background)), float(detector.variance_dn(detector.offset_dn))
    )
    variance = flux * image / detector.gain_e_per_dn + dark
    columns = np.stack([flux * by_x, flux * by_y, image]).reshape(3, -1)
    return np.sqrt(np.diag(np.linalg.inv(columns / variance.ravel() @ columns.T))[:2])


@pytest.mark.parametrize("sigma", [(0.5, 3.0), (3.0, 0.5), (1.2, 1.2)])
@pytest.mark.parametrize(("flux", "background"), [(1e5, 0.0), (300.0, 0.0), (300.0, 400.0)])
def test_the_bound_of_a_star_at_rest_is_that_of_its_pixels(sigma, flux, background):
    detector = lb.Detector(gain_e_per_dn=1.5, read_noise_e=6.0, offset_dn=100.0)
    at = [60.3, 55.2]
    found = lb.streak_bound(
        [at], flux, path=REST, camera=CAMERA, width=sigma, detector=detector, background=background
    )
    expected = by_differences(at, flux, sigma, detector, background)
    np.testing.assert_allclose(found[0], expected, rtol=1e-4)


def test_stars_in_blocks_have_the_bounds_that_they_have_alone():
    xy = np.random.default_rng(3).uniform(20.0, 100.0, (520, 2))
    options = {"path": REST, "camera": CAMERA, "width": 0.8, "detector": lb.Detector()}
    together = lb.streak_bound(xy, np.linspace(1e3, 1e5, 520), **options)
    for k in (0, 511, 512, 519):
        alone = lb.streak_bound(xy[[k]], np.linspace(1e3, 1e5, 520)[k], **options)
        np.testing.assert_allclose(together[k], alone[0], rtol=1e-9)


def test_a_bound_is_asked_for_with_a_detector():
    with pytest.raises(ValueError, match="detector must be a Detector, got None"):
        lb.streak_bound([[60.0, 50.0]], 1e3, path=REST, camera=CAMERA, width=1.0)
