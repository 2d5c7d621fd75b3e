"""The local linear trend against statsmodels itself, a filter written out by hand, and least
squares.
"""

import numpy as np
import pytest

import losbench as lb


def drifting(n=400, seed=1, variances=(0.09, 1e-4, 1e-7)):
    rng = np.random.default_rng(seed)
    noise, level, slope = np.sqrt(variances)
    rate = np.cumsum(slope * rng.standard_normal(n))
    truth = np.cumsum(rate + level * rng.standard_normal(n))
    return truth, truth + noise * rng.standard_normal(n)


def all_states_at_once(y, variances):
    """Levels, slopes and their covariance by weighted least squares over every state: no recursion,
    no start.
    """
    n, here = len(y), np.flatnonzero(~np.isnan(y))
    level, slope = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    rows = [level[here], level[1:] - level[:-1] - slope[:-1], slope[1:] - slope[:-1]]
    sizes = np.repeat(variances, [len(row) for row in rows])
    design = np.concatenate(rows) / np.sqrt(sizes)[:, None]
    right = np.concatenate([y[here], np.zeros(2 * n - 2)]) / np.sqrt(sizes)
    fit = lb.lstsq(design, right, scale=1.0)
    return fit.x[:n], fit.x[n:], fit.std_error[:n], fit.std_error[n:]


def test_given_variances_agree_with_least_squares_over_all_states():
    variances = np.array([0.09, 1e-3, 1e-5])
    y = drifting(60)[1]
    y[[0, 20, 21, 22, 59]] = np.nan
    fit = lb.kalman_smooth(y, variances=variances)
    found = fit.smoothed, fit.slope, fit.smoothed_std, fit.slope_std
    for ours, reference in zip(found, all_states_at_once(y, variances), strict=True):
        np.testing.assert_allclose(ours, reference, atol=1e-8)
    for now in (2, 10, 22, 58):
        level, _, level_std, _ = all_states_at_once(y[: now + 1], variances)
        assert fit.filtered[now] == pytest.approx(level[-1], abs=1e-8)
        assert fit.filtered_std[now] == pytest.approx(level_std[-1], abs=1e-8)
    assert np.isnan(fit.filtered[:2]).all()
    np.testing.assert_allclose(fit.variances, variances, rtol=1e-12)


def test_without_steps_the_smoother_is_a_straight_line_fit():
    y = drifting(60)[1]
    y[5:9] = np.nan
    here = ~np.isnan(y)
    design = np.column_stack([np.ones(60), np.arange(60.0)])
    line = lb.lstsq(design[here], y[here], scale=0.3)
    fit = lb.kalman_smooth(y, variances=[0.09, 0.0, 0.0])
    np.testing.assert_allclose(fit.smoothed, design @ line.x, atol=1e-10)
    np.testing.assert_allclose(fit.slope, line.x[1], atol=1e-10)
    np.testing.assert_allclose(
        fit.smoothed_std, np.sqrt(np.einsum("ij,jk,ik->i", design, line.cov, design)), rtol=1e-7
    )


def test_the_likelihood_is_that_of_second_differences():
    """Differencing twice removes the unknown start, for which the likelihood still counts log(2
    pi).
    """
    from scipy.stats import multivariate_normal

    noise, level, slope = variances = np.array([0.09, 0.01, 0.001])
    y = drifting(30)[1]
    n = len(y) - 2
    # Second differences are e_t - 2 e_(t-1) + e_(t-2) + u_(t-1) - u_(t-2) + v_(t-2).
    cov = (6 * noise + 2 * level + slope) * np.eye(n)
    cov += (-4 * noise - level) * (np.eye(n, k=1) + np.eye(n, k=-1))
    cov += noise * (np.eye(n, k=2) + np.eye(n, k=-2))
    expected = multivariate_normal(np.zeros(n), cov).logpdf(np.diff(y, 2)) - np.log(2 * np.pi)
    assert lb.kalman_smooth(y, variances=variances).log_likelihood == pytest.approx(
        expected, abs=1e-6
    )


def test_maximum_likelihood_is_at_least_as_good_as_the_truth_and_as_statsmodels():
    from statsmodels.tsa.statespace.structural import UnobservedComponents

    truth = (0.09, 1e-3, 1e-5)
    y = drifting(400, seed=5, variances=truth)[1]
    fit = lb.kalman_smooth(y)
    assert fit.converged
    assert fit.log_likelihood >= lb.kalman_smooth(y, variances=truth).log_likelihood
    peer = UnobservedComponents(y, "local linear trend", use_exact_diffuse=True).fit(disp=0)
    assert fit.log_likelihood >= peer.llf - 1e-3
    assert fit.variances[0] == pytest.approx(0.09, rel=0.3)


