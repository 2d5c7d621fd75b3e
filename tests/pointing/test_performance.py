"""Authority: closed forms of white noise, ramps, sines and random walks; intervals that cover."""

import numpy as np
import pytest
from scipy.signal import lfilter

import losbench as lb

ALL = ("ape", "mpe", "rpe", "smear", "jitter", "pde")


def values(found, names=ALL):
    return np.array([getattr(found, name).value for name in names])


def ramp(n=2000, rate_hz=200.0):
    return np.arange(n) / rate_hz


def test_white_noise_has_the_closed_forms():
    n, window = 2**17, 20
    found = lb.pointing_metrics(
        np.random.default_rng(1).standard_normal(n), np.arange(n) * 0.1, 2.0, 6.0
    )
    truth = np.sqrt([1, 1 / window, 1 - 1 / window, 1 / window, 1 - 2 / window, 2 / window])
    np.testing.assert_allclose(values(found), truth, rtol=0.02)
    assert found.windows == (n - window) // 2 + 1
    assert found.dropped == 0


@pytest.mark.parametrize("offset", [0.0, 1e9])
def test_a_ramp_smears_and_does_not_jitter(offset):
    t = ramp()
    found = lb.pointing_metrics(t + offset, t, 1.0, 3.0)
    exact = np.sqrt((200**2 - 1) / 12) / 200
    assert exact == pytest.approx(0.288671526133, abs=1e-12)
    tolerance = 1e-12 if offset == 0 else 2e-7
    np.testing.assert_allclose(values(found, ("rpe", "smear")), exact, rtol=tolerance)
    assert found.jitter.value < (1e-13 if offset == 0 else 1e-7)
    assert found.pde.value == pytest.approx(3.0, rel=tolerance)


@pytest.mark.parametrize("route", ["windows", "spectrum"])
@pytest.mark.parametrize(
    ("f", "separation", "expected"),
    [
        (0.25, 2.0, [0.636620, 0.307758, 0.301290, 0.062768, 1.273240]),
        (3.3, 5.0, [0.055180, 0.704951, 0.060220, 0.702374, 0.110359]),
    ],
)
def test_a_sine_has_the_closed_forms(route, f, separation, expected):
    t = np.arange(400_000) / 1000.0
    found = lb.pointing_metrics(np.sin(2 * np.pi * f * t), t, 1.0, separation, route=route)
    got = values(found, ("mpe", "rpe", "smear", "jitter", "pde"))
    np.testing.assert_allclose(got, expected, rtol=0.02)
    assert found.ape.value == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_the_weights_of_the_spectrum_are_exact_for_a_sine_at_any_phase():
    """Every start and phase of a sine, in windows of few samples, against the weights at its line."""
    from losbench.pointing.performance.spectrum import weights

    n, separation, dt = 8, 21, 0.1
    phase = 2 * np.pi * np.arange(360) / 360
    for f in (0.0, 1e-5, 0.03, 0.4, 1.3, 4.9, 5.0):
        t = dt * np.arange(n + separation)
        y = np.sqrt(2) * np.cos(2 * np.pi * f * t + phase[:, None])
        first, later = y[:, :n], y[:, separation:]
        about = first - first.mean(axis=1, keepdims=True)
        line = np.arange(n) - (n - 1) / 2
        along = (about @ line)[:, None] * line / (line @ line)
        expected = {
            "mpe": np.mean(first.mean(axis=1) ** 2),
            "rpe": np.mean(about**2),
            "smear": np.mean(along**2),
            "jitter": np.mean((about - along) ** 2),
            "pde": np.mean((later.mean(axis=1) - first.mean(axis=1)) ** 2),
        }
        got = weights(np.array([f]), dt, n, separation)
        for name, value in expected.items():
            assert got[name][0] == pytest.approx(value, rel=1e-6, abs=1e-11), (name, f)


