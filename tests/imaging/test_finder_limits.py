"""Comparisons of the finder in every type of number, at every border, in every strip."""

import numpy as np
import pytest
from scipy import ndimage

import losbench as lb
from losbench.imaging import finder
from losbench.imaging.finder import _above_level, _above_mesh, _beside, _image
from losbench.imaging.pattern import FLAT, Pattern
from losbench.imaging.sky import Sky

RNG = np.random.default_rng(91)


def flat(level, noise):
    ends = np.array([0.0, 1.0])
    return Sky(np.full((2, 2), level), np.full((2, 2), noise), ends, ends, FLAT)


def range_of(dtype):
    return np.iinfo(dtype) if np.dtype(dtype).kind in "ui" else np.iinfo(np.int16)


@pytest.mark.parametrize("rows", [1, 8, 9, 30])
@pytest.mark.parametrize(
    ("dtype", "level"),
    [
        (dtype, level)
        for dtype in (np.uint8, np.int8, np.uint16, np.int32, np.float32, float)
        for level in (-300.0, 20.0, 20.5, 100.0, 126.0, 254.0, 300.0)
        if level >= range_of(dtype).min
    ],
)
def test_pixels_above_a_level_are_those_that_are_greater(dtype, rows, level):
    """By so many noises, however the numbers are stored."""
    ends = range_of(dtype)
    pixels = RNG.integers(max(ends.min, -300), min(ends.max, 300), (rows, 11), endpoint=True)
    pixels = pixels.astype(dtype)
    bands = np.array([pixels[k : k + 8].max() for k in range(0, rows, 8)])
    found = _above_level(pixels, bands, flat(level - 9.0, 1.5), 6.0)
    np.testing.assert_array_equal(found, np.flatnonzero(pixels.astype(float) > level))


def test_pixels_above_their_own_level_are_found_in_every_strip(monkeypatch):
    pixels = RNG.normal(100.0, 30.0, (37, 20))
    row, column = np.array([0.0, 15.0, 36.0]), np.array([0.0, 9.0, 19.0])
    pattern = Pattern(np.array([[1.0, -2.0], [3.0, -2.0]]), np.array([7.0, -4.0]), (18.0, 10.0))
    sky = Sky(100.0 + RNG.random((3, 3)), 5.0 + RNG.random((3, 3)), row, column, pattern)
    expected = np.flatnonzero(pixels > sky.cut(4.0, 0, 37, 20))
    for strip in (1, 20, 100, 10_000):
        monkeypatch.setattr(finder, "_STRIP", strip)
        np.testing.assert_array_equal(_above_mesh(pixels, sky, 4.0), expected)


@pytest.mark.parametrize("border", ["top", "bottom", "left", "right"])
def test_one_pixel_at_a_border_has_no_light_beyond_it(border):
    """Beside others that lie within."""
    pixels, level = RNG.random((7, 9)) + 1.0, 0.25
    row, column = np.array([3, 4, 2]), np.array([4, 3, 6])
    at = {"top": (0, 4), "bottom": (6, 4), "left": (3, 0), "right": (3, 8)}[border]
    row[1], column[1] = at
    plus = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    times = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]])
    found = _beside(pixels, row, column, np.full(3, level))
    for got, kernel in zip(found, (plus, times), strict=True):
        expected = ndimage.convolve(pixels - level, kernel, mode="constant")[row, column]
        np.testing.assert_allclose(got, expected)


@pytest.mark.parametrize("level", [-500.0, 500.0])
def test_unread_pixels_are_like_the_sky_wherever_that_is(level):
    image = RNG.normal(level, 2.0, (60, 80))
    image[RNG.random(image.shape) < 0.05] = np.nan
    assert not len(lb.find_spots(image))
    filled = _image(image, 0.0)
    seen = np.isfinite(image)
    np.testing.assert_array_equal(filled[seen], image[seen])
    assert (filled[~seen] == np.median(image[seen])).all()
    assert not _image(np.full((5, 6), np.nan), 0.0).any()


def test_smoothing_is_by_a_gaussian_of_that_width():
    image = RNG.random((40, 50)).astype(np.float32)
    expected = ndimage.gaussian_filter(image, 1.5, mode="mirror", truncate=5.0)
    np.testing.assert_allclose(_image(image, 1.5), expected, atol=2e-3)
    assert _image(image, 0.0) is image


def test_a_spot_is_the_centre_of_mass_of_its_bright_pixels():
    image = np.zeros((40, 50))
    image[10:13, 20:24] = np.array([[9.0, 12, 10, 9], [11, 40, 30, 10], [9, 10, 12, 9]])
    sky = flat(0.0, 1.0)
    bright = np.flatnonzero(image > 8.0)
    ((x, y, light, peak),) = finder._spots(image, bright, sky)
    row, column = np.nonzero(image)
    weight = image[row, column]
    assert (light, peak) == (weight.sum(), 40.0)
    assert x == pytest.approx((weight * column).sum() / light)
    assert y == pytest.approx((weight * row).sum() / light)
    raised = finder._spots(image + 5.0, bright, flat(5.0, 1.0))
    np.testing.assert_allclose(raised, [[x, y, light, peak]])
    assert finder._spots(image, bright[:0], sky).shape == (0, 4)
