"""Closed forms, allantools, and truth recovered within the stated uncertainty."""

import allantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import fftconvolve

import losbench as lb
from losbench.estimation.stability import split_error
from losbench.series import mark_gaps, sliding_mean

ZIGZAG = np.resize([1.0, -1.0], 1001)
NOISE = 0.48 / 0.2225
WHITE = np.random.default_rng(20230329).standard_normal(200_000)


def slow_and_white(seed, n, correlation_samples, size):
    """Gaussian-correlated error of one and white noise of NOISE, in the proportion of ren2023's
    cameras.
    """
    rng = np.random.default_rng(seed)
    width = correlation_samples / np.sqrt(2.0)
    lag = np.arange(-int(5 * width), int(5 * width) + 1)
    kernel = np.exp(-0.5 * (lag / width) ** 2)[:, None]
    slow = fftconvolve(
        rng.standard_normal((n + len(lag) - 1, size)),
        kernel / np.linalg.norm(kernel),
        "valid",
        axes=0,
    )
    return slow + NOISE * rng.standard_normal((n, size))


def test_a_zigzag_has_the_split_of_the_closed_form():
    split = split_error(ZIGZAG)
    assert [float(split.total), float(split.lsfe), float(split.nea)] == pytest.approx(
        [3.0, 0.6, 4.2426], abs=5e-5
    )
    assert lb.nea(ZIGZAG, method="residual") == pytest.approx(2.4, abs=5e-5)


def test_white_noise_has_the_split_of_the_closed_form():
    values = [
        split_error(WHITE).total,
        lb.lsfe(WHITE),
        lb.nea(WHITE, method="residual"),
        lb.nea(WHITE),
    ]
    np.testing.assert_allclose(values, [3.0, 3 / np.sqrt(5), 3 * np.sqrt(4 / 5), 3.0], rtol=0.01)


def test_total_is_slow_part_and_residual_together_for_white_noise():
    parts = np.hypot(lb.lsfe(WHITE), lb.nea(WHITE, method="residual"))
    assert parts == pytest.approx(float(split_error(WHITE).total), rel=0.01)