def test_a_random_walk_has_the_closed_forms():
    rng = np.random.default_rng(2)
    n, window, lag = 200_000, 200, 1000
    found = [
        lb.pointing_metrics(
            rng.standard_normal(n).cumsum(), np.arange(float(n)), float(window), float(lag)
        )
        for _ in range(4)
    ]
    mean = np.sqrt(
        np.mean([values(f, ("rpe", "smear", "jitter", "pde")) ** 2 for f in found], axis=0)
    )
    np.testing.assert_allclose(mean, [5.7734, 4.4721, 3.6515, 30.5505], rtol=0.05)


def test_time_and_spectral_routes_agree_within_a_percent():
    n = 2**20
    t = np.arange(n) * 0.05
    y = lfilter([1], [1, -0.99], np.random.default_rng(3).standard_normal(n)) + 3 * np.sin(
        2 * np.pi * 0.37 * t
    )
    one, other = (
        values(lb.pointing_metrics(y, t, 10.0, 50.0, route=route))
        for route in ("windows", "spectrum")
    )
    np.testing.assert_allclose(one, other, rtol=0.01)


def test_a_bias_counts_in_the_absolute_errors_alone_and_by_both_routes():
    n = 20_000
    y = np.random.default_rng(4).standard_normal((n, 1)) + 5.0
    for route in ("windows", "spectrum"):
        found = lb.pointing_metrics(y, np.arange(n) * 0.1, 5.0, 25.0, route=route)
        assert found.ape.value[0] == pytest.approx(np.sqrt(26.0), rel=0.01)
        assert found.mpe.value[0] == pytest.approx(np.sqrt(25.02), rel=0.01)
        assert found.rpe.value[0] == pytest.approx(np.sqrt(0.98), rel=0.02)


def test_gaps_and_missing_samples_cost_windows_but_no_accuracy():
    rng = np.random.default_rng(5)
    n = 40_000
    t = np.arange(n) * 0.1
    y = lfilter([1], [1, -0.9], rng.standard_normal(n))
    whole = lb.pointing_metrics(y, t, 5.0, 20.0)
    spoiled = y.copy()
    spoiled[rng.choice(n, 40, replace=False)] = np.nan
    t2 = t + 1000.0 * (t > 1500.0)
    found = lb.pointing_metrics(spoiled, t2, 5.0, 20.0)
    assert found.dropped > 100
    np.testing.assert_allclose(values(found), values(whole), rtol=0.05)
    assert np.isfinite(found.pre.value)
    assert np.isnan(whole.pre.value)


def test_reproducibility_compares_the_means_of_observations():
    label = np.repeat(np.arange(4), 500)
    t = np.arange(2000) * 0.1
    steps = np.array([0.0, 1.0, -2.0, 4.0])
    found = lb.pointing_metrics(steps[label], t, 1.0, observations=label)
    pairs = [(a - b) ** 2 for a in steps for b in steps if a != b]
    # Windows that straddle two observations belong to the one in which they start.
    assert found.pre.value == pytest.approx(np.sqrt(np.mean(pairs)), rel=0.02)
    assert found.pre.dof == 3


def mean_of_memory(a, n):
    k = np.arange(1, n)
    return (n + 2 * np.sum((n - k) * a**k)) / n**2


@pytest.mark.slow
def test_intervals_cover_white_noise_memory_and_heavy_tails():
    """95 % intervals on 60 records each; floor 85 %. The full run is in benchmarks."""
    rng, n, dt, window = np.random.default_rng(20261), 16_384, 0.1, 50
    a = np.exp(-dt / 2.0)
    of_mean = mean_of_memory(a, window)
    cases = {
        "white": (lambda: rng.standard_normal(n), np.sqrt([1 / window, 1 - 1 / window])),
        "memory": (
            lambda: lfilter([np.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n + 500))[-n:],
            np.sqrt([of_mean, 1 - of_mean]),
        ),
        "tails": (
            lambda: rng.standard_t(5, n) / np.sqrt(5 / 3),
            np.sqrt([1 / window, 1 - 1 / window]),
        ),
    }
    for name, (draw, truth) in cases.items():
        found = [lb.pointing_metrics(draw(), np.arange(n) * dt, 5.0) for _ in range(60)]
        for i, metric in enumerate(("mpe", "rpe")):
            interval = np.array([getattr(f, metric).interval for f in found])
            covered = np.mean((interval[:, 0] <= truth[i]) & (truth[i] <= interval[:, 1]))
            assert covered >= 0.85, (name, metric, covered)


