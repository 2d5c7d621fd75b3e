"""Errors of an identification from either side: degrees of freedom by a dense likelihood, intervals,
and what searches leave."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.optimize import curve_fit

import losbench as lb
from losbench.pointing.performance.budget import _parameter
from losbench.pointing.thermal.correlated import Noise, _reml, _safe, fit_noise, generalised
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.notes import notes_of
from losbench.pointing.thermal.terms import Fourier, Lagged, Linear, Offset, Trend
from losbench.pointing.told import sensitivity_to
from losbench.units import arcsec_to_rad, rad_to_arcsec

T = 60.0 * np.arange(300)
ROOM = 2.0 * np.sin(2 * np.pi * T / 7000) + np.interp(T, [3e3, 9e3], [0.0, 4.0])
OTHER = np.cos(2 * np.pi * T / 4100) + T / 9000


def dense(t, tau, white):
    return np.exp(-np.abs(t[:, None] - t) / tau) + white * np.eye(t.size)


def restricted(t, columns, y, at):
    """Half the restricted -2 log-likelihood at the logarithms of scale^2, tau and white share."""
    scale2, tau, white = np.exp(at)
    inverse = np.linalg.inv(scale2 * dense(t, tau, white))
    normal = columns.T @ inverse @ columns
    x = np.linalg.solve(normal, columns.T @ inverse @ y)
    left = y - columns @ x
    parts = np.linalg.slogdet(inverse)[1] - np.linalg.slogdet(normal)[1] - left @ inverse @ left
    return -0.5 * parts


def log_variances(t, columns, at):
    scale2, tau, white = np.exp(at)
    inverse = np.linalg.inv(scale2 * dense(t, tau, white))
    return np.log(np.diag(np.linalg.inv(columns.T @ inverse @ columns)))


def record(n=70):
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5, 2.0, n))
    columns = np.column_stack([np.ones(n), np.sin(t / 9.0)])
    spread = np.linalg.cholesky(0.04 * dense(t, 4.0, 0.3)) @ rng.standard_normal(n)
    return t, columns, columns @ [1.0, 2.0] + spread


def test_degrees_of_freedom_are_those_of_the_dense_likelihood():
    """Satterthwaite's rule with differences a tenth of a logarithm apart, and a weak prior."""
    t, columns, y = record()
    fit = generalised(columns, y, t, Noise(4.0, 0.3))
    centre, step, e = np.log([fit.scale**2, 4.0, 0.3]), 0.1, np.eye(3)

    def f(v):
        return restricted(t, columns, y, centre + step * np.asarray(v))

    hessian = np.array(
        [
            [
                f(e[a]) - 2 * f(0 * e[a]) + f(-e[a])
                if a == b
                else (f(e[a] + e[b]) - f(e[a] - e[b]) - f(e[b] - e[a]) + f(-e[a] - e[b])) / 4
                for b in range(3)
            ]
            for a in range(3)
        ]
    )
    values, vectors = np.linalg.eigh(hessian / step**2)
    covariance = (vectors / (np.maximum(values, 0) + 1 / 9)) @ vectors.T
    ahead, behind = (
        np.array([log_variances(t, columns, centre + s * step * v) for v in e]) for s in (1, -1)
    )
    gradient = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(gradient[0], 1.0, rtol=1e-9)
    relative = np.einsum("ap,ab,bp->p", gradient, covariance, gradient)
    np.testing.assert_allclose(fit.dof, np.clip(2 / relative, 2.0, 68.0), rtol=1e-6)
    assert (fit.dof < 68.0).any()
    plain = generalised(columns, y, t, Noise(4.0, 0.3), freedom=False)
    np.testing.assert_array_equal(plain.dof, 68.0)
    np.testing.assert_array_equal(plain.sigma, fit.sigma)


def test_the_noise_that_is_found_is_the_most_likely_one():
    t, columns, y = record(120)
    found = fit_noise(columns, y, t)
    both, _ = _safe(columns, y)
    least = _reml(both, t, found)
    for tau in (0.8, 0.95, 1.05, 1.25):
        for white in (0.7, 1.0, 1.4):
            other = Noise(found.tau_s * tau, found.white * white)
            assert _reml(both, t, other) > least - 1e-2
    one, two = Noise(4.0, 0.3), Noise(6.0, 0.5)

    def profiled(noise):
        """-2 log-likelihood at its best scale, but for what is the same for all."""
        inverse = np.linalg.inv(dense(t, noise.tau_s, noise.white))
        normal = columns.T @ inverse @ columns
        left = y - columns @ np.linalg.solve(normal, columns.T @ inverse @ y)
        parts = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(inverse)[1]
        return parts + (120 - 2) * np.log(left @ inverse @ left)

    difference = _reml(both, t, one) - _reml(both, t, two)
    assert difference == pytest.approx(profiled(one) - profiled(two), rel=1e-6)


