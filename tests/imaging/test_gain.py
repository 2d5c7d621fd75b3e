"""Noise that frames tell of themselves: the gain that was put in, and errors that are the scatter.

Seeds were fixed before the first run.
"""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.noise import Gain, step_of
from losbench.imaging.pairs import nearest_pairs
from losbench.imaging.results import SpotFlag
from losbench.recording.contradiction import contradictions

SHAPE = (60, 120)
MIDDLES = np.array([[30.0, 30.0], [90.0, 30.0]])
SENSOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def run(seed, n=50, flux=2e5, sigma=2.0, jitter_px=0.0, sensor=SENSOR, sky_e=30.0):
    """Frames of two spots, and where these are."""
    rng = np.random.default_rng(seed)
    xy = MIDDLES + rng.uniform(-0.5, 0.5, (2, 2)) + rng.normal(0.0, jitter_px, (n, 1, 2))
    return sensor.expose(lb.render_spots(xy, flux, sigma, SHAPE) + sky_e, rng), xy


def stated_over_actual(method, recordings, **options):
    """Over so many recordings, in which every spot is somewhere else."""
    stated, actual, count = 0.0, 0.0, 0
    for seed in range(7000, 7000 + recordings):
        frames, xy = run(seed, **options)
        found = lb.centroid(frames, np.rint(xy), method=method)
        assert not found.flags.any()
        stated += np.sum(found.sigma_xy**2)
        actual += np.sum((found.xy - xy) ** 2)
        count += xy.size
    assert 1.0 / np.sqrt(2.0 * count) <= 0.016
    return np.sqrt(stated / actual)


@pytest.mark.parametrize("method", [lb.EIWA(), lb.Weighted()], ids=["eiwa", "weighted"])
@pytest.mark.parametrize(
    ("sigma", "flux", "jitter_px"),
    [(1.0, 2e4, 0.0), (2.0, 2e5, 0.0), (2.0, 2e4, 0.3), (2.0, 2e3, 0.0), (4.0, 4e5, 0.0)],
)
def test_without_a_detector_the_predicted_error_is_the_scatter(method, sigma, flux, jitter_px):
    # A brighter spot of sigma 1 shows EIWA's S-curve, 1 mpx, which is no noise: 0.94, also with the
    # true detector.
    ratio = stated_over_actual(method, 11, sigma=sigma, flux=flux, jitter_px=jitter_px)
    assert 0.95 < ratio < 1.05


@pytest.mark.parametrize("method", [lb.EIWA(), lb.Weighted()], ids=["eiwa", "weighted"])
@pytest.mark.parametrize(("n", "recordings"), [(3, 180), (10, 54)])
def test_few_frames_do_as_well_on_the_average(method, n, recordings):
    assert 0.93 < stated_over_actual(method, recordings, n=n) < 1.07


@pytest.mark.parametrize("bits", [8, 16])
def test_below_half_a_step_the_error_is_too_large_and_this_is_known(bits):
    """Eight bits, and twelve of sixteen aligned to the left."""
    coarse = lb.Detector(gain_e_per_dn=100.0, read_noise_e=5.0, offset_dn=10.0, bits=8)
    ratios = []
    for seed in range(6):
        frames, xy = run(seed, sensor=coarse)
        frames = frames.astype(np.uint8) if bits == 8 else 16 * frames.astype(np.uint16)
        found = lb.centroid(frames, np.rint(xy), method=lb.Weighted())
        assert found.noise.coarse
        ratios.append(found.sigma_xy.mean() / np.sqrt(np.mean((found.xy - xy) ** 2)))
    assert 1.0 < np.mean(ratios) < 1.4


@pytest.mark.parametrize(
    "options", [{}, {"n": 200}, {"jitter_px": 0.3}, {"jitter_px": 1.0}, {"sigma": 0.8}], ids=str
)
def test_the_gain_is_found_within_its_error(options):
    sigma = options.get("sigma", 2.0)
    found = [lb.estimate_gain(*run(seed, **options), sigma) for seed in range(9000, 9010)]
    per_dn, error = np.mean([(gain.per_dn, gain.std_error) for gain in found], axis=0)
    assert per_dn == pytest.approx(0.5, rel=0.06)
    assert 0.5 * error < np.std([gain.per_dn for gain in found]) < 1.7 * error < 0.11
    assert all(gain.known and gain.step_dn == 1.0 for gain in found)