def test_a_line_makes_an_interval_conservative_and_a_note_says_so():
    t = np.arange(16_384) * 0.1
    y = np.random.default_rng(6).standard_normal(t.size)
    assert lb.pointing_metrics(y, t, 5.0).notes == ()
    noted = lb.pointing_metrics(y + 5 * np.sin(2.3 * t), t, 5.0)
    assert "rpe" in noted.notes[0] and "conservative" in noted.notes[0]


def test_a_verdict_is_met_not_met_or_not_shown():
    t = np.arange(16_384) * 0.1
    y = lb.units.arcsec_to_rad(np.random.default_rng(7).standard_normal((t.size, 2)) * [1.0, 3.0])
    found = lb.pointing_metrics(y, t, 5.0)
    low, high = found.rpe.interval[0] * 206264.806
    for limit, verdict in ((0.99 * low, "not met"), (high * 1.01, "met"), (0.99, "not shown")):
        need = lb.PointingRequirement("R", "RPE", (2 * limit, 100.0), factor=2.0)
        assert found.verdict(need) == (verdict, "met"), limit


def test_percentiles_of_a_gaussian_error_hold_and_thin_ones_are_withheld():
    rng = np.random.default_rng(8)
    inside, truth = 0, 1.959963984540054
    for _ in range(100):
        _, (low, high) = lb.error_percentile(np.abs(rng.standard_normal(2000)), 0.95)
        inside += low <= truth <= high
    assert 90 <= inside <= 100
    assert np.isfinite(lb.error_percentile(np.abs(rng.standard_normal(230)), 0.95)[0])
    assert np.isnan(lb.error_percentile(np.abs(rng.standard_normal(150)), 0.95)[0])


def test_the_half_cone_is_that_of_rayleigh_and_of_one_axis():
    assert lb.half_cone((1.0, 1.0)) == pytest.approx(np.sqrt(-2 * np.log(0.05)), abs=1e-9)
    assert lb.half_cone((2.0, 1.0)) == pytest.approx(2 * 2.03586, abs=2e-5)
    assert lb.half_cone((0.0, 1.0)) == pytest.approx(1.959963984540054, abs=1e-9)


def test_the_noise_floor_is_the_noise_and_the_bottom_of_the_allan_curve():
    rng = np.random.default_rng(9)
    y = rng.standard_normal(2**15) + 0.01 * rng.standard_normal(2**15).cumsum()
    floor = lb.noise_floor(y, rate_hz=2.0)
    assert floor["sample"] == pytest.approx(1.0, rel=0.02)
    assert 20 < floor["tau_s"] < 300
    assert floor["allan_minimum"] < 0.15


def test_bias_and_sine_of_a_budget_agree_with_a_simulation():
    """Every kind of source, drawn and measured by windows, against its factor."""
    rng = np.random.default_rng(10)
    cases, n, window = 300, 4000, 100
    t = np.arange(n) * 0.01
    shape = (cases, 1)
    draw = {
        "noise": lambda p: p * rng.standard_normal((cases, n)),
        "uniform noise": lambda p: p * (rng.random((cases, n)) - 0.5),
        "fast sine": lambda p: p * np.sin(2 * np.pi * (20.0 * t + rng.random(shape))),
        "slow sine": lambda p: p * np.sin(2 * np.pi * (0.025 * t + rng.random(shape))),
        "bias": lambda p: p * np.ones((cases, n)),
    }
    for kind, make in draw.items():
        parameter = 3.0 + rng.uniform(-1, 1, shape)
        y = make(parameter)
        source = lb.PointingSource(kind, kind, np.array([3.0]), np.array([3**-0.5]))
        windows = y.reshape(cases, -1, window)
        mean = windows.mean(axis=2, keepdims=True)
        got = {
            "APE": np.sqrt(np.mean(y**2)),
            "MPE": np.sqrt(np.mean(mean**2)),
            "RPE": np.sqrt(np.mean((windows - mean) ** 2)),
        }
        for index, value in got.items():
            m, s = source.contribution(index)
            assert np.hypot(m, s)[0] == pytest.approx(value, rel=0.08, abs=0.35), (kind, index)


