"""Numbers that the docstrings of estimation promise, from either side."""

import allantools
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

import losbench as lb
from losbench.estimation.allan import _freedom
from losbench.estimation.solvers import as_part
from losbench.estimation.stability import _efficiency

LINE = np.column_stack([np.ones(5), np.arange(5.0)])
HEIGHTS = np.array([1.1, 2.9, 50.0, 7.1, 8.9])


@pytest.mark.parametrize("exponent", [2, 1, 0, -1, -2])
@pytest.mark.parametrize("m", [1, 2, 7, 40])
def test_degrees_of_freedom_of_an_allan_deviation_are_those_of_allantools(exponent, m):
    expected = allantools.edf_simple(1001, m, exponent)
    if (exponent, m) == (-1, 1):  # NIST SP 1065, table 5; allantools 2024.6 forgets the square
        expected = 2 * 999**2 / (2.3 * 1001 - 4.9)
    assert _freedom(exponent, 1001, m) == pytest.approx(expected, rel=1e-12)


def test_a_deviation_without_two_whole_averages_has_no_degrees_of_freedom():
    assert np.isnan(_freedom(0, 20, 10))
    assert np.isfinite(_freedom(0, 21, 10))


def moving(share, size=20_000):
    """A white series, its neighbours given a correlation."""
    white = np.random.default_rng(1).standard_normal(size + 1)
    weight = (1 - np.sqrt(1 - 4 * share**2)) / (2 * share)
    return 3.0 + 1e-3 * (white[1:] + weight * white[:-1])


NOISES = {2: "white phase", 1: "flicker phase", 0: "white", -1: "flicker", -2: "random walk"}


@pytest.mark.parametrize("share", [-0.47, -0.3, 0.1, 0.3, 0.36, 0.44])
def test_the_noise_is_that_of_allantools(share):
    """On both sides of where a series is taken for a walk, and of every name."""
    series = moving(share)
    found = lb.allan_deviation(series, rate_hz=8.0, tau_s=[0.125, 0.625], errors=True)
    expected = allantools.autocorr_noise_id(series, 1, data_type="freq")[0]
    assert found.noise[0] == NOISES[expected]
    assert found.tau_s.tolist() == [0.125, 0.625]
    dof = allantools.edf_simple(len(series) + 1, 1, expected)
    if expected != -1:  # see above
        assert found.dof[0] == pytest.approx(dof, rel=1e-12)
    coarse = allantools.autocorr_noise_id(series, 5, data_type="freq")[0]
    assert found.noise[1] == NOISES[coarse]


def test_a_drift_does_not_hide_the_noise():
    series = np.random.default_rng(4).standard_normal(2000) + 0.01 * np.arange(2000.0)
    found = lb.allan_deviation(series, rate_hz=1.0, tau_s=[1.0], errors=True)
    assert found.noise == ("white",)


def test_the_noise_of_differences_of_differences_is_the_last_that_has_a_name():
    series = np.diff(np.random.default_rng(2).standard_normal(2000), n=2)
    found = lb.allan_deviation(series, rate_hz=1.0, tau_s=[1.0], errors=True)
    assert found.noise == ("white phase",)


def test_a_series_with_a_gap_and_a_large_offset_has_the_allan_deviation_of_its_parts():
    white = np.random.default_rng(3).standard_normal(400)
    white[200] = np.nan
    plain, high = (
        lb.allan_deviation(white + c, rate_hz=1.0, tau_s=[1, 7, 150], errors=True)
        for c in (0.0, 1e9)
    )
    np.testing.assert_allclose(high.deviation, plain.deviation, rtol=2e-7)
    assert np.isnan(plain.deviation[2]) and np.isnan(plain.dof[2])
    assert np.isnan(plain.interval[2]).all()
    missing = lb.allan_deviation(np.full(9, np.nan), rate_hz=1.0, tau_s=[1], errors=True)
    assert np.isnan(missing.deviation).all() and np.isnan(missing.dof).all()


def test_the_confidence_of_an_allan_deviation_is_a_probability():
    series, asked = moving(0.1, 300), {"rate_hz": 1.0, "tau_s": [1], "errors": True}
    plain, given = (
        lb.allan_deviation(series, **asked, **more).interval[0]
        for more in ({}, {"confidence": 0.95})
    )
    np.testing.assert_array_equal(plain, given)
    with pytest.raises(ValueError, match="confidence must be"):
        lb.allan_deviation(series, **asked, confidence=1.01)


