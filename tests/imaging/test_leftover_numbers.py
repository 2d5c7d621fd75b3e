"""What a template of the spots themselves leaves over, from either side of each number."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.leftover import bad_pixels, unlike
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows

SIDE, FLOOR = 13, 9.0
INNER = np.s_[:, 1:-1, 1:-1]


def light_of(flux=4e4, sigma=2.0):
    return lb.render_spots([[SIDE // 2, SIDE // 2]], flux, sigma, (SIDE, SIDE))[None]


def windows_of(pixels, per_dn=0.0, floor=FLOOR, level_variance=0.0):
    count = len(pixels)
    plane = np.tile([level_variance, 0.0, 0.0], (count, 1))
    noise = PixelNoise(np.full(count, floor), per_dn, plane)
    zeros = np.zeros((count, 2))
    signal = np.pad(pixels, ((0, 0), (1, 1), (1, 1)))
    return Windows(signal, SIDE, zeros, zeros.astype(int), noise, zeros + 2.0)


# Bad pixels


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("place", [(6, 6), (0, 6), (12, 12), (3, 8)])
def test_a_pixel_is_bad_by_5_5_errors_where_the_noise_of_light_is_known(place, sign):
    """Of floor, shot noise, and 3 % of its light."""
    light = light_of()
    reading = light[0][place]
    error = np.sqrt(FLOOR + 0.5 * reading + (0.03 * reading) ** 2)
    for errors, bad in ((5.45, False), (5.55, True)):
        pixels = light.copy()
        pixels[0][place] += sign * errors * error
        found = bad_pixels(windows_of(pixels, 0.5), light, None)[0]
        assert found[place] == bad and found.sum() == bad


@pytest.mark.parametrize("place", [(0, 6), (12, 12), (1, 2)])
def test_a_pixel_is_bad_by_six_errors_where_it_is_not(place):
    """The spot itself tells it, of all its pixels by their light: nothing, if it fits."""
    light = light_of(sigma=1.2)
    for errors, bad in ((5.95, False), (6.05, True)):
        pixels = light.copy()
        pixels[0][place] += errors * np.sqrt(FLOOR + (0.03 * light[0][place]) ** 2)
        found = bad_pixels(windows_of(pixels), light, None)[0]
        assert found[place] == bad and found.sum() == bad


@pytest.mark.parametrize("masked", [False, True])
def test_the_noise_of_light_is_told_by_what_is_left_over_where_it_shines(masked):
    light, place = light_of(), (2, 9)
    rest = np.random.default_rng(4).normal(0.0, np.sqrt(FLOOR + 3.0 * light))
    kept = None
    if masked:
        kept = np.ones_like(light)
        kept[0, 6, 6] = 0.0
        rest[0, 6, 6] = 5e3
    rest[0][place] = 0.0
    weight = light if kept is None else light * kept
    beside = rest.copy()
    for size in np.linspace(20.0, 120.0, 80):
        beside[0][place] = size
        told = max(((beside**2 - FLOOR) * weight).sum() / (light * weight).sum(), 0.0)
        variance = FLOOR + (0.03 * light[0][place]) ** 2 + told * light[0][place]
        errors = size / np.sqrt(variance)
        if not 5.9 < errors < 6.1:
            found = bad_pixels(windows_of(light + beside), light, kept)[0]
            assert found[place] == (errors > 6.0)
            assert not found[6, 6]


def test_pixels_that_are_not_kept_are_not_bad_and_have_no_part():
    light, kept = light_of(), np.ones((1, SIDE, SIDE))
    pixels = light.copy()
    pixels[0, 3, 3], kept[0, 3, 3] = 1e5, 0.0
    for per_dn in (0.0, 0.5):
        assert not bad_pixels(windows_of(pixels, per_dn), light, kept).any()
        assert bad_pixels(windows_of(pixels, per_dn), light, None)[0, 3, 3]
        other = pixels.copy()
        other[0, 9, 9] += 500.0
        found = bad_pixels(windows_of(other, per_dn), light, kept)
        assert np.argwhere(found[0]).tolist() == [[9, 9]]


def test_a_wrong_shape_and_pixels_without_noise_are_not_bad():
    light = light_of()
    assert not bad_pixels(windows_of(light + 200.0, 0.5), light, None).any()
    dark = np.zeros((2, SIDE, SIDE))
    dark[0, 4, 4] = 3.0
    assert not bad_pixels(windows_of(dark, floor=0.0), np.zeros_like(dark), None).any()
    assert not bad_pixels(windows_of(dark, floor=0.0), -np.ones_like(dark), None).any()
    both = np.concatenate([light, light])
    both[1, 2, 2] += 900.0
    found = bad_pixels(windows_of(both, 0.5), np.concatenate([light, light]), None)
    assert np.argwhere(found).tolist() == [[1, 2, 2]]


# Light that is not like it


def is_unlike(pixels, light, *, kept=None, own=0.0, **noise):
    return bool(unlike(windows_of(pixels, **noise), light, kept, np.array([own]))[0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("masked", [False, True])
def test_a_window_is_unlike_by_a_tenth_of_its_light_and_five_errors_in_all(sign, masked):
    """Where the noise of the light is not known; of the pixels that are kept and of their level."""
    light = light_of()
    kept = (np.random.default_rng(5).random(light.shape) < 0.7).astype(float) if masked else None
    use = np.ones_like(light) if kept is None else kept
    error = np.sqrt(FLOOR * use.sum() + use.sum() ** 2 * 0.25)
    for factor, told in ((0.995, False), (1.005, True)):
        # |share| light = 0.1 (1 + share) light + 5 errors
        limit = (0.1 + 5.0 * error / (light * use).sum()) / (1.0 - sign * 0.1)
        pixels = light * (1.0 + sign * factor * limit)
        assert is_unlike(pixels, light, kept=kept, level_variance=0.25) == told


def test_a_window_without_light_of_its_own_is_unlike():
    light = light_of()
    assert is_unlike(-light, light) and is_unlike(np.zeros_like(light), light)
    assert not is_unlike(light, light) and not is_unlike(light, light, per_dn=0.5)


@pytest.mark.parametrize("own", [0.0, 0.3])
@pytest.mark.parametrize("masked", [False, True])
def test_a_window_is_unlike_by_five_errors_of_all_squares(own, masked):
    """Where the noise is known: those exceed the variances of pixel and template by five times
    the root of twice their squares."""
    light, per_dn = light_of(flux=300.0), 0.5
    kept = (np.random.default_rng(5).random(light.shape) < 0.7).astype(float) if masked else None
    use = np.ones_like(light) if kept is None else kept
    variance = FLOOR + per_dn * light
    board = np.where(np.indices(light.shape).sum(axis=0) % 2, 1.0, -1.0)
    chance = np.sqrt(2.0 * (variance**2 * use).sum())
    for errors, told in ((4.95, False), (5.05, True)):
        square = (1.0 + own) * (variance * use).sum() + errors * chance
        rest = board * np.sqrt(square / (variance * use).sum() * variance)
        assert is_unlike(light + rest, light, kept=kept, own=own, per_dn=per_dn) == told


@pytest.mark.parametrize(("share", "told"), [(0.0295, False), (0.0305, True)])
def test_a_window_is_unlike_by_three_hundredths_of_its_light(share, told):
    """Of that of the template, pixel by pixel, beyond the noise."""
    light, per_dn = light_of(flux=4e6), 1e-6
    board = np.where(np.indices(light.shape).sum(axis=0) % 2, 1.0, -1.0)
    variance = FLOOR + per_dn * light
    square = (share * light) ** 2 + variance
    assert is_unlike(light + board * np.sqrt(square), light, per_dn=per_dn) == told
    assert not is_unlike(light + board * np.sqrt(square), light)