BUDGET = """
[[requirement]]
id = "R1"
index = "APE"
limit = [12.0, 9.0]
factor = 2
[[source]]
name = "launch shift"
kind = "bias"
uniform = [[-3.0, 3.0], [0.0, 6.0]]
[[source]]
name = "sensor"
[[source.source]]
name = "pixel noise"
kind = "noise"
exactly = 2.0
[[source.source]]
name = "orbit"
kind = "slow sine"
gaussian = [[0.0, 1.0], [3.0, 4.0]]
"""


def test_a_budget_is_read_and_summed(tmp_path):
    path = tmp_path / "budget.toml"
    path.write_text(BUDGET)
    budget = lb.PointingBudget.from_toml(path)
    expected = [2 * np.sqrt(3 + 4 + 0.5), 3 + 2 * np.sqrt(3 + 4 + 12.5)]
    np.testing.assert_allclose(budget.total(budget.requirements[0]), expected)
    assert budget.table()["verdict"].tolist() == ["met", "not met"]
    assert len(budget.contributions()) == 2 * 5 * 2


# ECSS-E-ST-60-10C, Annex C: one-sigma totals about x, y, z in arcsec and what they are at two sigma.
# The RPE may be 30, 10, 10, which y and z miss. The annex's table of contributors is not at hand: of
# its example these tests check the step from totals to verdicts, to 0.01, and not the sums.
ANNEX_C = {
    "APE": ((13.509, 8.372, 8.607), (27.018, 16.744, 17.215)),
    "RPE": ((10.700, 6.892, 6.285), (21.401, 13.784, 12.570)),
}


@pytest.mark.parametrize("index", sorted(ANNEX_C))
def test_totals_of_annex_c_at_two_sigma(index):
    totals, doubled = ANNEX_C[index]
    need = lb.PointingRequirement(index, index, (30.0, 10.0, 10.0), factor=2.0)
    parts = np.multiply.outer([0.6, 0.8], totals)  # two sources that add up to them in squares
    sources = tuple(
        lb.PointingSource(f"part {k}", "noise", part, np.zeros(3)) for k, part in enumerate(parts)
    )
    table = lb.PointingBudget((need,), sources).table()
    np.testing.assert_allclose(table["total_arcsec"], doubled, rtol=0, atol=0.01)
    if index == "RPE":
        assert table["verdict"].tolist() == ["met", "not met", "not met"]


def test_annex_c_from_its_contributors(real_data):
    """For whoever has the standard and types its table of contributors as a budget."""
    path = real_data("ecss-e-st-60-10c") / "annex-c.toml"
    budget = lb.PointingBudget.from_toml(path)
    assert {need.index for need in budget.requirements} == set(ANNEX_C)
    for need in budget.requirements:
        np.testing.assert_allclose(budget.total(need), ANNEX_C[need.index][1], rtol=0, atol=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[[source]]", "[[sauce]]"), "unknown table sauce"),
        (('kind = "bias"', 'kind = "drift"'), r"source 1 \(launch shift\): kind must be one of"),
        (("exactly = 2.0", ""), "exactly one of exactly, gaussian, uniform and source is needed"),
        (("[-3.0, 3.0]", "[3.0, -3.0]"), "uniform must run from the smaller to the larger"),
        (("[0.0, 1.0]", "[0.0, -1.0]"), "gaussian must hold a mean and a sigma of at least 0"),
        (("limit = [12.0, 9.0]", "limit = [12.0, 9.0, 1.0]"), "must have as many axes"),
        (("limit = [12.0, 9.0]", "limit = -1"), "limit must be positive"),
        (('index = "APE"', 'index = "ABE"'), "requirement 1: index must be one of"),
        (("factor = 2", "factr = 2"), "unknown key factr"),
        (("exactly = 2.0", "exactly = 'two'"), "exactly must be an array of numbers"),
    ],
)
def test_a_wrong_budget_is_named(tmp_path, change, message):
    path = tmp_path / "budget.toml"
    path.write_text(BUDGET.replace(*change))
    with pytest.raises(ValueError, match=message):
        lb.PointingBudget.from_toml(path)