@pytest.mark.parametrize("c", [0.01, 0.5, 3.0, 60.0, 150.0, 400.0])
def test_the_gross_error_sensitivity_of_wide_losses_is_their_closed_form(c):
    """Largest pull of a bisquare, 16 c / (25 sqrt 5), over its mean slope on normal errors."""

    def slope(u):
        return (1 - (u / c) ** 2) * (1 - 5 * (u / c) ** 2) * norm.pdf(u)

    mean_slope = quad(slope, -min(c, 40.0), min(c, 40.0), epsabs=1e-12)[0]
    expected = 16 * c / (25 * np.sqrt(5)) / mean_slope
    assert lb.gross_error_sensitivity(lb.Bisquare(c)) == pytest.approx(expected, rel=1e-4)


def test_a_bounded_pull_is_bounded_however_late():
    assert lb.gross_error_sensitivity(lb.Huber(1e7)) == pytest.approx(1e7, rel=1e-6)
    assert lb.gross_error_sensitivity(lb.Huber(1.5e11)) == pytest.approx(1.5e11, rel=1e-6)
    assert lb.gross_error_sensitivity(lb.Huber(5e11)) == pytest.approx(5e11, rel=1e-4)
    assert lb.gross_error_sensitivity(lb.Huber(1e14)) == np.inf


@pytest.mark.parametrize(
    "pull",
    [lambda u: u * (1.0 + u**2) ** -0.325, np.log1p, lambda u: u / (1.0 + u) + 1e-10 * u**0.9],
)
def test_a_pull_that_grows_for_ever_has_no_bound_however_slowly_or_late(pull):
    class Growing:
        def weights(self, u):
            return pull(np.abs(u)) / np.maximum(np.abs(u), 1e-300)

    assert lb.gross_error_sensitivity(Growing()) == np.inf


def test_rows_of_full_weight_are_not_called_doubted():
    assert "0 of 5 rows have a weight below 1" in lb.lstsq(LINE, HEIGHTS)._repr_html_()
    robust = lb.irls(LINE, HEIGHTS)
    below = np.count_nonzero(robust.weights < 1)
    assert 0 < below < 5
    assert f"{below} of 5 rows have a weight below 1" in robust._repr_html_()


def test_one_negative_scale_among_many_is_refused():
    def scale(residuals):
        found = np.ones(len(residuals))
        found[-1] = -1.0
        return found

    with pytest.raises(ValueError, match="one non-negative number for each system"):
        lb.irls(LINE, np.stack([HEIGHTS, HEIGHTS]), scale=scale, max_iter=1, on_fail="ignore")


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_scale_of_one_s_own_sees_residuals_in_their_unit(unit):
    def scale(residuals):
        return np.median(np.abs(residuals), axis=-1) / norm.ppf(0.75)

    own, named = (lb.irls(LINE, unit * HEIGHTS, scale=each) for each in (scale, "mad"))
    assert own.scale == pytest.approx(named.scale, rel=1e-9)
    np.testing.assert_allclose(own.x, named.x, rtol=1e-9)


def test_a_batch_shows_the_lowest_weight_of_each_system():
    text = lb.irls(LINE, np.stack([HEIGHTS, 2 * HEIGHTS])).summary()
    (row,) = (line for line in text.splitlines() if line.startswith("lowest weight"))
    lowest = lb.irls(LINE, HEIGHTS).weights.min()
    assert float(row.split()[2]) == pytest.approx(lowest, rel=1e-3)


def test_a_part_of_a_task_takes_the_known_scale_unless_the_solver_has_its_own():
    for solver in (lb.LeastSquares(), lb.LTS(), lb.MM()):
        assert as_part(solver, 2.0).scale == 2.0
    assert as_part(lb.IRLS(scale="std"), 2.0).scale == "std"
    assert as_part(lb.IRLS(scale=3.0), 2.0).scale == 3.0
    with pytest.raises(ValueError, match="scale must be a"):
        as_part(lb.IRLS(scale=np.array([1.0, 2.0])), 2.0)


def test_the_median_absolute_residual_of_an_even_number_is_halfway():
    for size in (4, 5):
        y = np.array([0.0, 1.0, 3.0, 10.0, 20.0])[:size]
        fit = lb.irls(np.ones((size, 1)), y, scale="mad")
        expected = np.median(np.abs(fit.residuals)) / 0.6744897501960817
        assert fit.scale == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("loss", [lb.Huber, lb.Bisquare, lb.Cauchy, lb.Welsch])