@pytest.mark.parametrize("confidence", [0.68, 0.95])
def test_intervals_are_student_s_and_those_of_lags_are_even_in_their_logarithm(confidence):
    rng = np.random.default_rng(3)
    y = arcsec_to_rad(lagged(ROOM, T, 600.0) - 0.5 * OTHER + 0.05 * rng.standard_normal(300))
    sensors = {"room": ROOM, "other": OTHER}
    model = Offset() + Lagged("room") + Linear("other")
    found, wide = (
        lb.identify(model, y, sensors, T, errors="white", confidence=c) for c in (confidence, 0.999)
    )
    assert found.tau_state.tolist() == ["identified"]
    low, high = found.tau_interval_s[0]
    assert np.sqrt(low * high) == pytest.approx(found.tau_s[0], rel=1e-9)
    assert low < 600.0 < high
    half = np.diff(found.interval)[:, 0] / 2
    np.testing.assert_allclose(found.interval.mean(axis=1), found.sensitivity, rtol=1e-9)
    sigma = half / stats.t.ppf(0.5 + confidence / 2, found.dof)
    far = np.diff(wide.interval)[:, 0] / 2 / stats.t.ppf(0.9995, wide.dof)
    np.testing.assert_allclose(sigma, far, rtol=1e-9)
    lags = [
        np.log(each.tau_interval_s[0, 1] / each.tau_s[0])
        / stats.t.ppf(0.5 + level / 2, each.dof[0])
        for each, level in ((found, confidence), (wide, 0.999))
    ]
    assert lags[0] == pytest.approx(lags[1], rel=1e-6)


def test_white_errors_are_those_of_least_squares():
    rng = np.random.default_rng(4)
    y = arcsec_to_rad(1.5 * ROOM - 0.5 * OTHER + 0.05 * rng.standard_normal(300))
    found = lb.identify(
        Offset() + Linear("room", "other"), y, {"room": ROOM, "other": OTHER}, T, errors="white"
    )
    fit = lb.lstsq(np.column_stack([np.ones(300), ROOM, OTHER]), y)
    half = stats.t.ppf(0.975, 297) * fit.std_error[1:]
    np.testing.assert_allclose(arcsec_to_rad(np.diff(found.interval)[:, 0]) / 2, half, rtol=1e-6)
    np.testing.assert_allclose(found.dof, 297.0)


# What other variables would change


@pytest.mark.parametrize(("share", "told"), [(0.0, False), (0.4, True)])
def test_a_trend_that_would_change_a_sensitivity_is_told(share, told):
    rng = np.random.default_rng(5)
    drift = ROOM + 4.0 * T / T[-1]
    y = arcsec_to_rad(2.0 * drift + share * 4.0 * T / T[-1] + 0.05 * rng.standard_normal(300))
    found = lb.identify(Offset() + Linear("room"), y, {"room": drift}, T, errors="white")
    assert any("room changes" in note for note in found.notes) == told
    with_trend = lb.identify(
        Offset() + Linear("room") + Trend(1), y, {"room": drift}, T, errors="white"
    )
    assert not any("room changes" in note for note in with_trend.notes)


@pytest.mark.parametrize(("years", "told"), [(1.4, False), (1.6, True)])
def test_seasons_are_looked_for_in_a_year_and_a_half(years, told):
    year = 31_557_600.0
    t = np.linspace(0.0, years * year, 400)
    season = np.cos(2 * np.pi * t / year)
    rng = np.random.default_rng(6)
    room = season + 0.3 * rng.standard_normal(400)
    y = arcsec_to_rad(room + 2.0 * season + 0.02 * rng.standard_normal(400))
    model = Offset() + Linear("room") + Trend(1)
    found = lb.identify(model, y, {"room": room}, t, errors="white")
    assert any("room changes" in note for note in found.notes) == told
    seasonal = lb.identify(model + Fourier(year), y, {"room": room}, t, errors="white")
    assert not any("room changes" in note for note in seasonal.notes)


def test_a_sensor_that_is_not_in_the_model_may_change_a_sign():
    rng = np.random.default_rng(7)
    first = OTHER + 0.3 * rng.standard_normal(300)
    y = arcsec_to_rad(3.0 * OTHER - 1.0 * first + 0.02 * rng.standard_normal(300))
    model = Offset() + Linear("first") + Trend(1)
    for sensors, told in (
        ({"first": first}, False),
        ({"first": first, "still": np.full(300, 21.3)}, False),
        ({"first": first, "gappy": np.where(np.arange(300) == 7, np.nan, OTHER)}, False),
        ({"first": first, "other": OTHER}, True),
    ):
        found = lb.identify(model, y, sensors, T, errors="white")
        assert any("first changes sign" in note for note in found.notes) == told, sensors.keys()