def test_the_curve_lies_on_the_line():
    gain = lb.estimate_gain(*run(1, n=100), 2.0)
    curve = gain.curve
    line = curve.floor_dn2 + gain.per_dn * np.maximum(curve.signal_dn, 0.0)
    assert np.abs((curve.variance_dn2 - line) / curve.error_dn2)[2:].max() < 5.0
    assert (np.diff(curve.signal_dn) > 0).all() and curve.signal_dn[-1] > 2000.0
    assert curve.level_dn == pytest.approx(115.0, abs=2.0)


@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_the_unit_does_not_matter(factor):
    frames, xy = run(2)
    one = lb.estimate_gain(frames.astype(float), xy, 2.0)
    other = lb.estimate_gain(factor * frames, xy, 2.0)
    assert other.per_dn == pytest.approx(factor * one.per_dn, rel=1e-2)
    assert other.std_error == pytest.approx(factor * one.std_error, rel=1e-2)


def test_a_saturated_spot_does_not_tell_the_gain_and_others_do():
    frames, xy = run(3)
    capped = frames.copy()
    capped[:, :, :60] = np.minimum(capped[:, :, :60], 900)
    assert lb.estimate_gain(capped, xy, 2.0).per_dn == pytest.approx(0.5, rel=0.12)
    at_full_scale = lb.estimate_gain(np.minimum(frames, 1500), xy, 2.0, full_scale_dn=1500.0)
    assert at_full_scale.per_dn == pytest.approx(0.5, rel=0.12)


@pytest.mark.parametrize("frames", [2, 1, 0])
def test_where_frames_do_not_tell_the_error_is_infinite(frames):
    stack, xy = run(4, n=3)
    xy[frames:] = np.nan
    found = lb.estimate_gain(stack, xy, 2.0)
    assert found.per_dn == 0.0 and found.std_error == np.inf and not found.known


def test_a_gain_that_four_frames_of_a_sharp_spot_leave_open_is_not_taken_for_one():
    """One that is found to be zero, and may be anything, would make errors twenty times too
    small.
    """
    told = 0
    for seed in range(60):
        frames, xy = run(seed, n=4, flux=4e5, sigma=0.9, jitter_px=0.3)
        frames, xy = frames[:, :, :60], xy[:, :1]
        found, known = (
            lb.centroid(frames, np.rint(xy), method=lb.Weighted(0.9), detector=detector)
            for detector in (None, SENSOR)
        )
        stated = np.median(found.sigma_xy / known.sigma_xy)
        assert stated > 0.4 or (found.flags & SpotFlag.LOWER_BOUND).all()
        told += found.noise.known
    assert told > 30


def test_frames_of_a_spot_at_rest_are_paired_with_each_other_and_not_all_with_one():
    pairs = nearest_pairs(np.zeros((100, 1, 2)), 100).frames
    assert np.bincount(pairs.ravel()).max() <= 5 and len(pairs) > 50


def test_every_frame_is_paired_with_its_nearest_once_and_the_closest_come_first():
    places = np.array([[0.0, 0.0], [5.0, 0.0], [0.1, 0.0], [np.nan, 0.0], [5.0, 0.05], [5.0, 0.0]])
    one = places[:, None]
    assert nearest_pairs(one, 10).frames.tolist() == [[1, 5], [4, 5], [0, 2]]
    assert nearest_pairs(one, 2).frames.tolist() == [[1, 5], [4, 5]]
    assert len(nearest_pairs(one[:1], 10).spot) == 0


def test_spots_are_paired_as_if_each_were_alone():
    rng = np.random.default_rng(3)
    places = rng.normal(0.0, 0.3, (40, 5, 2)) + rng.uniform(0.0, 2.0, (5, 2))
    places[rng.random((40, 5)) < 0.2] = np.nan
    places[1:, 2] = np.nan
    together = nearest_pairs(places, 12)
    for k in range(5):
        mine, alone = together.spot == k, nearest_pairs(places[:, k : k + 1], 12)
        assert together.frames[mine].tolist() == alone.frames.tolist()
        np.testing.assert_array_equal(together.shared[mine], alone.shared)
    assert set(together.spot.tolist()) == {0, 1, 3, 4}


