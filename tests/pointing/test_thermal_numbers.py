"""Numbers that identification promises, from either side: loops, statsmodels, likelihoods of dense matrices."""

from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from scipy import stats
from statsmodels.stats.outliers_influence import variance_inflation_factor

import losbench as lb
from losbench.pointing.thermal import axis
from losbench.pointing.thermal.axis import _collinearity, _thinning
from losbench.pointing.thermal.correlated import Noise, has_memory
from losbench.pointing.thermal.folds import YEAR_S, read_folds, sigma_about_zero
from losbench.pointing.thermal.lag import lag_grid, lagged
from losbench.pointing.thermal.notes import notes_of
from losbench.pointing.thermal.ridge import ridge_sums
from losbench.pointing.thermal.states import LackOfFit, lack_of_fit, lag_set, lag_state
from losbench.pointing.thermal.terms import (
    Difference,
    Fourier,
    Lagged,
    Linear,
    Offset,
    Product,
    Steps,
    Trend,
)

DAY_S = 86_400.0


# Lags


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_lags_are_allowed_up_to_the_95_percent_of_a_chi_square(correlation):
    """Under a correlation r, n (1 - r) / (1 + r) samples are independent."""
    edge = stats.chi2.ppf(0.95, 1) * (1 + correlation) / (1 - correlation)
    rss = 7.0 * np.exp(np.array([0.0, 0.99, 1.01]) * edge / 80)
    assert lag_set(rss, 80, correlation).tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("allowed", "state"),
    [
        ([5], "identified"),
        ([3, 9], "identified"),
        ([3, 10], "weak"),
        ([9, 30], "not identifiable"),
        ([0, 5], "no lag seen"),
        ([0, 30], "not identifiable"),
    ],
)
def test_a_lag_that_may_be_a_third_of_the_record_is_weak(allowed, state):
    grid = np.arange(31.0)
    assert lag_state(np.isin(np.arange(31), allowed), grid) == state


@pytest.mark.parametrize(
    ("f", "neumann", "rejects"),
    [
        (0.024, 0.9, True),
        (0.9, 0.024, True),
        (0.026, 0.026, False),
        (np.nan, 0.049, True),
        (0.051, np.nan, False),
        (np.nan, np.nan, False),
    ],
)
def test_tests_of_a_law_share_five_percent(f, neumann, rejects):
    assert LackOfFit(f, neumann).rejects == rejects


def test_the_f_test_of_more_lags_is_that_of_statsmodels():
    rng = np.random.default_rng(1)
    law, more = rng.standard_normal((60, 2)), rng.standard_normal((60, 3))
    y = law @ [1.0, 2.0] + more @ [0.2, 0.0, 0.2] + rng.standard_normal(60)
    t = np.arange(60.0)
    expected = sm.OLS(y, np.column_stack([law, more])).fit().compare_f_test(sm.OLS(y, law).fit())
    found = lack_of_fit(law, more, y, t, Noise())
    assert found.f_p_value == pytest.approx(expected[1], rel=1e-9)
    noise = Noise(tau_s=3.0, white=0.2)
    dense = np.exp(-np.abs(t[:, None] - t) / 3.0) + 0.2 * np.eye(60)
    root = np.linalg.inv(np.linalg.cholesky(dense))
    wide = sm.OLS(root @ y, root @ np.column_stack([law, more])).fit()
    found = lack_of_fit(law, more, y, t, noise)
    expected = wide.compare_f_test(sm.OLS(root @ y, root @ law).fit())
    assert found.f_p_value == pytest.approx(expected[1], rel=1e-7)
    assert np.isnan(found.neumann_p_value)


def test_von_neumann_s_ratio_is_uniform_on_white_noise_and_small_on_smooth():
    rng, t = np.random.default_rng(2), np.arange(60.0)
    law, none = np.ones((60, 1)), np.empty((60, 0))
    p = [
        lack_of_fit(law, none, rng.standard_normal(60), t, Noise()).neumann_p_value
        for _ in range(1500)
    ]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    smooth = lack_of_fit(law, none, np.sin(t / 9.0), t, Noise())
    assert smooth.neumann_p_value < 1e-9 and np.isnan(smooth.f_p_value)
    assert lack_of_fit(law, none, np.zeros(60), t, Noise()).neumann_p_value == pytest.approx(0.5)


