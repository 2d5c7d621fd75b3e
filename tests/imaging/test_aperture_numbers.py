"""The aperture of a width, number by number: how it grows, what it takes for level and noise, and
when it is darker far away."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import aperture
from losbench.imaging.aperture import _Aperture, _around, aperture_sigma

MIDDLE = 60
Y, X = np.mgrid[-60:61, -60:61]
AWAY = np.maximum(abs(X), abs(Y))
MAD = 1.482602218505602


def seen(image, half=12, at=(MIDDLE, MIDDLE)):
    return _Aperture.at(image[None], np.array([0]), np.array([at]), half)


def noisy(seed=1, noise=2.0, level=50.0):
    return np.random.default_rng(seed).normal(level, noise, AWAY.shape)


# How it grows


@pytest.mark.parametrize(
    ("shape", "halves"),
    [
        ((8, 9), [10]),
        ((10, 10), [10]),
        ((11, 8), [10, 17]),
        ((17, 17), [10, 17]),
        ((18, 18), [10, 17, 29]),
        ((40, 60), [10, 17, 29, 50, 85]),
    ],
)
def test_an_aperture_grows_by_seventeen_tenths_until_it_is_as_large_as_the_frame(
    monkeypatch, shape, halves
):
    asked, standing = [], _Aperture.at

    def at(stack, frame, middle, half):
        asked.append(half)
        return standing(stack, frame, middle, half)

    monkeypatch.setattr(aperture._Aperture, "at", at)
    frame = np.full((1, *shape), 7.0)
    assert np.isnan(aperture_sigma(frame, np.array([0]), np.array([[4, 4]])))
    assert asked == halves


@pytest.mark.parametrize(("half", "side"), [(10, 61), (17, 93), (29, 147)])
def test_what_is_looked_at_is_two_and_a_quarter_as_wide_and_twice_the_ring(half, side):
    assert seen(np.ones((161, 161)), half, (80, 80)).signal.shape == (side, side)


def test_frames_are_averaged_from_two_on():
    stack = np.stack([noisy(1), noisy(2), noisy(3)])
    for count in (1, 2, 3):
        pixels, _ = _around(stack, np.arange(count), np.full((count, 2), MIDDLE), 5, 1)
        expected = stack[:count, 55:66, 55:66].mean(axis=0)
        np.testing.assert_allclose(pixels, expected)


# Level and noise


def test_the_ring_is_four_pixels_outside_the_aperture():
    level = np.where(AWAY <= 12, 500.0, np.where(AWAY <= 16, 40.0, 60.0))
    image = level + np.where((X + Y) % 2, 1.0, -1.0)
    found = seen(image)
    assert found.peak == pytest.approx(461.0, abs=1.01)
    assert found.noise == pytest.approx(MAD, rel=0.02)


def test_a_gradient_is_no_noise():
    image = noisy() + 3.0 * X - 2.0 * Y
    assert seen(image).noise == pytest.approx(2.0, rel=0.12)
    flat = seen(3.0 * X - 2.0 * Y + 0.0)
    assert flat.noise < 1e-3


def test_noise_that_half_of_a_ring_does_not_have_is_a_third_of_its_mean_deviation():
    """Of quiet whole numbers: one of four differs by 6."""
    image = np.full(AWAY.shape, 50.0)
    image[::2, ::2] += 6.0
    away = np.abs(image - 50.0)[(AWAY > 12) & (AWAY <= 16)]
    assert np.median(away) == 0.0
    # The plane through those that are alike is theirs.
    assert seen(image).noise == pytest.approx(away.mean() / 3.0, rel=1e-6)


def test_without_a_ring_the_level_is_that_of_all_that_was_read():
    image = np.full(AWAY.shape, np.nan)
    image[55:66, 55:66] = 40.0 + np.arange(121.0).reshape(11, 11)
    found = seen(image)
    assert found.peak == 60.0 and not found.darker
    spread = np.abs(np.arange(121) - 60.0)
    assert found.noise == pytest.approx(MAD * np.median(spread))
    nothing = seen(np.full(AWAY.shape, np.nan))
    assert (nothing.noise, nothing.peak, nothing.stands_out) == (0.0, 0.0, False)


# Darker far away


@pytest.mark.parametrize(("first", "darker"), [(32, True), (33, False)])
def test_far_away_is_beyond_twice_the_aperture_and_a_ring(first, darker):
    """From 29 pixels to 35; the median of the outer four is that of all."""
    image = np.where(first <= AWAY, 50.0, 100.0)
    image[MIDDLE, MIDDLE] = 150.0
    assert seen(image).darker == darker


@pytest.mark.parametrize(("step", "darker"), [(49.0, False), (51.0, True)])
def test_far_away_is_darker_by_a_twentieth_of_the_peak(step, darker):
    """Where there is no noise; above the level of the ring."""
    image = np.where(AWAY > 28, 500.0 - step, 500.0)
    image[58:63, 58:63] = 1500.0
    assert seen(image).darker == darker


@pytest.mark.parametrize(("share", "darker"), [(0.97, False), (1.03, True)])
def test_far_away_is_darker_by_five_errors_of_two_medians(share, darker):
    """Each 1.25 noises over the root of its pixels."""
    image = noisy()
    ring, far = (AWAY > 12) & (AWAY <= 16), (AWAY > 28) & (AWAY <= 35)
    error = 1.25 * seen(image).noise * np.sqrt(1.0 / ring.sum() + 1.0 / far.sum())
    image[far] += np.median(image[ring]) - np.median(image[far]) - share * 5.0 * error
    assert seen(image).darker == darker


def test_one_pixel_far_away_tells_as_little_as_it_can():
    image = noisy()
    image[AWAY > 28] = np.nan
    ring = image[(AWAY > 12) & (AWAY <= 16)]
    assert not seen(image).darker
    error = 1.25 * seen(image).noise * np.sqrt(1.0 / ring.size + 1.0)
    for share, darker in ((0.98, False), (1.02, True)):
        image[MIDDLE + 30, MIDDLE] = np.median(ring) - share * 5.0 * error
        assert seen(image).darker == darker


# What stands in it


def test_a_spot_is_what_hangs_together_above_half_of_the_peak():
    image = np.full(AWAY.shape, 50.0)
    image[60, 58:63] = 1050.0
    image[61:64, 62] = 560.0
    image[64, 63] = 1000.0  # at a corner
    image[57:60, 58] = 540.0
    found = seen(image)
    assert (found.peak, found.off) == (1000.0, 2.0)
    assert found.core.sum() == 8 and not found.core[:35].any() and not found.core[39:].any()


@pytest.mark.parametrize(("away", "inside"), [(12, True), (13, False)])
def test_a_peak_is_within_the_aperture(away, inside):
    image = noisy(noise=0.5)
    image += lb.render_spots([[MIDDLE + away, MIDDLE]], 2e4, 0.8, AWAY.shape)
    assert seen(image).off == 12
    assert seen(image).peak == pytest.approx(image[60, 72] - 50.0, abs=0.2)
    assert (image.max() == image[60, 72]) == inside


def test_the_sharpest_spot_has_the_width_of_one_pixel():
    image = noisy(noise=0.01)
    image[MIDDLE, MIDDLE] += 10.0
    image[MIDDLE, MIDDLE + 1] += 3.1
    found = seen(image, 10)
    assert found.core.sum() == 1
    assert found.sigma == pytest.approx(2.0 / np.sqrt(np.pi) / 2.3548)
