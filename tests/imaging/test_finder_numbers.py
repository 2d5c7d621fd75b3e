"""Numbers that the finder and the engine of centroids promise, from either side, by loops."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage

import losbench as lb
from losbench.imaging.background import Ring
from losbench.imaging.engine import Engine
from losbench.imaging.finder import _around, _beside
from losbench.imaging.flags import _leaks
from losbench.imaging.levels import _least_noise
from losbench.imaging.noise import PixelNoise, saturated, step_of
from losbench.imaging.places import peak_pixels
from losbench.imaging.protocols import Windows
from losbench.imaging.ranks import digit_step, level_and_noise, medians, noise_above_black
from losbench.imaging.sizes import default_window, spot_sigma, window_in_first
from losbench.imaging.window import WindowFit, look, spread, window_estimate

SHAPE = (60, 80)


def sky(seed=1, noise=2.0, shape=SHAPE):
    return np.random.default_rng(seed).normal(100.0, noise, shape)


# The finder


@pytest.mark.parametrize("share", [0.001, 0.3])
def test_a_path_may_lead_over_two_pixels_around_bright_ones(share):
    for seed in range(5):
        bright = np.random.default_rng(seed).random((30, 41)) < share
        bright[0, 0] = bright[-1, -1] = bright[12, 0] = bright[14, -1] = True
        expected = ndimage.binary_dilation(bright, np.ones((5, 5)))
        found = _around(np.flatnonzero(bright), bright.shape)
        np.testing.assert_array_equal(found, np.flatnonzero(expected))


@pytest.mark.parametrize("width", [1, 2, 4, 5, 7])
def test_a_path_ends_at_the_border_of_frames_of_any_width(width):
    for seed in range(8):
        bright = np.random.default_rng(seed).random((1200 // width, width)) < 0.006
        bright[-1, -1] = True
        expected = ndimage.binary_dilation(bright, np.ones((5, 5)))
        found = _around(np.flatnonzero(bright), bright.shape)
        np.testing.assert_array_equal(found, np.flatnonzero(expected))


def test_the_light_beside_a_pixel_is_that_of_its_neighbours_within_the_frame():
    pixels = np.random.default_rng(2).random((7, 9))
    row, column = (v.ravel() for v in np.mgrid[:7, :9])
    above = pixels - 0.25
    plus = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    times = np.array([[1, 0, 1], [0, 0, 0], [1, 0, 1]])
    inner = (row > 0) & (row < 6) & (column > 0) & (column < 8)
    for some in (np.ones(63, dtype=bool), inner):
        found = _beside(pixels, row[some], column[some], np.full(some.sum(), 0.25))
        for got, kernel in zip(found, (plus, times), strict=True):
            expected = ndimage.convolve(above, kernel, mode="constant").ravel()[some]
            np.testing.assert_allclose(got, expected, atol=1e-12)


@pytest.mark.parametrize("kind", ["flat", "sloping"])
def test_a_pixel_belongs_to_a_spot_above_its_threshold(kind):
    """Three pixels in a row; noise is told to some percent."""
    image = sky()
    if kind == "sloping":
        image = image + np.linspace(0.0, 60.0, 80)
    for height, found in ((9.5, True), (6.5, False)):
        lit = image.copy()
        lit[30, 39:42] = 100.0 + 2.0 * height + (30.0 if kind == "sloping" else 0.0)
        spots = lb.find_spots(lit, smooth=0.0)
        assert len(spots) == found
        if found:
            np.testing.assert_allclose(spots, [[40.0, 30.0]], atol=0.05)
    assert len(lb.find_spots(lit, threshold=5.5)) == 1


def test_spots_are_numbered_by_light_by_peak_or_from_left_to_right():
    image = sky()
    image += lb.render_spots(
        [[60, 30], [20, 30], [40, 15]], [3e4, 1e4, 2e4], [[4.0], [1.2], [2.0]], SHAPE
    )
    for order, expected in (("light", [60, 40, 20]), ("peak", [20, 40, 60]), ("x", [20, 40, 60])):
        found = lb.find_spots(image, order=order)
        assert found[:, 0].round().tolist() == expected
    assert lb.find_spots(image, 2, order="x")[:, 0].round().tolist() == [40, 60]
    assert lb.find_spots(image, 1, order="peak")[:, 0].round().tolist() == [20]


def test_as_many_spots_as_allowed_are_no_error_and_one_more_is():
    image = sky() + lb.render_spots([[20, 30], [60, 30], [40, 15]], 2e4, 2.0, SHAPE)
    assert len(lb.find_spots(image, most=3)) == len(lb.find_spots(image, 3)) == 3
    with pytest.raises(ValueError, match="3 candidates at threshold 8"):
        lb.find_spots(image, most=2)
    with pytest.raises(ValueError, match="found 3 of the 4 spots asked for"):
        lb.find_spots(image, 4)
    for bad in ({"n": 0}, {"most": 0}, {"threshold": -0.1}, {"smooth": -0.1}, {"smooth": 1001}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            lb.Find(**bad)
    assert lb.Find(n=1, most=1, threshold=0, smooth=1000).n == 1


@pytest.mark.parametrize(("share", "hot"), [(0.27, True), (0.33, False)])
def test_a_lone_pixel_with_less_than_three_tenths_of_its_light_beside_it_is_hot(share, hot):
    image = np.full(SHAPE, 100.0) + 1e-3 * sky(3, 1.0)
    image[30, 40] += 1000.0
    level = np.median(image)
    for place in ((29, 40), (31, 40), (30, 39), (30, 41)):
        image[place] = level + share / 4 * 1000.0
    threshold = 0.5 * 1000.0 / np.std(1e-3 * sky(3, 1.0))
    assert len(lb.find_spots(image, threshold=threshold)) == (not hot)


def test_whole_numbers_hide_the_noise_of_a_uniform_rounding():
    assert _least_noise(16.0, 1e3, 8.0) == pytest.approx(16 / np.sqrt(12), rel=0.01)
    assert _least_noise(0.0, 800.0, 8.0) == pytest.approx(1e-4)
    assert _least_noise(0.0, 800.0, 0.5) == pytest.approx(8e-4)
    assert _least_noise(0.0, -1.0, 8.0) == 0.0


# Windows


@pytest.mark.parametrize(
    ("sigma", "window"), [(1.5, 9), (1.85, 11), (2.0, 13), (2.18, 13), (2.35, 15)]
)
def test_a_window_is_the_first_odd_one_of_six_sigma(sigma, window):
    frame = lb.render_spots([[40.2, 30.4]], 1e5, sigma, SHAPE)
    assert default_window(frame, [[40.0, 30.0]]) == window == window_in_first(frame, [[40.0, 30.0]])


@pytest.mark.parametrize(("x", "window"), [(4.0, 9), (5.0, 11), (6.0, 13), (9.0, 13)])
def test_a_window_fits_around_its_start(x, window):
    for place in ([x, 30.0], [79.0 - x, 30.0], [40.0, x], [40.0, 59.0 - x]):
        frame = lb.render_spots([place], 1e5, 2.0, SHAPE)
        assert default_window(frame, [place]) == window


@pytest.mark.parametrize(("away", "theirs"), [(9, True), (11, True), (12, False), (15, False)])
def test_the_width_is_that_of_the_highest_pixel_within_ten_of_the_start(away, theirs):
    """Of two squares, the other of which is higher and smaller."""
    for step in ((away, 0), (-away, 0), (0, away), (0, -away)):
        own, other = np.array([40, 30]), np.array([40, 30]) + step
        frame = np.zeros((60, 80))
        frame[own[1] - 2 : own[1] + 3, own[0] - 2 : own[0] + 3] = 30.0
        square = np.s_[other[1] - 1 : other[1] + 2, other[0] - 1 : other[0] + 2]
        frame[square] = 90.0
        found = spot_sigma(frame, [own])
        frame[square] = 0.0
        alone = spot_sigma(frame, [own])
        assert (found < 0.7 * alone) == theirs, step


def seen_by(pixels, centre, window):
    """Sum, moments and their variances, pixel by pixel."""
    half, total, moment = pixels.shape[0] // 2, 0.0, np.zeros(2)
    for (i, j), value in np.ndenumerate(pixels):
        at = np.array([j - half, i - half])
        part = np.clip((window + 1) / 2 - np.abs(at - centre), 0, 1).prod()
        total += part * value
        moment += part * value * at
    return total, moment / total


@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.3, -0.45), (-0.9, 0.8)])
def test_a_window_sees_what_a_loop_over_its_pixels_sees(centre):
    pixels = np.random.default_rng(4).random((9, 9)) + 1.0
    at = np.array([centre])
    seen = look(pixels[None], at, 7)
    total, centroid = seen_by(pixels, at[0], 7)
    assert seen.total[0] == pytest.approx(total)
    np.testing.assert_allclose(seen.centroid[0], centroid, atol=1e-12)
    if centre != (0.0, 0.0):  # there the slope has a kink
        for axis in (0, 1):
            step = 1e-6 * np.eye(2)[axis]
            ends = [seen_by(pixels, at[0] + sign * step, 7)[1][axis] for sign in (1, -1)]
            slope = (ends[0] - ends[1]) / 2e-6
            assert seen.contraction[0, axis] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_the_spread_of_a_window_is_that_of_its_pixels(per_dn):
    pixels, floor = np.random.default_rng(5).random((2, 9, 9)), np.array([3.0, 0.7])
    centre = np.array([[0.3, -0.45], [-0.9, 0.8]])
    total, moment = spread(pixels, centre, 7, PixelNoise(floor, per_dn, np.zeros((len(floor), 3))))
    y, x = np.mgrid[-4:5, -4:5]
    for k in range(2):
        arms = x - centre[k, 0], y - centre[k, 1]
        weight = np.prod([np.clip(4.0 - np.abs(arm), 0, 1) for arm in arms], axis=0)
        variance = weight**2 * (floor[k] + per_dn * pixels[k])
        assert total[k] == pytest.approx(variance.sum())
        expected = [(variance * arm**2).sum() for arm in arms]
        np.testing.assert_allclose(moment[k], expected, rtol=1e-9)


def test_the_spread_of_a_window_on_clipped_black_is_between_that_of_its_sky_and_of_its_light():
    """Against the scatter of clipped numbers, of a spot of some noises on black at one below."""
    rng, noise = np.random.default_rng(6), 4.0
    y, x = np.mgrid[-7:8, -7:8]
    light = 60.0 * np.exp(-0.5 * (x**2 + y**2) / 4.0)
    for black in (0.0, -4.0):
        drawn = rng.normal(light + black, noise, (4000, 15, 15)).clip(0.0)
        sky = rng.normal(black, noise, 10**6).clip(0.0)
        lost = np.full(4000, noise**2 - sky.var())
        known = PixelNoise(np.full(4000, noise**2), 0.0, np.zeros((4000, 3)), lost)
        total, moment = spread(drawn - sky.mean(), np.zeros((4000, 2)), 13, known)
        inner = drawn[:, 1:-1, 1:-1]
        assert np.sqrt(total.mean()) == pytest.approx(inner.sum(axis=(1, 2)).std(), rel=0.1)
        arm = (inner * x[1:-1, 1:-1]).sum(axis=(1, 2)).std()
        assert np.sqrt(moment[:, 0].mean()) == pytest.approx(arm, rel=0.1)


@pytest.mark.parametrize("moved", [False, True])
def test_errors_of_a_window_are_sums_over_its_pixels(moved):
    """Those of the background plane: of its level for the light, of its slopes for the place."""
    side, pixels = 7, np.full((1, 9, 9), 10.0)
    plane = np.array([[0.04, 0.0009, 0.0025]])
    windows = Windows(
        signal=pixels,
        side=side,
        start=np.zeros((1, 2)),
        middle=np.zeros((1, 2), np.intp),
        noise=PixelNoise(np.array([2.0]), 0.5, plane),
        width=np.full((1, 2), np.nan),
    )
    seen = look(pixels, np.zeros((1, 2)), side)
    left = np.array([[0.01, 0.02]])
    fit = WindowFit(np.zeros((1, 2)), left, np.array([3]), np.array([True]), seen)
    found = window_estimate(windows, fit, moved=moved)
    y, x = np.mgrid[-3:4, -3:4]
    each = 2.0 + 0.5 * 10.0
    light = 49 * each + 49**2 * 0.04
    assert found.sigma_flux[0] == pytest.approx(np.sqrt(light))
    gain = 1.0 / max(1.0 - seen.contraction[0, 0], 0.15) if moved else 1.0
    for axis, arm in enumerate((x, y)):
        moment = each * (arm**2).sum() + (arm**2).sum() ** 2 * plane[0, 1 + axis]
        error = np.sqrt(moment * (gain / 490.0) ** 2 + left[0, axis] ** 2)
        assert found.sigma[0, axis] == pytest.approx(error, rel=1e-9)


# What holds for every spot of a call


def test_eight_different_readings_tell_their_step():
    for different, step in ((7, 1.0), (8, 16.0)):
        stack = 16 * (np.arange(1200).reshape(3, 20, 20) % different)
        assert step_of(stack.astype(np.uint16)) == step
    stack = (16 * (np.arange(1200).reshape(3, 20, 20) % 9)).astype(np.uint16)
    engine = Engine.of_stack(stack, lb.Grey(), Ring(), 9)
    assert engine.noise.rounding == pytest.approx(16**2 / 8)
    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, full_well_e=2001.0)
    for given, known, expected in (
        (None, None, 65_535.0),
        (1000.0, detector, 1000.0),
        (None, detector, np.floor(detector.full_scale_dn)),
    ):
        engine = Engine.of_stack(stack, lb.Grey(), Ring(), 9, known, given)
        assert engine.full_scale_dn == expected
        assert engine.noise is detector if known else engine.noise.rounding > 0
    light = Engine.of_stack(stack.astype(np.float32), lb.Grey(), Ring(), 9)
    assert light.full_scale_dn == np.inf and light.noise.rounding == pytest.approx(16**2 / 8)
    assert Engine.of_stack(stack[:, :, :19], lb.Grey(), Ring(), 19).window == 19
    with pytest.raises(ValueError, match="window of 21 x 21 pixels does not fit"):
        Engine.of_stack(stack, lb.Grey(), Ring(), 21)


@pytest.mark.parametrize(("sharing", "flagged"), [(5, False), (6, True)])
def test_a_plateau_is_five_pixels_and_what_rounding_makes_of_a_round_top(sharing, flagged):
    """With a window of ten by ten and a top of a hundred one pixel more may share it."""
    raw = np.full((1, 12, 12), 3.0)
    raw[0, 5, 2 : 2 + sharing] = 103.0
    raw[0, 0, 0] = 900.0  # beyond the window
    level = np.array([3.0])
    told, least = saturated(raw, None, level, np.inf)
    assert told[0] == flagged and least.ravel() == [103.0]
    assert saturated(raw, None, level, 103.0)[0][0]
    assert saturated(raw, None, level, 90.0)[1].ravel() == [90.0]
    assert not saturated(np.full((1, 12, 12), 3.0), None, level, np.inf)[0][0]


@pytest.mark.parametrize(
    ("excess", "error", "leaks"),
    [(1.01, 0.2, True), (0.99, 0.1, False), (1.01, 0.203, False), (5.0, 0.99, True)],
)
def test_a_ring_leaks_by_five_sigma_and_a_hundredth_of_the_peak(excess, error, leaks):
    plane = SimpleNamespace(excess=np.array([excess]), excess_error=np.array([error]))
    cut = SimpleNamespace(plane=plane, peak=np.array([103.0]))
    assert _leaks(cut, np.array([3.0]))[0] == leaks


# Ranks


@pytest.mark.parametrize(
    ("sample", "step"),
    [
        ([7, 23, 55], 16.0),
        ([0, 6, 10], 2.0),
        ([5, 5, 5], 1.0),
        ([0.0, 0.5, 3.0], 0.0),
        ([-8, 4, 16], 12.0),
        ([0.0, 2.0**53, 4.0], 0.0),
    ],
)
def test_the_step_of_a_sample_is_the_greatest_that_divides_all_differences(sample, step):
    assert digit_step(np.array(sample, dtype=float)) == step


@pytest.mark.parametrize("most", [0.5, 0.75])
def test_ranks_below_a_twentieth_and_above_three_quarters_say_nothing(most):
    values = np.sort(np.random.default_rng(6).normal(20.0, 3.0, 2000))
    none = np.zeros((1, 2000), dtype=bool)
    plain = np.array(level_and_noise(values[None], 0.0, none, most=most))
    np.testing.assert_allclose(plain[:, 0], [20.0, 3.0], rtol=0.06)
    for rank, counts in (
        (0.045, False),
        (0.055, True),
        (most - 0.005, True),
        (most + 0.005, False),
    ):
        moved, at = values.copy(), int(rank * 2000)
        moved[at] = (moved[at - 1 : at + 2] * [0.5, 0.0, 0.5]).sum() + 1e-6
        found = np.array(level_and_noise(moved[None], 0.0, none, most=most))
        assert (found != plain).any() == counts, rank


def test_fifteen_ranks_tell_level_and_noise_and_fourteen_do_not():
    for n, told in ((20, False), (21, True)):
        values = np.random.default_rng(n).normal(20.0, 3.0, (1, n)).round()
        none = np.zeros((1, n), dtype=bool)
        level, noise = level_and_noise(values, 4.0, none, unknown=(-1.0, -2.0))
        assert ((level[0], noise[0]) == (-1.0, -2.0)) != told
        level, noise = level_and_noise(values, 4.0, none)
        assert (noise[0] == 2.0) != told
        if not told:
            assert values.min() - 2.0 <= level[0] <= values.min() + 2.0


@pytest.mark.parametrize("share", [0.1, 0.4, 0.6])
def test_a_sky_that_is_clipped_at_black_keeps_its_level_and_noise(share):
    values = np.random.default_rng(7).standard_normal((1, 40_000))
    black = np.quantile(values, share)
    level, noise = level_and_noise(np.maximum(values, black), 0.0, values <= black)
    assert level[0] == pytest.approx(0.0, abs=0.03) and noise[0] == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(
    ("level", "noise", "told"),
    [
        (0.0, 4.0, "noise"),
        (-4.0, 4.0, "noise"),
        (20.0, 4.0, "nothing"),  # not clipped
        (100.3, 0.3, "nothing"),  # four in five are 100, by rounding
        (100.0, 0.05, "nothing"),  # all are 100
        (100.0, 0.7, "nothing"),  # a quarter is 99, by rounding
        (-8.0, 4.0, "clipped"),  # one in fifty is left
    ],
)
def test_a_ring_tells_the_noise_that_it_had_before_black_was_clipped(level, noise, told):
    rings = np.random.default_rng(41).normal(level, noise, (200, 360)).round().clip(0)
    rings[:, 7] = np.nan
    found = noise_above_black(rings.astype(np.float32))
    if told == "noise":
        assert np.mean(found) == pytest.approx(noise, rel=0.06)
        assert np.std(found) < (0.15 if level == 0.0 else 0.25) * noise
    elif told == "nothing":
        assert not found.any()
    else:
        assert np.isnan(found).mean() > 0.9


def test_medians_are_the_upper_of_two():
    assert medians(np.array([[4.0, 1.0, 3.0, 2.0], [1.0, 1.0, 5.0, 9.0]])).tolist() == [3.0, 5.0]
    assert medians(np.array([[3.0, 1.0, 2.0]])).tolist() == [2.0]


@pytest.mark.parametrize("radius", [0, 1, 3])
def test_the_brightest_pixel_is_looked_for_within_a_radius_and_the_frame(radius):
    for place in ((10, 12), (0, 0), (29, 19)):
        for across in (-1, 1):
            for reach, found in ((radius, True), (radius + 1, False)):
                at = place[0] + across * reach
                if not 0 <= at < 30:
                    continue
                image = np.zeros((20, 30), dtype=np.uint16)
                image[place[1], at] = 9
                peak = peak_pixels(image, [place], radius=radius)[0]
                assert (peak.tolist() == [at, place[1]]) == found
    assert np.isnan(peak_pixels(image, [(30.0, 3.0)], radius=radius)).all()
    assert np.isnan(peak_pixels(np.full((9, 9), np.nan), [(3.0, 3.0)], radius=radius)).all()