def test_a_grid_of_lags_runs_from_half_a_step_to_the_record():
    t = np.cumsum([5.0, 2.0, 2.0, 2.0, 40.0])
    for options, first in (({}, 1.0), ({"shortest": 0.1}, 0.2), ({"shortest": 900.0}, 46.0)):
        grid = lag_grid(t, 7, **options)
        assert (grid.size, grid[0]) == (7, pytest.approx(first))
        assert grid[-1] == pytest.approx(46.0)
        np.testing.assert_allclose(np.diff(np.log(grid)), np.log(46.0 / first) / 6, atol=1e-12)


# Errors with memory


def restricted(columns, y, covariance):
    """-2 log of the restricted likelihood, its scale at its best, by dense matrices."""
    weight = np.linalg.inv(covariance)
    normal = columns.T @ weight @ columns
    left = y - columns @ np.linalg.solve(normal, columns.T @ weight @ y)
    dets = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
    return (y.size - columns.shape[1]) * np.log(left @ weight @ left) + dets


def test_memory_is_what_explains_clearly_better_than_white_noise():
    """Twice the gain in log-likelihood beyond 9.2: a chi-square of two at one percent."""
    assert stats.chi2.sf(9.2, 2) == pytest.approx(0.01, rel=0.01)
    rng, t, gains = np.random.default_rng(3), np.arange(70.0), []
    columns = np.column_stack([np.ones(70), t])
    covariance = np.exp(-np.abs(t[:, None] - t) / 2.0) + 0.5 * np.eye(70)
    root = np.linalg.cholesky(covariance)
    for _ in range(150):
        y = root @ rng.standard_normal(70)
        gain = restricted(columns, y, np.eye(70)) - restricted(columns, y, covariance)
        assert has_memory(columns, y, t, Noise(2.0, 0.5)) == (gain > 9.2), gain
        gains.append(gain)
    assert any(6.0 < gain < 9.2 for gain in gains) and any(9.2 < gain < 14.0 for gain in gains)


def test_errors_are_thinned_as_long_as_neighbouring_steps_are_alike():
    """Steps of an AR(1) of coefficient a have the correlation a: 0.15 is the edge, 40 are left."""
    rng = np.random.default_rng(4)
    for a, thinned in ((0.13, False), (0.17, True)):
        change = np.empty(200_000)
        change[0] = 0.0
        noise = rng.standard_normal(change.size)
        for i in range(1, change.size):
            change[i] = a * change[i - 1] + noise[i]
        assert (_thinning(np.cumsum(change), 40) > 1) == thinned
    smooth = np.sin(np.arange(640) / 300.0)
    for n, fewest, step in ((79, 1, 1), (80, 1, 2), (159, 1, 2), (160, 1, 4), (160, 50, 2)):
        assert _thinning(smooth[:n], fewest) == step


# Columns


def test_inflation_and_condition_are_those_of_centred_columns():
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((90, 3)) * [1.0, 1e3, 1e-3] + [5.0, 0.0, 1.0]
    columns[:, 2] += 1e-3 * columns[:, 0]
    condition, vif = _collinearity(np.column_stack([np.ones(90), columns]))
    wide = sm.add_constant(columns)
    expected = [variance_inflation_factor(wide, k) for k in (1, 2, 3)]
    np.testing.assert_allclose(vif, [1.0, *expected], rtol=1e-9)
    unit = (columns - columns.mean(axis=0)) / columns.std(axis=0)
    assert condition == pytest.approx(np.linalg.cond(unit), rel=1e-9)
    assert _collinearity(np.column_stack([np.ones(90), columns[:, 0]]))[0] == 1.0
    assert _collinearity(columns[:, :2])[0] > 1.0


@pytest.mark.parametrize(
    ("condition", "vif", "said"),
    [(29.0, 9.9, False), (31.0, 9.9, True), (29.0, 10.1, True), (30.0, 10.0, False)],
)
def test_columns_are_nearly_collinear_beyond_a_condition_of_30_or_an_inflation_of_10(
    condition, vif, said
):
    axis = SimpleNamespace(
        tau_state=[],
        lack_of_fit=LackOfFit(np.nan, np.nan),
        omitted=(),
        vif=np.array([1.0, vif, 2.0]),
        condition=condition,
        thinned=1,
        rejected=np.array([False] * 4),
        residuals=np.ones(4),
        law="as given",
        alike=np.zeros(3, dtype=bool),
    )
    design = SimpleNamespace(lags=[], model=SimpleNamespace(labels=("a", "b", "c")))
    (*line,) = notes_of([axis], design, series=True)
    assert bool(line) == said
    if said:
        assert f"variance of b inflated {vif:.3g} times" in line[0]
    axis.thinned, axis.rejected = 2, np.array([True, False, False, False])
    lines = notes_of([axis, axis], design, series=False)
    assert lines[-1] == "Axis 2: 1 of 4 samples lie beyond four sigma and enter no interval"
    assert "one of 2 samples enters the intervals" in lines[-2]


