"""Readings in another unit: places, errors and flags stay the same to the last bit, light and level
are in that unit. Powers of two round nothing.
"""

import numpy as np
import pytest

import losbench as lb

SHAPE = (90, 130)
PLACES = np.array(
    [[30.2, 30.4], [64.7, 28.3], [99.1, 31.6], [28.4, 63.8], [66.2, 61.9], [101.3, 58.7]]
)


def scene(noise=0.02, seed=11):
    """A clean spot, two that crowd, one with a hot pixel, one faint, one of another shape, one with
    a bright row: a few units of light at most.
    """
    image = lb.render_spots(PLACES, [60.0, 60.0, 60.0, 1.0, 40.0, 60.0], 1.6, SHAPE)
    image += lb.render_spots([[70.6, 28.1]], 30.0, 1.6, SHAPE)
    image[33, 101] += 1.5
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    image += 1.2 * np.clip(4.5 - np.hypot(x - 66.2, y - 61.9), 0.0, 1.0)
    image[60, 96:108] += 0.6
    image += 0.3 + 0.002 * x
    return image + np.random.default_rng(seed).normal(0.0, noise, (3, *SHAPE))


@pytest.mark.parametrize("unit", [2.0**-30, 2.0**12])
@pytest.mark.parametrize(
    ("method", "frames"),
    [
        *(("auto", 1), ("auto", 3), ("eiwa", 1), ("grey", 3)),
        *(("weighted", 3), ("likelihood", 1), ("gaussian", 3)),
    ],
)
def test_centroids_do_not_depend_on_the_unit_of_readings(method, frames, unit):
    stack = scene()[:frames]
    one, other = (lb.centroid(k * stack, PLACES.round(), method=method) for k in (1.0, unit))
    assert (one.flags > 0).any() and np.isfinite(one.xy).any()
    for name in ("xy", "sigma_xy", "n_iter", "flags", "n_bad", "width_px", "window"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    for name in ("flux", "background"):
        np.testing.assert_array_equal(unit * getattr(one, name), getattr(other, name), err_msg=name)
    assert type(one.method) is type(other.method)
    assert (unit * one.noise.per_dn, one.noise.known) == (other.noise.per_dn, other.noise.known)


@pytest.mark.parametrize("unit", [2.0**-30, 2.0**12])
def test_spots_that_are_found_do_not_depend_on_the_unit_of_readings(unit):
    for image in (scene()[0], scene()[0][:32, :32], scene()[0] + np.linspace(0.0, 9.0, 130)):
        one, other = lb.find_spots(image), lb.find_spots(unit * image)
        assert len(one)
        np.testing.assert_array_equal(one, other)
