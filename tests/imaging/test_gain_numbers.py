"""The steps of the gain, one by one: which spots and pairs tell, what explains a difference, and the
regression, against loops, least squares and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import gain
from losbench.imaging.columns import Templates
from losbench.imaging.gain import _brightest, _curve, _samples, _Slope, _slope, _tells
from losbench.imaging.groups import grouped
from losbench.imaging.noise import Gain
from losbench.imaging.pairs import Pairing, Pairs, _explaining

RNG = np.random.default_rng(61)


# Which spots and pairs


def test_the_sixteen_spots_that_read_most_on_the_average_tell():
    x = 1 + 2 * np.arange(20)
    level = RNG.permutation(20) + 10.0
    stack = np.zeros((5, 9, 42))
    stack[:, 4, x] = level * np.array([0.5, 1.5, 1.0, 0.8, 1.2])[:, None]
    places = np.stack(np.broadcast_arrays(x + 0.4, 3.6), axis=-1) * np.ones((5, 1, 1))
    order = np.argsort(-level)
    assert _brightest(stack, places).tolist() == order[:16].tolist()
    places[3:, order[0]] = np.nan  # in three frames, and none of the brightest of its frames
    stack[2:, 4, x[order[1]]] = np.nan  # read in two
    places[2:, order[2], 0] = -0.6  # within the frame in two
    seen = stack[:, 4, x].mean(axis=0)
    seen[order[0]] = stack[:3, 4, x[order[0]]].mean()
    expected = [k for k in np.argsort(-seen) if k not in (order[1], order[2])][:16]
    assert sorted(_brightest(stack, places).tolist()) == sorted(expected)
    assert _brightest(stack, places).tolist() == [k for k in np.argsort(-seen) if k in expected]


@pytest.mark.parametrize(
    ("place", "seen"),
    [
        ((0.0, 0.0), True),
        ((-0.4, -0.4), True),
        ((41.4, 8.4), True),
        ((-0.6, 0.0), False),
        ((0.0, -0.6), False),
        ((41.6, 4.0), False),
        ((4.0, 8.6), False),
    ],
)
def test_a_spot_is_read_as_far_as_pixels_reach(place, seen):
    assert len(_brightest(np.ones((3, 9, 42)), np.tile(place, (3, 1, 1)))) == seen


def few_pairs(count=2, pixels=9):
    """Pairs that no shift, width or light has changed."""
    return Pairs(
        difference=np.ones((count, pixels)),
        signal=np.tile(np.linspace(1.0, 9.0, pixels), (count, 1)),
        basis=np.zeros((count, 14, pixels)),
        floor=np.ones((count, 1)),
        use=np.ones((count, pixels), bool),
        shifted=np.zeros((count, pixels)),
        shared=np.ones(count),
        level=np.zeros(count),
    )


def spy_on_windows(monkeypatch):
    asked = []

    def compared(stack, pairing, at, width, side, full_scale_dn, step):
        asked.append((pairing, at, width, side))
        return few_pairs(len(at))

    monkeypatch.setattr(gain.Pairs, "compared", compared)
    return asked


@pytest.mark.parametrize(
    ("n_spots", "width", "side", "pairs"),
    [
        (1, 2.0, 13, 96),
        (1, 2.1, 15, 96),
        (2, 2.0, 13, 48),
        (5, 2.0, 13, 19),
        (1, 10.0, 61, 70),  # 2^18 pixels in all
        (2, 10.0, 61, 35),
        (1, 100.0, 601, 2),  # but two pairs of each
    ],
)
def test_windows_of_three_sigma_either_way_are_96_pairs_in_all(
    monkeypatch, n_spots, width, side, pairs
):
    asked = spy_on_windows(monkeypatch)
    stack = np.zeros((250, 4, 30))
    start = np.stack([np.arange(n_spots), np.ones(n_spots)], axis=-1)
    wandering = start + RNG.uniform(0.0, 0.3, (250, n_spots, 2))
    lb.estimate_gain(stack, wandering, width)
    spots = np.concatenate([pairing.spot for pairing, *_ in asked])
    assert np.bincount(spots).tolist() == [pairs] * n_spots
    for pairing, at, widths, of_side in asked:
        assert of_side == side and (widths == width).all()
        np.testing.assert_array_equal(at, wandering[pairing.frames, pairing.spot[:, None]])


def test_a_width_is_that_of_each_spot(monkeypatch):
    asked = spy_on_windows(monkeypatch)
    stack = np.zeros((5, 4, 30))
    stack[:, 1, 20] = 9.0
    xy = np.array([[10.0, 1.0], [20.0, 1.0]]) + RNG.uniform(0.0, 0.1, (5, 2, 2))
    lb.estimate_gain(stack, xy, [1.0, 2.0])
    assert [(widths[0], side) for _, _, widths, side in asked] == [(1.0, 7), (2.0, 13)]
    for (_, at, *_), x in zip(asked, (10.0, 20.0), strict=True):
        np.testing.assert_allclose(at[..., 0], x, atol=0.1)


@pytest.mark.parametrize(("n", "looked"), [(2, 0), (3, 3), (64, 64), (65, 64), (200, 64)])
def test_64_frames_of_a_recording_are_looked_at(monkeypatch, n, looked):
    seen = []

    def estimate(stack, xy, width, **options):
        seen.append((len(stack), xy, width, options))
        return Gain(0.5, 0.1)

    monkeypatch.setattr(gain, "estimate_gain", estimate)
    one = lb.render_spots([[12.3, 11.0], [31.0, 12.6]], 4e4, 1.5, (24, 46)).round()
    stack = np.broadcast_to(one.astype(np.uint16), (n, 24, 46))
    places = np.tile([[12.0, 11.0], [31.0, 13.0]], (n, 1, 1))

    def found_at(places):
        sides = np.array([11, 9])
        return gain.recording_gain(
            grouped(stack, places, sides, lb.EIWA(), lb.Ring(), None, None), stack
        )

    found = found_at(places)
    if not looked:
        assert (found.per_dn, found.std_error, found.step_dn) == (0.0, np.inf, 1.0) and not seen
        return
    ((frames, xy, width, options),) = seen
    assert (frames, options) == (looked, {"full_scale_dn": 65535.0})
    rank = np.argsort(xy[0, :, 0])
    np.testing.assert_allclose(width[rank], [11 / 6, 9 / 6])
    expected = np.tile([[12.3, 11.0], [31.0, 12.6]], (looked, 1, 1))
    np.testing.assert_allclose(xy[:, rank], expected, atol=0.03)
    nowhere = found_at(np.full_like(places, np.nan))
    assert nowhere.std_error == np.inf and len(seen) == 1


# Windows of a pair


def pair_of(
    frames, at=((20.0, 20.0), (20.0, 20.0)), *, full_scale_dn=np.inf, step=0.0, pairs=((0, 1),)
):
    count = len(pairs)
    pairing = Pairing.of_frames(np.zeros(count, int), np.array(pairs))
    places, width = np.tile(at, (count, 1, 1)), np.full(count, 1.5)
    return Pairs.compared(np.asarray(frames), pairing, places, width, 9, full_scale_dn, step)


def noisy(n=2, sigma=1.0):
    light = lb.render_spots([[20.0, 20.0]], 3e4, sigma, (41, 41)) + 50.0
    return light + np.random.default_rng(3).normal(0.0, 2.0, (n, 41, 41))


def test_the_difference_and_the_mean_of_two_windows_without_their_rings():
    frames = noisy() + np.array([0.0, 300.0])[:, None, None]
    found = pair_of(frames)
    inner = frames[:, 16:25, 16:25]
    np.testing.assert_allclose(found.difference[0], (inner[0] - inner[1]).ravel())
    np.testing.assert_allclose(found.level, [200.0], atol=1.0)
    # A plane of the noise of the ring is off by a tenth of it or so.
    expected = (inner.mean(axis=0) - 200.0).ravel()
    np.testing.assert_allclose(found.signal[0], expected, atol=1.0)
    assert found.floor[0, 0] == pytest.approx(4.0, rel=0.15)
    assert found.use.all() and found.difference.shape == (1, 81)


@pytest.mark.parametrize("step", [0.0, 1.0, 16.0, 48.0])
def test_the_floor_is_at_least_the_variance_of_a_rounding(step):
    """step^2 / 12, that of a uniform distribution as wide as the step."""
    frames = np.broadcast_to(lb.render_spots([[20.0, 20.0]], 3e4, 1.0, (41, 41)), (2, 41, 41))
    assert pair_of(frames, step=step).floor[0, 0] == pytest.approx(step**2 / 12.0, abs=1e-6)
    scatter = pair_of(noisy(), step=step).floor[0, 0]
    assert scatter == pytest.approx(max(step**2 / 12.0, 4.0), rel=0.15)


@pytest.mark.parametrize(("sharing", "used"), [(4, True), (5, False)])
@pytest.mark.parametrize("frame", [0, 1])
def test_a_plateau_of_five_pixels_has_no_noise(sharing, used, frame):
    frames = noisy()
    inner = frames[frame, 16:25, 16:25]
    top = frames.max() + 10.0
    inner[3, 2 : 2 + sharing] = top
    use = pair_of(frames).use.reshape(9, 9)
    assert use[3, 2 : 2 + sharing].all() == use[3, 2] == used
    assert use.sum() == 81 - (0 if used else sharing)


def test_readings_below_full_scale_are_used_in_both_frames():
    frames = noisy()
    frames[0, 20, 18], frames[1, 20, 22], frames[1, 18, 18] = 9000.0, 9001.0, 8999.0
    use = pair_of(frames, full_scale_dn=9000.0).use.reshape(9, 9)
    assert np.argwhere(~use).tolist() == [[4, 2], [4, 6]]


def test_what_was_not_read_in_either_frame_or_beside_it_is_left_out():
    frames = noisy()
    frames[0, 19, 21], frames[1, 23, 17] = np.nan, np.nan
    found = pair_of(frames)
    use = found.use.reshape(9, 9)
    assert np.argwhere(~use).tolist() == [[3, 5], [7, 1]]
    assert np.isfinite(found.basis).all()
    assert found.signal[0].reshape(9, 9)[[3, 7], [5, 1]].tolist() == [0.0, 0.0]
    frames[:, :12], frames[:, 29:], frames[:, :, :12], frames[:, :, 29:] = [np.nan] * 4
    frames[:, 12:16], frames[:, 25:], frames[:, :, 12:16], frames[:, :, 25:] = [np.nan] * 4
    assert not pair_of(frames).use.any()  # no ring tells the floor


def test_gradient_squared_times_shift_squared_is_what_a_shift_may_leave():
    frames = noisy(sigma=2.5)
    at = ((20.2, 20.1), (19.9, 20.5))
    found = pair_of(frames, at)
    rows, columns = np.gradient(frames.mean(axis=0))
    square = (rows**2 + columns**2)[16:25, 16:25].ravel() * (0.3**2 + 0.4**2)
    np.testing.assert_allclose(found.shifted[0], square, rtol=0.02, atol=0.02 * square.max())


def test_the_template_of_a_pair_stands_between_its_two_places():
    found = pair_of(noisy(), ((20.5, 19.6), (20.1, 19.8)))
    expected = lb.render_spots([[4.3, 3.7]], 1.0, 1.5, (9, 9))
    np.testing.assert_allclose(found.basis[0, 9].reshape(9, 9), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("pairs", "shared"),
    [
        ([(0, 1)], 1.0),
        ([(0, 1), (2, 3)], 1.0),
        ([(0, 1), (1, 2)], 1.25),
        ([(0, 1), (0, 2), (0, 3), (0, 4)], 1.75),
    ],
)
def test_pairs_that_share_a_frame_tell_less(pairs, shared):
    """Squares of a - b and b - c are correlated by a quarter; so much more is the variance of the
    mean."""
    np.testing.assert_allclose(pair_of(noisy(5), pairs=pairs).shared, shared)
    of_frames = np.random.default_rng(1).standard_normal((40_000, 5))
    squares = np.stack([(of_frames[:, a] - of_frames[:, b]) ** 2 for a, b in pairs]) / 2.0
    assert squares.mean(axis=0).var() * len(pairs) / 2.0 == pytest.approx(shared, rel=0.05)


@pytest.mark.parametrize("width", [0.1, 0.3, 1.7])
def test_what_may_explain_a_difference_stands_in_fourteen_columns(width):
    signal = RNG.random((2, 9, 9))
    centre = np.array([[0.2, -0.3], [-0.1, 0.4]])
    found = _explaining(signal, centre, np.array([width, width + 0.1])).reshape(2, 14, 7, 7)
    widths = np.maximum([[width] * 2, [width + 0.1] * 2], 0.3)
    template = Templates.of(7, centre, widths, np.float64, free=True).profiles
    for p in range(2):
        for y in range(7):
            for x in range(7):
                s = signal[p, y : y + 3, x : x + 3]
                along_x, along_y = template[p, 0, :, x], template[p, 1, :, y]
                expected = [
                    1.0,
                    s[1, 1],
                    x - 3.0,
                    y - 3.0,
                    s[1, 2] - s[1, 0],
                    s[2, 1] - s[0, 1],
                    s[1, 2] - 2 * s[1, 1] + s[1, 0],
                    s[2, 1] - 2 * s[1, 1] + s[0, 1],
                    (s[2, 2] - s[2, 0]) - (s[0, 2] - s[0, 0]),
                    along_x[0] * along_y[0],
                    along_x[1] * along_y[0],
                    along_x[0] * along_y[1],
                    along_x[2] * along_y[0],
                    along_x[0] * along_y[2],
                ]
                np.testing.assert_allclose(found[p, :, y, x], expected, atol=1e-12)


# Samples of the variance


def pairs_with(basis, *, difference=None, signal=None, shifted=None, use=None, shared=1.0):
    """Columns (P, S, k), as least squares has them."""
    count, pixels, _ = basis.shape
    rng = np.random.default_rng(5)
    return Pairs(
        difference=rng.normal(0.0, 2.0, (count, pixels)) if difference is None else difference,
        signal=rng.uniform(-2.0, 9.0, (count, pixels)) if signal is None else signal,
        basis=basis.swapaxes(1, 2),
        floor=rng.uniform(1.0, 2.0, (count, 1)),
        use=np.ones((count, pixels), bool) if use is None else use,
        shifted=rng.uniform(0.0, 2.0, (count, pixels)) if shifted is None else shifted,
        shared=np.full(count, shared),
        level=rng.uniform(90.0, 110.0, count),
    )


@pytest.mark.parametrize("first", [True, False])
def test_samples_are_squares_of_what_weighted_least_squares_leaves(first):
    """Corrected for leverage; columns may be zero or twice the same."""
    basis = RNG.normal(0.0, 1.0, (3, 40, 5))
    basis[:, :, 3], basis[1, :, 4] = basis[:, :, 0], 0.0
    use = RNG.random((3, 40)) < 0.8
    pairs = pairs_with(basis, use=use)
    pairs.difference[~use] = 0.0
    found = _samples(pairs, 0.3, 0.2, first=first)
    for p in range(3):
        variance = pairs.floor[p] + 0.3 * np.maximum(pairs.signal[p], 0.0) + 0.2 * pairs.shifted[p]
        columns = basis[p] * (use[p] / np.sqrt(variance))[:, None]
        hat = columns @ np.linalg.pinv(columns, rcond=1e-6)
        data = pairs.difference[p] / np.sqrt(variance)
        leverage = np.diag(hat)
        square = (data - hat @ data) ** 2 / (2.0 * (1.0 - leverage)) * variance
        np.testing.assert_allclose(found.square[p], square, rtol=1e-4, atol=1e-6)
        told = use[p] & (leverage < 0.7) & (first | (square < 16.0 * variance))
        weight = (1.0 - leverage) / (2.0 if first else 2.0 * variance**2)
        np.testing.assert_allclose(found.weight[p], np.where(told, weight, 0.0), rtol=1e-6)


def test_columns_that_differ_by_a_thousandth_are_two_in_any_unit():
    basis = RNG.normal(0.0, 1.0, (1, 40, 3))
    basis[0, :, 1] = basis[0, :, 0] + 1e-3 * basis[0, :, 1]
    pairs = pairs_with(basis)
    variance = pairs.floor[0] + 0.3 * np.maximum(pairs.signal[0], 0.0)
    columns = basis[0] / np.sqrt(variance)[:, None]
    data = pairs.difference[0] / np.sqrt(variance)
    rest = data - columns @ np.linalg.lstsq(columns, data, rcond=None)[0]
    leverage = np.diag(columns @ np.linalg.pinv(columns))
    for unit in (1.0, 1e-7, 1e7):
        found = _samples(replace(pairs, basis=unit * pairs.basis), 0.3, 0.0, first=True)
        square = rest**2 / (2.0 * (1.0 - leverage)) * variance
        np.testing.assert_allclose(found.square[0], square, rtol=0.01)


@pytest.mark.parametrize(("leverage", "told"), [(0.69, True), (0.71, False)])
def test_a_pixel_that_is_seven_tenths_of_its_own_explanation_tells_nothing(leverage, told):
    basis = np.full((1, 30, 1), np.sqrt((1.0 - leverage) / 29))
    basis[0, 0] = np.sqrt(leverage)
    weight = _samples(pairs_with(basis), 0.0, 0.0, first=True).weight[0]
    assert (weight[0] > 0) == told and (weight[1:] > 0).all()


@pytest.mark.parametrize(("times", "told"), [(15.9, True), (16.1, False)])
def test_a_square_beyond_sixteen_times_the_variance_is_no_noise(times, told):
    pairs = pairs_with(np.zeros((1, 30, 2)))
    variance = pairs.floor[0, 0] + 0.5 * max(pairs.signal[0, 3], 0.0) + 0.1 * pairs.shifted[0, 3]
    pairs.difference[:] = 0.1
    pairs.difference[0, 3] = np.sqrt(2.0 * times * variance)
    assert (_samples(pairs, 0.5, 0.1, first=False).weight[0, 3] > 0) == told
    assert _samples(pairs, 0.5, 0.1, first=True).weight[0, 3] > 0


# The regression


def on_a_line(per_dn, left, count=4, pixels=60, shared=1.0, scale=1.0):
    """Pairs whose differences are what floor + per_dn signal + left shifted calls for."""
    rng = np.random.default_rng(7)
    signal = rng.uniform(0.0, 1.0, (count, pixels)) * scale
    shifted = rng.uniform(0.0, 1.0, (count, pixels)) * scale
    pairs = pairs_with(np.zeros((count, pixels, 1)), signal=signal, shifted=shifted, shared=shared)
    variance = pairs.floor + per_dn * signal + left * shifted
    pairs.difference[:] = np.sqrt(2.0 * variance)
    return pairs, variance


@pytest.mark.parametrize("per_dn", [0.0, 0.25, 3.0])
@pytest.mark.parametrize("shared", [1.0, 1.5])
def test_the_slope_of_a_line_is_found_with_the_error_of_weighted_least_squares(per_dn, shared):
    """A square of normal noise of the variance V has the variance 2 V^2."""
    pairs, variance = on_a_line(per_dn, 0.0, shared=shared)
    found = _slope([pairs])
    assert found.per_dn == pytest.approx(per_dn, abs=1e-9) and found.left == 0.0
    information = (pairs.signal**2 / (2.0 * variance**2)).sum() / shared
    assert found.error == pytest.approx(information**-0.5, rel=1e-6)


def test_spots_add_up_whatever_their_floor():
    parts = [on_a_line(0.5, 0.0, count=k)[0] for k in (2, 5)]
    found = _slope(parts)
    assert found.per_dn == pytest.approx(0.5)
    alone = np.array([_slope([part]).error for part in parts])
    assert found.error == pytest.approx((alone**-2.0).sum() ** -0.5, rel=1e-6)
    assert len(found.samples) == 2


def test_a_slope_is_not_negative_and_nothing_tells_none():
    pairs, _ = on_a_line(-0.5, 0.0, scale=0.5)
    assert _slope([pairs]).per_dn == 0.0
    nothing, _ = on_a_line(0.5, 0.0)
    nothing.use[:] = False
    found = _slope([nothing])
    assert found.per_dn == 0.0 and found.error > 1e100


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_a_slope_tells_where_the_brightest_variance_is_known_within_twice_itself(per_dn):
    signal = np.full((2, 9), 20.0)
    signal[1, 4], signal[0, 2] = 80.0, 900.0
    pairs = pairs_with(np.zeros((2, 9, 1)), signal=signal)
    pairs.use[0, 2] = False
    pairs.floor[:] = [[1.0], [3.0]]
    faint = pairs_with(np.zeros((1, 9, 1)), signal=signal[:1] * 0.0)
    faint.floor[:] = 2.0
    limit = 2.0 * (2.0 / 80.0 + per_dn)
    for times, told in ((0.99, True), (1.01, False)):
        assert _tells(_Slope(per_dn, 0.0, times * limit, []), [faint, pairs]) == told
    assert not _tells(_Slope(per_dn, 0.0, np.inf, []), [pairs])


def test_what_a_shift_leaves_is_told_from_the_signal():
    pairs, _ = on_a_line(0.5, 40.0, count=40)
    found = _slope([pairs])
    assert (found.per_dn, found.left) == pytest.approx((0.5, 40.0), rel=1e-6)
    one = on_a_line(0.5, 0.0, count=40)[0]
    assert found.error > _slope([one]).error


@pytest.mark.parametrize(("sigmas", "kept"), [(2.8, False), (3.2, True)])
def test_what_a_shift_leaves_is_kept_where_it_is_sure_by_three_sigma(sigmas, kept):
    pairs, variance = on_a_line(0.0, 0.0, count=400, scale=0.1)
    columns = np.stack([pairs.signal, pairs.shifted], axis=-1).reshape(-1, 2)
    information = columns.T @ (columns / (2.0 * variance.reshape(-1, 1) ** 2))
    left = sigmas * np.sqrt(np.linalg.inv(information)[1, 1])
    pairs.difference[:] = np.sqrt(2.0 * (pairs.floor + left * pairs.shifted))
    found = _slope([pairs])
    assert (found.left > 0) == kept
    if kept:
        assert found.left == pytest.approx(left, rel=1e-3)
        assert found.error == pytest.approx(np.linalg.inv(information)[0, 0] ** 0.5, rel=0.05)


@pytest.mark.parametrize(("count", "looked"), [(47, 47), (48, 12), (50, 13)])
def test_nothing_is_cut_in_the_first_of_three_rounds(monkeypatch, count, looked):
    """The rounds that only tell the weights make do with every fourth of many pairs."""
    rounds = []

    def samples(pairs, per_dn, left, *, first):
        rounds.append((first, per_dn, left, len(pairs.level)))
        return _samples(pairs, per_dn, left, first=first)

    monkeypatch.setattr(gain, "_samples", samples)
    _slope([on_a_line(0.5, 0.0, count=count)[0]])
    assert [first for first, *_ in rounds] == [True, False, False]
    assert rounds[0] == (True, 0.0, 0.0, looked) and rounds[1][1] == pytest.approx(0.5)
    assert [n for *_, n in rounds] == [looked, looked, count]


@pytest.mark.parametrize(("pixels", "bins"), [(60, 12), (7, 7)])
def test_the_curve_has_twelve_bins_of_as_many_pixels(pixels, bins):
    pairs, _ = on_a_line(0.5, 40.0, count=1 if pixels == 7 else 40, pixels=pixels)
    pairs.use[0, 0] = False
    slope = _slope([pairs])
    curve = _curve([pairs], slope)
    used = slope.samples[0].weight > 0
    signal = pairs.signal[used]
    square = (slope.samples[0].square - slope.left * pairs.shifted)[used]
    parts = np.array_split(np.argsort(signal), 12)
    parts = [part for part in parts if len(part)]
    assert len(curve.signal_dn) == len(parts) == min(bins, used.sum())
    np.testing.assert_allclose(curve.signal_dn, [signal[part].mean() for part in parts])
    np.testing.assert_allclose(curve.variance_dn2, [square[part].mean() for part in parts])
    share = [np.sqrt(2.0 / len(part)) for part in parts]  # of a mean of so many squares
    np.testing.assert_allclose(curve.error_dn2 / curve.variance_dn2, share)
    assert curve.floor_dn2 == np.median(pairs.floor)
    assert curve.level_dn == np.median(pairs.level)


# Options


def test_noise_below_half_a_step_is_coarse():
    for floor, coarse in ((0.99 * 64.0, True), (1.01 * 64.0, False)):
        curve = gain.Transfer(*np.zeros((3, 1)), floor, 0.0)
        assert Gain(0.5, 0.1, 16.0, curve).coarse == coarse
    assert not Gain(0.5, 0.1, 16.0).coarse
    assert Gain(0.5, 0.1, 16.0).rounding == pytest.approx(32.0)  # more than 256 / 12
