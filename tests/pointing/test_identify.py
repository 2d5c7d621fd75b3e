"""Authority: the exact network, dense generalised least squares, statsmodels; intervals that cover."""

import numpy as np
import pytest
from scipy.signal import lfilter

import losbench as lb
from losbench.papers.liu2026 import ThermalBench, warm_up
from losbench.pointing.thermal.correlated import Noise, _reml, fit_noise, generalised
from losbench.pointing.thermal.lag import lag_grid, lagged
from losbench.pointing.thermal.ridge import ridge_sums
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
from losbench.units import arcsec_to_rad, rad_to_arcsec

T = 60.0 * np.arange(800)
ONE = 2.0 * np.sin(2 * np.pi * T / 17_000) + np.interp(T, [5e3, 3e4], [0.0, 4.0])
TWO = 1.5 * np.sin(2 * np.pi * T / 9_000 + 1.0) + np.sin(2 * np.pi * T / 41_000)
SENSORS = {"T1": ONE, "T2": TWO}
CLEAN = 1.0 * lagged(ONE, T, 1500.0) - 0.5 * TWO + 1e-5 * T
MODEL = Offset() + Lagged("T1") + Linear("T2") + Trend(1)


def memory(rng, n, a):
    return lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n + 800))[-n:]


def test_a_lag_is_a_node_of_the_network_on_any_times():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.exponential(40.0, 300))
    room = rng.standard_normal(300).cumsum()
    node = lb.ThermalNetwork({"node": 250.0}, {}, {"node": 1.0}).simulate(t, room)[:, 0]
    np.testing.assert_allclose(lagged(room, t, 250.0), node, atol=1e-11)
    np.testing.assert_array_equal(lagged(room, t, 0.0), room)
    np.testing.assert_allclose(lagged(room, t, 1e-6), room, atol=1e-5)


def test_generalised_least_squares_is_that_of_the_dense_matrix_and_of_statsmodels():
    sm = pytest.importorskip("statsmodels.api")
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5, 2.0, 80))
    columns = np.column_stack([np.ones(80), np.sin(t / 9.0), 1e6 * t])
    noise = Noise(tau_s=4.0, white=0.3)
    dense = np.exp(-np.abs(t[:, None] - t) / 4.0) + 0.3 * np.eye(80)
    y = columns @ [1.0, 2.0, 3e-6] + np.linalg.cholesky(dense) @ rng.standard_normal(80)
    gram, log_det = noise.gram(columns, t)
    np.testing.assert_allclose(gram, columns.T @ np.linalg.solve(dense, columns), rtol=1e-10)
    assert log_det == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-10)
    ours, theirs = generalised(columns, y, t, noise), sm.GLS(y, columns, sigma=dense).fit()
    np.testing.assert_allclose(ours.x, theirs.params, rtol=1e-7)
    np.testing.assert_allclose(ours.sigma, theirs.bse, rtol=1e-8)


def test_white_noise_has_the_degrees_of_freedom_of_least_squares():
    rng = np.random.default_rng(3)
    fit = generalised(np.ones((50, 1)), rng.standard_normal(50), np.arange(50.0), Noise())
    assert fit.dof[0] == 49


def test_the_noise_comes_back():
    rng = np.random.default_rng(4)
    n = 4000
    y = memory(rng, n, np.exp(-1 / 20.0)) + 0.5 * rng.standard_normal(n)
    noise = fit_noise(np.ones((n, 1)), y, np.arange(float(n)))
    assert noise.tau_s == pytest.approx(20.0, rel=0.3)
    assert noise.white == pytest.approx(0.25, rel=0.3)
    long = np.tile(y, 8)
    assert fit_noise(np.ones((8 * n, 1)), long, np.arange(8.0 * n)).tau_s == pytest.approx(
        20.0, rel=0.3
    )


def in_bursts(rng, spread, count=8, each=80):
    """Bursts of 80 samples over two months, each with an error of its own beside white noise."""
    t = (np.linspace(0.0, 5e6, count)[:, None] + 0.125 * np.arange(each)).ravel()
    errors = 0.6 * rng.standard_normal(t.size)
    return t, errors + np.repeat(spread * rng.standard_normal(count), each)