def test_terms_are_the_columns_that_they_say():
    t = np.array([0.0, 10.0, 20.0, 40.0])
    sensors = {"a": np.array([1.0, 2.0, -1.0, 3.0]), "b": np.array([0.5, 0.0, 1.0, 2.0])}
    a, b = sensors["a"], sensors["b"]
    cases = {
        Linear("a", "b", degree=2): ([a, a**2, b, b**2], ["a", "a^2", "b", "b^2"]),
        Difference("a", "b"): ([a - b], ["a - b"]),
        Trend(2, unit_s=10.0): ([(t - 20) / 10, ((t - 20) / 10) ** 2], ["trend", "trend^2"]),
        Trend(1, origin_s=5.0): ([(t - 5) / (365.25 * DAY_S)], ["trend"]),
        Steps((20.0, 10.0)): ([t >= 10, t >= 20], ["step at 10 s", "step at 20 s"]),
        Fourier(80.0, (1, 3)): (
            [f(2 * np.pi * k * t / 80) for k in (1, 3) for f in (np.cos, np.sin)],
            [f"{f} {k} of 80 s" for k in (1, 3) for f in ("cos", "sin")],
        ),
        Product(Linear("a"), Linear("b", degree=2)): ([a * b, a * b**2], ["a x b", "a x b^2"]),
        Lagged("b", tau_s=7.0, degree=2): (
            [lagged(b, t, 7.0), lagged(b, t, 7.0) ** 2],
            ["b lagged 7 s", "b lagged 7 s^2"],
        ),
        Offset(): ([np.ones(4)], ["offset"]),
    }
    for term, (columns, labels) in cases.items():
        np.testing.assert_allclose(term.columns(sensors, t), np.transpose(columns), atol=1e-12)
        assert list(term.labels) == labels
    assert Fourier(80.0, 2).orders == (1, 2)


@pytest.mark.parametrize(
    "make", [lambda k: Linear("a", degree=k), lambda k: Lagged("a", degree=k), Trend]
)
def test_powers_go_from_the_first_to_the_fifth(make):
    for degree in (1, 5):
        assert len(make(degree).labels) == degree
    for degree in (0, 6):
        with pytest.raises(ValueError, match="degree must be a whole number"):
            make(degree)


@pytest.mark.parametrize(
    ("make", "name"),
    [(lambda v: Lagged("a", tau_s=v), "tau_s"), (Fourier, "period_s")],
)
def test_a_lag_and_a_period_are_positive(make, name):
    assert make(1e-3).labels
    for value in (0.0, -1.0):
        with pytest.raises(ValueError, match=f"{name} must be positive"):
            make(value)
    with pytest.raises(ValueError, match="harmonics must be a whole number"):
        Fourier(1.0, (0, 1))
    with pytest.raises(ValueError, match="harmonics must be a whole number"):
        Fourier(1.0, 0)


# Folds


def test_folds_are_julian_years_blocks_of_equal_length_or_labels_in_order_of_time():
    t = 100.0 + YEAR_S * np.array([0.0, 0.999, 1.0, 1.5, 3.0])
    number, labels = read_folds("year", t)
    assert number.tolist() == [0, 0, 1, 1, 2] and labels == ["year 1", "year 2", "year 4"]
    assert YEAR_S == 365.25 * DAY_S
    for count in (2, 3, 5):
        number, labels = read_folds(count, t)
        sizes = np.bincount(number)
        assert labels == [f"block {k + 1}" for k in range(count)]
        assert np.ptp(sizes) <= 1 and (np.diff(number) >= 0).all()
    for count in (1, 6):
        with pytest.raises(ValueError, match="folds must be a whole number"):
            read_folds(count, t)
    number, labels = read_folds(["z", "z", "a", "z", "m"], t)
    assert number.tolist() == [0, 0, 1, 0, 2] and labels == ["z", "a", "m"]
    with pytest.raises(ValueError, match="folds must be at least two, got 1"):
        read_folds(["z"] * 5, t)


