"""The search for lags, step by step: dense weighted least squares, and minima that are minima."""

from types import SimpleNamespace

import numpy as np
import pytest

import losbench as lb
from losbench.pointing.thermal.correlated import Noise, _safe, _upright, fit_noise, generalised
from losbench.pointing.thermal.design import bind
from losbench.pointing.thermal.lag import lagged
from losbench.pointing.thermal.ridge import ridge_sums
from losbench.pointing.thermal.search import _gauss_newton, fit_point, profile
from losbench.pointing.thermal.terms import Lagged, Linear, Offset

T = 30.0 * np.arange(240.0)
ROOM = np.interp(T, [1e3, 3e3], [-2.0, 3.0]) + np.sin(T / 500.0)
OTHER = np.cos(T / 333.0)
SENSORS = {"room": ROOM, "other": OTHER}


def angle(*, tau=420.0, seed=1, noise=0.2, heavy=True):
    rng = np.random.default_rng(seed)
    errors = rng.standard_t(2, 240) if heavy else rng.standard_normal(240)
    return 1e-6 * (lagged(ROOM, T, tau) + 0.5 * OTHER + noise * errors)


def off_the_minimum(design, point, y, weights, lag=0, step=1e-4):
    """How far a lag lies from the least weighted sum of squares, in its logarithm."""
    around = point.tau_s[lag] * np.exp(step * np.array([-1.0, 0.0, 1.0]))
    low, middle, high = profile(design, point, y, lag, around, weights)
    return 0.5 * step * (low - high) / (low - 2.0 * middle + high)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_profile_is_what_weighted_least_squares_leaves(degree):
    y, rng = angle(), np.random.default_rng(2)
    model = Offset() + Lagged("room", degree=degree) + Linear("other")
    design = bind(model, SENSORS, T)
    rows, weights = np.arange(5, 240), rng.uniform(0.1, 1.0, 235)
    point = SimpleNamespace(tau_s=np.array([400.0]), rows=rows)
    root, taus = np.sqrt(weights), np.array([0.0, 20.0, 400.0, 5000.0])
    expected = []
    for tau in taus:
        matrix = design.matrix(np.array([tau]))[rows] * root[:, None]
        left = y[rows] * root - matrix @ np.linalg.lstsq(matrix, y[rows] * root)[0]
        expected.append(left @ left)
    np.testing.assert_allclose(profile(design, point, y, 0, taus, weights), expected, rtol=1e-9)


def test_a_sensor_that_does_not_move_explains_nothing():
    design = bind(
        Offset() + Lagged("room"), {"room": np.full(240, 3.0)}, T, reference={"room": 3.0}
    )
    y = angle()
    point = SimpleNamespace(tau_s=np.array([400.0]), rows=np.arange(240))
    found = profile(design, point, y, 0, np.array([10.0, 100.0]), np.ones(240))
    np.testing.assert_allclose(found, np.sum((y - y.mean()) ** 2), rtol=1e-12)


@pytest.mark.parametrize("solver", [lb.LeastSquares(), lb.IRLS(), lb.MM()])
@pytest.mark.parametrize("degree", [1, 2])
def test_a_lag_is_where_the_weighted_squares_are_least(solver, degree):
    y = angle()
    model = Offset() + Lagged("room", degree=degree) + Linear("other")
    design = bind(model, SENSORS, T)
    point = fit_point(design, y, solver)
    assert abs(off_the_minimum(design, point, y, point.fit.weights)) < 1e-5
    assert point.tau_s[0] == pytest.approx(420.0, rel=0.3)


def test_two_lags_are_where_both_are_least():
    y = angle() + 1e-6 * lagged(OTHER, T, 90.0)
    design = bind(Offset() + Lagged("room", "other"), SENSORS, T)
    point = fit_point(design, y, lb.IRLS())
    for lag in (0, 1):
        assert abs(off_the_minimum(design, point, y, point.fit.weights, lag)) < 1e-4