def test_pairs_that_share_a_frame_tell_less():
    """Two pairs of three frames: their mean has 1 + 2 / 4 / 2 times the variance."""
    places = np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[2.1, 0.0]]])
    assert nearest_pairs(places, 9).frames.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_allclose(nearest_pairs(places, 9).shared, 1.25)
    apart = np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[9.0, 0.0]], [[10.1, 0.0]]])
    np.testing.assert_allclose(nearest_pairs(apart, 9).shared, 1.0)


def test_the_step_of_whole_readings_is_seen_in_any_type():
    frames, _ = run(5, n=3)
    assert step_of(frames) == 1.0 and step_of(frames.astype(np.float32)) == 1.0
    assert step_of(16 * frames.astype(np.uint16)) == 16.0
    assert step_of(frames + 0.5 * np.sqrt(frames)) == 0.0
    assert step_of(np.full((3, 4, 4), np.nan)) == 0.0


@pytest.mark.parametrize(
    ("per_dn", "error", "said"),
    [(0.50, 0.01, 0), (0.56, 0.01, 0), (0.60, 0.01, 1), (0.60, 0.04, 0), (0.25, 0.02, 1)],
)
def test_a_gain_contradicts_a_detector_where_it_is_surely_another(per_dn, error, said):
    assert len(contradictions(SENSOR, Gain(per_dn, error))) == said
    assert not contradictions(SENSOR, Gain(0.0, np.inf))


@pytest.mark.parametrize("method", ["eiwa", "weighted"])
@pytest.mark.parametrize("black", [100.0, 3.0, 0.0, -3.0])
def test_errors_on_a_sky_clipped_at_black_are_those_of_the_scatter(black, method):
    """Bright spots on a level one noise above zero, at it and below: what is stated is neither
    below the scatter, for frames without another flag too, nor much above it.
    """
    rng = np.random.default_rng(8)
    light = lb.render_spots([[24.3, 23.8]], 1000.0 * 8 * np.pi, 2.0, (48, 48)) + black
    frames = (light + rng.normal(0.0, 3.0, (400, 48, 48))).round().clip(0).astype(np.uint16)
    found = lb.centroid(frames, [[24, 24]], method=method)
    stated, xy, flags = found.sigma_xy[:, 0], found.xy[:, 0], found.flags[:, 0]
    assert (flags & SpotFlag.CLIPPED > 0).all() == (black < 50.0)
    good = flags & ~SpotFlag.CLIPPED == 0
    assert 0.9 < stated.mean() / xy.std(axis=0).mean() < 1.2
    assert good.sum() > 40
    assert stated[good].mean() > 0.9 * xy[good].std(axis=0).mean()


@pytest.mark.parametrize("method", ["eiwa", "weighted"])
@pytest.mark.parametrize(("black", "sure"), [(4.0, 1.0), (0.0, 1.0), (-4.0, 1.0), (-8.0, 0.8)])
@pytest.mark.parametrize(("flux", "sigma"), [(1e5, 2.0), (2e3, 2.0), (2e4, 4.0)])
def test_where_black_is_clipped_gain_and_errors_hold_or_are_flagged(
    black, sure, flux, sigma, method
):
    """Gain 2 e-/DN and noise of 4 DN, on black from one noise above the lowest reading to two
    below, where next to nothing of the sky is left to tell its noise.
    """
    rng = np.random.default_rng(int(flux) + int(black) + 77)
    truth = np.array([[20.0, 20.0], [60.0, 30.0]]) + rng.normal(0.0, 0.15, (120, 2, 2))
    light = rng.poisson(lb.render_spots(truth, 2.0 * flux, sigma, (50, 80))) / 2.0 + black
    frames = (light + rng.normal(0.0, 4.0, light.shape)).round().clip(0).astype(np.uint16)
    found = lb.centroid(frames, truth.round(), method=method)
    assert (found.flags & SpotFlag.CLIPPED > 0).mean() >= sure
    ratio = found.sigma_xy.mean() / (found.xy - truth).std()
    if black > -8.0:
        assert found.noise.per_dn == pytest.approx(0.5, rel=0.3)
        assert 0.88 < ratio < 1.2
    else:
        assert 0.88 < ratio < 1.7
