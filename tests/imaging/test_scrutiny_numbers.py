"""What stands out of a template, number by number, from either side: pixels, rows, columns, light on
one side of a spot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import losbench as lb
from losbench.imaging import scrutiny
from losbench.imaging.neighbours import lopsided, turned
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Estimate, Windows
from losbench.imaging.scrutiny import (
    Looked,
    _beyond_shot_noise,
    _lines,
    _rest,
    asks,
    dead_pixels,
    filled,
    lone_pixels,
    look_into,
    unexplained,
)
from losbench.imaging.template import TemplateFit, fit_template

SIDE, FLOOR, FLUX = 13, 9.0, 4e4


def light_of(sigma=2.0, at=(0.0, 0.0), side=SIDE + 2, flux=FLUX):
    return lb.render_spots([np.array(at) + side // 2], flux, sigma, (side, side))


def windows_of(*signals, per_dn=0.0, kept=None, floor=FLOOR, width=2.0):
    signal = np.stack(signals)
    count = len(signal)
    noise = PixelNoise(np.full(count, floor), per_dn, np.zeros((count, 3)))
    zeros = np.zeros((count, 2))
    return Windows(
        signal,
        signal.shape[1] - 2,
        zeros,
        zeros.astype(int),
        noise,
        zeros + width,
        kept,
        leave=4.0,
    )


def fit_of(count=1, sigma=2.0, flux=FLUX, at=(0.0, 0.0)):
    return TemplateFit(
        np.tile(np.array(at, float), (count, 1)),
        np.full((count, 2), sigma),
        np.full(count, flux),
        np.ones((count, 3)),
        np.ones(count, int),
        np.ones(count, bool),
    )


def estimate_of(*, width=None, at=(0.0, 0.0), count=1):
    return Estimate(
        np.tile(np.array(at), (count, 1)),
        np.ones((count, 2)),
        np.full(count, FLUX),
        np.ones(count),
        np.ones(count, int),
        np.ones(count, bool),
        np.zeros((count, 2)),
        np.zeros(count, bool),
        np.zeros(count, bool),
        None if width is None else np.full((count, 2), width),
    )


# Who is asked


@pytest.mark.parametrize(("per_dn", "sure"), [(0.0, 6.0), (0.5, 5.5)])
@pytest.mark.parametrize("place", [(7, 7), (3, 8), (1, 1), (13, 13)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pixel_asks_for_a_look_by_5_5_errors_or_6_where_the_shot_noise_is_not_known(
    per_dn, sure, place, sign
):
    """A template may be wrong by 3 % of its light in every pixel."""
    light = light_of()
    error = np.sqrt(FLOOR + per_dn * light[place] + (0.03 * light[place]) ** 2)
    for errors, asked in ((sure - 0.05, False), (sure + 0.05, True)):
        signal = light.copy()
        signal[place] += sign * errors * error
        assert asks(windows_of(signal, per_dn=per_dn), estimate_of(width=2.0)).tolist() == [asked]
    masked = np.ones((1, *signal.shape))
    masked[0][place] = 0.0
    assert not asks(windows_of(signal, kept=masked), estimate_of(width=2.0)).any()


@pytest.mark.parametrize("place", [(0, 7), (14, 3), (5, 0), (5, 14)])
def test_the_margin_of_a_window_asks_for_nothing(place):
    signal = light_of()
    signal[place] += 1e4
    assert not asks(windows_of(signal), estimate_of(width=2.0)).any()


@pytest.mark.parametrize(("per_dn", "sure"), [(0.0, 6.0), (0.5, 5.5)])
@pytest.mark.parametrize("place", [(7, 9), (3, 8), (10, 12), (0, 7)])
@pytest.mark.parametrize("sigma", [0.8, 1.2, 2.0])
def test_without_a_template_a_spot_is_compared_with_itself_turned(per_dn, sure, place, sigma):
    """Two pixels are compared, so that the variance is twice that of one; the light between pixels
    may be wrong by 0.37 of what the middle pixel holds of it, and by 3 % at least."""
    light = light_of(sigma)
    reading = light[place]
    wrong = max(0.37 * light[7, 7] / FLUX, 0.03)
    for change in np.linspace(0.0, 900.0, 91):
        top = reading + change
        variance = 2.0 * (FLOOR + per_dn * top + (wrong * top) ** 2)
        signal = light.copy()
        signal[place] += change
        margin = change**2 / (sure**2 * variance)
        if not 0.98 < margin < 1.02:
            asked = asks(windows_of(signal, per_dn=per_dn), estimate_of())
            assert asked.tolist() == [margin > 1.0]


def test_a_window_without_a_centroid_is_compared_about_its_middle():
    light = light_of()
    assert not asks(windows_of(light), estimate_of(at=(np.nan, np.nan))).any()
    assert asks(windows_of(light), estimate_of(at=(2.0, 0.0))).all()


# What a moment may leave out


def looked_of(places, column=None, second=None):
    kept, lines = np.ones((1, SIDE + 2, SIDE + 2)), np.zeros((1, SIDE + 2, SIDE + 2), bool)
    for place in places:
        kept[0][place] = 0.0
    for line in (column, second):
        if line is not None:
            kept[0, :, line], lines[0, :, line] = 0.0, True
    return Looked(kept, lines, np.ones(1, int), fit_of(), np.ones(1, bool))


@pytest.mark.parametrize(
    ("places", "column", "second", "sparse"),
    [
        ([(3, 3), (3, 4)], None, None, True),  # a pair
        ([(3, 3), (3, 4), (4, 4)], None, None, False),  # three side by side
        ([(1, 1), (3, 3), (7, 7), (11, 11)], None, None, True),  # four of 225: 2 %
        ([(1, 1), (3, 3), (7, 7), (11, 11), (1, 9)], None, None, False),
        ([], 5, None, True),
        ([(3, 3), (9, 9)], 5, None, True),
        ([(3, 3), (9, 9), (3, 11)], 5, None, False),
        ([], 5, 9, False),
    ],
)
def test_few_pixels_by_themselves_or_one_line_are_left_out_of_a_moment(
    places, column, second, sparse
):
    assert looked_of(places, column, second).sparse.tolist() == [sparse]


def test_what_is_left_out_is_filled_by_the_template_and_the_other_side():
    """A Gaussian template under a spot half as bright again: the rest is that of the other side."""
    light, bad = 1.5 * light_of(), (4, 9)
    signal = light.copy()
    signal[bad] = -500.0
    windows = windows_of(signal)
    assert filled(windows, looked_of([bad]))[0] == pytest.approx(light, rel=1e-6)
    both = filled(windows, looked_of([bad, (10, 5)]))[0]
    assert both[bad] == pytest.approx(light_of()[bad], rel=1e-6)


# Turned images


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.25, -0.4), (-1.0, 0.5)])
@pytest.mark.parametrize("size", [9, 12])
def test_an_image_turned_about_its_centre_is_linear_between_pixels(centre, size):
    image = np.random.default_rng(3).random((size, size))
    middle = size // 2 + np.array(centre)
    row, column = np.indices(image.shape)
    at = [2.0 * middle[1] - row, 2.0 * middle[0] - column]
    expected = map_coordinates(np.pad(image, 9), [a + 9 for a in at], order=1)
    np.testing.assert_allclose(turned(image[None], np.array([centre]))[0], expected, atol=1e-12)


# Single pixels


def rest_with(*places, size=15):
    rest = np.zeros((1, size, size))
    for (row, column), value in places:
        rest[0, row, column] = value
    return rest


def stands_out(rest, row, column):
    return bool(lone_pixels(rest)[0, row, column])


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("place", [(7, 7), (0, 7), (14, 14), (3, 0)])
def test_a_pixel_stands_out_by_5_5_errors(sign, place):
    for errors, out in ((5.45, False), (5.55, True)):
        assert stands_out(rest_with((place, sign * errors)), *place) == out


@pytest.mark.parametrize(("share", "out"), [(0.49, False), (0.51, True)])
def test_a_pixel_stands_out_half_as_much_as_the_worst_of_the_window(share, out):
    rest = rest_with(((3, 3), 40.0), ((10, 10), share * 40.0))
    assert stands_out(rest, 3, 3) and stands_out(rest, 10, 10) == out
    for margin in ((0, 3), (14, 3), (3, 0), (3, 14)):  # none of it is the worst
        assert stands_out(rest_with((margin, 1e3), ((10, 10), 20.0)), 10, 10)
    for inner in ((1, 3), (13, 3), (3, 1), (3, 13)):
        assert not stands_out(rest_with((inner, 1e3), ((10, 10), 20.0)), 10, 10)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_all_nine_neighbours_leave_over_is_the_shape(sign):
    rest = np.full((1, 15, 15), sign * 4.0)
    for errors, out in ((9.9, False), (10.1, True), (-1.4, False), (-1.6, True)):
        rest[0, 7, 7] = sign * errors
        assert stands_out(rest, 7, 7) == out
    rest[0] = sign * 6.0
    rest[0, 7, 7] = -sign * 0.5
    assert stands_out(rest, 7, 7)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("third", "out"), [(7.9, True), (8.1, False)])
def test_a_pixel_is_two_and_a_half_times_the_third_of_its_neighbours(sign, third, out):
    """One neighbour may be as bad; light of another spot is less pointed."""
    rest = rest_with(((7, 7), sign * 20.0), ((7, 8), sign * 20.0), ((6, 6), sign * third))
    assert stands_out(rest, 7, 7) == out
    assert stands_out(rest_with(((7, 7), sign * 20.0), ((6, 6), sign * 19.0)), 7, 7)


def lacks(*places, at=(0.0, 0.0), sigma=2.0):
    """Which pixels are dead of a spot that lacks so much of its light at places (row, column)."""
    signal = light_of(sigma, at)
    for (row, column), share in places:
        signal[row, column] *= 1.0 - share
    return np.argwhere(dead_pixels(windows_of(signal), fit_of(sigma=sigma, at=at))[0]).tolist()


@pytest.mark.parametrize("place", [(7, 5), (4, 9), (0, 3), (14, 14)])
def test_a_dead_pixel_lacks_half_of_its_light(place):
    assert lacks((place, 0.49)) == [] and lacks((place, 0.51)) == [list(place)]
    assert lacks((place, -0.9)) == []


def test_four_of_nine_lack_less_than_half_as_much_as_a_dead_pixel():
    around = [(3, 4), (3, 5), (3, 6), (4, 4), (4, 6)]
    for n, told in ((4, True), (5, False)):
        found = lacks(*((place, 1.0) for place in [(4, 5), *around[:n]]), sigma=30.0)
        assert ([4, 5] in found) == told and [3, 4] in found
    half = lacks(((4, 5), 1.0), *((place, 0.49) for place in around), sigma=30.0)
    assert half == [[4, 5]]


@pytest.mark.parametrize("at", [(0.0, 0.0), (0.5, -0.5)])
def test_the_other_side_lacks_less_than_half_as_much_as_a_dead_pixel(at):
    row, column = 4, 6
    mirror = (14 - row + round(2 * at[1]), 14 - column + round(2 * at[0]))
    assert lacks(((row, column), 0.8), (mirror, 0.39), at=at) == [[row, column]]
    assert lacks(((row, column), 0.8), (mirror, 0.41), at=at) == []


@pytest.mark.parametrize(("sigma", "told"), [(0.78, False), (0.82, True)])
def test_a_spot_as_narrow_as_its_pixels_has_no_dead_ones(sigma, told):
    """Any shape of it may change by half from one to the next."""
    fit = fit_of(2, sigma=sigma)
    fit.width[1] = 2.0, sigma
    signal = light_of(sigma)
    signal[6, 8] = 0.0
    found = dead_pixels(windows_of(signal, signal, width=sigma), fit)
    assert found[:, 6, 8].tolist() == [told, told]


# Rows and columns


@pytest.mark.parametrize("axis", [1, 2])
@pytest.mark.parametrize("line", [1, 6, 13])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_row_or_column_stands_out_by_22_errors_of_its_mean(axis, line, sign):
    for errors, out in ((21.5, False), (22.5, True)):
        rest = np.zeros((1, 15, 15))
        rest.swapaxes(1, axis)[0, line] = sign * errors / np.sqrt(13)
        found = _lines(rest)
        expected = np.zeros_like(found)
        expected.swapaxes(1, axis)[0, line] = out
        np.testing.assert_array_equal(found, expected)


def test_a_row_stands_out_by_four_scatters_of_the_others():
    """Rows alternate by +-2 about the middle one, and 1.4826 MAD is their scatter."""
    rest = np.zeros((1, 15, 15))
    rest[0, 1:14] = np.array([-2.0, 2, -2, 2, -2, 0, 0, 0, 2, -2, 2, -2, 2])[:, None]
    for scatters, out in ((3.9, False), (4.1, True)):
        rest[0, 7] = scatters * 1.4826 * 2.0
        rest[0, 6] = rest[0, 8] = 0.0
        assert _lines(rest)[0, 7].all() == out


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("beside", [4, 6])
@pytest.mark.parametrize(("share", "out"), [(0.39, True), (0.41, False)])
def test_a_row_is_two_and_a_half_times_those_beside_it(sign, beside, share, out):
    rest = np.zeros((1, 15, 15))
    rest[0, 5], rest[0, beside] = sign * 30.0, sign * share * 30.0
    assert _lines(rest)[0, 5].all() == out
    rest[0, beside] = -rest[0, beside]
    assert _lines(rest)[0, 5].all()


def test_half_of_a_row_is_none():
    for n, out in ((6, False), (7, True)):
        rest = np.zeros((1, 15, 15))
        rest[0, 5, 1 : 1 + n] = 40.0
        assert _lines(rest)[0, 5].all() == out


def test_only_the_worst_row_and_the_worst_column_of_a_window_are_taken():
    rest = np.zeros((2, 15, 15))
    rest[0, 3], rest[0, 9], rest[0, :, 6] = 30.0, 40.0, 50.0
    found = _lines(rest)
    assert found[0, 9].all() and found[0, :, 6].all() and not found[0, 3, :6].any()
    assert not found[1].any()


# A window that is looked into


def test_pixels_without_any_noise_leave_nothing_over():
    """Where there is neither floor nor light; it would be infinite."""
    windows, fit = windows_of(np.full((15, 15), 3.0), floor=0.0), fit_of(sigma=0.3)
    rest = _rest(windows, fit)[0]
    assert rest[0, 0] == rest[14, 14] == rest[0, 14] == 0.0 and abs(rest[7, 7]) > 1.0
    below = _rest(windows_of(np.full((15, 15), -3.0), floor=0.0), fit)[0]
    assert below[0, 0] == below[14, 14] == below[0, 14] == 0.0


def test_templates_of_a_close_look_are_as_near_as_a_twentieth_of_a_pixel(monkeypatch):
    """4e-3 pixels squared, in 25 steps at most; the first of the width of the call."""
    asked = []

    def fitted(windows, **options):
        asked.append(options)
        return fit_template(windows, **options)

    monkeypatch.setattr(scrutiny, "fit_template", fitted)
    signal = noisy_window(2)
    signal[9, 5] += 900.0
    look_into(windows_of(signal))
    near = {"tolerance": 4e-3, "max_iter": 25}
    assert (
        asked[0] == near and asked[1:] and all(each == near | {"free": True} for each in asked[1:])
    )


def test_a_window_is_looked_into_four_times_at_most(monkeypatch):
    """Where each round finds a pixel more."""
    rounds = []

    def one_more(rest):
        rounds.append(len(rest))
        found = np.zeros(rest.shape, bool)
        found[:, 3, 2 + 2 * len(rounds)] = True
        return found

    monkeypatch.setattr(scrutiny, "lone_pixels", one_more)
    signal = light_of()
    signal[12, 2:12:2] += 900.0
    look_into(windows_of(signal))
    assert rounds == [1] * 4


def noisy_window(seed=0, sigma=2.0):
    return light_of(sigma) + np.random.default_rng(seed).normal(0.0, 3.0, (15, 15))


def test_clean_windows_are_kept_whole():
    looked = look_into(windows_of(noisy_window(0), noisy_window(1)))
    assert looked.kept.all() and not looked.lines.any() and looked.n_bad.tolist() == [0, 0]
    assert looked.fit.converged.all()
    np.testing.assert_allclose(looked.fit.flux, FLUX, rtol=0.02)


def test_bad_pixels_are_masked_of_the_windows_that_have_them():
    bad, row = noisy_window(2), noisy_window(3)
    bad[9, 5] += 900.0
    bad[4, 10] = 0.0
    row[5] += 400.0
    looked = look_into(windows_of(noisy_window(1), bad, row))
    assert looked.n_bad.tolist() == [0, 2, 13]
    assert np.argwhere(looked.kept[1] == 0).tolist() == [[4, 10], [9, 5]]
    assert (looked.kept[2, 5] == 0).all() and looked.lines[2, 5].all()
    np.testing.assert_allclose(looked.fit.centre, 0.0, atol=0.02)
    np.testing.assert_allclose(looked.fit.width[1:], 2.0, rtol=0.02)


def test_what_was_not_kept_before_is_not_counted():
    signal = noisy_window(2)
    signal[9, 5] += 900.0
    kept = np.ones((1, 15, 15))
    kept[0, 9, 5] = kept[0, 0, 0] = 0.0
    looked = look_into(windows_of(signal, kept=kept))
    assert looked.n_bad.tolist() == [0]
    np.testing.assert_array_equal(looked.kept, kept)


@pytest.mark.parametrize("width", [np.nan, 2.0])
def test_a_window_without_a_width_is_looked_into_by_a_sixth_of_its_side(width):
    signal = noisy_window(4, sigma=13 / 6)
    signal[9, 5] += 900.0
    looked = look_into(windows_of(signal, width=width))
    assert looked.n_bad.tolist() == [1]
    np.testing.assert_allclose(looked.fit.width, 13 / 6, rtol=0.02)


@pytest.mark.parametrize(("n", "masked"), [(25, True), (26, False)])
def test_more_than_fifteen_of_a_hundred_pixels_are_the_shape(n, masked):
    """Of 169 pixels 25; four in a row or column are no line."""
    signal = light_of()
    for k in range(n):
        signal[1 + 2 * (k // 4), 1 + 2 * ((k // 4 + k % 4) % 7)] += 400.0
    looked = look_into(windows_of(signal, floor=1600.0))
    assert looked.n_bad.tolist() == [n if masked else 0]


# What a template does not explain


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_the_share_that_a_template_does_not_explain_is_beyond_the_noise(per_dn):
    light = light_of()
    rest = np.random.default_rng(4).normal(0.0, 40.0, light.shape)
    inner = np.s_[1:-1, 1:-1]
    kept = (np.random.default_rng(5).random((1, *light.shape)) < 0.8).astype(float)
    windows = windows_of(light + rest, per_dn=per_dn)
    for mask in (None, kept):
        weight = 1.0 if mask is None else mask[0][inner]
        variance = FLOOR + per_dn * light[inner]
        excess = ((rest[inner] ** 2 - variance) * weight).sum()
        expected = np.sqrt(excess / (light[inner] ** 2 * weight).sum())
        assert unexplained(windows, fit_of(), mask) == pytest.approx([expected])
    assert unexplained(windows_of(light, per_dn=per_dn), fit_of()).tolist() == [0.0]
    assert unexplained(windows, fit_of(flux=0.0))[0] > 1e300
    assert unexplained(windows_of(0.0 * light), fit_of(flux=0.0)).tolist() == [np.inf]


@pytest.mark.parametrize(("share", "out"), [(0.29, True), (0.35, False)])
def test_a_template_that_leaves_three_tenths_tells_nothing_of_pixels(share, out):
    """Squares of 3 x 3 pixels, brighter and darker by two errors each, are not pointed."""
    light = light_of()
    board = np.where((np.indices(light.shape) // 3).sum(axis=0) % 2, 1.0, -1.0)
    size = share * np.sqrt((light[1:-1, 1:-1] ** 2).mean())
    signal = light + size * board
    signal[10, 4] += 20.0 * size
    windows = windows_of(signal, floor=size**2 / 4.0)
    looked = look_into(windows)
    kept = np.ones((1, 15, 15))
    kept[0, 10, 4] = 0.0
    assert (unexplained(windows, looked.fit, kept)[0] < 0.3) == out
    assert looked.n_bad.tolist() == [int(out)]


@pytest.mark.parametrize("sigma", [0.8, 2.0])
def test_without_shot_noise_a_pixel_stands_out_by_the_gain_that_the_others_tell(sigma):
    light, rng = light_of(sigma), np.random.default_rng(6)
    per_dn = 0.7
    signal = light + rng.normal(0.0, np.sqrt(FLOOR + per_dn * light))
    kept = np.ones((1, 15, 15))
    kept[0, 7, 7] = 0.0
    windows, fit = windows_of(signal), fit_of(sigma=sigma)
    square = (signal - light) ** 2
    told = ((square - FLOOR) * light * kept[0]).sum() / (light**2 * kept[0]).sum()
    variance = FLOOR + (0.03 * light) ** 2 + told * light
    for errors, out in ((5.95, False), (6.05, True)):
        changed = signal.copy()
        changed[7, 7] = light[7, 7] + errors * np.sqrt(variance[7, 7])
        found = _beyond_shot_noise(replace(windows, signal=changed[None]), fit, kept)
        assert found[0, 7, 7] == out
        assert not np.delete(found.ravel(), 7 * 15 + 7).any()
    dark = np.zeros((1, 15, 15))
    found = _beyond_shot_noise(replace(windows, signal=dark), fit_of(sigma=sigma, flux=-1.0), kept)
    assert not found.any()
    loud = 3.0 * np.sqrt(FLOOR) * np.where(np.indices(light.shape).sum(axis=0) % 2, 1.0, -1.0)
    loud[7, 7] = 6.1 * np.sqrt(FLOOR)
    found = _beyond_shot_noise(replace(windows, signal=loud[None]), fit_of(flux=0.0), kept)
    assert np.argwhere(found[0]).tolist() == [[7, 7]]  # without light there is no shot noise


def test_pixels_that_shot_noise_explains_are_kept_where_nobody_knows_it():
    light, rng = light_of(), np.random.default_rng(7)
    signals = light + rng.normal(0.0, np.sqrt(FLOOR + 6.0 * light), (40, *light.shape))
    looked = look_into(windows_of(*signals))
    assert looked.kept.all() and not looked.n_bad.any()
    signals[:, 9, 5] += 1500.0
    assert np.median(look_into(windows_of(*signals)).n_bad) == 1


# Light on one side


TALL = SIDE + 8


EVERY = np.ones((1, TALL, TALL))


def stamp_of(value, at=(5, 6), *, sigma=1.5, peak=1000.0):
    """A spot of that peak, and 3 x 3 pixels with that light beside it."""
    flux = peak / light_of(sigma, side=TALL, flux=1.0).max()
    stamp = light_of(sigma, side=TALL, flux=flux)
    x, y = TALL // 2 + np.array(at)
    stamp[y - 1 : y + 2, x - 1 : x + 2] += value
    return stamp, fit_of(sigma=sigma, flux=flux)


def is_lopsided(value, *, floor=FLOOR, per_dn=0.0, kept=EVERY, **options):
    stamp, fit = stamp_of(value, **options)
    windows = windows_of(np.zeros((15, 15)), floor=floor, per_dn=per_dn)
    return bool(lopsided(stamp[None], kept, windows.noise, fit)[0])


@pytest.mark.parametrize("at", [(6, 0), (0, -6), (-5, 6), (-7, -7)])
def test_light_on_one_side_is_that_of_nine_pixels_beyond_5_5_errors(at):
    """The mean of nine differences of two pixels has the variance 2 V / 9."""
    error = np.sqrt(2.0 * 100.0 / 9.0)
    for errors, told in ((5.4, False), (5.6, True)):
        assert is_lopsided(errors * error, at=at, floor=100.0) == told


@pytest.mark.parametrize(("floor", "told"), [(0.01, True), (10.0, False)])
def test_far_from_a_spot_there_is_no_shot_noise_of_it(floor, told):
    assert is_lopsided(5.0, at=(7, 7), peak=100.0, floor=floor, per_dn=10.0) == told


@pytest.mark.parametrize(("share", "told"), [(0.019, False), (0.021, True)])
def test_light_on_one_side_is_two_hundredths_of_the_peak(share, told):
    assert is_lopsided(share * 1000.0, floor=1e-6) == told


@pytest.mark.parametrize(("share", "told"), [(0.69, True), (0.71, False)])
def test_one_pixel_with_seven_tenths_of_the_light_is_no_spot(share, told):
    stamp, fit = stamp_of(0.0)
    y, x = TALL // 2 + 6, TALL // 2 + 5
    stamp[y, x : x + 2] += np.array([share, 1.0 - share]) * 900.0
    windows = windows_of(np.zeros((15, 15)), floor=1e-6)
    assert lopsided(stamp[None], EVERY, windows.noise, fit).tolist() == [told]


@pytest.mark.parametrize(
    ("at", "told"), [((2, 0), False), ((0, -3), True), ((2, 1), False), ((2, -2), True)]
)
def test_light_within_one_and_a_half_sigma_is_the_spot_s_own(at, told):
    """Sigma 1.5: from 2.25 pixels on. One pixel aside the mean holds six of the nine."""
    assert is_lopsided(1.2 * 5.5 * np.sqrt(2.0 * 100.0 / 9.0), at=at, floor=100.0) == told


@pytest.mark.parametrize("at", [(7, 0), (0, 7)])
def test_shot_noise_of_the_spot_s_own_light_is_noise(at):
    stamp, _ = stamp_of(0.0, sigma=4.0)
    own = stamp[TALL // 2 + at[1], TALL // 2 + at[0]]
    error = np.sqrt(2.0 * (FLOOR + 4.0 * own) / 9.0)
    for errors, told in ((5.4, False), (5.6, True)):
        assert is_lopsided(errors * error, at=at, per_dn=4.0, sigma=4.0) == told


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_means_that_hang_over_the_border_of_a_stamp_do_not_count(turns):
    stamp, fit = stamp_of(0.0)
    error = np.sqrt(2.0 * 100.0 / 9.0)
    windows = windows_of(np.zeros((15, 15)), floor=100.0)
    for rows, size, told in ((slice(1, 2), 11.0, False), (slice(0, 3), 6.6, True)):
        changed = stamp.copy()
        changed[rows, 6:9] += size * error
        turned = np.rot90(changed, turns)
        assert lopsided(turned[None], EVERY, windows.noise, fit).tolist() == [told]


def test_pixels_that_are_not_kept_on_either_side_are_not_compared():
    for row, column in ((6, 5), (-6, -5)):
        kept = EVERY.copy()
        y, x = TALL // 2 + row, TALL // 2 + column
        kept[0, y - 1 : y + 2, x - 1 : x + 2] = 0.0
        assert not is_lopsided(200.0, kept=kept)
    assert is_lopsided(200.0)


def test_windows_are_lopsided_each_by_its_own_peak_and_noise():
    parts = [stamp_of(90.0, peak=peak) for peak in (1e3, 1e4, 1e3)]
    stamps = np.stack([stamp for stamp, _ in parts])
    fit = fit_of(3, sigma=1.5)
    fit.flux[:] = [part.flux[0] for _, part in parts]
    noise = PixelNoise(np.array([1.0, 1.0, 1e4]), 0.0, np.zeros((3, 3)))
    found = lopsided(stamps, np.ones((3, TALL, TALL)), noise, fit)
    assert found.tolist() == [True, False, False]


@pytest.mark.parametrize(("turned", "told"), [(False, True), (True, False)])
def test_light_on_both_sides_is_the_shape(turned, told):
    stamp, fit = stamp_of(200.0)
    if turned:
        stamp = (stamp + stamp[::-1, ::-1]) / 2.0
    windows = windows_of(np.zeros((15, 15)))
    assert lopsided(stamp[None], EVERY, windows.noise, fit).tolist() == [told]


def test_a_template_fitted_to_what_is_kept_has_the_light_of_all():
    signal = noisy_window(8)
    kept = np.ones((1, 15, 15))
    kept[0, 6, 6] = 0.0
    signal[6, 6] = 1e5
    fit = fit_template(windows_of(signal, kept=kept), free=True, tolerance=1e-3, max_iter=50)
    np.testing.assert_allclose(fit.flux, FLUX, rtol=0.02)