@pytest.mark.parametrize("route", ["windows", "spectrum"])
def test_windows_of_two_samples_have_no_jitter(route):
    rng = np.random.default_rng(32)
    t, y = 0.1 * np.arange(2000), rng.standard_normal(2000)
    found = lb.pointing_metrics(y, t, 0.2, route=route)
    assert np.isnan(found.jitter.value) and np.isnan(found.jitter.interval).all()
    assert found.notes[0] == "Windows of two samples have no jitter: both lie on their line."
    assert found.rpe.value == pytest.approx(np.sqrt(0.5), rel=0.1)
    three = lb.pointing_metrics(y, t, 0.3, route=route)
    assert three.jitter.value == pytest.approx(np.sqrt(1 / 3), rel=0.1)
    assert not any("jitter: both" in note for note in three.notes)


def test_uneven_times_are_said():
    rng = np.random.default_rng(31)
    t = 0.1 * np.arange(2000)
    assert lb.pointing_metrics(rng.standard_normal(2000), t, 1.0).notes == ()
    t = np.delete(t + 0.004 * rng.uniform(-1, 1, 2000), slice(500, 600))
    assert lb.pointing_metrics(rng.standard_normal(1900), t, 1.0).notes == ()
    t = np.cumsum(rng.uniform(0.08, 0.12, 2000))
    (note,) = lb.pointing_metrics(rng.standard_normal(2000), t, 1.0).notes
    assert note.startswith("Times are not evenly spaced: steps of 0.08 to 0.12 s count as")


T = ramp()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: lb.pointing_metrics(T, T[::-1], 1.0), "time_s must increase"),
        (lambda: lb.pointing_metrics(T, T[:-1], 1.0), r"angles must have shape \(1999,\)"),
        (lambda: lb.pointing_metrics(T, T, 100.0), "window_s must span 2 samples or more and fit"),
        (lambda: lb.pointing_metrics(T, T, 0.005), "window_s must span 2 samples or more"),
        (lambda: lb.pointing_metrics(T, T, 1.0, 0.0), "separation_s must span 1 samples or more"),
        (
            lambda: lb.pointing_metrics(np.where(np.arange(2000) % 50, T, np.nan), T, 1.0),
            "window_s must fit into a stretch without gaps, the longest of which is 0.245 s",
        ),
        (lambda: lb.pointing_metrics(T * np.nan, T, 1.0), "the longest of which is 0 s"),
        (lambda: lb.pointing_metrics(T, np.r_[T[:1], T[:-1]], 1.0), "time_s must increase"),
        (lambda: lb.pointing_metrics(T[:1], T[:1], 1.0), "time_s must hold two samples or more"),
        (lambda: lb.pointing_metrics(T[:0], T[:0], 1.0), "must hold at least one sample"),
        (lambda: lb.pointing_metrics(T, T, 1.0, 100.0), "separation_s must span 1 samples or more"),
        (
            lambda: lb.pointing_metrics(np.c_[T, T], T, 1.0).verdict(
                lb.PointingRequirement("R1", "APE", (1.0, 2.0, 3.0))
            ),
            "limit of R1 must be one number or 2, one per axis, got 3",
        ),
        (lambda: lb.half_cone((0.0, 0.0)), "sigma must be two numbers"),
        (lambda: lb.mtf(smear=-1.0), "smear must be a finite number of at least 0"),
        (lambda: lb.noise_floor(T[:4], rate_hz=1.0), "series must hold at least 8 samples"),
        (lambda: lb.error_percentile(T, 95), "probability must be a finite number from 0 to 1"),
    ],
)
def test_bad_input_to_the_metrics_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