def test_rows_and_a_lag_that_go_on_changing_each_other_have_not_converged():
    """Trimmed squares may throw out other rows at each of two lags, and these come in turns."""
    design = bind(Offset() + Lagged("room") + Linear("other"), SENSORS, T)
    found = [fit_point(design, angle(seed=seed), lb.LTS()) for seed in range(6)]
    moved = []
    for seed, point in enumerate(found):
        weights, limits = point.fit, np.log([1e-3, 1e4])
        tau = _gauss_newton(design, point.tau_s, angle(seed=seed), point.rows, weights, limits)
        moved.append(bool(np.abs(np.log(tau / point.tau_s)).max() > 1e-5))
    assert [not point.converged for point in found] == moved
    assert any(moved) and not all(moved)
    y = angle(seed=moved.index(True))
    with pytest.warns(RuntimeWarning, match="1 of 1 axes did not converge"):
        fit = lb.identify(Offset() + Lagged("room") + Linear("other"), y, SENSORS, T, solver="lts")
    assert not fit.converged
    assert fit_point(design, angle(seed=moved.index(True)), lb.IRLS()).converged


@pytest.mark.parametrize("start", [90.0, 300.0, 1500.0])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_gauss_newton_comes_from_afar_in_one_call(start, unit):
    y, rng = unit * angle(heavy=False), np.random.default_rng(3)
    design = bind(Offset() + Lagged("room") + Linear("other"), SENSORS, T)
    fit = SimpleNamespace(weights=rng.uniform(0.1, 1.0, 240))
    rows, limits = np.arange(240), np.log([1e-3, 1e4])
    tau = _gauss_newton(design, np.array([start]), y, rows, fit, limits)
    point = SimpleNamespace(tau_s=tau, rows=rows)
    assert abs(off_the_minimum(design, point, y, fit.weights)) < 1e-5
    ends = np.log([500.0, 900.0])
    assert _gauss_newton(design, np.array([700.0]), y, rows, fit, ends) == pytest.approx(500.0)
    ends = np.log([10.0, 200.0])
    assert _gauss_newton(design, np.array([150.0]), y, rows, fit, ends) == pytest.approx(200.0)


def test_an_exact_lag_is_found_to_the_digits_that_there_are():
    y = lagged(ROOM, T, 420.0)
    design = bind(Offset() + Lagged("room"), SENSORS, T)
    fit = SimpleNamespace(weights=np.ones(240))
    tau = _gauss_newton(design, np.array([300.0]), y, np.arange(240), fit, np.log([1.0, 7e3]))
    assert tau == pytest.approx(420.0, rel=1e-9)


def test_a_curvature_is_found_behind_a_lag():
    noise = 0.01 * np.random.default_rng(4).standard_normal(240)
    behind = lagged(ROOM, T, 420.0) - 0.0
    celsius = 20.0 + ROOM
    change = behind - ROOM.mean()
    y = lb.units.arcsec_to_rad(2.0 * change - 0.3 * change**2 + noise)
    fit = lb.fit_sensitivity(celsius, y, time_s=T, lag_s="fit", quadratic=True)
    assert float(fit.lag_s) == pytest.approx(420.0, rel=0.01)
    assert float(fit.k_arcsec_per_degC) == pytest.approx(2.0, rel=0.01)
    assert float(lb.units.rad_to_arcsec(fit.quadratic)) == pytest.approx(-0.3, rel=0.02)
    assert float(fit.rms) == pytest.approx(lb.units.arcsec_to_rad(noise.std()), rel=0.05)
    np.testing.assert_allclose(fit.predict(celsius, time_s=T) - y, fit.residuals, atol=1e-15)


# Errors with memory, and sums over lags