def test_the_error_of_a_lag_is_that_of_a_nonlinear_fit():
    """By scipy's curve_fit, in the logarithm of the lag."""
    rng = np.random.default_rng(8)
    y = arcsec_to_rad(lagged(ROOM, T, 600.0) + 0.02 * rng.standard_normal(300))
    found = lb.identify(
        Offset() + Lagged("room"), y, {"room": ROOM}, T, errors="white", solver=lb.LeastSquares()
    )

    def law(t, offset, gain, log_tau):
        return offset + gain * lagged(ROOM, T, np.exp(log_tau))

    best, cov = curve_fit(law, T, rad_to_arcsec(y), [0.0, 1.0, np.log(600.0)])
    sigma = np.sqrt(np.diag(cov))
    t95 = stats.t.ppf(0.975, found.dof[0])
    assert found.tau_s[0] == pytest.approx(np.exp(best[2]), rel=1e-4)
    half = np.log(found.tau_interval_s[0, 1] / found.tau_s[0])
    assert half == pytest.approx(t95 * sigma[2], rel=0.01)
    assert np.diff(found.interval[0])[0] / 2 == pytest.approx(t95 * sigma[1], rel=0.01)


@pytest.mark.parametrize("law", ["as given", "all lags"])
def test_the_states_of_lags_are_told_as_the_law_has_them(law):
    states = ["identified", "weak", "no lag seen", "not identifiable"]
    axis = SimpleNamespace(
        law=law,
        tau_state=states,
        lack_of_fit=SimpleNamespace(rejects=False),
        omitted=["a changes"],
        vif=np.ones(2),
        condition=1.0,
        thinned=1,
        rejected=np.zeros(9, dtype=bool),
        alike=np.zeros(2, dtype=bool),
    )
    design = SimpleNamespace(
        lags=[(k, f"T{k}") for k in range(4)], model=SimpleNamespace(labels=("a", "b"))
    )
    lines = notes_of([axis], design, series=True)
    assert not any("T0" in line for line in lines)
    (lost,) = (line for line in lines if "T3" in line)
    assert ("neither is the sensitivity" in lost) == (law == "as given")
    told = ["known weakly", "no lag behind T2"]
    assert [any(word in line for line in lines) for word in told] == [True, True]


# What a table owes to a temperature


@pytest.mark.parametrize(
    ("samples", "span", "fitted"),
    [(10, 0.6, True), (9, 0.6, False), (40, 0.49, False), (40, 0.51, True)],
)
def test_ten_samples_over_half_a_degree_tell_a_sensitivity(samples, span, fitted):
    celsius = 20.0 + span * np.linspace(0.0, 1.0, samples)
    noise = 1e-3 * np.random.default_rng(9).standard_normal(samples)
    frame = pd.DataFrame(
        {
            "time_s": np.full(samples, 5.0),
            "temperature_degC": celsius,
            "alpha_arcsec": 2.0 * celsius + noise,
        }
    )  # one time for all: no lag is fitted
    found = sensitivity_to("temperature_degC", frame, {"alpha": "about X"})
    assert (found is not None) == fitted
    if fitted:
        assert found.found.sensitivity[0, 0] == pytest.approx(2.0, abs=0.02)
        assert found.lag_state == ["given"]
        left = found.compensated(frame)["alpha_compensated_arcsec"]
        assert left.std() == pytest.approx(noise.std(), rel=0.2)


def test_samples_without_a_time_or_a_temperature_are_left_out():
    celsius = 20.0 + np.linspace(0.0, 3.0, 60)
    frame = pd.DataFrame(
        {
            "time_s": 10.0 * np.arange(60.0),
            "temperature_degC": celsius,
            "alpha_arcsec": 2.0 * celsius + 1e-3 * np.random.default_rng(10).standard_normal(60),
        }
    )
    frame.loc[4, "time_s"] = frame.loc[9, "temperature_degC"] = np.nan
    found = sensitivity_to("temperature_degC", frame, {"alpha": "about X"})
    assert np.flatnonzero(~found.used).tolist() == [4, 9]
    assert np.flatnonzero(np.isnan(found.predicted[:, 0])).tolist() == [4, 9]
    assert found.shortest_lag_s == pytest.approx(0.2 * 10.0)


@pytest.mark.parametrize("value", [[1.0, 2.0, 3.0], [[1.0, 2.0, 3.0]], [[[1.0, 2.0]]], 4.0])
def test_a_law_of_two_numbers_takes_pairs(value):
    with pytest.raises(
        ValueError, match="gaussian must be a pair of numbers, or one pair per axis"
    ):
        _parameter("gaussian", value)
