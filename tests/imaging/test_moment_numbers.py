"""The width of a spot step by step: aperture, ring, moments, and the light of others, from either side."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import losbench as lb
from losbench.imaging import moment
from losbench.imaging.aperture import _Aperture, _around, aperture_sigma
from losbench.imaging.moment import (
    _kept_variance,
    _Light,
    _long_arm,
    _matched,
    _square,
    moment_sigma,
    plane_under,
)
from losbench.imaging.ownlight import without_hot, without_others

RNG = np.random.default_rng(57)
MAD = 1.482602218505602


def spot(sigma=2.0, at=(20.0, 20.0), shape=(41, 41), flux=1e4):
    return lb.render_spots([at], flux, sigma, shape)


# The plane under it


def ring_of(shape=(21, 23), half=6):
    ring = np.ones(shape, bool)
    ring[half:-half, half:-half] = False
    return ring


def test_a_plane_goes_through_its_ring_alone():
    ring = ring_of()
    y, x = np.indices(ring.shape)
    truth = 40.0 + 0.7 * x - 0.3 * y
    pixels = np.where(ring, truth, 1e4)
    np.testing.assert_allclose(plane_under(pixels, ring), truth, atol=1e-6)
    pixels[0, 3:6] += 500.0  # a neighbour
    np.testing.assert_allclose(plane_under(pixels, ring), truth, atol=1e-6)


def test_a_plane_is_that_of_least_squares_within_three_scatters():
    """Twice: all, then those within 3 x 1.4826 MAD of the median of what is left over."""
    ring = ring_of()
    y, x = np.indices(ring.shape)
    pixels = RNG.normal(0.0, 2.0, ring.shape) + 0.5 * x
    pixels[1, 1], pixels[2, 20] = 40.0, -30.0
    basis = np.stack([np.ones(ring.sum()), x[ring], y[ring]], axis=-1)
    values, kept = pixels[ring], np.ones(ring.sum(), bool)
    for _ in range(2):
        plane = np.linalg.lstsq(basis[kept], values[kept], rcond=None)[0]
        rest = values - basis @ plane
        rest -= np.median(rest)
        kept = np.abs(rest) <= 3.0 * MAD * np.median(np.abs(rest))
    expected = plane[0] + plane[1] * x + plane[2] * y
    np.testing.assert_allclose(plane_under(pixels, ring), expected, atol=1e-5)


@pytest.mark.parametrize(("count", "sloping"), [(0, False), (5, False), (11, False), (12, True)])
def test_twelve_pixels_tell_a_plane_and_fewer_their_median(count, sloping):
    ring = np.zeros((9, 9), bool)
    ring.ravel()[np.linspace(0, 80, count).astype(int)] = True
    y, x = np.indices(ring.shape)
    pixels = 10.0 + 2.0 * x + y
    found = plane_under(pixels, ring)
    if sloping:
        np.testing.assert_allclose(found, pixels, atol=1e-6)
    else:
        assert (found == (np.median(pixels[ring]) if count else 0.0)).all()


# What lies around its centre


@pytest.mark.parametrize(
    ("centre", "rows", "columns"),
    [
        ((20.4, 10.6), (8, 15), (17, 24)),
        ((1.0, 38.6), (36, 41), (0, 5)),
        ((49.0, 0.4), (0, 4), (46, 50)),
    ],
)
def test_a_square_holds_the_pixels_within_so_many_of_its_middle(centre, rows, columns):
    found = _square(np.zeros((41, 50)), np.array(centre), 3)
    assert [(part.start, part.stop) for part in found] == [rows, columns]


@pytest.mark.parametrize(
    ("half", "ring"), [(2, 9**2 - 5**2), (6, 17**2 - 13**2), (9, 25**2 - 19**2)]
)
def test_the_ring_around_a_square_is_a_third_of_its_half_and_two_pixels_at_least(half, ring):
    y, x = np.indices((61, 61))
    plane = 7.0 + 0.2 * x - 0.1 * y
    light = spot(1.0 if half == 2 else 2.0, (30.0, 31.0), (61, 61), 1e3)
    found = _Light.around(plane + light, np.array([30.2, 30.8]), half)
    assert found.ring == ring
    assert (found.x[0], found.x[-1], found.y[0], found.y[-1]) == (
        30 - half,
        30 + half,
        31 - half,
        31 + half,
    )
    inside = light[31 - half : 32 + half, 30 - half : 31 + half]
    np.testing.assert_allclose(found.light, inside, atol=1.0 if half == 2 else 0.1)


def test_the_error_of_a_moment_is_that_of_its_pixels_and_of_the_level():
    """Of sum(arm light), and of a level that is known to 1 / sqrt(ring)."""
    seen = _Light(np.zeros((5, 7)), np.arange(7.0), np.arange(5.0), 80)
    for square, across in (((seen.x - 3.1) ** 2, 5), ((seen.y - 1.7) ** 2, 7)):
        every = np.repeat(square, across)
        expected = np.sqrt((every**2).sum() + every.sum() ** 2 / 80)
        assert _long_arm(square, seen) == pytest.approx(expected)


# Matched moments


@pytest.mark.parametrize("sigma", [(1.5, 1.5), (1.2, 2.6), (4.0, 3.0)])
@pytest.mark.parametrize("begin", [0.7, 1.0, 1.4])
def test_a_gaussian_is_told_by_the_moments_that_it_weighs_itself(sigma, begin):
    at = np.array([30.3, 26.6])
    light = spot(sigma, at, (61, 61))
    seen = _Light(light, np.arange(61.0), np.arange(61.0), 1)
    found = _matched(seen, at + 0.3, begin * np.array(sigma))
    np.testing.assert_allclose(found, sigma, rtol=0.01)


def test_what_has_no_light_has_no_matched_width():
    arms = np.arange(21.0)
    for light in (np.zeros((21, 21)), -spot(2.0, (10.0, 10.0), (21, 21))):
        seen = _Light(light, arms, arms, 1)
        assert np.isnan(_matched(seen, np.array([10.0, 10.0]), np.array([40.0, 40.0]))).all()


def test_a_matched_width_is_one_that_tells_of_itself():
    """Of a disc, which no Gaussian is."""
    seen = _Light(disc(7.0), np.arange(61.0), np.arange(61.0), 1)
    centre = np.array([30.0, 30.0])
    found = _matched(seen, centre, np.array([2.0, 6.0]))
    np.testing.assert_allclose(_matched(seen, centre, found), found, rtol=0.003)
    line = np.zeros((61, 61))
    line[:, 30] = 100.0
    assert np.isnan(_matched(replace(seen, light=line), centre, np.array([2.0, 2.0]))).all()


# The second moment


def disc(radius, size=61):
    """A disc of so many pixels around the middle, in parts of 8 x 8 of a pixel."""
    fine = (np.arange(8 * size) + 0.5) / 8 - 0.5 - size // 2
    inside = (np.hypot(fine[:, None], fine) <= radius).astype(float)
    return 100.0 * inside.reshape(size, 8, size, 8).mean(axis=(1, 3))


def width_of(signal, first, noise=1e-6):
    return moment_sigma(signal, noise, signal > signal.max() / 2, first)


def test_the_second_moment_is_that_of_a_gaussian_cut_off_at_three_sigma():
    """Of a disc: a quarter of its square, a twelfth for the pixels, and what a Gaussian would
    have lost beyond its window, until that changes by less than 2 %."""
    light = disc(7.0)
    arm = (np.arange(61) - 30.0) ** 2
    square = (light.sum(axis=0) @ arm) / light.sum()
    assert square == pytest.approx(7.0**2 / 4 + 1 / 12, rel=3e-3)
    sigma = 3.4
    while True:
        half = int(np.rint(3.0 * sigma))
        found = np.sqrt(square / _kept_variance(np.array([(half + 0.5) / sigma]))[0] - 1 / 12)
        done, sigma = abs(found - sigma) < 0.02 * sigma, found
        if done:
            break
    assert width_of(light, 3.4) == pytest.approx(sigma, rel=1e-4)


def test_a_width_is_three_fifths_of_the_first_at_least():
    assert width_of(disc(7.0), 7.0) == pytest.approx(4.2)


@pytest.mark.parametrize(
    ("axes", "found"),
    [((2.0, 2.3), 2.15), ((2.3, 2.0), 2.15), ((2.0, 2.5), 2.5), ((2.5, 2.0), 2.5)],
)
def test_a_spot_is_round_up_to_a_ratio_of_one_point_two(axes, found):
    assert width_of(spot(axes), 2.2) == pytest.approx(found, rel=2e-3)


@pytest.mark.parametrize(("errors", "taken"), [(2.7, True), (3.3, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_matched_width_is_taken_within_three_errors_of_the_moment(
    monkeypatch, errors, taken, sign
):
    noise, asked = 0.02, []

    def matched(seen, centre, sigma):
        arm = (seen.x - centre[0]) ** 2
        half = (len(seen.x) - 1) / 2
        kept = _kept_variance(np.array([(half + 0.5) / sigma[0]]))[0] * seen.light.sum()
        asked.append(np.sqrt(sigma**2 + sign * errors * noise * _long_arm(arm, seen) / kept))
        return asked[-1]

    monkeypatch.setattr(moment, "_matched", matched)
    found = width_of(disc(7.0), 3.4, noise)
    assert (found == pytest.approx(asked[0].mean(), rel=1e-6)) == taken


def test_a_faint_spot_has_the_width_that_matches_and_without_one_the_first(monkeypatch):
    """Below twenty errors of its flux."""
    light = spot(1.5, flux=1e3)
    assert width_of(light, 1.7, noise=30.0) == pytest.approx(1.5, rel=0.05)
    monkeypatch.setattr(moment, "_matched", lambda *_: np.full(2, np.nan))
    window = 2 * 5 + 1  # three times 1.7
    for times, faint in ((19.0, True), (21.0, False)):
        noise = light.sum() / times / window
        assert (width_of(light, 1.7, noise) == 1.7) == faint


# Light of others


def test_a_hot_pixel_stands_out_of_its_nine_and_shares_no_light():
    image = spot(flux=5e3).astype(np.float32)
    for height, cross, hot in (
        (4.9, 0.0, False),
        (5.1, 0.0, True),
        (20.0, 0.29, True),
        (20.0, 0.31, False),
    ):
        noise = 3.0
        changed = np.zeros((15, 15), np.float32)
        changed[7, 7] = height * noise
        changed[7, 8] = cross * height * noise
        found = without_hot(changed, noise)
        assert (found[7, 7] == 0.0) == hot
    for level, height, hot in ((10.0, 2 * 10.0 + 14.0, False), (10.0, 2 * 10.0 + 16.0, True)):
        changed = np.full((15, 15), level, np.float32)
        changed[7, 7] = height
        cross = 4 * level < 0.3 * height
        assert (without_hot(changed, 3.0)[7, 7] == level) == (hot and cross)
    np.testing.assert_array_equal(without_hot(image, 1.0), image)


def test_light_beyond_a_dip_is_replaced_by_that_on_the_other_side():
    own, other = spot(), spot(at=(32.0, 20.0))
    centre = np.array([20.0, 20.0])
    found = without_others(own + other, centre, 5.0, 0.5)
    np.testing.assert_allclose(found[:, 27:], own[:, 27:], atol=12.0)
    np.testing.assert_allclose(found[18:23, 30:35], own[18:23, 30:35], atol=0.1)
    np.testing.assert_array_equal(found[:, :20], (own + other)[:, :20])
    assert without_others(own + other, centre, 1e4, 0.5) is not None
    np.testing.assert_array_equal(without_others(own + other, centre, 1e4, 0.5), own + other)
    np.testing.assert_array_equal(without_others(own, centre, 5.0, 0.5), own)


@pytest.mark.parametrize(("dip", "told"), [(0.77, True), (0.83, False)])
def test_a_dip_is_below_eight_tenths_of_what_comes_after_it(dip, told):
    """On a line of squares, seen without noise."""
    light = np.zeros((41, 41))
    light[16:25, 16:25] = 200.0
    light[16:25, 25:31] = dip * 100.0
    light[16:25, 31:38] = 100.0
    found = without_others(light, np.array([20.0, 20.0]), 50.0, 0.0)
    assert (found[20, 34] < 1.0) == told
    noisy = without_others(light, np.array([20.0, 20.0]), 50.0, 20.0)
    assert noisy[20, 34] == 100.0  # not by five noises


# The aperture


def test_pixels_around_a_spot_are_the_mean_of_sixteen_frames():
    stack = RNG.normal(50.0, 3.0, (40, 60, 70))
    stack[:, 20, 31] = np.nan
    stack[3:, 22, 31] = np.nan
    stack[2:, 24, 31] = np.nan  # one of the sixteen frames shows it
    frame = np.arange(40)
    middle = np.tile([30, 20], (40, 1))
    pixels, away = _around(stack, frame, middle, 8, 1)
    some = np.linspace(0, 39, 16).astype(int)
    with np.errstate(invalid="ignore"):
        import warnings

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = np.nanmean(stack[some, 12:29, 22:39], axis=0)
    np.testing.assert_allclose(pixels, expected)
    y, x = np.mgrid[-8:9, -8:9]
    np.testing.assert_array_equal(away, np.maximum(abs(x), abs(y)))
    one, _ = _around(stack, frame[:1], middle[:1], 8, 1)
    np.testing.assert_array_equal(one, stack[0, 12:29, 22:39])


@pytest.mark.parametrize("middle", [(60, 50), (5, 110), (118, 3)])
def test_wide_apertures_see_squares_of_one_frame(middle):
    image = RNG.normal(50.0, 3.0, (2, 121, 131))
    column, row = middle
    pixels, away = _around(image, np.array([1, 0]), np.array([middle, (0, 0)]), 30, 3)
    x = np.arange(max(column - 30, 0), min(column + 31, 131) - 2, 3)
    y = np.arange(max(row - 30, 0), min(row + 31, 121) - 2, 3)
    assert pixels.shape == (len(y), len(x))
    for i, top in enumerate(y):
        for j, left in enumerate(x):
            square = image[1, top : top + 3, left : left + 3]
            assert pixels[i, j] == pytest.approx(square.mean())
            far = max(abs(left + 1 - column), abs(top + 1 - row)) / 3
            assert away[i, j] == pytest.approx(far)


def seen(image, half=10, at=(60, 60)):
    return _Aperture.at(image[None], np.array([0]), np.array([at]), half)


@pytest.mark.parametrize("half", [13, 20])
def test_in_wide_apertures_the_peak_is_that_of_means_of_nine_pixels(half):
    image = spot(3.0, (60.0, 60.0), (121, 121), 3e3)
    image += RNG.normal(50.0, 2.0, image.shape)
    y, x = np.mgrid[-60:61, -60:61]
    away = np.maximum(abs(x), abs(y))
    level = np.median(image[(away > half) & (away <= half + 4)])
    means = ndimage.uniform_filter(image - level, 3, mode="mirror")
    assert seen(image, half).peak == pytest.approx(means[away <= half].max(), rel=1e-4)


def test_an_aperture_has_level_noise_peak_and_core():
    image = spot(3.0, (60.0, 60.0), (121, 121), 3e3)
    image += RNG.normal(50.0, 2.0, image.shape)
    found = seen(image, 12)
    y, x = np.mgrid[-60:61, -60:61]
    away = np.maximum(abs(x), abs(y))
    ring = image[(away > 12) & (away <= 16)]
    level = np.median(ring)
    assert found.noise == pytest.approx(2.0, rel=0.12)
    assert found.peak == pytest.approx((image - level)[away <= 12].max(), rel=1e-6)
    assert (found.bin, found.half, found.darker) == (1, 12, False)
    groups, _ = ndimage.label(image - level > found.peak / 2)
    assert found.core.sum() == (groups == groups[60, 60]).sum()
    assert found.sigma == pytest.approx(2.0 * np.sqrt(found.core.sum() / np.pi) / 2.3548)
    assert found.off <= 2.0 and found.stands_out and not found.outgrown


@pytest.mark.parametrize(("half", "size"), [(10, 1), (40, 1), (79, 1), (80, 2), (120, 3)])
def test_pixels_are_averaged_beyond_forty_of_the_half(half, size):
    image = RNG.normal(50.0, 2.0, (301, 301))
    found = seen(image, half, (150, 150))
    assert found.bin == size and found.half == half / size


@pytest.mark.parametrize(("half", "limit"), [(12, 5.0), (13, 5.0 / 3.0)])
def test_a_spot_stands_out_by_five_noises_or_as_much_of_a_mean_of_nine(half, limit):
    for times, out in ((0.98, False), (1.02, True)):
        found = _Aperture(
            np.zeros((3, 3)), 1, half, 2.0, times * limit * 2.0, 0.0, np.ones((1, 1), bool), False
        )
        assert found.stands_out == out


@pytest.mark.parametrize(("side", "outgrown"), [(15, False), (16, False), (17, True)])
def test_a_core_of_eight_tenths_of_the_half_has_outgrown_it(side, outgrown):
    core = np.zeros((60, 60), bool)
    core[30, 10 : 10 + side] = True  # a line, which has a small area
    for turned in (core, core.T):
        found = _Aperture(np.zeros((60, 60)), 1, 20.0, 1.0, 100.0, 0.0, turned, False)
        assert found.outgrown == outgrown
    assert _Aperture(np.zeros((60, 60)), 1, 20.0, 1.0, 100.0, 0.0, core, True).outgrown


@pytest.mark.parametrize(("area", "outgrown"), [(169, False), (171, True)])
def test_an_aperture_is_three_and_a_fifth_sigma_wide_at_least(area, outgrown):
    """20 pixels of the half: sigma 6.25, 170.2 pixels above half of the peak."""
    core = np.zeros((60, 60), bool)
    core[20:33, 20:33] = True
    core.ravel()[np.flatnonzero(~core.ravel())[: area - 169]] = area > 169
    core[33, 20:22] = area > 169
    core[:20] = False
    assert core.sum() == area
    found = _Aperture(np.zeros((60, 60)), 1, 20.0, 1.0, 100.0, 0.0, core, False)
    assert found.outgrown == outgrown


@pytest.mark.parametrize(("away", "known"), [(9, True), (15, False)])
def test_what_stands_out_more_than_ten_pixels_away_is_another(away, known):
    image = spot(1.5, (60.0 + away, 60.0), (121, 121), 3e3)
    image += np.random.default_rng(2).normal(50.0, 1.0, image.shape)
    found = aperture_sigma(image[None], np.array([0]), np.array([[60, 60]]))
    assert np.isfinite(found) == known


@pytest.mark.parametrize(("away", "known"), [(16, True), (20, False)])
def test_a_wide_spot_is_known_from_one_and_a_half_sigma_away(away, known):
    """Sigma 12, of which 18 pixels are one and a half."""
    image = lb.render_spots([[100.0 + away, 100.0]], 1e6, 12.0, (201, 221))
    image += np.random.default_rng(2).normal(50.0, 1.0, image.shape)
    found = aperture_sigma(image[None], np.array([0]), np.array([[100, 100]]))
    assert np.isfinite(found) == known
    if known:
        assert found == pytest.approx(12.0, rel=0.03)