def test_predicted_errors_are_the_errors_made_in_gaps_too():
    variances = (0.09, 1e-3, 1e-6)
    pulls = []
    for seed in range(30):
        truth, y = drifting(200, seed, variances)
        y[80:110] = np.nan
        fit = lb.kalman_smooth(y, variances=variances)
        pulls.append((fit.smoothed - truth) / fit.smoothed_std)
    pulls = np.array(pulls)
    assert np.sqrt(np.mean(pulls**2)) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean(pulls[:, 85:105] ** 2)) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_the_unit_does_not_matter(unit):
    y = drifting()[1]
    plain, scaled = lb.kalman_smooth(y), lb.kalman_smooth(y * unit + 300 * unit)
    np.testing.assert_allclose(scaled.smoothed / unit - 300, plain.smoothed, atol=1e-5)
    np.testing.assert_allclose(scaled.smoothed_std / unit, plain.smoothed_std, rtol=1e-3)
    assert scaled.log_likelihood + (len(y) - 2) * np.log(unit) == pytest.approx(
        float(plain.log_likelihood), abs=1e-4
    )


def test_smoothing_brings_the_series_nearer_to_the_truth():
    truth, y = drifting()
    fit = lb.kalman_smooth(y)
    assert lb.rms(fit.smoothed - truth, about=0) < 0.4 * lb.rms(y - truth, about=0)
    assert lb.rms(fit.filtered[5:] - truth[5:], about=0) < 0.6 * lb.rms(y - truth, about=0)


def test_columns_are_smoothed_alone():
    series = np.stack([drifting(60, seed)[1] for seed in range(4)], axis=1).reshape(60, 2, 2)
    together = lb.kalman_smooth(series)
    assert together.smoothed.shape == (60, 2, 2)
    assert together.variances.shape == (3, 2, 2)
    assert together.log_likelihood.shape == together.converged.shape == (2, 2)
    alone = lb.kalman_smooth(series[:, 1, 0])
    np.testing.assert_array_equal(together.smoothed[:, 1, 0], alone.smoothed)
    np.testing.assert_array_equal(together.variances[:, 1, 0], alone.variances)


@pytest.mark.parametrize("y", [np.full(20, 3.7), 0.01 * np.arange(20.0) - 4, np.zeros(20)])
def test_an_exact_line_stays_what_it_is(y):
    gappy = y.copy()
    gappy[7:9] = np.nan
    fit = lb.kalman_smooth(gappy)
    np.testing.assert_allclose(fit.smoothed, y, atol=1e-12)
    assert fit.converged
    assert (fit.smoothed_std > 0.0).all()
    size = np.abs(y).max()
    assert (fit.smoothed_std <= max(64 * np.finfo(float).eps * size, 1e-99)).all()
    np.testing.assert_allclose(np.sqrt(fit.variances), [max(64 * 2**-52 * size, 1e-100), 0.0, 0.0])


@pytest.mark.parametrize(("bend", "exact"), [(60.0, True), (70.0, False)])
def test_a_line_is_exact_to_64_roundings_of_its_size(bend, exact):
    """A step in its middle by so many roundings, between slopes of none."""
    y = np.ones(21)
    y[10:] += bend * np.finfo(float).eps
    variance = lb.kalman_smooth(y).variances[0]
    expected = pytest.approx((64 * np.finfo(float).eps) ** 2, rel=1e-9, abs=0.0)
    assert (variance == expected) == exact


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_given_variances_have_their_unit_on_an_exact_line_too(unit):
    fit = lb.kalman_smooth(np.zeros(5), variances=[unit**2, 0.0, 0.0])
    np.testing.assert_allclose(fit.smoothed_std[2], unit / np.sqrt(5.0), rtol=1e-9)
    np.testing.assert_allclose(fit.variances, [unit**2, 0.0, 0.0], rtol=1e-15)


def test_a_column_with_too_few_samples_is_flagged_and_the_others_go_on():
    series = np.stack([drifting(50)[1], np.full(50, np.nan)], axis=1)
    series[:3, 1] = 1.0, 2.0, 4.0
    with pytest.warns(
        RuntimeWarning, match=r"kalman_smooth: 1 of 2 series are too short or did not converge"
    ):
        fit = lb.kalman_smooth(series)
    assert fit.converged.tolist() == [True, False]
    assert np.isnan(fit.smoothed[:, 1]).all()
    assert np.isfinite(fit.smoothed[:, 0]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"series": np.ones(3)}, r"series must have at least 4 frames, got shape \(3,\)"),
        (
            {"series": [1.0, np.inf, 2.0, 3.0]},
            "series must be finite or NaN, got 1 infinite of 4 values",
        ),
        (
            {"series": np.ones((9, 2)), "variances": [1.0, 2.0]},
            r"variances must have shape \(3,\) or \(3, 2\), got \(2,\)",
        ),
        (
            {"series": np.ones(9), "variances": [1.0, -2.0, 0.0]},
            "variances must not be negative, got -2",
        ),
        ({"series": np.ones(9), "variances": [0.0, 0.0, 0.0]}, "variances must not all be zero"),
    ],
)
def test_bad_input_is_refused_by_name(arguments, message):
    with pytest.raises(ValueError, match=message):
        lb.kalman_smooth(**arguments)