def test_noise_is_three_times_the_allan_deviation_at_the_sampling_time():
    _, expected, _, _ = allantools.oadev(WHITE[:5000], rate=8.0, data_type="freq", taus=[0.125])
    assert lb.nea(WHITE[:5000]) == pytest.approx(3 * expected[0], rel=1e-12)
    assert lb.allan_deviation(WHITE[:5000], rate_hz=8.0, tau_s=[0.125]) == pytest.approx(
        expected, rel=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize(("n", "correlation"), [(2400, 40), (2400, 120), (9600, 120)])
@pytest.mark.parametrize("window", [3, 5, 21])
def test_unbiased_forms_recover_truth_within_their_uncertainty_where_the_papers_do_not(
    n, correlation, window
):
    series = slow_and_white(n + correlation, n, correlation, 200)
    paper, fair = (
        split_error(series, window=window),
        split_error(series, window=window, unbiased=True),
    )
    for value, sigma, truth in (
        (fair.lsfe, fair.lsfe_sigma, 3.0),
        (fair.nea, fair.nea_sigma, 3.0 * NOISE),
    ):
        score = (value - truth) / sigma
        assert 0.58 < np.mean(np.abs(score) < 1) < 0.8
        assert np.mean(np.abs(score) < 2) > 0.86
        assert abs(np.median(score)) < 0.45
    assert np.std(fair.lsfe) == pytest.approx(np.mean(fair.lsfe_sigma), rel=0.2)
    assert np.std(fair.nea) == pytest.approx(np.mean(fair.nea_sigma), rel=0.2)
    leak = np.sqrt(1 + NOISE**2 / window)
    assert np.sqrt(np.mean(paper.lsfe**2)) / 3.0 == pytest.approx(leak, rel=0.07)


def test_the_uncertainty_of_lsfe_is_right_on_average_and_small_where_the_lsfe_is():
    fair = split_error(slow_and_white(20230329, 2400, 120, 500), unbiased=True)
    assert np.sqrt(np.mean((fair.lsfe - 3.0) ** 2)) == pytest.approx(
        np.mean(fair.lsfe_sigma), rel=0.15
    )
    assert np.corrcoef(fair.lsfe, fair.lsfe_sigma)[0, 1] > 0.5
    score = (fair.lsfe - 3.0) / fair.lsfe_sigma
    assert 1.0 < np.std(score) < 1.4
    assert 0.86 < np.mean(np.abs(score) < 2) < 0.94


def test_residuals_restored_give_the_noise_of_the_differences():
    series = slow_and_white(3, 9600, 120, 20)
    fair = lb.nea(series, method="residual", unbiased=True)
    np.testing.assert_allclose(fair, lb.nea(series), rtol=0.03)


def test_a_white_series_has_no_slow_part():
    split = split_error(WHITE[:10_000], unbiased=True)
    assert split.lsfe < 3 * split.lsfe_sigma


@pytest.mark.parametrize("scale", ["std", "mad"])
def test_a_constant_series_has_no_error_and_no_uncertainty(scale):
    split = split_error(np.full(100, 7.0), unbiased=True, scale=scale)
    values = [
        split.total,
        split.lsfe,
        split.nea,
        split.total_sigma,
        split.lsfe_sigma,
        split.nea_sigma,
    ]
    np.testing.assert_allclose(values, 0.0, atol=1e-12)


def test_one_camera_of_two_is_smaller_by_root_two():
    one, both = split_error(WHITE[:100]).per_camera(), split_error(WHITE[:100])
    assert np.array([one.total, one.nea_sigma]) * np.sqrt(2) == pytest.approx(
        np.array([both.total, both.nea_sigma])
    )


def test_outliers_hardly_move_the_robust_split():
    series = slow_and_white(7, 9600, 120, 1)[:, 0]
    dirty = series.copy()
    dirty[::97] += 500.0
    clean, robust = (
        split_error(series, unbiased=True),
        split_error(dirty, unbiased=True, scale="mad"),
    )
    assert split_error(dirty, unbiased=True).nea > 20 * clean.nea
    assert robust.nea == pytest.approx(float(clean.nea), rel=0.05)
    assert abs(robust.lsfe - 3.0) < 2 * robust.lsfe_sigma
    assert robust.nea_sigma > clean.nea_sigma


def test_a_gap_is_never_bridged():
    time = np.arange(2000) * 0.125
    series = WHITE[:2000]
    kept = np.r_[0:900, 1000:2000]
    stepped = series + 1e3 * (np.arange(2000) >= 950)
    gappy = mark_gaps(time[kept], stepped[kept])
    assert len(gappy) == len(kept) + 1 and np.isnan(gappy[900])
    assert lb.nea(gappy) == pytest.approx(float(lb.nea(series)), rel=0.02)
    assert np.isnan(sliding_mean(gappy)).sum() == 5
    assert mark_gaps(time, series).shape == series.shape


def test_missing_columns_do_not_spoil_their_neighbours():
    both = np.stack([WHITE[:500], WHITE[500:1000]], axis=1)
    both[100, 0] = np.nan
    alone = split_error(both[:, 1], unbiased=True)
    assert split_error(both, unbiased=True).lsfe_sigma[1] == pytest.approx(
        float(alone.lsfe_sigma), rel=1e-9
    )


@given(shift=st.floats(-1e3, 1e3), size=st.floats(1e-3, 1e3), window=st.sampled_from([3, 5, 9]))
def test_the_split_ignores_a_shift_and_follows_a_scale(shift, size, window):
    before, after = (
        split_error(s, window=window, unbiased=True)
        for s in (WHITE[:300], shift + size * WHITE[:300])
    )
    for name in ("total", "nea", "nea_sigma", "lsfe_sigma"):
        assert getattr(after, name) == pytest.approx(size * getattr(before, name), rel=1e-4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lb.lsfe(WHITE[:50], window=4),
            "window must be odd, so that its mean belongs to a sample, got 4",
        ),
        (
            lambda: lb.lsfe(WHITE[:4]),
            "series must hold at least 5 samples for a window of 5, got 4",
        ),
        (
            lambda: lb.lsfe([1.0, 2.0, np.nan, 3.0, 4.0]),
            "series must hold a run of 5 samples without a gap",
        ),
        (lambda: lb.nea([1.0, np.nan, 2.0]), "series must hold two neighbouring samples"),
        (
            lambda: lb.nea([1.0, 2.0], method="fft"),
            "method must be one of 'difference', 'residual', got 'fft'",
        ),
        (lambda: lb.lsfe(WHITE[:50], scale="iqr"), "scale must be one of 'std', 'mad', got 'iqr'"),
        (
            lambda: mark_gaps([0.0, 2.0, 1.0], [1.0, 2.0, 3.0]),
            "time_s must increase, but sample 2 at 1 s is before the one before it",
        ),
        (
            lambda: mark_gaps([0.0, 2.0], [1.0, 2.0, 3.0]),
            r"series must have shape \(2,\) to match 2 times, got \(3,\)",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
