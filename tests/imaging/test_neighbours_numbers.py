"""Light of another spot, number by number: one side, two tops, a glance, and what a window has left
behind."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.cleaning import captured
from losbench.imaging.neighbours import dark_in_the_middle, one_sided, two_tops
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows

SIZE, HALF = 21, 10


def noise_of(floor=4.0, per_dn=0.0, count=1):
    return PixelNoise(np.full(count, floor), per_dn, np.zeros((count, 3)))


def spot(at=(0.0, 0.0), peak=1000.0, sigma=1.5, size=SIZE):
    image = lb.render_spots([np.array(at) + size // 2], 1.0, sigma, (size, size))
    return peak * image / lb.render_spots([[size // 2] * 2], 1.0, sigma, (size, size)).max()


# A glance


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
@pytest.mark.parametrize("centre", [(0.0, 0.0), (2.3, -3.4), (-9.7, 9.6)])
def test_a_centre_is_dark_below_eight_tenths_of_the_height_by_5_5_errors_of_a_mean(per_dn, centre):
    height = 1000.0
    limit = 0.8 * height - 5.5 / 3.0 * np.sqrt(4.0 + per_dn * height)
    x, y = np.rint(centre).astype(int) + HALF
    for value, dark in ((limit - 1.0, True), (limit + 1.0, False), (0.81 * height, False)):
        signal = np.zeros((2, SIZE, SIZE))
        signal[:, y, x] = value
        signal[1, y, x] = 2e3
        found = dark_in_the_middle(
            signal, np.array([centre] * 2), np.full(2, height), noise_of(per_dn=per_dn, count=2)
        )
        assert found.tolist() == [dark, False]


def test_a_centre_that_is_not_known_is_the_middle_and_one_outside_the_border():
    signal = np.full((2, SIZE, SIZE), 1000.0)
    signal[0, HALF, HALF] = signal[1, 0, SIZE - 1] = 0.0
    centre = np.array([[np.nan, np.nan], [40.0, -40.0]])
    found = dark_in_the_middle(signal, centre, np.full(2, 1000.0), noise_of(count=2))
    assert found.all()


# Two tops


def windows_of(signal, kept=None, **noise):
    zeros = np.zeros((1, 2))
    return Windows(signal[None], SIZE - 2, zeros, zeros.astype(int), noise_of(**noise), zeros, kept)


def between(signal, centre=(0.0, 0.0), kept=None, **noise):
    return bool(two_tops(windows_of(signal, kept, **noise), np.array([centre]))[0])


@pytest.mark.parametrize("away", [(6, 0), (0, 6), (4, 4), (-6, 2)])
def test_a_window_stands_between_two_tops_or_beside_one(away):
    way = np.array(away, float)
    assert between(spot(way) + spot(-way))
    assert between(spot(way))  # beside a brighter one
    assert not between(spot() + 0.5 * spot(way))
    assert not between(spot())


def test_a_ring_is_one_spot():
    y, x = np.mgrid[-HALF : HALF + 1, -HALF : HALF + 1]
    ring = 1000.0 * np.exp(-0.5 * ((np.hypot(x, y) - 6.0) / 1.5) ** 2)
    assert not between(ring)
    assert between(np.where(abs(y) < 3, ring, 0.4 * ring))
    assert not between(np.where(abs(y) < 3, ring, 0.6 * ring))


def blocks(centre, beside=0.0, top=1000.0, away=6):
    """Squares of 5 x 5: at the middle, two tops on a row, and two beside the line."""
    signal = np.zeros((SIZE, SIZE))
    for (x, y), value in (
        ((0, 0), centre),
        ((away, 0), top),
        ((-away, 0), 0.99 * top),
        ((0, away), beside),
        ((0, -away), 0.9 * beside),
    ):
        signal[HALF + y - 2 : HALF + y + 3, HALF + x - 2 : HALF + x + 3] = value
    return signal


@pytest.mark.parametrize("per_dn", [0.0, 2.0])
@pytest.mark.parametrize(("errors", "told"), [(5.4, False), (5.6, True)])
def test_a_dip_is_below_eight_tenths_of_the_top_by_5_5_errors_of_a_mean(per_dn, errors, told):
    error = np.sqrt((900.0 + per_dn * 1000.0) / 9.0)
    assert between(blocks(800.0 - errors * error), floor=900.0, per_dn=per_dn) == told


@pytest.mark.parametrize(("beside", "told"), [(490.0, True), (510.0, False)])
def test_both_places_beside_the_line_are_darker_than_half_of_the_top(beside, told):
    assert between(blocks(100.0, beside)) == told
    assert between(blocks(100.0, beside)[::-1]) == told


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_a_centre_is_looked_at_where_it_is_as_far_as_means_reach(turns):
    """A top of 8 x 8 pixels that ends a pixel before it; what lies beyond the border is that."""
    signal = np.zeros((SIZE, SIZE))
    signal[HALF : HALF + 8, HALF : HALF + 8] = 1000.0
    x, y = 8.0, 8.0
    for _ in range(turns):
        signal, (x, y) = np.rot90(signal), (y, -x)
    assert between(signal, (x, y)) and between(signal, (1.2 * x, 1.2 * y))
    assert not between(signal, (0.7 * x, 0.7 * y))


@pytest.mark.parametrize(("away", "told"), [((1.0, 1.0), False), ((2.0, 0.0), True)])
def test_a_top_is_one_and_a_half_pixels_away(away, told):
    signal = np.zeros((SIZE, SIZE))
    x, y = HALF + np.array(away, int)
    signal[y - 1 : y + 2, x - 1 : x + 2] = 1000.0
    signal[y, x] = 1100.0
    signal[HALF - 1 : HALF + 2, HALF - 3 : HALF] = 0.0
    assert between(signal, floor=1e-3) == told


def test_one_pixel_that_holds_seven_tenths_of_its_nine_is_no_top():
    for share, told in ((0.69, True), (0.71, False)):
        signal = np.zeros((SIZE, SIZE))
        signal[HALF, HALF + 6] = share * 9000.0
        signal[HALF, HALF + 7] = (1.0 - share) * 9000.0
        assert between(signal, floor=1e-3) == told


def test_means_are_those_of_the_pixels_that_are_kept():
    signal, kept = blocks(700.0), np.ones((1, SIZE, SIZE))
    assert between(signal, floor=1.0)
    signal[HALF - 1 : HALF + 2, HALF - 1] = -2e3
    kept[0, HALF - 1 : HALF + 2, HALF - 1] = 0.0
    kept[0, HALF, HALF + 6] = 0.0
    assert between(signal, kept=kept, floor=1.0)
    full = blocks(1000.0)
    full[HALF, HALF - 1 : HALF + 2] = 0.0
    kept = np.ones((1, SIZE, SIZE))
    assert between(full, kept=kept, floor=1.0)
    kept[0, HALF, HALF - 1 : HALF + 2] = 0.0
    assert not between(full, kept=kept, floor=1.0)


# One side only


def is_one_sided(value, at=(6, 0), *, side=13, centre=(0.0, 0.0), peak=1000.0, **options):
    stamp = spot(peak=peak)
    x, y = HALF + np.array(at)
    stamp[y - 1 : y + 2, x - 1 : x + 2] += value
    noise = {name: options.pop(name) for name in ("floor", "per_dn") if name in options}
    kept = options.pop("kept", np.ones((1, SIZE, SIZE)))
    found = one_sided(stamp[None], kept, noise_of(**noise), np.array([centre]), side, **options)
    return bool(found[0])


@pytest.mark.parametrize("at", [(6, 0), (0, -6), (-5, 6)])
@pytest.mark.parametrize("sure", [1.0, 0.8])
def test_light_on_one_side_is_beyond_so_much_of_5_5_errors(at, sure):
    error = np.sqrt(2.0 * 100.0 / 9.0)
    for errors, told in ((5.3, False), (5.7, True)):
        value = sure * errors * error
        assert is_one_sided(value, at, floor=100.0, sure=sure, of_peak=1e-3) == told


@pytest.mark.parametrize(("share", "told"), [(0.97, False), (1.03, True)])
@pytest.mark.parametrize("of_peak", [0.02, 0.1])
@pytest.mark.parametrize(("sigma", "half"), [(0.7, 0.5), (1.5, 0.75), (2.5, 1.0)])
def test_light_on_one_side_is_so_much_of_the_brightest_mean(share, told, of_peak, sigma, half):
    """Of nine pixels; half of it for a spot of a sigma of one pixel by its light, all from two on."""
    given = {} if of_peak == 0.02 else {"of_peak": of_peak}
    stamp = spot(sigma=sigma)
    by_light = np.sqrt(stamp.sum() / (2.0 * np.pi * stamp.max()))
    least = of_peak * np.clip(by_light / 2.0, 0.5, 1.0)
    assert np.clip(by_light / 2.0, 0.5, 1.0) == pytest.approx(half, abs=0.04)
    least *= stamp[HALF - 1 : HALF + 2, HALF - 1 : HALF + 2].mean()
    # What is added is of the light as well.
    added = share * least * (1.0 + 9.0 * least / (2.0 * stamp.sum()) * (half not in (0.5, 1.0)))
    stamp[HALF - 1 : HALF + 2, HALF + 7 : HALF + 10] += added
    kept = np.ones((1, SIZE, SIZE))
    found = one_sided(stamp[None], kept, noise_of(1e-6), np.zeros((1, 2)), 13, **given)
    assert found.tolist() == [told]


@pytest.mark.parametrize(("side", "told"), [(15, True), (16, False), (17, False)])
def test_light_in_the_middle_of_a_window_is_the_spot_s_own(side, told):
    """Half as wide: at four pixels, beyond a quarter of fifteen; of a wide spot."""
    value = 1.2 * 5.5 * np.sqrt(2.0 * 400.0 / 9.0)
    stamp = np.full((1, SIZE, SIZE), 500.0)
    stamp[0, HALF - 1 : HALF + 2, HALF + 3 : HALF + 6] += value
    kept = np.ones_like(stamp)
    found = one_sided(stamp, kept, noise_of(400.0), np.zeros((1, 2)), side, of_peak=0.1)
    assert found.tolist() == [told]


@pytest.mark.parametrize(("sigma", "told"), [(0.6, True), (2.0, False)])
def test_the_middle_of_a_sharp_spot_is_smaller_than_its_window(sigma, told):
    """1.5 of the sigma that its light and its brightest pixel have."""
    stamp = spot(sigma=sigma, peak=1e4)
    stamp[HALF - 1 : HALF + 2, HALF + 1 : HALF + 4] += 1500.0
    kept = np.ones((1, SIZE, SIZE))
    for unit in (1.0, 1e-6):
        given = unit * stamp[None], kept, noise_of(unit**2)
        assert one_sided(*given, np.zeros((1, 2)), 17, of_peak=0.1).tolist() == [told]


def test_one_pixel_may_hold_all_of_what_no_template_has_a_top_for():
    stamp = spot(sigma=2.0)
    stamp[HALF, HALF + 7] += 1800.0
    given = stamp[None], np.ones((1, SIZE, SIZE)), noise_of(1.0), np.zeros((1, 2)), 13
    assert not one_sided(*given, of_peak=0.1).any()
    assert one_sided(*given, of_peak=0.1, lone=None).all()


def test_shot_noise_of_the_light_is_noise():
    stamp = np.full((1, SIZE, SIZE), 500.0)
    stamp[0, HALF - 1 : HALF + 2, HALF + 5 : HALF + 8] += 100.0
    for per_dn, told in ((0.0, True), (100.0, False)):
        noise = noise_of(4.0, per_dn)
        assert one_sided(stamp, np.ones_like(stamp), noise, np.zeros((1, 2)), 13).all() == told


def test_where_there_is_no_light_there_is_no_shot_noise():
    """A ring of eight pixels around one that is dark, which has the noise of the floor alone."""
    for dark in (0.0, -1.0):
        stamp = np.zeros((1, SIZE, SIZE))
        stamp[0, HALF - 1 : HALF + 2, HALF + 5 : HALF + 8] = 9.0
        stamp[0, HALF, HALF + 6] = dark
        for floor, told in ((0.01, True), (10.0, False)):
            given = stamp, np.ones_like(stamp), noise_of(floor, 10.0), np.zeros((1, 2)), 13
            assert one_sided(*given, of_peak=0.1).tolist() == [told]


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_means_that_hang_over_the_border_do_not_count(turns):
    error = np.sqrt(2.0 * 100.0 / 9.0)
    for rows, size, told in ((slice(1, 2), 11.0, False), (slice(0, 3), 6.6, True)):
        stamp = np.zeros((SIZE, SIZE))
        stamp[rows, 6:9] = size * error
        given = np.rot90(stamp, turns)[None], np.ones((1, SIZE, SIZE)), noise_of(100.0)
        assert one_sided(*given, np.zeros((1, 2)), 13, of_peak=0.01).tolist() == [told]


def test_each_window_is_judged_by_its_own_light_and_noise():
    stamps = np.stack([spot(peak=p) for p in (1e2, 1e4, 1e3)])
    stamps[:, HALF - 1 : HALF + 2, HALF + 5 : HALF + 8] += 90.0
    noise = PixelNoise(np.array([1.0, 1.0, 1e4]), 0.0, np.zeros((3, 3)))
    kept, centre = np.ones_like(stamps), np.zeros((3, 2))
    assert one_sided(stamps, kept, noise, centre, 13).tolist() == [True, False, False]
    tops = np.stack([blocks(500.0), blocks(990.0), blocks(500.0)])
    zeros = np.zeros((3, 2))
    windows = Windows(tops, SIZE - 2, zeros, zeros.astype(int), noise, zeros)
    windows.noise.floor[2] = 1e6
    assert two_tops(windows, zeros).tolist() == [True, False, False]
    height = np.full(3, 1000.0)
    assert dark_in_the_middle(tops, zeros, height, noise).tolist() == [True, False, False]


# What a window has left behind


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
@pytest.mark.parametrize(("errors", "told"), [(5.4, False), (5.6, True)])
def test_a_spot_is_left_behind_where_its_mean_drops_by_5_5_errors_on_the_way(per_dn, errors, told):
    """Of means of 3 x 3 pixels, of which two are compared."""
    drop = np.linspace(1.0, 400.0, 4000)
    drop = drop[np.searchsorted(drop / np.sqrt((100.0 + per_dn * drop) * 2.0 / 9.0), errors)]
    frame = np.zeros((2, 40, 50))
    frame[1, 18:23, 8:13] = drop
    frame[1, 18:23, 28:33] = 5.0 * drop
    start, now = np.array([[10.0, 20.0]]), np.array([[30.0, 20.0]])
    noise = noise_of(100.0, per_dn)
    assert captured(frame, np.array([1]), start, now, noise).tolist() == [told]
    assert captured(frame, np.array([0]), start, now, noise).tolist() == [False]


def test_a_drop_has_the_noise_of_the_floor_and_none_without_one():
    frame = np.zeros((1, 40, 50))
    frame[0, 18:23, 8:13] = 1.0
    start, now = np.array([[10.0, 20.0]]), np.array([[30.0, 20.0]])
    for floor, told in ((0.14, True), (0.16, False), (0.0, True), (-1.0, True)):
        found = captured(frame, np.array([0]), start, now, noise_of(floor))
        assert found.tolist() == [told]


@pytest.mark.parametrize("axis", [0, 1])
def test_a_way_that_reaches_the_border_tells_nothing(axis):
    """Means of 3 x 3 pixels are not read there."""
    frame = np.zeros((1, 40, 50))
    last = frame.shape[2 - axis] - 1
    for begin, end, told in (
        (1, 20, True),
        (0, 20, False),
        (-3, 20, False),
        (last - 1, 20, True),
        (last, 20, False),
        (20, last, False),
        (20, last + 9, False),
        (20, last - 1, True),
    ):
        start, now = np.full((1, 2), 20.0), np.full((1, 2), 20.0)
        start[0, axis], now[0, axis] = begin, end
        frame[:] = 0.0
        bright = frame[0].T if axis == 0 else frame[0]
        nearest = min(max(begin, 0), last)
        bright[max(nearest - 1, 0) : nearest + 2] = 100.0
        found = captured(frame, np.array([0]), start, now, noise_of(1.0))
        assert found.tolist() == [told], (begin, end)


def test_a_way_without_a_dip_leaves_nothing_behind():
    frame = np.zeros((1, 40, 50))
    frame[0, :, :40] = np.arange(40.0) * 30.0
    start, now = np.array([[10.0, 20.0]]), np.array([[30.0, 20.0]])
    assert not captured(frame, np.array([0]), start, now, noise_of(1.0)).any()
    assert captured(frame, np.array([0]), now, start, noise_of(1.0)).all()
    unread = np.full_like(frame, np.nan)
    assert not captured(unread, np.array([0]), start, now, noise_of(1.0)).any()


def test_nine_places_on_the_way_are_looked_at():
    """A dip of three pixels at each eighth of the way."""
    start, now = np.array([[4.0, 20.0]]), np.array([[84.0, 20.0]])
    for k in range(1, 9):
        frame = np.full((1, 40, 90), 100.0)
        frame[0, 19:22, 4 + 10 * k - 1 : 4 + 10 * k + 2] = 0.0
        assert captured(frame, np.array([0]), start, now, noise_of(1.0)).all()
        frame = np.full((1, 40, 90), 100.0)
        frame[0, :, 4 + 10 * k - 6 : 4 + 10 * k - 4] = 0.0
        assert not captured(frame, np.array([0]), start, now, noise_of(1.0)).any()
