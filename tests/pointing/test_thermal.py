"""Authority: closed forms, energy balance and scipy's adaptive integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import losbench as lb
from losbench.pointing.thermal import thermoelastic_tilt

CAMERA_NODES = lb.ThermalNetwork(
    {"base": 8000.0, "primary": 1500.0, "secondary": 400.0, "detector": 250.0},
    {("base", "primary"): 1.2, ("base", "secondary"): 0.3, ("base", "detector"): 0.8},
    {"base": 2.0, "primary": 0.2, "detector": 0.1},
)
TIME_S = np.arange(400) * 5.0
ROOM_DEGC = np.interp(TIME_S, [200.0, 1400.0], [18.0, 25.0])


def test_one_node_under_a_step_and_a_ramp_follows_the_closed_form():
    tau = 600.0
    node = lb.ThermalNetwork({"node": 300.0}, {}, {"node": 0.5})
    t = np.array([0.0, 1.0, 50.0, 700.0, 3000.0])
    step = node.simulate(t, np.full(5, 25.0), initial_degC=18.0)[:, 0]
    np.testing.assert_allclose(step, 25.0 - 7.0 * np.exp(-t / tau), rtol=1e-13)
    ramp = node.simulate(t, 18.0 + 0.01 * t)[:, 0]
    np.testing.assert_allclose(ramp, 18.0 + 0.01 * (t - tau * (1 - np.exp(-t / tau))), rtol=1e-13)


def test_a_network_follows_the_adaptive_integrator():
    c = np.array(list(CAMERA_NODES.capacity_J_per_K.values()))
    links = [(0, 1, 1.2), (0, 2, 0.3), (0, 3, 0.8)]
    room = np.array([2.0, 0.2, 0.0, 0.1])

    def heat_flow(t, temperature):
        flow = room * (np.interp(t, TIME_S, ROOM_DEGC) - temperature)
        for i, j, g in links:
            flow[i] += g * (temperature[j] - temperature[i])
            flow[j] += g * (temperature[i] - temperature[j])
        return flow / c

    start = [18.0, 20.0, 17.0, 30.0]
    expected = solve_ivp(
        heat_flow, (0, TIME_S[-1]), start, t_eval=TIME_S, rtol=1e-10, atol=1e-10, max_step=20.0
    ).y.T
    np.testing.assert_allclose(CAMERA_NODES.simulate(TIME_S, ROOM_DEGC, start), expected, atol=1e-6)


def test_the_result_does_not_depend_on_the_steps():
    irregular = np.sort(np.random.default_rng(3).uniform(0, TIME_S[-1], 60))
    t = np.unique(np.concatenate([irregular, [0.0, 200.0, 1400.0, TIME_S[-1]]]))
    fine = CAMERA_NODES.simulate(TIME_S, ROOM_DEGC)
    coarse = CAMERA_NODES.simulate(t, np.interp(t, [200.0, 1400.0], [18.0, 25.0]))
    np.testing.assert_allclose(coarse[-1], fine[-1], rtol=1e-12)


def test_without_a_room_energy_is_kept_and_shared():
    isolated = lb.ThermalNetwork({"a": 100.0, "b": 300.0}, {("a", "b"): 2.0}, {})
    temperature = isolated.simulate(TIME_S, ROOM_DEGC, [40.0, 0.0])
    np.testing.assert_allclose(temperature @ [100.0, 300.0], 4000.0, rtol=1e-12)
    np.testing.assert_allclose(temperature[-1], 10.0, rtol=1e-9)
    assert isolated.time_constants_s[0] == np.inf


def test_every_node_ends_at_room_temperature_and_starts_there_unless_told():
    slow = 50 * CAMERA_NODES.time_constants_s[0]
    temperature = CAMERA_NODES.simulate([0.0, 1.0, slow], [18.0, 25.0, 25.0])
    np.testing.assert_array_equal(temperature[0], 18.0)
    np.testing.assert_allclose(temperature[-1], 25.0, rtol=1e-12)


def test_nodes_without_links_are_independent():
    pair = lb.ThermalNetwork({"a": 100.0, "b": 700.0}, {}, {"a": 1.0, "b": 1.0})
    alone = lb.ThermalNetwork({"b": 700.0}, {}, {"b": 1.0})
    np.testing.assert_allclose(
        pair.simulate(TIME_S, ROOM_DEGC)[:, 1], alone.simulate(TIME_S, ROOM_DEGC)[:, 0], rtol=1e-13
    )


def test_tilt_is_linear_in_each_node():
    matrix = np.arange(12.0).reshape(3, 4)
    temperature = CAMERA_NODES.simulate(TIME_S, ROOM_DEGC)
    tilt = thermoelastic_tilt(temperature, matrix, reference_degC=temperature[0])
    np.testing.assert_array_equal(tilt[0], 0.0)
    np.testing.assert_allclose(
        np.degrees(tilt[-1]) * 3600, matrix @ (temperature[-1] - temperature[0]), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lb.ThermalNetwork({"a": 0.0}, {}, {}), "capacity_J_per_K must be positive, got 0"),
        (lambda: lb.ThermalNetwork({}, {}, {}), "capacity_J_per_K must hold at least one sample"),
        (
            lambda: lb.ThermalNetwork({"a": 1.0}, {}, {"b": 1.0}),
            "room_W_per_K must join nodes of a, got b",
        ),
        (
            lambda: lb.ThermalNetwork({"a": 1.0}, {("a", "c"): 1.0}, {}),
            "link_W_per_K must join nodes of a, got c",
        ),
        (
            lambda: lb.ThermalNetwork({"a": 1.0}, {("a", "a"): 1.0}, {}),
            "link_W_per_K must name two different nodes",
        ),
        (
            lambda: lb.ThermalNetwork({"a": 1.0, "b": 1.0}, {("a", "b"): 1.0, ("b", "a"): 2.0}, {}),
            "link_W_per_K must name two different nodes per link and each pair once",
        ),
        (
            lambda: lb.ThermalNetwork({"a": 1.0}, {}, {"a": -1.0}),
            "room_W_per_K must not be negative, got -1",
        ),
        (
            lambda: CAMERA_NODES.simulate([0.0, 0.0], [1.0, 1.0]),
            "time_s must increase, but sample 1 at 0 s equals the one before it",
        ),
        (
            lambda: CAMERA_NODES.simulate([0.0, 1.0], [1.0]),
            r"room_degC must have shape \(2,\) to match time_s, got \(1,\)",
        ),
        (
            lambda: CAMERA_NODES.simulate([0.0, 1.0], [1.0, 1.0], [1.0, 2.0]),
            r"initial_degC must have shape \(4,\) to match the nodes, or be one number, got \(2,\)",
        ),
        (
            lambda: thermoelastic_tilt(np.zeros((5, 4)), np.zeros((3, 3)), reference_degC=0.0),
            r"sensitivity_arcsec_per_degC must have shape \(3, 4\) to match 4 nodes, got \(3, 3\)",
        ),
        (
            lambda: thermoelastic_tilt(np.zeros((5, 4)), np.zeros((3, 4)), reference_degC=[0.0]),
            r"reference_degC must have shape \(4,\) to match 4 nodes, got \(1,\)",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


# Temperature to line of sight

K = np.array([1.5e-6, -4e-6, 2e-7])
OFFSET = np.array([1e-5, 0.0, -3e-5])


def drift(temperature, *, noise=0.0, seed=0, quadratic=0.0):
    change = (temperature - np.mean(ROOM_DEGC))[:, None]
    errors = np.random.default_rng(seed).standard_normal((temperature.size, 3))
    return OFFSET + K * change + quadratic * change**2 + noise * errors


@pytest.mark.parametrize("method", ["ls", "irls"])
def test_a_straight_drift_comes_back(method):
    fit = lb.fit_sensitivity(ROOM_DEGC, drift(ROOM_DEGC), method=method)
    np.testing.assert_allclose(fit.k, K, rtol=1e-9)
    np.testing.assert_allclose(fit.offset, OFFSET, atol=1e-15)
    np.testing.assert_allclose(fit.k_arcsec_per_degC, np.degrees(K) * 3600, rtol=1e-9)
    np.testing.assert_allclose(
        fit.predict([20.0, np.nan])[0], drift(np.array([20.0]))[0], rtol=1e-9
    )
    assert np.isnan(fit.predict([20.0, np.nan])[1]).all()
    assert fit.k_interval.shape == (3, 2)
    assert fit.reference_degC == pytest.approx(np.mean(ROOM_DEGC))


def test_least_squares_agrees_with_statsmodels_in_value_and_interval():
    sm = pytest.importorskip("statsmodels.api")
    angle = drift(ROOM_DEGC, noise=1e-6, seed=1)[:, 0]
    fit = lb.fit_sensitivity(ROOM_DEGC, angle, method="ls", errors="white", confidence=0.9)
    authority = sm.OLS(angle, sm.add_constant(ROOM_DEGC)).fit()
    np.testing.assert_allclose(fit.k, authority.params[1], rtol=1e-9)
    np.testing.assert_allclose(fit.k_interval, authority.conf_int(0.1)[1], rtol=1e-9)
    assert fit.rms == pytest.approx(np.sqrt(np.mean(authority.resid**2)))


@pytest.mark.parametrize("method", ["ls", "irls"])
def test_intervals_cover_the_truth_as_often_as_they_say(method):
    temperature = ROOM_DEGC[::20]
    rng = np.random.default_rng(2)
    angles = 1e-6 * temperature[:, None] + 1e-6 * rng.standard_normal((temperature.size, 600))
    interval = lb.fit_sensitivity(temperature, angles, method=method, errors="white").k_interval
    covered = np.mean((interval[:, 0] < 1e-6) & (interval[:, 1] > 1e-6))
    assert covered == pytest.approx(0.95, abs=0.03)


def test_outliers_that_cost_least_squares_its_k_leave_irls_with_it():
    angles = drift(ROOM_DEGC, noise=2e-7, seed=3)
    angles[-40::4] += 5e-5  # one-sided, in the warm part
    least, robust = (
        lb.fit_sensitivity(ROOM_DEGC, angles, method=method) for method in ("ls", "irls")
    )
    assert (np.abs(least.k - K) > 1e-7).all()
    assert (np.abs(robust.k - K) < 1e-8).all()
    assert (robust.weights[-40::4] < 0.05).all()


@pytest.mark.parametrize(
    ("chosen", "named"),
    [
        (lb.IRLS("cauchy"), {"method": "irls", "loss": "cauchy"}),
        (lb.LeastSquares(), {"solver": "ls"}),
        (lb.MM(seed=1), {"solver": lb.MM(seed=1)}),
        (lb.LTS(seed=1), {"method": lb.LTS(seed=1)}),
    ],
)
def test_a_solver_is_an_object_or_its_name(chosen, named):
    angles = drift(ROOM_DEGC, noise=2e-7, seed=3)
    angles[::9] += 5e-5
    fit = lb.fit_sensitivity(ROOM_DEGC, angles, solver=chosen)
    same = lb.fit_sensitivity(ROOM_DEGC, angles, **named)
    np.testing.assert_array_equal(fit.k, same.k)
    np.testing.assert_array_equal(fit.k_interval, same.k_interval)
    design = np.column_stack([np.ones_like(ROOM_DEGC), ROOM_DEGC - fit.reference_degC])
    np.testing.assert_allclose(fit.k[1], chosen.fit(design, angles[:, 1]).x[1], rtol=1e-12)


def test_it_is_the_small_case_of_identify():
    angles = drift(ROOM_DEGC, noise=1e-6, seed=4)[:, :2]
    fit = lb.fit_sensitivity(ROOM_DEGC, angles, time_s=TIME_S, lag_s="fit")
    model = lb.terms.Offset() + lb.terms.Lagged("room", tau_s="spectrum")
    found = lb.identify(model, angles, {"room": ROOM_DEGC}, TIME_S)
    np.testing.assert_allclose(fit.k_at_rest_arcsec_per_degC, found.sensitivity[:, 0])
    np.testing.assert_allclose(fit.k_interval_arcsec_per_degC, found.interval[:, 0])
    np.testing.assert_array_equal(fit.lag_state, found.tau_state[:, 0])
    np.testing.assert_allclose(fit.k_interval.mean(axis=-1), fit.k_at_rest, rtol=1e-9)
    np.testing.assert_array_equal(fit.weights, found.weights)
    plain = lb.fit_sensitivity(ROOM_DEGC, angles, solver="ls", errors="white")
    np.testing.assert_allclose(plain.k_at_rest, plain.k, rtol=1e-9)


def test_a_missing_sample_is_a_sample_left_out():
    angles, temperature = drift(ROOM_DEGC, noise=1e-6, seed=4), ROOM_DEGC.copy()
    angles[100, 1] = np.nan
    temperature[[7, 200]] = np.nan
    fit = lb.fit_sensitivity(temperature, angles, time_s=TIME_S)
    kept = np.isfinite(temperature) & np.isfinite(angles[:, 1])
    alone = lb.fit_sensitivity(temperature[kept], angles[kept, 1], time_s=TIME_S[kept])
    np.testing.assert_allclose(fit.k[1], alone.k, rtol=1e-9)
    np.testing.assert_allclose(fit.k_interval[1], alone.k_interval, rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(fit.residuals[:, 1]), ~kept)
    np.testing.assert_array_equal(fit.weights[~kept, 1], 0.0)


def test_axes_are_fitted_one_by_one():
    angles = drift(ROOM_DEGC, noise=1e-6, seed=5)
    together = lb.fit_sensitivity(ROOM_DEGC, angles, time_s=TIME_S, lag_s="fit")
    alone = lb.fit_sensitivity(ROOM_DEGC, angles[:, 1], time_s=TIME_S, lag_s="fit")
    for name in ("k", "k_interval", "offset", "lag_s", "lag_interval_s", "rms"):
        np.testing.assert_allclose(getattr(together, name)[1], getattr(alone, name), rtol=1e-12)
    np.testing.assert_allclose(together.residuals[:, 1], alone.residuals)


def test_a_curved_drift_comes_back():
    fit = lb.fit_sensitivity(ROOM_DEGC, drift(ROOM_DEGC, quadratic=3e-7), quadratic=True)
    np.testing.assert_allclose(fit.k, K, rtol=1e-8)
    np.testing.assert_allclose(fit.quadratic, 3e-7, rtol=1e-8)
    np.testing.assert_array_equal(lb.fit_sensitivity(ROOM_DEGC, drift(ROOM_DEGC)).quadratic, 0.0)


def test_a_known_lag_is_taken_out_and_a_fitted_one_is_found():
    node = lb.ThermalNetwork({"node": 250.0}, {}, {"node": 1.0})
    lagging = node.simulate(TIME_S, ROOM_DEGC)[:, 0]
    known = lb.fit_sensitivity(ROOM_DEGC, drift(lagging), time_s=TIME_S, lag_s=250.0)
    np.testing.assert_allclose(known.k, K, rtol=1e-9)
    np.testing.assert_allclose(known.predict(ROOM_DEGC, time_s=TIME_S), drift(lagging), atol=1e-15)
    found = lb.fit_sensitivity(ROOM_DEGC, drift(lagging), time_s=TIME_S, lag_s="fit")
    np.testing.assert_allclose(found.lag_s, 250.0, rtol=1e-4)
    np.testing.assert_allclose(found.k, K, rtol=1e-5)
    blind = lb.fit_sensitivity(ROOM_DEGC, drift(lagging))
    assert (blind.rms > 100 * found.rms).all()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ls", "irls"])
def test_lag_and_sensitivity_fitted_together_lie_within_their_intervals(method):
    lagging = lb.ThermalNetwork({"node": 250.0}, {}, {"node": 1.0}).simulate(TIME_S, ROOM_DEGC)
    angles = 1e-6 * lagging + 2e-7 * np.random.default_rng(6).standard_normal((TIME_S.size, 60))
    fit = lb.fit_sensitivity(ROOM_DEGC, angles, time_s=TIME_S, lag_s="fit", method=method)
    for interval, truth in ((fit.k_interval, 1e-6), (fit.lag_interval_s, 250.0)):
        covered = np.mean((interval[:, 0] < truth) & (interval[:, 1] > truth))
        assert covered == pytest.approx(0.95, abs=0.06)


def test_where_no_lag_shows_its_interval_says_so_without_a_warning():
    time_s = np.arange(40) * 5.0
    noise = 1e-6 * np.random.default_rng(1).standard_normal((40, 20))
    fit = lb.fit_sensitivity(18.0 + time_s / 40.0, noise, time_s=time_s, lag_s="fit")
    low, high = fit.lag_interval_s.T
    assert (low < 1e-6).all() and (high > 1e6).all()
    assert np.isinf(high).any()


def test_a_lag_runs_straight_over_a_gap_of_the_log():
    node = lb.ThermalNetwork({"node": 250.0}, {}, {"node": 1.0})
    angle = 1e-6 * node.simulate(TIME_S, ROOM_DEGC)[:, 0]
    gappy = ROOM_DEGC.copy()
    gappy[100:120] = np.nan  # within the ramp, which is straight
    fit = lb.fit_sensitivity(gappy, angle, time_s=TIME_S, lag_s=250.0)
    np.testing.assert_allclose(fit.k, 1e-6, rtol=1e-9)


ANGLE = 1e-6 * ROOM_DEGC


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: lb.fit_sensitivity(np.full(400, 20.0), ANGLE),
            "temperature_degC must vary to give a sensitivity, got 20 throughout",
        ),
        (
            lambda: lb.fit_sensitivity(np.arange(400) % 2, ANGLE, quadratic=True),
            "temperature_degC must take at least 3 values for a quadratic fit, got 2",
        ),
        (
            lambda: lb.fit_sensitivity([18.0, 19.0], [0.0, 1.0]),
            "angles must hold more than 2 samples with a temperature",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE[:-1]),
            r"angles must have shape \(400,\) to match temperature_degC, got \(399,\)",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, np.zeros((3, 400))),
            r"angles must have shape \(400, k\) to match temperature_degC, got \(3, 400\)",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, lag_s=10.0),
            "time_s must be given with a lag",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, lag_s=-1.0, time_s=TIME_S),
            "lag_s must be positive, got -1",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, lag_s="auto", time_s=TIME_S),
            "lag_s must be a number, got 'auto'",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, lag_s="fit", time_s=TIME_S[1:]),
            r"time_s must have shape \(400,\) to match temperature_degC, got \(399,\)",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, method="best"),
            "method must be one of 'irls', 'ls', 'lts', 'mm', got 'best'",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, solver=lb.MM(), loss="cauchy"),
            "loss belongs to the solver",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, solver="ls", method="ls"),
            "solver and method are one thing",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, confidence=95),
            "confidence must be a finite number from 0 to 1",
        ),
        (
            lambda: lb.fit_sensitivity(ROOM_DEGC, ANGLE, time_s=TIME_S, lag_s=9.0).predict(
                ROOM_DEGC
            ),
            "time_s must be given with a lag",
        ),
    ],
)
def test_bad_input_to_the_fit_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