def test_directions_that_rounding_makes_change_no_noise():
    t, y = in_bursts(np.random.default_rng(6), 0.3)
    columns = np.vander(t / t[-1], 4)
    alone = fit_noise(columns, y, t)
    for twin in (columns[:, 1] * (1.0 + 1e-16), columns @ [0.3, -0.1, 0.7, 0.2]):
        assert fit_noise(np.column_stack([columns, twin]), y, t).tau_s == pytest.approx(
            alone.tau_s, rel=1e-3
        )


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_intervals_hold_where_a_short_memory_and_a_long_one_explain_a_record_as_well(spread):
    rng, hits = np.random.default_rng(5), []
    for _ in range(40):
        t, errors = in_bursts(rng, spread)
        room = 20.0 + 8.0 * t / 5e6
        y = arcsec_to_rad(0.5 * lagged(room - 20.0, t, 4.0) + errors)
        found = lb.identify(Offset() + Lagged("room", tau_s="spectrum"), y, {"room": room}, t)
        low, high = found.interval[0]
        hits.append(low < 0.5 < high)
    assert np.mean(hits) >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 40)


def test_a_long_memory_is_taken_unless_the_short_one_is_ten_times_as_likely():
    rng, differences = np.random.default_rng(8), []
    for _ in range(30):
        t, y = in_bursts(rng, 0.2)
        basis = np.linalg.qr(np.vander(t / t[-1], 6))[0]
        both = np.column_stack([basis, y - basis @ (basis.T @ y)])
        taken = fit_noise(basis, y, t)
        grid = np.geomspace(0.1, 5e6, 24)
        cost = [
            min(_reml(both, t, Noise(tau, w)) for w in np.geomspace(1e-4, 1e3, 14)) for tau in grid
        ]
        differences.append(_reml(both, t, taken) - min(cost))
    assert max(differences) < 4.6 + 0.2
    assert any(one > 1.0 for one in differences)


def test_terms_add_and_make_their_columns():
    model = Offset() + (Linear("T1", degree=2) + Difference("T1", "T2")) + Steps((6e3,))
    model = model + Fourier(9000.0, harmonics=(1, 3)) + Product(Trend(1), Linear("T2"))
    assert model.labels[:5] == ("offset", "T1", "T1^2", "T1 - T2", "step at 6000 s")
    assert model.sensors == ("T1", "T2")
    columns = model.columns(SENSORS, T)
    assert columns.shape == (800, 10)
    np.testing.assert_allclose(columns[:, 2], ONE**2, rtol=1e-14)
    np.testing.assert_array_equal(columns[:, 4], T >= 6e3)
    np.testing.assert_allclose(columns[:, 7], np.cos(3 * 2 * np.pi * T / 9000.0))
    middle = (T - T.mean()) / 31_557_600.0
    np.testing.assert_allclose(columns[:, 9], middle * TWO)


def test_an_exact_record_gives_its_law_back():
    found = lb.identify(MODEL, arcsec_to_rad(CLEAN), SENSORS, T)
    np.testing.assert_allclose(found.sensitivity, [1.0, -0.5], rtol=1e-6)
    np.testing.assert_allclose(found.tau_s, 1500.0, rtol=1e-5)
    assert found.tau_state.tolist() == ["identified"]
    np.testing.assert_allclose(found.compensate(arcsec_to_rad(CLEAN), SENSORS, T), 0, atol=1e-12)
    assert found.of == ("T1 lagged", "T2")


@pytest.mark.parametrize("sigma", [0.0, 1e-3])
def test_where_there_is_no_lag_none_is_left_in_the_residuals(sigma):
    """A tenth of a step would leave a hundred times this noise."""
    noise = sigma * np.random.default_rng(12).standard_normal(800)
    found = lb.identify(Offset() + Lagged("T1"), arcsec_to_rad(-3.0 * ONE + noise), SENSORS, T)
    assert rad_to_arcsec(found.residuals).std() == pytest.approx(noise.std(), rel=0.01, abs=1e-5)
    assert found.sensitivity[0] == pytest.approx(-3.0, abs=1e-3)
    if sigma:
        assert found.tau_state.tolist() == ["no lag seen"]
        assert found.tau_interval_s[0, 0] == 0.0
        assert 6.0 <= found.tau_interval_s[0, 1] < 60.0