def test_sigma_about_zero_is_that_of_a_normal_error_and_counts_an_offset():
    normal = stats.norm.ppf((np.arange(9999) + 0.5) / 9999)
    errors = np.stack([normal, 3.0 * np.ones(9999), np.full(9999, np.nan)], axis=1)
    errors[::7, 0] = np.nan
    found = sigma_about_zero(errors)
    assert found[0] == pytest.approx(1.0, rel=1e-3)
    assert found[1] == pytest.approx(3.0 / stats.norm.ppf(0.75)) and np.isnan(found[2])


@pytest.mark.parametrize("horizon", ["left out", "forward"])
def test_baselines_are_a_constant_a_trend_and_the_last_known_angle(horizon):
    rng = np.random.default_rng(6)
    t = 0.5 * DAY_S * np.arange(90.0)
    y = 1e-6 * (rng.standard_normal(90).cumsum())
    y[[4, 40]] = np.nan
    room = rng.standard_normal(90)
    fold = np.repeat([0, 1, 2], 30)
    found = lb.cross_validate(
        Offset() + Linear("room"), y, {"room": room}, t, folds=3, horizon=horizon, solver="ls"
    )
    assert set(found.baselines) == {"constant", "trend", "last", "1 d", "30 d"}
    for name, wait_s in (("last", 0.0), ("1 d", DAY_S), ("30 d", 30 * DAY_S)):
        changes = []
        for i in np.flatnonzero(np.isfinite(y)):
            before = (t <= t[i] - wait_s) if wait_s else (t < t[i])
            known = np.flatnonzero(before & np.isfinite(y))
            if known.size:
                changes.append(y[i] - y[known[-1]])
        expected = stats.median_abs_deviation(changes, center=lambda x, axis: 0.0, scale="normal")
        assert found.baselines[name] == pytest.approx(expected, rel=1e-9)
    for name, columns in (
        ("constant", np.ones((90, 1))),
        ("trend", np.column_stack([np.ones(90), t / t[-1]])),
    ):
        errors = []
        for k in range(3):
            train = (fold < k if horizon == "forward" else fold != k) & np.isfinite(y)
            if train.any():
                x = lb.irls(columns[train], y[train], on_fail="ignore").x
                errors.append((y - columns @ x)[(fold == k) & np.isfinite(y)])
        expected = np.median(np.abs(np.concatenate(errors))) / stats.norm.ppf(0.75)
        assert found.baselines[name] == pytest.approx(expected, rel=1e-6)
    assert np.isnan(found.errors[:30]).all() == (horizon == "forward")
    assert found.not_predictable == (("block 1",) if horizon == "forward" else ())
    assert np.isnan(found.errors[[4, 40]]).all()


def test_baselines_of_days_need_a_longer_record():
    t, room = np.arange(20.0), np.sin(np.arange(20.0))
    model, y = Offset() + Linear("room"), 1e-6 * np.cos(np.arange(20.0))
    for unit_s, names in (
        (1.0, ["last"]),
        (DAY_S / 19, ["last"]),
        (DAY_S / 18, ["last", "1 d"]),
        (30 * DAY_S / 18, ["last", "1 d", "30 d"]),
    ):
        found = lb.cross_validate(model, y, {"room": room}, unit_s * t, folds=2)
        assert [name for name in found.baselines if name not in ("constant", "trend")] == names


# Steps of an identification


def wandering(n, memory, seed):
    """Errors of which each keeps a share of the one before."""
    errors = np.random.default_rng(seed).standard_normal(n)
    for k in range(1, n):
        errors[k] += memory * errors[k - 1]
    return errors


