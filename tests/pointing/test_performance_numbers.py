"""Numbers that the pointing metrics promise, from either side: loops, closed forms and other libraries."""

import numpy as np
import pytest
from scipy import signal, stats
from statsmodels.stats.proportion import proportion_confint

import losbench as lb
from losbench.pointing.performance.intervals import chi2_interval, freedom, mean_variance
from losbench.pointing.performance.spectrum import spectrum
from losbench.pointing.performance.windows import window_statistics


@pytest.mark.parametrize("samples", [2, 7, 8, 15, 16, 17])
@pytest.mark.parametrize("separation", [None, 1, 5, 40])
def test_windows_start_every_eighth_of_their_length_and_show_what_a_loop_finds(samples, separation):
    series = np.random.default_rng(samples).standard_normal((120, 2)).cumsum(axis=0)
    pieces = [slice(3, 63), slice(64, 64 + samples), slice(85, 84 + samples), slice(100, 120)]
    found = window_statistics(series, pieces, samples, separation)
    line = np.arange(samples) - (samples - 1) / 2
    rows, drifts = [], []
    for piece in pieces:
        for start in range(piece.start, piece.stop - samples + 1, max(samples // 8, 1)):
            window = series[start : start + samples]
            mean = window.mean(axis=0)
            along = np.outer(line, line @ window) / (line @ line)
            squares = (about**2 for about in (window - mean, along, window - mean - along))
            rows.append((mean, *(square.mean(axis=0) for square in squares)))
            if separation is not None and start + separation + samples <= piece.stop:
                later = series[start + separation : start + separation + samples]
                drifts.append((later.mean(axis=0) - mean) ** 2)
    expected = np.array(rows)
    for k, name in enumerate(("mean", "rpe", "smear", "jitter")):
        np.testing.assert_allclose(getattr(found, name), expected[:, k], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.pde, np.reshape(drifts, (-1, 2)), rtol=1e-9, atol=1e-12)
    assert found.start[0] == 3 and len(found.start) == len(rows)


def test_windows_of_long_records_are_those_of_short_ones():
    """More windows than are worked on at once."""
    series = np.random.default_rng(1).standard_normal((9000, 2)).cumsum(axis=0)
    whole = window_statistics(series, [slice(0, 9000)], 16, 100)
    for first in (0, 4000, 8000):
        part = window_statistics(series, [slice(first, first + 1000)], 16, 100)
        at = slice(first // 2, first // 2 + len(part.start))
        np.testing.assert_array_equal(whole.start[at], part.start)
        np.testing.assert_allclose(whole.jitter[at], part.jitter, rtol=1e-9, atol=1e-12)
        drifts = slice(first // 2, first // 2 + len(part.pde))
        np.testing.assert_allclose(whole.pde[drifts], part.pde, rtol=1e-9, atol=1e-12)
    assert len(whole.start) == (9000 - 16) // 2 + 1
    assert len(whole.pde) == (9000 - 16 - 100) // 2 + 1


@pytest.mark.parametrize(
    ("length", "samples", "size"),
    [(1600, 20, 200), (1600, 30, 240), (200, 30, 200), (2**20, 20, 65_536)],
)
def test_the_spectrum_is_welch_s_of_an_eighth_of_the_record_or_of_eight_windows(
    length, samples, size
):
    noise = np.random.default_rng(2).standard_normal((length, 1))
    frequency, density, segments = spectrum(noise, [slice(0, length)], 0.5, samples)
    expected = signal.welch(noise, fs=2.0, nperseg=size, detrend=False, axis=0)
    np.testing.assert_allclose(frequency, expected[0])
    np.testing.assert_allclose(density, expected[1], rtol=1e-9)
    assert segments == (length - size) // (size - size // 2) + 1


def test_pieces_count_in_the_spectrum_by_their_segments_and_short_ones_do_not():
    noise = np.random.default_rng(3).standard_normal((1700, 1))
    pieces = [slice(0, 1000), slice(1010, 1510), slice(1520, 1680)]
    for last, segments in ((1680, (11, 5, 1)), (1679, (11, 5))):
        pieces[2] = slice(1520, last)
        _, density, count = spectrum(noise, pieces, 0.5, 20)
        parts = [
            signal.welch(noise[piece], fs=2.0, nperseg=160, detrend=False, axis=0)[1]
            for piece in pieces[: len(segments)]
        ]
        expected = np.average(parts, axis=0, weights=segments)
        np.testing.assert_allclose(density, expected, rtol=1e-9)
        assert count == sum(segments)


def test_a_window_of_two_samples_is_a_line():
    """It smears by half their difference, and cannot tell of jitter: by both routes."""
    y = np.random.default_rng(4).standard_normal(20_000)
    for route, rtol in (("windows", 1e-12), ("spectrum", 0.02)):
        found = lb.pointing_metrics(y, np.arange(20_000.0), 2.0, route=route)
        expected = np.sqrt(np.mean(np.diff(y) ** 2)) / 2
        assert found.smear.value == pytest.approx(expected, rel=rtol)
        assert found.rpe.value == pytest.approx(expected, rel=rtol)
        assert np.isnan(found.jitter.value)
        need = lb.PointingRequirement("R1", "jitter", 1.0)
        assert found.verdict(need) == ("not shown",)


# How well a mean square is known


def sokal(series):
    """Sokal (1989), equations 3.16 to 3.19 by loops: lags up to the first of six autocorrelation times."""
    n, about = len(series), series - series.mean()
    covariance = [about[: n - lag] @ about[lag:] / n for lag in range(n)]
    time = 0.5
    for lag in range(1, n):
        time += covariance[lag] / covariance[0]
        if lag >= 6 * time:
            break
    return covariance[0] * max(2 * time, 1.0) / n


@pytest.mark.parametrize("memory", [-0.5, 0.0, 0.7, 0.95])
@pytest.mark.parametrize("n", [40, 64, 301])
def test_the_variance_of_a_mean_is_sokal_s(memory, n):
    series = signal.lfilter([1.0], [1.0, -memory], np.random.default_rng(n).standard_normal(n))
    assert mean_variance(series) == pytest.approx(sokal(series), rel=1e-9)


@pytest.mark.parametrize("n", [2**15, 2**17 + 1])
def test_the_variance_of_a_mean_is_that_of_a_memory_in_closed_form(n):
    """(1 + a) / (1 - a) / n for an AR(1) of variance one."""
    a, rng = 0.8, np.random.default_rng(5)
    noise = np.sqrt(1 - a * a) * rng.standard_normal((20, n))
    found = np.mean([mean_variance(signal.lfilter([1.0], [1.0, -a], each)) for each in noise])
    assert found == pytest.approx((1 + a) / (1 - a) / n, rel=0.04)


def test_a_constant_has_a_mean_without_error():
    assert mean_variance(np.full(50, 3.0)) == 0.0
    by_spectrum, by_windows = freedom(np.full(50, 3.0), np.zeros(10), 0.1, 50.0, 5)
    assert by_spectrum == by_windows == np.inf


def test_squares_of_white_noise_have_a_degree_of_freedom_each():
    rng, n = np.random.default_rng(6), 4096
    found = [freedom(rng.standard_normal(n) ** 2, np.ones(9), 0.1, 1.0, 4)[1] for _ in range(100)]
    assert np.mean(1 / np.array(found)) == pytest.approx(1 / n, rel=0.05)


@pytest.mark.parametrize("nu", [0.7, 3.0, 40.0, 1e4])
@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_the_interval_of_a_root_mean_square_is_that_of_a_chi_square(nu, confidence):
    tail = (1 - confidence) / 2
    expected = np.sqrt(9.0 * nu / stats.chi2.ppf([1 - tail, tail], nu))
    np.testing.assert_allclose(chi2_interval(9.0, nu, confidence), expected, rtol=1e-9)


def test_the_interval_ends_where_nothing_or_everything_is_known():
    np.testing.assert_array_equal(chi2_interval(9.0, np.inf, 0.95), [3.0, 3.0])
    assert chi2_interval(9.0, 1e-3, 0.95)[1] == np.inf


def test_two_and_a_half_degrees_of_freedom_are_needed_for_an_interval():
    """Two of them correct for the bias of the inverse: what is told has the rest."""
    rng, told, untold = np.random.default_rng(7), [], []
    for n in (24, 32, 48, 64, 96):
        for _ in range(30):
            found = lb.pointing_metrics(
                rng.standard_normal(n).cumsum(), np.arange(float(n)), n / 2.0
            )
            known = np.isfinite(found.mpe.interval).all()
            (told if known else untold).append(float(found.mpe.dof))
    assert 2.2 < max(untold) <= 2.5
    assert 0.5 <= min(told) < 1.0


def test_a_bias_is_known_as_the_mean_of_white_noise_is():
    """Var(1 + b^2) = 2 / n + 4 b^2 / n."""
    rng, n, b = np.random.default_rng(8), 2048, 3.0
    dof = [
        lb.pointing_metrics(rng.standard_normal(n) + b, 0.25 * np.arange(n), 5.0).ape.dof
        for _ in range(150)
    ]
    expected = (1 + 2 * b**2) / n / (1 + b**2) ** 2
    assert np.mean(1 / np.array(dof)) == pytest.approx(expected, rel=0.08)


def test_a_constant_error_is_its_bias_without_doubt():
    for bias in (-3.0, 0.1, 0.0):
        found = lb.pointing_metrics(np.full(100, bias), np.arange(100.0), 10.0, 20.0)
        for name in ("ape", "mpe", "rpe", "pde", "smear", "jitter"):
            metric, value = getattr(found, name), abs(bias) if name in ("ape", "mpe") else 0.0
            assert metric.value == pytest.approx(value, abs=1e-15) and metric.dof == np.inf
            np.testing.assert_allclose(metric.interval, [value, value], atol=1e-15)


def test_a_line_is_noted_where_it_costs_three_quarters_of_the_freedom():
    t = 0.1 * np.arange(8192.0)
    noise = np.random.default_rng(9).standard_normal(t.size)
    seen = []
    for amplitude in np.arange(0.0, 1.2, 0.05):
        y = noise + amplitude * np.sin(2.3 * t)
        found = lb.pointing_metrics(y, t, 5.0)
        frequency, density = found.psd()
        segments = spectrum(y[:, None], [slice(0, t.size)], 0.1, 50)[2]
        squares, length_s = (y - y.mean()) ** 2, 0.1 * t.size
        ratio = np.divide(*freedom(squares, density, frequency[1], length_s, segments))
        assert ("ape" in "".join(found.notes)) == (ratio < 0.25), (amplitude, ratio)
        seen.append(ratio)
    assert any(0.16 < each < 0.25 for each in seen) and any(0.25 < each < 0.39 for each in seen)


# Windows of a record


@pytest.mark.parametrize(("samples", "stride"), [(2, 1), (15, 1), (16, 2), (24, 3)])
def test_windows_that_a_missing_sample_spoils_are_counted(samples, stride):
    y = np.random.default_rng(10).standard_normal(300)
    whole = lb.pointing_metrics(y, np.arange(300.0), float(samples))
    assert (whole.windows, whole.dropped) == ((300 - samples) // stride + 1, 0)
    y[150] = np.nan
    found = lb.pointing_metrics(y, np.arange(300.0), float(samples))
    parts = (150 - samples) // stride + 1 + (149 - samples) // stride + 1
    assert (found.windows, found.dropped) == (parts, whole.windows - parts)


def test_a_window_may_be_the_whole_record_and_is_rounded_to_samples():
    y = np.random.default_rng(11).standard_normal(100)
    whole = lb.pointing_metrics(y, 0.1 * np.arange(100), 10.04)
    assert whole.windows == 1 and whole.window_s == pytest.approx(10.0)
    assert whole.rpe.value == pytest.approx(y.std(), rel=1e-9)
    with pytest.raises(ValueError, match="window_s must span 2 samples or more and fit"):
        lb.pointing_metrics(y, 0.1 * np.arange(100), 10.06)
    assert lb.pointing_metrics(y, 0.1 * np.arange(100), 0.16).window_s == pytest.approx(0.2)
    found = lb.pointing_metrics(y, 0.1 * np.arange(100), 1.0, 0.06)
    assert found.separation_s == pytest.approx(0.1) and np.isfinite(found.pde.value)


@pytest.mark.parametrize(("gap_s", "two"), [(4.9, False), (5.1, True)])
def test_gaps_longer_than_a_window_part_observations(gap_s, two):
    t = np.arange(100.0)
    t[50:] += gap_s - 1.0
    found = lb.pointing_metrics((t > 50).astype(float), t, 5.0)
    assert np.isfinite(found.pre.value) == two
    if two:
        assert found.pre.value == pytest.approx(1.0) and found.pre.dof == 1
        expected = chi2_interval(1.0, 1.0, 0.95)
        np.testing.assert_allclose(found.pre.interval, expected)


def test_two_observations_differ_by_their_scatter_too():
    """Mean square difference of every pair of windows, one of each."""
    rng, label = np.random.default_rng(12), np.repeat(np.arange(3), 40)
    y = rng.standard_normal((120, 2))
    found = lb.pointing_metrics(y, np.arange(120.0), 2.0, observations=label)
    mean = (y[1:] + y[:-1]) / 2
    groups = [mean[label[:-1] == each] for each in range(3)]
    pairs = [
        np.mean((a[:, None] - b[None]) ** 2, axis=(0, 1))
        for i, a in enumerate(groups)
        for b in groups[:i]
    ]
    np.testing.assert_allclose(found.pre.value, np.sqrt(np.mean(pairs, axis=0)), rtol=1e-9)


def test_a_limit_at_the_end_of_an_interval_is_kept_and_one_at_its_beginning_not_shown():
    y = lb.units.arcsec_to_rad(np.random.default_rng(13).standard_normal(4000))
    found = lb.pointing_metrics(y, np.arange(4000.0), 5.0)
    low, high = found.table().set_index("metric").loc["RPE", ["from_arcsec", "to_arcsec"]]
    for limit, verdict in (
        (high, "met"),
        (high * (1 - 1e-9), "not shown"),
        (low, "not shown"),
        (low * (1 - 1e-9), "not met"),
    ):
        need = lb.PointingRequirement("R", "RPE", limit, factor=1.0)
        assert found.verdict(need) == (verdict,)


def test_tables_of_metrics_hold_a_row_for_each_axis_counted_from_one():
    y = lb.units.arcsec_to_rad(np.random.default_rng(14).standard_normal((2000, 2)) * [1.0, 3.0])
    found = lb.pointing_metrics(y, np.arange(2000.0), 5.0)
    table = found.table()
    assert table["metric"].unique().tolist() == [
        "APE",
        "MPE",
        "RPE",
        "PDE",
        "PRE",
        "smear",
        "jitter",
    ]
    assert table["axis"].tolist() == [1, 2] * 7
    share = found.percentiles([0.5, 0.9])
    assert share["of"].tolist() == ["axis 1"] * 2 + ["axis 2"] * 2 + ["half-cone"] * 2
    radius = np.hypot(*lb.units.rad_to_arcsec(y).T)
    np.testing.assert_allclose(share["value_arcsec"][4:], np.quantile(radius, [0.5, 0.9]))
    one = lb.pointing_metrics(y[:, 0], np.arange(2000.0), 5.0)
    assert one.percentiles([0.5])["of"].tolist() == ["axis 1"]
    assert found.jitter_lucke is found.rpe


# Percentiles, floors, budgets


@pytest.mark.parametrize("p", [0.1, 0.5, 0.95])
@pytest.mark.parametrize("confidence", [0.6827, 0.95])
def test_the_interval_of_a_percentile_is_wilson_s(p, confidence):
    x = np.abs(np.random.default_rng(15).standard_normal(3000))
    value, interval = lb.error_percentile(x, p, confidence=confidence)
    n = p * (1 - p) / mean_variance((x <= value).astype(float))
    share = proportion_confint(p * n, n, 1 - confidence, method="wilson")
    np.testing.assert_allclose(interval, np.quantile(x, share), rtol=1e-9)
    assert value == np.quantile(x, p)


def test_the_noise_floor_is_sought_up_to_a_quarter_of_the_record():
    rng = np.random.default_rng(16)
    for n, longest in ((8, 2), (15, 2), (16, 4), (64, 16)):
        floors = [lb.noise_floor(rng.standard_normal(n), rate_hz=2.0) for _ in range(60)]
        assert max(floor["tau_s"] for floor in floors) == longest / 2.0
        assert min(floor["tau_s"] for floor in floors) < longest / 2.0
    with pytest.raises(ValueError, match="at least 8 samples for a noise floor, got 7"):
        lb.noise_floor(rng.standard_normal(7), rate_hz=2.0)


def test_a_noise_floor_is_sought_among_the_averages_that_gaps_leave():
    series = np.random.default_rng(24).standard_normal(64)
    series[5::6] = np.nan  # five samples in a row: two averages of two of them, none of four
    floor = lb.noise_floor(series, rate_hz=1.0)
    deviation = lb.allan_deviation(series, rate_hz=1.0, tau_s=[1.0, 2.0, 4.0])
    assert np.isnan(deviation).tolist() == [False, False, True]
    assert floor["sample"] == deviation[0]
    assert (floor["allan_minimum"], floor["tau_s"]) == min(
        zip(deviation[:2], (1.0, 2.0), strict=True)
    )
    series[::2] = np.nan
    with pytest.raises(ValueError, match="series must hold two neighbouring samples"):
        lb.noise_floor(series, rate_hz=1.0)


def test_the_factors_of_a_budget_are_root_mean_squares():
    """A slow sine at two instants half a period apart, where it differs most."""
    phase = 2 * np.pi * (np.arange(360) + 0.5) / 360
    sine, flat = np.sin(phase), (np.arange(1000) + 0.5) / 1000 - 0.5
    apart = np.sqrt(np.mean((np.sin(phase + np.pi) - sine) ** 2))
    rms = np.sqrt(np.mean(sine**2))
    cases = {
        "noise": {"APE": 1.0, "RPE": 1.0},
        "uniform noise": {"APE": flat.std(), "RPE": flat.std()},
        "fast sine": {"APE": rms, "RPE": rms},
        "slow sine": {"APE": rms, "MPE": rms, "PDE": apart, "PRE": apart},
        "bias": {"APE": 1.0, "MPE": 1.0, "PRE": np.sqrt(2.0)},
    }
    for kind, expected in cases.items():
        source = lb.PointingSource(kind, kind, np.array([0.0]), np.array([1.0]))
        for index in ("APE", "MPE", "RPE", "PDE", "PRE"):
            mean, sigma = source.contribution(index)
            assert mean == 0.0
            assert sigma[0] == pytest.approx(expected.get(index, 0.0), rel=1e-5), (kind, index)
    shift = lb.PointingSource("shift", "bias", np.array([-2.0]), np.array([0.0]))
    added = [shift.contribution(index)[0][0] for index in ("APE", "MPE", "RPE", "PDE", "PRE")]
    assert added == [-2.0, -2.0, 0.0, 0.0, 0.0]


def test_a_budget_at_its_limit_is_met_and_its_shares_are_told_by_axis():
    source = lb.PointingSource("s", "noise", np.array([3.0, 1.0]), np.array([4.0, 0.0]))
    need = lb.PointingRequirement("R", "APE", 10.0, factor=2.0)
    budget = lb.PointingBudget((need,), (source,))
    table = budget.table()
    assert table["total_arcsec"].tolist() == [10.0, 2.0]
    assert table["margin_arcsec"].tolist() == [0.0, 8.0]
    assert table["verdict"].tolist() == ["met", "met"] and table["axis"].tolist() == [1, 2]
    shares = budget.contributions()
    assert shares["sigma_arcsec"].tolist() == [5.0, 1.0, 0, 0, 5.0, 1.0, 0, 0, 0, 0]
    assert shares["axis"].tolist() == [1, 2] * 5
    tight = lb.PointingRequirement("R", "APE", 10.0 - 1e-9, factor=2.0)
    assert lb.PointingBudget((tight,), (source,)).table()["verdict"].tolist() == ["not met", "met"]


@pytest.mark.parametrize("probability", [0.6827, 0.95, 0.9973])
def test_the_factor_of_a_probability_is_its_two_sided_quantile(probability):
    factor = lb.PointingRequirement("R", "APE", 1.0, probability=probability).factor
    assert stats.norm.cdf(factor) - stats.norm.cdf(-factor) == pytest.approx(probability)
    with pytest.raises(ValueError, match="probability"):
        lb.PointingRequirement("R", "APE", 1.0, probability=1.0)


def test_one_limit_serves_every_axis_and_other_numbers_of_them_are_refused():
    noise = lb.units.arcsec_to_rad(np.random.default_rng(20).standard_normal((4000, 3)))
    found = lb.pointing_metrics(noise, 0.1 * np.arange(4000.0), 5.0)
    assert found.verdict(lb.PointingRequirement("R", "RPE", 9.0)) == ("met",) * 3
    with pytest.raises(ValueError, match="limit of R must be one number or 3, one per axis, got 2"):
        found.verdict(lb.PointingRequirement("R", "RPE", (9.0, 9.0)))


@pytest.mark.parametrize("sigma", [(np.nan, 1.0), (np.inf, 1.0), (-1.0, 1.0), (0.0, 0.0), (1.0,)])
def test_a_half_cone_is_of_two_numbers(sigma):
    with pytest.raises(ValueError, match="sigma must be two numbers, not negative, one positive"):
        lb.half_cone(sigma)


def test_a_requirement_is_of_95_percent_unless_it_says_so():
    plain, said = (
        lb.PointingRequirement("R", "APE", 1.0, **p) for p in ({}, {"probability": 0.95})
    )
    assert plain == said
    assert lb.half_cone((1.0, 0.5)) == lb.half_cone((1.0, 0.5), 0.95)
    error = np.random.default_rng(21).standard_normal(4000)
    plain, said = lb.error_percentile(error, 0.9), lb.error_percentile(error, 0.9, confidence=0.95)
    np.testing.assert_array_equal(plain[1], said[1])
    plain, said = (
        lb.pointing_metrics(error, 0.1 * np.arange(4000.0), 5.0, **asked).rpe.interval
        for asked in ({}, {"confidence": 0.95, "route": "windows"})
    )
    np.testing.assert_array_equal(plain, said)
    assert lb.mtf(smear=0.3) == pytest.approx(np.sinc(0.15))


def test_percentiles_are_told_at_one_two_and_three_sigma_of_a_gaussian():
    noise = lb.units.arcsec_to_rad(np.random.default_rng(22).standard_normal((9000, 2)))
    table = lb.pointing_metrics(noise, 0.1 * np.arange(9000.0), 5.0).percentiles()
    told = table["probability"].unique()
    np.testing.assert_allclose(told, 2 * stats.norm.cdf([1, 2, 3]) - 1, atol=5e-5)
    assert table["of"].unique().tolist() == ["axis 1", "axis 2", "half-cone"]
    cone = table[table["of"] == "half-cone"]["value_arcsec"].to_numpy()
    np.testing.assert_allclose(cone[:2], np.sqrt(-2 * np.log(1 - told[:2])), rtol=0.05)


@pytest.mark.parametrize("rate_hz", [1e-3, 8.0])
def test_a_noise_floor_may_be_of_slow_samples(rate_hz):
    series = np.random.default_rng(23).standard_normal(400)
    found, plain = (lb.noise_floor(series, rate_hz=r) for r in (rate_hz, 1.0))
    assert found["tau_s"] == pytest.approx(plain["tau_s"] / rate_hz)
    assert found["sample"] == plain["sample"]


def test_a_group_has_as_many_axes_as_the_part_with_most(tmp_path):
    path = tmp_path / "budget.toml"
    path.write_text(
        """
[[requirement]]
id = "R"
index = "APE"
limit = 9.0

[[source]]
name = "both"
[[source.source]]
name = "one"
kind = "noise"
exactly = 3.0
[[source.source]]
name = "three"
kind = "noise"
exactly = [4.0, 0.0, 1.0]
"""
    )
    budget = lb.PointingBudget.from_toml(path)
    assert budget.axes == 3
    assert budget.sources[0].mean.size == 3
    factor = budget.requirements[0].factor
    np.testing.assert_allclose(
        budget.total(budget.requirements[0]), factor * np.hypot(3, [4, 0, 1])
    )


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("ratio", [0.0, 0.4, 1.0])
def test_a_half_cone_follows_its_unit(unit, ratio):
    plain, other = (lb.half_cone((k, k * ratio), 0.9) for k in (1.0, unit))
    assert other / unit == pytest.approx(plain, rel=1e-8)


def test_one_sample_has_no_percentile():
    for error in ([1.0], [np.nan, 2.0]):
        value, interval = lb.error_percentile(error, 0.5)
        assert np.isnan(value) and np.isnan(interval).tolist() == [True, True]


@pytest.mark.parametrize(
    "call",
    [lambda p: lb.half_cone((1.0, 1.0), p), lambda p: lb.error_percentile(np.arange(99.0), p)],
)
def test_a_probability_is_at_most_one(call):
    with pytest.raises(
        ValueError, match="probability must be a finite number from 0 to 1, got 1.2"
    ):
        call(1.2)


@pytest.mark.parametrize("route", ["windows", "spectrum"])
def test_a_bias_costs_what_the_spectrum_at_rest_says(route):
    """Of the square s + b^2 the bias has the variance 4 b^2 p / (2 T), p at the first frequency."""
    rng = np.random.default_rng(25)
    walk = np.cumsum(rng.standard_normal(4000)) * 0.03 + rng.standard_normal(4000)
    t = 0.5 * np.arange(4000.0)
    quiet, bias = walk - walk.mean(), 3.0
    rest, moved = (lb.pointing_metrics(quiet + b, t, 20.0, route=route) for b in (0.0, bias))
    frequency, density = moved.psd()
    assert frequency[0] == 0.0 and not 0.8 < density[1] / density[2] < 1.25
    for name in ("ape", "mpe"):
        one, two = getattr(rest, name), getattr(moved, name)
        square = one.value**2
        assert two.value == pytest.approx(np.sqrt(square + bias**2), rel=1e-9)
        variance = 2.0 * square**2 / (one.dof + 2.0)
        variance += 4.0 * bias**2 * density[1] / (2.0 * 4000 * 0.5)
        assert two.dof + 2.0 == pytest.approx(2.0 * (square + bias**2) ** 2 / variance, rel=1e-6)
    for name in ("rpe", "smear", "jitter"):
        assert getattr(rest, name).dof == pytest.approx(getattr(moved, name).dof, rel=1e-6)


@pytest.mark.parametrize("axes", [None, 1, 3])
def test_metrics_and_spectra_have_the_axes_of_their_angles(axes):
    shape = (200,) if axes is None else (200, axes)
    angles = np.random.default_rng(26).standard_normal(shape)
    found = lb.pointing_metrics(angles, np.arange(200.0), 10.0, 20.0)
    for name in ("ape", "mpe", "rpe", "pde", "pre", "smear", "jitter"):
        metric = getattr(found, name)
        assert np.shape(metric.value) == np.shape(metric.dof) == shape[1:]
        assert np.shape(metric.interval) == (*shape[1:], 2)
    frequency, density = found.psd()
    assert density.shape == (*frequency.shape, *shape[1:])


def test_two_samples_are_a_record_and_one_is_none():
    found = lb.pointing_metrics([3.0, 4.0], [0.0, 2.0], 4.0)
    assert (found.windows, found.window_s) == (1, 4.0)
    assert found.mpe.value == pytest.approx(3.5) and found.rpe.value == pytest.approx(0.5)
    with pytest.raises(ValueError, match="time_s must hold two samples or more, got one"):
        lb.pointing_metrics([3.0], [0.0], 4.0)


@pytest.mark.parametrize(("share", "said"), [(0.09, False), (0.11, True), (-0.11, True)])
def test_times_are_uneven_beyond_a_tenth_of_a_step(share, said):
    t = np.arange(200.0)
    t[100:] += share
    notes = lb.pointing_metrics(np.sin(t), t, 10.0).notes
    assert any("not evenly spaced" in note for note in notes) == said


def test_metrics_are_shown_with_those_that_there_are():
    found = lb.pointing_metrics(
        np.random.default_rng(27).standard_normal(200), np.arange(200.0), 2.0
    )
    head, names, *rows = repr(found).splitlines()
    assert head == f"PointingMetrics: windows of 2 s, {found.windows} used"
    assert names.split() == ["metric", "axis", "value_arcsec", "from_arcsec", "to_arcsec", "dof"]
    assert [row.split()[0] for row in rows[:4]] == ["APE", "MPE", "RPE", "smear"]
    assert rows[4:] == list(found.notes)  # no PDE without a separation, no PRE, no jitter


def test_a_pattern_of_no_frequency_keeps_its_modulation():
    for name, value in (("smear", 0.7), ("jitter", 0.2), ("sine", 0.3)):
        assert lb.mtf(0.0, **{name: value}) == 1.0
        assert 0.0 <= lb.mtf(0.9, **{name: value}) < 1.0


@pytest.mark.parametrize("k", [1, 3, 100])
def test_the_square_of_a_spectrum_is_taken_less_its_own_variance(k):
    """Of k Hann segments that overlap by half: one plus twice the square of 1/6, over k."""
    density, squares = np.array([0.0, 3.0, 2.0, 1.0]), np.ones(50)
    by_spectrum, by_windows = freedom(squares, density, 0.25, 40.0, k)
    square = 14.0 * 0.25 / (1.0 + (1.0 + 2.0 * (1.0 / 6.0) ** 2) / k)
    assert by_spectrum == pytest.approx(2.0 * 40.0 * (6.0 * 0.25) ** 2 / square, rel=1e-12)
    assert by_windows == np.inf
    assert freedom(squares, 0.0 * density, 0.25, 40.0, k)[0] == np.inf