def test_two_lags_at_once_and_a_gap_of_a_sensor():
    rng = np.random.default_rng(5)
    y = lagged(ONE, T, 1500.0) - 0.5 * lagged(TWO, T, 400.0) + 0.02 * rng.standard_normal(800)
    gappy = ONE.copy()
    gappy[300:310] = np.nan
    model = Offset() + Lagged("T1", "T2")
    found = lb.identify(model, arcsec_to_rad(y), {"T1": gappy, "T2": TWO}, T)
    assert (np.abs(found.tau_s - [1500.0, 400.0]) < 40.0).all()
    assert np.isnan(found.residuals[300:310]).all()
    assert np.isnan(found.predict({"T1": gappy, "T2": TWO}, T)[300:310]).all()


def test_axes_are_identified_one_by_one_and_outliers_are_named():
    rng = np.random.default_rng(6)
    y = CLEAN[:, None] * [1.0, -2.0] + 0.1 * rng.standard_normal((800, 2))
    y[::40, 1] += 30.0
    both = lb.identify(MODEL, arcsec_to_rad(y), SENSORS, T)
    alone = lb.identify(MODEL, arcsec_to_rad(y[:, 1]), SENSORS, T)
    np.testing.assert_allclose(both.sensitivity[1], alone.sensitivity, rtol=1e-12)
    assert both.interval.shape == (2, 2, 2)
    assert np.flatnonzero(both.rejected[:, 1]).tolist() == list(range(0, 800, 40))
    assert any(note.startswith("Axis 2: 20 of 800 samples lie beyond") for note in both.notes)
    assert len(both.table()) == 4


def covered(model, draw, truth, runs=60, **options):
    hits = []
    for run in range(runs):
        y, sensors, t = draw(np.random.default_rng(20261900 + run))
        found = lb.identify(model, arcsec_to_rad(y), sensors, t, **options)
        hits.append(
            (found.interval[..., 0] <= np.array(truth))
            & (np.array(truth) <= found.interval[..., 1])
        )
    return np.mean(hits, axis=0)


@pytest.mark.slow
def test_intervals_cover_under_the_right_law():
    """95 % on 60 records with memory, white noise and gross errors; floor 85 %.

    The full run of 400 records is in benchmarks.
    """

    def draw(rng):
        noise = memory(rng, 800, 0.97) + rng.standard_normal(800) + 20.0 * (rng.random(800) < 0.05)
        return CLEAN + 0.2 * noise, SENSORS, T

    share = covered(MODEL, draw, (1.0, -0.5))
    assert (share >= 0.85).all(), share


@pytest.mark.slow
def test_all_lags_cover_where_one_lag_is_a_wrong_law():
    """Laws whose misfit no test sees at this noise, and the twin of liu2026."""
    t = np.arange(0.0, 9000.1, 30.0)
    room = np.interp(t, [600.0, 5400.0], [18.0, 25.0])
    model = Offset() + Lagged("room", tau_s="spectrum")
    for gains, taus in (
        ((1.0, 0.4, -0.3), (400, 1500, 2000)),
        ((0.8, 0.6, -0.25), (300, 1200, 3200)),
    ):
        clean = sum(g * lagged(room, t, tau) for g, tau in zip(gains, taus, strict=True))
        share = covered(
            model,
            lambda rng, clean=clean: (
                clean + 0.05 * rng.standard_normal(t.size),
                {"room": room},
                t,
            ),
            sum(gains),
            runs=20,
        )
        assert share >= 0.85
    setting = ThermalBench()
    run = warm_up(setting, time_s=t)
    clean = rad_to_arcsec(run.angles_rad[:, 0])
    truth = float(np.sum(setting.sensitivity_arcsec_per_degC[0]))
    share = covered(
        model,
        lambda rng: (clean + 0.045 * rng.standard_normal(t.size), {"room": run.room_degC}, t),
        truth,
        runs=30,
    )
    assert share >= 0.85


@pytest.mark.slow
def test_fit_sensitivity_holds_the_truth_of_the_twin():
    setting = ThermalBench()
    t = np.arange(0.0, 9000.1, 30.0)
    run = warm_up(setting, time_s=t)
    truth = np.sum(setting.sensitivity_arcsec_per_degC, axis=1)
    hits, p_values = [], []
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal((t.size, 3)) * [0.045, 0.045, 4.4]
        angles = run.angles_rad + arcsec_to_rad(noise)
        fit = lb.fit_sensitivity(run.room_degC, angles, time_s=t, lag_s="fit")
        low, high = fit.k_interval_arcsec_per_degC.T
        hits.append((low <= truth) & (truth <= high))
        p_values.append(fit.one_lag_p_value[1])
    assert np.median(p_values) < 1e-3
    assert (np.mean(hits, axis=0) >= 0.85).all()