@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_a_lag_is_judged_by_samples_that_count_as_their_correlation_says(memory, monkeypatch):
    asked = []
    monkeypatch.setattr(
        axis, "lag_set", lambda rss, n, r: asked.append((n, r)) or lag_set(rss, n, r)
    )
    t = 30.0 * np.arange(400.0)
    room = np.interp(t, [2e3, 7e3], [18.0, 24.0])
    angle = 1e-5 * lagged(room, t, 600.0) + 1e-7 * wandering(400, memory, 1)
    found = lb.identify(Offset() + Lagged("room"), angle, {"room": room}, t)
    left = found.residuals[np.isfinite(found.residuals) & ~found.rejected]
    weights = found.weights[~found.rejected]
    left = left * np.sqrt(weights)
    ((n, r),) = asked
    assert n == left.size
    expected = max(left[1:] @ left[:-1] / (left @ left), 0.0)
    assert r == pytest.approx(expected, abs=1e-6)
    assert (r > 0.5) == (memory > 0)


def test_a_choice_stops_below_a_gain_of_two_percent_and_after_eight():
    rng = np.random.default_rng(2)
    t = np.arange(3000.0)
    sensors = {f"s{k}": rng.standard_normal(3000) for k in range(12)}
    sizes = np.sqrt(np.geomspace(0.11, 0.015, 12))
    angle = rng.standard_normal(3000) + sum(
        size * sensor for size, sensor in zip(sizes, sensors.values(), strict=True)
    )
    terms = {name: Linear(name) for name in sensors}
    every = lb.choose(terms, angle, sensors, t, folds=3, least_gain=0.0, at_most=12).path
    sigma = np.array([s for _, s in every])
    gain = 1 - sigma[1:] / sigma[:-1]
    taken = lb.choose(terms, angle, sensors, t, folds=3, at_most=12).path
    assert list(taken) == list(every[: len(taken)])
    assert len(taken) == 1 + int(np.argmax(gain < 0.02))
    assert np.count_nonzero((gain > 0.012) & (gain < 0.032)) >= 4
    strong = {name: 9.0 * sensor for name, sensor in sensors.items()}
    angle = rng.standard_normal(3000) + sum(strong.values())
    assert len(lb.choose(terms, angle, strong, t, folds=3).path) == 1 + 8


def test_three_folds_are_enough_for_a_choice_and_five_are_taken():
    t = np.arange(60.0)
    sensor, angle = np.sin(t / 3), np.random.default_rng(3).standard_normal(60)
    model = {"s": Linear("s")}
    assert lb.choose(model, angle, {"s": sensor}, t, folds=3).folds == 3
    assert lb.choose(model, angle, {"s": sensor}, t).folds == 5
    assert len(lb.cross_validate(Linear("s"), angle, {"s": sensor}, t).labels) == 5
    assert len(lb.choose(model, angle, {"s": sensor}, t, least_gain=0.0, at_most=1).path) < 3
    with pytest.raises(ValueError, match="folds must be at least three"):
        lb.choose(model, angle, {"s": sensor}, t, folds=2)


@pytest.mark.parametrize("unit", [1e-15, 1.0, 1e15])
def test_time_constants_follow_the_unit_of_capacity_and_nodes_without_a_path_have_none(unit):
    network = lb.ThermalNetwork(
        {"a": 3.0 * unit, "b": 5.0 * unit, "c": 2.0 * unit, "d": 7.0 * unit},
        {("a", "b"): 0.7, ("c", "d"): 1.9},
        {"a": 0.5},
    )
    slowest, *others = network.time_constants_s / unit
    assert slowest == np.inf
    matrix = np.array([[1.2, -0.7], [-0.7, 0.7]]) / np.array([[3.0], [5.0]])
    expected = 1 / np.linalg.eigvals(matrix)
    expected = np.sort([*expected, 1 / (1.9 / 2.0 + 1.9 / 7.0)])[::-1]
    np.testing.assert_allclose(others, expected, rtol=1e-9)


@pytest.mark.parametrize("units", [(1.0, 1e-9), (1e9, 1.0), (1e-3, 1e-3)])
@pytest.mark.parametrize("gain", [1e-6, 1.0, 1e6])
def test_sums_over_all_lags_follow_the_units_of_every_column(units, gain):
    t = 30.0 * np.arange(200.0)
    room = np.interp(t, [1e3, 3e3], [0.0, 5.0])
    bank = np.stack([lagged(room, t, tau) for tau in (0.0, 100.0, 400.0, 1500.0)], axis=1)
    base = np.column_stack([np.ones(200), t / t[-1]])
    y = bank @ [0.0, 1.0, 1.0, 0.0] + 0.05 * np.random.default_rng(4).standard_normal(200)
    plain = ridge_sums(base, bank, np.ones((1, 4)), y, t, Noise())
    other = ridge_sums(base * units, bank / gain, np.ones((1, 4)), y, t, Noise())
    np.testing.assert_allclose(other.total / gain, plain.total, rtol=1e-5)
    np.testing.assert_allclose(other.sigma / gain, plain.sigma, rtol=1e-4)
    assert other.dof == plain.dof == 198
    quiet = ridge_sums(base, bank, np.ones((1, 4)), y, t, Noise(1e-3, 1e8))
    np.testing.assert_allclose(quiet.total, plain.total, rtol=1e-3)
    assert abs(plain.total[0] - 2.0) < 4 * plain.sigma[0] < 0.5