def test_columns_of_any_unit_and_columns_of_zeros_are_made_upright():
    rng = np.random.default_rng(5)
    columns, y = rng.standard_normal((40, 3)), rng.standard_normal(40)
    plain = _upright(columns, y)
    assert plain.shape == (40, 4)
    for units in ([1e-12, 1.0, 1e12], [1e-12, 1e-9, 1e-12]):
        other = _upright(columns * units, y)
        assert other.shape == (40, 4)
        np.testing.assert_allclose(
            other[:, :3] @ other[:, :3].T, plain[:, :3] @ plain[:, :3].T, atol=1e-12
        )
        np.testing.assert_allclose(other[:, 3], plain[:, 3], atol=1e-12)
    with_zero = np.column_stack([columns, np.zeros(40)])
    np.testing.assert_allclose(_upright(with_zero, y)[:, -1], plain[:, 3], atol=1e-12)
    both, (unit, start) = _safe(with_zero, y)
    assert unit[3] == 1.0 and (both[:, 3] == 0.0).all() and np.isfinite(start).all()
    for apart, kept in ((1e-9, 5), (1e-11, 4)):
        near = np.column_stack([columns, columns[:, 0] + apart * rng.standard_normal(40)])
        assert _upright(near, y).shape[1] == kept


def test_a_column_of_zeros_leaves_the_others_their_unknowns():
    rng = np.random.default_rng(6)
    t, columns, y = np.arange(40.0), rng.standard_normal((40, 2)), rng.standard_normal(40)
    for noise in (Noise(), Noise(3.0, 0.5)):
        plain = generalised(columns, y, t, noise)
        other = generalised(np.column_stack([columns, np.zeros(40)]), y, t, noise, freedom=False)
        np.testing.assert_allclose(other.x[:2], plain.x, rtol=1e-9)
        assert other.x[2] == 0.0


def test_a_long_memory_without_white_noise_has_next_to_none():
    """Steps of a memory of 500 samples are a 250th of its variance."""
    rng, t = np.random.default_rng(7), np.arange(3000.0)
    errors = rng.standard_normal(3000)
    for k in range(1, 3000):
        errors[k] = np.exp(-1 / 500) * errors[k - 1] + np.sqrt(-np.expm1(-2 / 500)) * errors[k]
    noise = fit_noise(np.ones((3000, 1)), errors, t)
    assert noise.white < 5e-4 and noise.tau_s > 100.0


def test_a_prior_is_averaged_over_seven_e_folds_of_its_variance_to_either_side():
    """By dense matrices on a fine grid; a flat likelihood makes the ends of the grid matter."""
    rng, t = np.random.default_rng(8), np.arange(30.0)
    base, bank = np.ones((30, 1)), rng.standard_normal((30, 2))
    y = bank @ [0.4, 0.3] + rng.standard_normal(30)
    sums = np.ones((1, 2))
    size = np.linalg.norm(bank, axis=0).max()

    def at(log_prior):
        covariance = np.eye(30) + np.exp(log_prior) * bank @ bank.T / size**2
        weight = np.linalg.inv(covariance)
        normal = base.T @ weight @ base
        x = np.linalg.solve(normal, base.T @ weight @ y)
        left = y - base @ x
        project = weight - weight @ base @ np.linalg.solve(normal, base.T @ weight)
        rss = left @ weight @ left
        cost = 29 * np.log(rss) + np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
        prior = np.exp(log_prior) * np.eye(2) / size**2
        gain = prior @ bank.T @ weight @ left
        spread = prior - prior @ bank.T @ project @ bank @ prior
        return cost, (sums @ gain)[0], (sums @ spread @ sums.T)[0, 0] * rss / 29

    power = np.linalg.eigvalsh((bank - bank.mean(axis=0)).T @ (bank - bank.mean(axis=0)))[-1]
    wide = np.arange(-8.0, 20.5, 0.5) - np.log(power / size**2)
    best = wide[int(np.argmin([at(p)[0] for p in wide]))]
    cost, total, variance = np.transpose([at(p) for p in best + np.linspace(-7.0, 7.0, 60)])
    weight = np.exp(-0.5 * (cost - cost.min()))
    weight /= weight.sum()
    mean = weight @ total
    found = ridge_sums(base, bank, sums, y, t, Noise())
    assert found.total[0] == pytest.approx(mean, rel=1e-6)
    assert found.sigma[0] == pytest.approx(
        np.sqrt(weight @ (variance + (total - mean) ** 2)), rel=1e-6
    )
    assert found.dof == 29