def test_the_sum_over_all_lags_is_exact_where_the_data_are():
    t = np.arange(0.0, 40_000.0, 30.0)
    room = np.sin(t / 3000.0) + np.sin(t / 700.0) + np.interp(t, [0, 2e4], [0, 5])
    taus = np.r_[0.0, lag_grid(t, 24)]
    bank = np.stack([lagged(room, t, tau) for tau in taus], axis=1)
    y = 2.0 + 1.5 * bank[:, 12] - 0.25 * bank[:, 18]
    for noise in (1e-2, 1e-4, 1e-6):
        z = y + noise * np.random.default_rng(7).standard_normal(t.size)
        found = ridge_sums(np.ones((t.size, 1)), bank, np.ones((1, 25)), z, t, Noise())
        assert abs(found.total[0] - 1.25) < 2.0 * found.sigma[0] < 0.1


STATE_S = np.arange(400.0)
STATE_DEGC = np.interp(STATE_S, [40.0, 200.0], [18.0, 25.0]) + np.sin(2 * np.pi * STATE_S / 60.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tau", "gain", "state"),
    [
        (1.0, 1.0, "identified"),
        (20.0, 1.0, "identified"),
        (80.0, 1.0, "identified"),
        (150.0, 1.0, "weak"),
        (400.0, 1.0, "not identifiable"),
        (1200.0, 1.0, "not identifiable"),
        (0.0, 1.0, "no lag seen"),
        (30.0, 0.0, "not identifiable"),
    ],
)
def test_a_lag_has_a_state(tau, gain, state):
    states = []
    for seed in range(12):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(400)
        y = arcsec_to_rad(gain * lagged(STATE_DEGC, STATE_S, tau) + noise)
        found = lb.identify(Offset() + Lagged("room"), y, {"room": STATE_DEGC}, STATE_S)
        states.append(str(found.tau_state[0]))
        if states[-1] == "not identifiable" and str(found.law) == "as given":
            assert np.isnan(found.sensitivity[0])
            assert np.isnan(found.tau_s[0])
    assert states.count(state) >= 10, states


def test_notes_tell_of_omitted_variables_and_of_collinear_columns():
    rng = np.random.default_rng(8)
    trend = np.linspace(0.0, 5.0, 800)
    one = trend + 0.5 * rng.standard_normal(800)
    y = arcsec_to_rad(3.0 * trend - 1.0 * one + 0.05 * rng.standard_normal(800))
    alone = lb.identify(Offset() + Linear("T1"), y, {"T1": one}, T, errors="white")
    assert any("T1 changes sign" in note for note in alone.notes)
    sensors = {"T1": one, "T2": one + 0.01 * rng.standard_normal(800)}
    both = lb.identify(Offset() + Linear("T1", "T2") + Trend(1), y, sensors, T)
    assert both.condition > 30
    assert both.vif[1] > 10
    assert any("nearly collinear" in note for note in both.notes)
    assert (
        lb.identify(MODEL, arcsec_to_rad(CLEAN + 0.1 * rng.standard_normal(800)), SENSORS, T).notes
        == ()
    )


def test_a_wrong_law_is_told():
    t = np.arange(0.0, 9000.1, 30.0)
    run = warm_up(ThermalBench(), time_s=t)
    noise = arcsec_to_rad(0.02 * np.random.default_rng(9).standard_normal(t.size))
    found = lb.identify(
        Offset() + Lagged("room"), run.angles_rad[:, 1] + noise, {"room": run.room_degC}, t
    )
    assert found.lack_of_fit[0].rejects
    assert str(found.law) == "all lags"
    assert "one lag does not describe it" in found.notes[0]


