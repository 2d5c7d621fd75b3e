"""Steps of the identification of one axis, each threshold from either side: dense least squares,
null spaces made by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from scipy import stats

import losbench as lb
from losbench.pointing.thermal import axis
from losbench.pointing.thermal.axis import _collinearity, _Kept, _kept, _outliers, _thinning
from losbench.pointing.thermal.correlated import Noise, generalised
from losbench.pointing.thermal.design import bind
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.states import lack_of_fit, lag_set
from losbench.pointing.thermal.terms import Fourier, Lagged, Linear, Offset, Trend
from losbench.units import rad_to_arcsec

T = 30.0 * np.arange(300.0)
ROOM = np.interp(T, [2e3, 5e3], [18.0, 24.0]) + np.sin(T / 700.0)
OTHER = np.cos(T / 410.0)


def kept_of(law, more, y):
    return _Kept(np.arange(y.size), np.arange(float(y.size)), y, law, more)


# Outliers


@pytest.mark.parametrize("solver", [lb.IRLS(), lb.LeastSquares()])
def test_four_robust_sigma_are_the_limit_and_least_squares_rejects_nothing(solver):
    residuals = 0.25 * np.array([3.99, 4.01, -3.99, -4.01, 0.0])
    point = SimpleNamespace(fit=SimpleNamespace(residuals=residuals, scale=0.25))
    off, left = _outliers(kept_of(np.ones((5, 1)), np.empty((5, 0)), np.zeros(5)), point, solver)
    robust = isinstance(solver, lb.IRLS)
    assert off.tolist() == [False, robust, False, robust, False]
    assert left is residuals


@pytest.mark.parametrize(("samples", "richer"), [(8, False), (9, True)])
def test_outliers_are_told_about_more_lags_where_two_samples_speak_for_each_column(samples, richer):
    rng = np.random.default_rng(1)
    law, more = rng.standard_normal((samples, 1)), rng.standard_normal((samples, 3))
    y = more @ [1.0, 2.0, 3.0]
    point = SimpleNamespace(fit=SimpleNamespace(residuals=y, scale=1.0))
    _, left = _outliers(kept_of(law, more, y), point, lb.LeastSquares())
    assert (left is y) != richer
    assert (np.abs(left).max() < 1e-12) == richer


# Which samples, and which lags beside the law


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_thinning_does_not_depend_on_the_unit_and_leaves_what_does_not_move(unit):
    smooth = np.sin(np.arange(640) / 300.0)
    assert _thinning(unit * smooth, 40) == 16
    assert _thinning(unit * np.ones(640), 40) == 1


@pytest.mark.parametrize("errors", ["ou+white", "white"])
def test_thinning_leaves_two_samples_for_each_column_of_the_law(errors, monkeypatch):
    """Offset, gain and slope of the lag, and another sensor: four columns."""
    asked = []
    monkeypatch.setattr(axis, "_thinning", lambda left, fewest: asked.append(fewest) or 1)
    y = 1e-6 * (lagged(ROOM, T, 600.0) + 0.05 * np.random.default_rng(2).standard_normal(300))
    model = Offset() + Lagged("room") + Linear("other")
    lb.identify(model, y, {"room": ROOM, "other": OTHER}, T, errors=errors)
    assert asked == ([8] if errors == "ou+white" else [])


def test_beside_the_law_stand_no_lag_and_five_from_two_steps_to_the_record():
    design = bind(Offset() + Lagged("room"), {"room": ROOM}, T)
    point = SimpleNamespace(
        rows=np.arange(300), tau_s=np.array([600.0]), fit=SimpleNamespace(x=np.ones(2))
    )
    taus = np.r_[0.0, np.geomspace(60.0, T[-1], 5)]
    expected = np.stack([lagged(ROOM - ROOM.mean(), T, tau) for tau in taus], axis=1)
    for samples, more in ((9, 0), (10, 6), (300, 6)):  # three columns of the law, six beside it
        rows = np.arange(300) < samples
        kept = _kept(design, point, ROOM, rows)
        assert kept.law.shape == (samples, 3) and kept.more.shape == (samples, more)
        if more:
            np.testing.assert_allclose(kept.more, expected[:samples], atol=1e-12)


@pytest.mark.parametrize(("noise", "perfect"), [(1e-9, False), (1e-14, True)])
def test_a_fit_is_perfect_where_residuals_are_rounding(noise, perfect):
    y = 1e-6 * (ROOM + OTHER)
    y = y + noise * np.abs(y).max() * np.random.default_rng(3).standard_normal(300)
    sensors = {"room": ROOM, "other": OTHER}
    found = lb.identify(Offset() + Linear("room", "other"), y, sensors, T)
    assert (found.noise[0].tau_s == 0.0) == perfect


# Lags


def lag_asked(y, monkeypatch, **options):
    """What the profile of the one lag is judged by, with the identification."""
    asked = []
    monkeypatch.setattr(axis, "profile", lambda *a, **k: asked.append(a[4]) or np.ones(a[4].size))
    monkeypatch.setattr(
        axis,
        "lag_set",
        lambda rss, n, r: asked.append((n, r)) or np.isin(np.arange(rss.size), options["allowed"]),
    )
    found = lb.identify(Offset() + Lagged("room"), y, {"room": ROOM}, T, errors="white")
    (grid, (n, r)) = asked
    return grid, n, r, found


@pytest.mark.parametrize(("allowed", "longest"), [([0], 1), ([0, 1, 2, 3], 4), ([0, 2], 3)])
def test_a_lag_that_is_none_may_be_as_long_as_the_first_that_is_not_allowed(
    allowed, longest, monkeypatch
):
    rng = np.random.default_rng(4)
    y = 1e-6 * (lagged(ROOM, T, 600.0) + 0.05 * rng.standard_normal(300))
    grid, n, r, found = lag_asked(y, monkeypatch, allowed=allowed)
    tried = np.r_[0.0, np.geomspace(3.0, T[-1], 30)]
    np.testing.assert_allclose(grid, np.sort(np.r_[tried, found.fitted.tau_s[0]]))
    assert found.tau_state.tolist() == ["no lag seen"]
    np.testing.assert_allclose(found.tau_interval_s[0], [0.0, grid[longest]])
    assert n == 300 and 0.0 <= r < 0.3


def test_residuals_that_hardly_move_count_as_two(monkeypatch):
    """The profile of a record whose errors are one bow: n (1 - r) / (1 + r) is at least one."""
    monkeypatch.setattr(axis, "_outliers", lambda every, *_: (np.zeros(300, dtype=bool), T))
    y = 1e-6 * ROOM
    monkeypatch.setattr(
        axis, "fit_point", lambda *a, fit=axis.fit_point: with_residuals(fit(*a), np.ones(300))
    )
    *_, r, _ = lag_asked(y, monkeypatch, allowed=[5])
    assert r == pytest.approx(1.0 - 2.0 / 300)


def with_residuals(point, residuals):
    return replace(
        point,
        fit=SimpleNamespace(
            residuals=residuals, weights=np.ones(residuals.size), x=point.fit.x, scale=1.0
        ),
    )


def test_residuals_that_are_none_have_no_memory(monkeypatch):
    monkeypatch.setattr(
        axis, "fit_point", lambda *a, fit=axis.fit_point: with_residuals(fit(*a), np.zeros(300))
    )
    *_, r, _ = lag_asked(1e-6 * ROOM, monkeypatch, allowed=[5])
    assert r == 0.0
    monkeypatch.undo()
    zigzag = np.resize([1.0, -1.0], 300)
    monkeypatch.setattr(
        axis, "fit_point", lambda *a, fit=axis.fit_point: with_residuals(fit(*a), zigzag)
    )
    *_, r, _ = lag_asked(1e-6 * ROOM, monkeypatch, allowed=[5])
    assert r == 0.0


# Sensitivities


def test_a_sensor_beside_all_lags_keeps_its_degrees_of_freedom():
    """By generalised least squares under the noise that is told, which costs some of them."""
    rng = np.random.default_rng(5)
    errors = rng.standard_normal(300)
    for k in range(1, 300):
        errors[k] += 0.8 * errors[k - 1]
    y = 1e-6 * (lagged(ROOM, T, 600.0) + 0.5 * OTHER + 0.02 * errors)
    model = Offset() + Lagged("room", tau_s="spectrum") + Linear("other")
    found = lb.identify(model, y, {"room": ROOM, "other": OTHER}, T)
    assert str(found.law) == "all lags"
    assert found.dof[1] < 200.0
    assert found.noise[0].tau_s > 0.0


# Columns


def test_columns_are_constant_below_a_spread_of_1e_12_and_lost_with_a_part_of_a_millionth():
    rng = np.random.default_rng(6)
    x, y = rng.standard_normal((2, 400))
    for spread, varies in ((1e-10, True), (1e-13, False)):
        condition, _ = _collinearity(np.column_stack([1.0 + spread * x, y]))
        assert (condition > 1.0) == varies
    for nearly, finite in ((1e-6, True), (1e-9, False)):  # eigenvalues of the squares of these
        condition, vif = _collinearity(np.column_stack([x, x + nearly * y]))
        assert np.isfinite(condition) == finite == np.isfinite(vif).all()
    for part, lost in ((1e-5, True), (1e-7, False)):
        x, y = (v - v.mean() for v in (x, y))
        third = x + part * y
        _, vif = _collinearity(np.column_stack([x, y, third]))
        assert np.isinf(vif[[0, 2]]).all()
        assert np.isinf(vif[1]) == lost


# What other variables would change


def omitted_of(y, sensors, *, model=None, all_lags=False, t=T):
    model = Offset() + Linear("room") if model is None else model
    design = bind(model, sensors, t)
    law = design.fixed
    kept = kept_of(law, np.empty((t.size, 0)), y)
    kept = _Kept(kept.rows, t, y, law, kept.more)
    fit = generalised(law, y, t, Noise())
    return axis._omitted(design, kept, fit, Noise(), sensors, all_lags)


def test_what_changes_is_told_in_arcseconds_from_and_to():
    rng = np.random.default_rng(7)
    y = 1e-5 * (ROOM + 3.0 * OTHER + 0.1 * rng.standard_normal(300))
    room = ROOM + 2.0 * OTHER
    (line,) = omitted_of(y, {"room": room, "other": OTHER})
    columns = np.column_stack([np.ones(300), room, T, OTHER])
    one, two = (lb.lstsq(columns[:, :k], y).x[1] for k in (2, 4))
    numbers = [f"{float(rad_to_arcsec(v)):+.3g}" for v in (one, two)]
    assert line == f"room changes from {numbers[0]} to {numbers[1]} arcsec/degC"


def test_a_change_counts_beyond_two_errors_of_both():
    rng = np.random.default_rng(8)
    found = []
    for share in np.linspace(0.0, 0.12, 25):
        room = ROOM + OTHER
        y = 1e-5 * (room + share * OTHER + 0.1 * rng.standard_normal(300))
        columns = np.column_stack([np.ones(300), room, T, OTHER])
        one, two = (lb.lstsq(columns[:, :k], y) for k in (2, 4))
        change = abs(one.x[1] - two.x[1]) / np.hypot(one.std_error[1], two.std_error[1])
        told = omitted_of(y, {"room": room, "other": OTHER}) != ()
        assert told == (change > 2.0)
        found.append(change)
    assert sum(1.2 < change < 2.0 for change in found) and sum(2.0 < c < 3.2 for c in found)


def test_no_change_is_told_without_a_few_samples_more_than_columns():
    t, other = np.arange(7.0), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0])
    room, y = other + 0.1 * np.sin(5.0 * t), 5.0 * other + 1e-3 * np.sin(9.0 * t)
    for samples, told in ((6, False), (7, True)):  # offset, room, trend, other, and two more
        part = slice(samples)
        sensors = {"room": room[part], "other": other[part]}
        assert (omitted_of(y[part], sensors, t=t[part]) != ()) == told


def test_under_all_lags_no_trend_and_no_season_are_looked_for():
    year = 365.25 * 86_400.0
    t = np.linspace(0.0, 2.0 * year, 300)
    season, rng = np.cos(2 * np.pi * t / year), np.random.default_rng(9)
    for slow in (t / year, season):
        room = slow + 0.3 * rng.standard_normal(300)
        y = room + 2.0 * slow + 0.02 * rng.standard_normal(300)
        assert omitted_of(y, {"room": room}, t=t) != ()
        assert omitted_of(y, {"room": room}, t=t, all_lags=True) == ()
        other = {"room": room, "other": slow}
        assert omitted_of(y, other, t=t, all_lags=True) != ()
    model = Offset() + Trend(1) + Fourier(year)
    assert omitted_of(season, {"other": ROOM}, t=t, model=model) == ()


# Whether the law fits


def test_lags_of_a_profile_that_leaves_next_to_nothing_are_compared():
    """Down to sums of squares of 1e-300, below which all are one."""
    assert lag_set(np.array([0.0, 1e-298, 1e-301]), 10, 0.0).tolist() == [True, False, True]


def test_lags_that_add_no_direction_have_no_f_test():
    rng = np.random.default_rng(10)
    law, y, t = rng.standard_normal((12, 2)), rng.standard_normal(12), np.arange(12.0)
    none = (law @ [[1.0, 0.0], [1.0, 2.0]], np.zeros((12, 2)), rng.standard_normal((12, 10)))
    for more in none:  # nothing new; nothing at all; so much that nothing is left to judge by
        assert np.isnan(lack_of_fit(law, more, y, t, Noise()).f_p_value)
    axes = np.eye(4)
    exact = lack_of_fit(axes[:, :1], axes[:, 1:2], axes[:, 0], t[:4], Noise())
    assert np.isnan(exact.f_p_value)
    one_left = lack_of_fit(law, none[2][:, :9], y, t, Noise())
    wide = sm.OLS(y, np.column_stack([law, none[2][:, :9]])).fit()
    expected = wide.compare_f_test(sm.OLS(y, law).fit())[1]
    assert one_left.f_p_value == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    ("apart", "told"), [(1e-5, True), (3e-6, True), (1.5e-6, False), (1e-7, False)]
)
def test_a_lag_is_another_direction_from_a_millionth_on(apart, told):
    """Unit columns at an angle a have eigenvalues of 2 and a^2 / 2: a limit of two millionths."""
    rng = np.random.default_rng(11)
    law, other = np.linalg.qr(rng.standard_normal((50, 2)))[0].T[..., None]
    y = rng.standard_normal(50)
    more = law + apart * other
    found = lack_of_fit(law, more, y, np.arange(50.0), Noise()).f_p_value
    if told:
        wide = sm.OLS(y, np.column_stack([law, other])).fit()
        expected = wide.compare_f_test(sm.OLS(y, law).fit())[1]
        assert found == pytest.approx(expected, rel=1e-3)
    else:
        assert np.isnan(found)


@pytest.mark.parametrize("n", [4, 5, 9])
def test_von_neumann_s_ratio_has_its_variance_in_short_records_too(n):
    left = np.random.default_rng(n).standard_normal(n)
    left[0] = 0.0
    left[-1] -= left.sum()
    ratio = np.sum(np.diff(left) ** 2) / np.sum(left**2)
    expected = stats.norm.cdf((ratio - 2.0) / np.sqrt(4.0 * (n - 2) / (n**2 - 1)))
    found = lack_of_fit(np.ones((n, 1)), np.empty((n, 0)), left, np.arange(float(n)), Noise())
    assert found.neumann_p_value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("zero", [False, True])
def test_a_residual_of_zero_among_others_is_one_like_them(zero):
    """About a law of one column that is zero there, so that it stays exactly zero."""
    law = np.array([1.0, 1.0, 0.0, 1.0, 1.0])[:, None]
    y = np.array([1.0, -1.0, 0.0 if zero else 0.5, 2.0, -2.0])
    ratio = np.sum(np.diff(y) ** 2) / np.sum(y**2)
    found = lack_of_fit(law, np.empty((5, 0)), y, np.arange(5.0), Noise())
    assert found.neumann_p_value == pytest.approx(stats.norm.cdf((ratio - 2.0) / np.sqrt(0.5)))