def test_a_sensitivity_with_a_lag_needs_a_sample_more():
    t = 60.0 * np.arange(4.0)
    celsius, angle = np.array([18.0, 19.0, 21.0, 20.0]), 1e-6 * np.array([1.0, 2.0, 4.0, 3.5])
    for quadratic, fitted, samples in ((False, False, 3), (True, False, 4), (False, True, 4)):
        given = {"quadratic": quadratic, "lag_s": "fit" if fitted else None}
        enough = {"solver": "ls", "time_s": t[:samples], **given}
        with pytest.raises(ValueError, match=f"more than {samples - 1} samples with a temperature"):
            lb.fit_sensitivity(
                celsius[: samples - 1],
                angle[: samples - 1],
                **(enough | {"time_s": t[: samples - 1]}),
            )


def test_a_cross_validation_is_told_in_milliarcseconds():
    t = np.arange(90.0)
    sensor = np.sin(t / 3)
    angle = lb.units.arcsec_to_rad(sensor + 0.1 * np.random.default_rng(5).standard_normal(90))
    found = lb.cross_validate(
        Offset() + Linear("s") + Steps((15.0,)), angle, {"s": sensor}, t, folds=3
    )
    text = repr(found)
    assert text.endswith("\nnot predictable: block 1")
    number = f"{float(lb.units.rad_to_arcsec(found.sigma)):.3f}"
    (row,) = (line for line in text.splitlines() if line.startswith("all"))
    assert row.split()[1] == number.rstrip("0")


def test_two_samples_before_are_enough_to_predict_a_constant():
    t = np.arange(6.0)
    angle = np.array([1.0, 1.2, 3.0, 3.2, 3.1, 3.3])
    found = lb.cross_validate(Offset(), angle, {}, t, folds=[0, 0, 1, 1, 1, 1], horizon="forward")
    errors = angle[2:] - 1.1
    assert found.baselines["constant"] == pytest.approx(1.482602218505602 * np.median(errors))
    assert np.isnan(found.baselines["trend"])


def test_trends_are_about_the_middle_of_a_record_wherever_it_lies():
    t = 5000.0 + np.r_[np.arange(10.0), 30.0]
    model = lb.identify(Offset() + Trend(1), np.sin(t), {}, t, errors="white").fitted.model
    assert model.terms[1].origin_s == 5015.0


@pytest.mark.parametrize(("tau_s", "told"), [(0.0, True), (0.4, False), (4.0, False)])
def test_von_neumann_s_ratio_says_nothing_under_errors_with_memory(tau_s, told):
    t = np.arange(50.0)
    y = np.random.default_rng(6).standard_normal(50)
    noise = Noise(tau_s, 0.5)
    tests = lack_of_fit(np.ones((50, 1)), t[:, None], y, t, noise)
    assert np.isfinite(tests.neumann_p_value) == told
    assert np.isfinite(tests.f_p_value)


def test_an_identification_is_shown_as_its_table_and_its_notes():
    t = np.arange(60.0)
    room = np.sin(t / 5)
    angle = lb.units.arcsec_to_rad(
        np.column_stack([room, -3 * room]) + 0.1 * np.random.default_rng(7).standard_normal((60, 2))
    )
    found = lb.identify(Offset() + Linear("room"), angle, {"room": room}, t)
    head, first, second, *notes = repr(found).splitlines()
    names = ["axis", "to", "arcsec_per_degC", "from", "until", "dof", "law"]
    assert head.split() == names
    assert (first.split()[0], second.split()[0]) == ("1", "2")
    assert notes == list(found.notes)
    table = found.table()
    assert table["to"].tolist() == ["room", "room"]
    np.testing.assert_array_equal(table["arcsec_per_degC"], found.sensitivity.ravel())
    np.testing.assert_array_equal(table[["from", "until"]], found.interval.reshape(2, 2))
    one = lb.identify(Offset() + Trend(1), angle[:, 0], {}, t)
    assert repr(one).splitlines()[0] == "no sensitivities"