def test_default_constants_keep_95_percent_and_not_94_or_96(loss):
    kept = lb.efficiency(loss())
    assert 0.9495 < kept < 0.9505


def test_outliers_are_beyond_three_scales():
    fit = lb.irls(LINE, HEIGHTS)
    size = np.abs(fit.residuals) / fit.scale
    np.testing.assert_array_equal(fit.outliers(), size > 3.0)
    just = float(size.max())
    assert fit.outliers(0.999 * just).any() and not fit.outliers(1.001 * just).any()


def test_the_mad_has_the_efficiency_of_its_closed_form():
    """Asymptotic variance of the MAD's sigma, 1 / (16 q^2 phi(q)^2), against 1 / 2."""
    q = norm.ppf(0.75)
    assert _efficiency("mad") == pytest.approx(8 * (q * norm.pdf(q)) ** 2, abs=1e-4)
    assert _efficiency("std") == 1.0


def test_four_samples_can_be_smoothed_and_three_cannot():
    series = np.array([0.0, 1.0, 0.5, 2.0, np.nan, np.nan])
    assert np.isfinite(lb.kalman_smooth(series).smoothed[:4]).all()
    series[3] = np.nan
    with pytest.warns(RuntimeWarning, match="1 of 1 series are too short"):
        assert np.isnan(lb.kalman_smooth(series).smoothed).all()
    with pytest.raises(ValueError, match="series must have at least 4 frames"):
        lb.kalman_smooth(series[:3])


@pytest.mark.parametrize("far", [1e4, 1e9, 1e12])
def test_how_far_off_bad_rows_are_makes_no_difference_to_the_trimmed_fit(far):
    """Not even in the last digits, of which the sums of such rows leave none; systems that need no
    second look stand beside those that do.
    """
    rng = np.random.default_rng(5)
    design = np.concatenate([np.ones((40, 11, 1)), rng.standard_normal((40, 11, 1))], axis=2)
    good = 1e-2 * rng.standard_t(1.5, (40, 11))
    near, off = good.copy(), good.copy()
    near[:, [1, 6]] += [300.0, -200.0]
    off[:, [1, 6]] += [far, -0.7 * far]
    off[35:] = near[35:]
    expected, found = lb.lts(design, near), lb.lts(design, off)
    np.testing.assert_array_equal(found.weights, expected.weights)
    np.testing.assert_allclose(found.x, expected.x, rtol=0, atol=1e-12)


DESIGN, VALUES = np.vander(np.arange(9.0), 2), np.sin(np.arange(9.0))


@pytest.mark.parametrize(
    ("call", "value", "message"),
    [
        (
            lambda v: lb.allan_deviation(
                VALUES, rate_hz=1.0, tau_s=[1.0], errors=True, confidence=v
            ),
            1.01,
            "confidence .* from 0 to 1,",
        ),
        (lambda v: lb.mm(DESIGN, VALUES, efficiency=v), 1.01, "efficiency .* from 0 to 1,"),
        (lambda v: lb.tuned(lb.Huber(), v), 1.01, "efficiency .* from 0 to 1,"),
        (lambda v: lb.irls(DESIGN, VALUES).outliers(v), -1.0, "threshold .* of at least 0,"),
        (lambda v: lb.irls(DESIGN, VALUES, tolerance=v), -1.0, "tolerance .* of at least 0,"),
        (lambda v: lb.irls(DESIGN, VALUES, max_iter=v), 0, "max_iter .* of at least 1,"),
        (lambda v: lb.lts(DESIGN, VALUES, starts=v), 0, "starts .* of at least 1,"),
        (lambda v: lb.mm(DESIGN, VALUES, starts=v), 0, "starts .* of at least 1,"),
        (lambda v: lb.lts(DESIGN, VALUES, h=v), 1, "h .* from 2 to 9,"),
        (lambda v: lb.lts(DESIGN, VALUES, h=v), 10, "h .* from 2 to 9,"),
        (lambda v: lb.Huber(v), -1.0, "c .* of at least 0,"),
        (lambda v: lb.tuned(lb.Huber(), 0.95, rows=v), 0, "rows .* of at least 1,"),
    ],
)
def test_a_number_has_the_limits_that_it_is_told(call, value, message):
    with pytest.raises(ValueError, match=message):
        call(value)