@pytest.mark.parametrize("origin_s", [-7000.0, 1e5])
def test_when_a_record_begins_makes_no_difference(origin_s):
    rng = np.random.default_rng(9)
    errors = rng.standard_normal(240)
    for k in range(1, 240):
        errors[k] += 0.7 * errors[k - 1]
    basis = np.column_stack([np.ones(240), ROOM])
    plain, moved = (fit_noise(basis, errors, T + origin) for origin in (0.0, origin_s))
    assert (moved.tau_s, moved.white) == pytest.approx((plain.tau_s, plain.white), rel=1e-6)
    # Little but a slow wander: the noise's longest memory is the record.
    slow = np.cumsum(rng.standard_normal(240))
    plain, moved = (fit_noise(basis[:, :1], slow, T + origin) for origin in (0.0, origin_s))
    assert moved.tau_s == pytest.approx(plain.tau_s, rel=1e-6) and plain.tau_s <= T[-1]
    y = 1e-6 * (lagged(ROOM, T, 420.0) + 0.05 * errors)
    model = Offset() + Lagged("room")
    one, two = (lb.identify(model, y, {"room": ROOM}, T + origin) for origin in (0.0, origin_s))
    np.testing.assert_allclose(two.interval, one.interval, rtol=1e-6)
    np.testing.assert_allclose(two.tau_interval_s, one.tau_interval_s, rtol=1e-6)
    assert two.lack_of_fit[0].f_p_value == pytest.approx(one.lack_of_fit[0].f_p_value, rel=1e-6)


@pytest.mark.parametrize("apart", [1e-3, 2e-6])
@pytest.mark.parametrize("noise", [Noise(), Noise(1e-3, 1.0)])
def test_columns_that_are_nearly_parallel_have_the_errors_that_they_have(apart, noise):
    """Down to 1e-13 in the squares; the second noise is white at any step."""
    rng, t = np.random.default_rng(10), np.arange(60.0)
    one, other = np.linalg.qr(rng.standard_normal((60, 2)))[0].T
    columns, y = np.column_stack([one, one + apart * other]), rng.standard_normal(60)
    found, expected = generalised(columns, y, t, noise, freedom=False), lb.lstsq(columns, y)
    np.testing.assert_allclose(found.sigma, expected.std_error, rtol=0.01)


@pytest.mark.parametrize(("worse", "long"), [(-3.0, True), (4.5, True), (4.7, False)])
@pytest.mark.parametrize("first", ["short", "long"])
def test_the_longer_memory_is_taken_within_4_6_of_the_likelihood(worse, long, first, monkeypatch):
    """Of the two minima that the search ends in, here given."""
    ends = {
        "short": SimpleNamespace(x=np.log([2.0, 0.5]), fun=10.0),
        "long": SimpleNamespace(x=np.log([20.0, 0.3]), fun=10.0 + worse),
    }
    found = [ends[first], *(end for name, end in ends.items() if name != first)]
    monkeypatch.setattr("scipy.optimize.minimize", lambda *a, **k: found.pop(0))
    t = np.arange(60.0)
    noise = fit_noise(np.ones((60, 1)), np.random.default_rng(11).standard_normal(60), t)
    assert (noise.tau_s, noise.white) == pytest.approx((20.0, 0.3) if long else (2.0, 0.5))


@pytest.mark.parametrize(("apart", "told"), [(6e-6, True), (1e-7, False)])
def test_lags_are_told_apart_down_to_the_rounding_of_their_squares(apart, told):
    """Two unit columns at an angle a: the smaller power is a^2 / 4 of the greater."""
    rng, t = np.random.default_rng(12), np.arange(80.0)
    basis = np.linalg.qr(np.column_stack([np.ones(80), rng.standard_normal((80, 2))]))[0]
    one, other = basis[:, 1:].T
    bank, base = np.stack([one, one + apart * other], axis=1), np.ones((80, 1))
    y = 5.0 * other + 1e-3 * rng.standard_normal(80)
    found = ridge_sums(base, bank, np.array([[0.0, 1.0]]), y, t, Noise())
    if told:
        assert found.total[0] * apart == pytest.approx(5.0, rel=0.01)
    else:
        assert abs(found.total[0]) * apart < 0.1