def test_the_unit_of_a_trend_is_at_least_a_nanosecond():
    assert Trend(unit_s=1.1e-9).unit_s == 1.1e-9
    with pytest.raises(ValueError, match="unit_s must be"):
        Trend(unit_s=0.9e-9)


def test_two_lags_have_errors_of_their_own():
    t = 30.0 * np.arange(500.0)
    one, two = np.sin(t / 900), np.interp(t, [4e3, 9e3], [0.0, 6.0]) + np.cos(t / 2100)
    angle = lagged(one, t, 200.0) + lagged(two, t, 900.0)
    angle = 1e-6 * (angle + 0.02 * np.random.default_rng(8).standard_normal(500))
    sensors = {"one": one, "two": two}
    forth, back = (
        lb.identify(Offset() + Lagged(*names), angle, sensors, t, errors="white")
        for names in (("one", "two"), ("two", "one"))
    )
    assert forth.tau_state.tolist() == ["identified"] * 2
    np.testing.assert_allclose(forth.tau_interval_s, back.tau_interval_s[::-1], rtol=1e-3)
    width = np.log(forth.tau_interval_s[:, 1] / forth.tau_interval_s[:, 0])
    assert not 0.8 < width[0] / width[1] < 1.25


@pytest.mark.parametrize(("errors", "memory"), [("ou+white", True), ("white", False)])
def test_errors_have_a_memory_where_that_is_asked_for(errors, memory):
    t = 30.0 * np.arange(300.0)
    room = np.interp(t, [2e3, 5e3], [18.0, 24.0])
    angle = 1e-6 * (lagged(room, t, 600.0) + 0.05 * np.random.default_rng(9).standard_normal(300))
    (noise,) = lb.identify(Offset() + Lagged("room"), angle, {"room": room}, t, errors=errors).noise
    assert (noise.tau_s > 0) == memory


def test_a_candidate_with_a_lag_to_fit_is_refused_among_other_terms_too():
    t = np.arange(60.0)
    with pytest.raises(ValueError, match="candidates must have known lags, got one to fit in both"):
        lb.choose({"both": Trend(1) + Lagged("s")}, np.sin(t), {"s": np.cos(t)}, t)


def test_two_samples_are_enough_for_a_lag():
    """Behind a ramp of one degree in a step."""
    behind = lagged(np.array([3.0, 4.0]), np.array([0.0, 2.0]), 5.0)
    np.testing.assert_allclose(behind, [3.0, 4.0 - 0.5 * 5.0 * (1 - np.exp(-2.0 / 5.0))])


def test_intervals_are_of_95_percent_unless_said():
    t = np.arange(80.0)
    room = np.sin(t / 5)
    angle = 1e-6 * (room + 0.1 * np.random.default_rng(10).standard_normal(80))
    for fit in (
        lambda **k: lb.identify(Offset() + Linear("s"), angle, {"s": room}, t, **k).interval,
        lambda **k: lb.fit_sensitivity(room, angle, **k).k_interval,
    ):
        np.testing.assert_array_equal(fit(), fit(confidence=0.95))


@pytest.mark.parametrize("names", [(), ("",), (3,), ("a", 3), ("a", "a")])
def test_sensors_are_named_by_words_and_once(names):
    with pytest.raises(ValueError, match=r"Linear must name (its sensors|each sensor once)"):
        Linear(*names)


@pytest.mark.parametrize("degrees", [1e-3, 1.0, 1e3])
def test_a_lag_is_found_behind_a_temperature_that_moves_a_little_or_much(degrees):
    t = 30.0 * np.arange(120.0)
    room = degrees * np.sin(t / 500)
    noise = 0.02 * degrees * np.random.default_rng(11).standard_normal(120)
    angle = 1e-6 * (lagged(room, t, 300.0) + noise)
    found = lb.identify(Offset() + Lagged("s"), angle, {"s": room}, t, errors="white")
    assert found.fitted.tau_s[0, 0] == pytest.approx(300.0, rel=0.05)