def test_a_model_comes_back_from_its_file_bit_by_bit(tmp_path):
    rng = np.random.default_rng(10)
    model = MODEL + Steps((6e3, 2e4)) + Fourier(9000.0, 2) + Product(Trend(1), Linear("T2"))
    y = arcsec_to_rad(CLEAN[:, None] * [1, 2] + 0.1 * rng.standard_normal((800, 2)))
    found = lb.identify(model, y, SENSORS, T)
    found.save(tmp_path / "model.toml")
    again = lb.FittedModel.from_toml(tmp_path / "model.toml")
    np.testing.assert_array_equal(again.predict(SENSORS, T), found.predict(SENSORS, T))
    assert again.model == found.fitted.model
    text = (tmp_path / "model.toml").read_text()
    for word in ('unit = "rad"', "sign = ", "frame = ", "# T1 lagged"):
        assert word in text
    with pytest.raises(ValueError, match="angles must have 2 axes as the model, got 1"):
        again.compensate(y[:, 0], SENSORS, T)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('unit = "rad"', 'unit = "arcsec"'), "model.toml: unit must be 'rad', got 'arcsec'"),
        (("sign =", "sing ="), "model.toml: a thermal model has"),
        (('kind = "Trend"', 'kind = "Trond"'), "model.toml: not a thermal model: 'Trond'"),
        (("coefficients = [", "coefficients = [ 1.0,"), "must have 4 coefficients and 1 lags"),
        (("degree = 1", "degree = 0"), "degree must be a whole number from 1 to 5"),
    ],
)
def test_a_wrong_model_file_is_named(tmp_path, change, message):
    found = lb.identify(MODEL, arcsec_to_rad(CLEAN), SENSORS, T)
    path = tmp_path / "model.toml"
    found.save(path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(ValueError, match=message):
        lb.FittedModel.from_toml(path)


Y = arcsec_to_rad(CLEAN)
NOISY = Y + arcsec_to_rad(0.1 * np.random.default_rng(20).standard_normal(800))


@pytest.mark.parametrize(
    ("model", "sensors", "alike"),
    [
        (Offset() + Linear("T1", "T2"), {"T1": ONE, "T2": 2 * ONE + 1}, "T1, T2"),
        (Offset() + Lagged("T1", "T2"), {"T1": ONE, "T2": 3 * ONE}, "T1 lagged, T2 lagged"),
        (
            Offset() + Lagged("T1", "T2", tau_s="spectrum"),
            {"T1": ONE, "T2": -ONE},
            "T1 lagged, T2 lagged",
        ),
        (
            Offset() + Linear("T1") + Lagged("T1", tau_s="spectrum"),
            {"T1": ONE},
            "T1, T1 lagged",
        ),
        (
            Offset() + Linear("T1", "T2") + Difference("T1", "T2"),
            SENSORS,
            "T1, T2, T1 - T2",
        ),
    ],
)
def test_sensors_that_read_the_same_get_no_sensitivity_and_predictions_stay(model, sensors, alike):
    found = lb.identify(model, NOISY, sensors, T)
    assert np.isnan(found.sensitivity).all() and np.isnan(found.interval).all()
    assert any(note.startswith(f"{alike} cannot be told apart") for note in found.notes)
    assert not any("nearly collinear" in note for note in found.notes)
    assert np.isfinite(found.predict(sensors, T)).all()


def test_a_sensor_beside_its_own_lag_is_no_second_sensor():
    y = NOISY + arcsec_to_rad(0.5 * ONE)
    model = MODEL + Linear("T1")
    found = lb.identify(model, y, SENSORS, T)
    assert str(found.law) == "as given"
    assert np.isfinite(found.sensitivity).all()
    assert not any("told apart" in note for note in found.notes)
    judged = lb.cross_validate(model, y, SENSORS, T, folds=2)
    assert judged.not_predictable == ()


def test_what_only_unused_samples_tell_is_withheld():
    steady = {"T1": ONE, "T2": np.where(T[400] > T, 3.0, 4.0)}
    found = lb.identify(
        Offset() + Linear("T1", "T2"), np.where(T[300] > T, NOISY, np.nan), steady, T
    )
    assert np.isnan(found.sensitivity).tolist() == [False, True]
    assert any(note.startswith("offset, T2 cannot be told apart") for note in found.notes)
    silent = np.where((T[300] <= T) & (T[400] > T), np.nan, NOISY)
    steps = lb.identify(Offset() + Steps((T[320], T[350])), silent, {}, T)
    assert np.isinf(steps.condition) and np.isinf(steps.vif[1:]).all() and steps.vif[0] == 1
    assert "step at 19200 s, step at 21000 s cannot be told apart" in steps.notes[0]
    assert repr(steps).startswith("no sensitivities\nstep at 19200 s")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lb.identify(MODEL, Y, SENSORS, T[::-1]), "time_s must increase"),
        (lambda: lb.identify(MODEL, Y, SENSORS, np.r_[T[:1], T[:-1]]), "time_s must increase"),
        (lambda: lb.identify(MODEL, Y[1:], SENSORS, T), r"angles must have shape \(800,\)"),
        (lambda: lb.identify(MODEL, Y, {"T1": ONE}, T), "sensors must hold T2, got T1"),
        (
            lambda: lb.identify(MODEL, Y, SENSORS | {"T2": TWO * 0 + 3.0}, T),
            "sensor T2 must vary to give a sensitivity, got 3 throughout",
        ),
        (
            lambda: lb.identify(MODEL, Y, SENSORS | {"T2": TWO[1:]}, T),
            r"sensor T2 must have shape \(800,\)",
        ),
        (
            lambda: lb.identify(MODEL, Y[:5], {k: v[:5] for k, v in SENSORS.items()}, T[:5]),
            "angles must hold more than 5 samples with every sensor",
        ),
        (
            lambda: lb.identify(Linear("T1"), Y * np.nan, SENSORS, T),
            "must hold more than 1 samples",
        ),
        (lambda: lb.identify("T1", Y, SENSORS, T), "model must be a sum of terms"),
        (lambda: lb.identify(Offset() + Offset(), Y, SENSORS, T), "got offset twice"),
        *(
            (
                lambda at=at: lb.identify(Offset() + Steps((6e3, at)), Y, {}, T),
                f"Steps must lie within the record, after 0 s and until 47940 s, got {at:g} s",
            )
            for at in (-500.0, 0.0, 47940.5)
        ),
        (
            lambda: lb.identify(Offset() + Product(Steps((9e9,)), Linear("T1")), Y, SENSORS, T),
            "Steps must lie within the record",
        ),
        (lambda: lb.identify(MODEL, Y, SENSORS, np.where(T > 6e3, np.inf, T)), "time_s must be fi"),
        (
            lambda: lb.identify(MODEL, Y, SENSORS | {"T1": np.where(T > 6e3, np.inf, ONE)}, T),
            "sensor T1 must be finite or NaN",
        ),
        (lambda: lb.identify(MODEL, Y, SENSORS | {"T1": ONE * np.nan}, T), "must hold a reading"),
        (lambda: lb.identify(MODEL, Y, SENSORS, T, solver="best"), "solver must be one of"),
        (lambda: Lagged("T1", tau_s="fast"), 'tau_s must be a number, "fit" or "spectrum"'),
        (lambda: Lagged("T1", tau_s=-3.0), "tau_s must be positive, got -3"),
        (lambda: Linear(), "Linear must name its sensors"),
        (lambda: Linear("T1", "T1"), "Linear must name each sensor once"),
        (lambda: Fourier(0.0), "period_s must be positive"),
        (lambda: Fourier(1.0, harmonics=0), "harmonics must be a whole number of at least 1"),
        (
            lambda: lb.identify(Offset() + Product(Trend(1), Lagged("T1")), Y, SENSORS, T),
            "Product must be of lags that are known",
        ),
    ],
)
def test_bad_input_to_an_identification_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_series_that_was_smoothed_is_thinned_and_keeps_its_interval_about_the_truth():
    rng = np.random.default_rng(11)
    kernel = np.hanning(61) / np.hanning(61).sum()
    noise = 0.5 * np.convolve(rng.standard_normal(860), kernel, mode="valid")
    y = lagged(ONE, T, 1500.0) + noise
    found = lb.identify(Offset() + Lagged("T1", tau_s="spectrum"), arcsec_to_rad(y), SENSORS, T)
    assert any("smoother than noise" in note for note in found.notes)
    assert found.interval[0, 0] < 1.0 < found.interval[0, 1]
    white = lb.identify(
        Offset() + Linear("T2"), arcsec_to_rad(rng.standard_normal(800)), SENSORS, T
    )
    assert not any("smoother" in note for note in white.notes)
