"""What reports say of sensitivities and metrics: the numbers that were found, series by series."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.pointing.performance import pointing_metrics
from losbench.pointing.told import (
    METRICS,
    Sensitivity,
    compensated_figure,
    metric_numbers,
    metric_sentences,
    metrics_figure,
    metrics_section,
    sensitivity_section,
    sensitivity_to,
    table_of,
)
from losbench.units import arcsec_to_rad

NAMES = {"alpha": "about X", "beta": "about Y"}
ROWS = 8
SPACE = "\N{NO-BREAK SPACE}"


def told(**changes):
    """A lag of one minute and one that cannot be told; a sensitivity that one lag gives, and one
    that it does not.
    """
    rejected = np.zeros((ROWS, 2), dtype=bool)
    rejected[3, 0] = rejected[1, 1] = rejected[6, 1] = True
    residuals = arcsec_to_rad(np.resize([[0.01, 0.3], [-0.01, -0.3]], (ROWS, 2)))
    residuals[5] = np.nan
    found = {
        "sensitivity": np.array([[2.0], [-3.1234567]]),
        "interval": np.array([[[1.9, 2.1]], [[-3.5, -2.5]]]),
        "tau_s": np.array([[61.0], [np.nan]]),
        "tau_interval_s": np.array([[[50.0, 75.1234]], [[0.0, np.inf]]]),
        "tau_state": np.array([["identified"], ["not identifiable"]]),
        "fitted": SimpleNamespace(
            coefficients=arcsec_to_rad(np.array([[7.0, 2.05], [8.0, 4.0]])),
            tau_s=np.array([[60.0], [80.0]]),
        ),
        "residuals": residuals,
        "rejected": rejected,
        "lack_of_fit": (
            SimpleNamespace(f_p_value=0.25, neumann_p_value=1e-12),
            SimpleNamespace(f_p_value=np.nan, neumann_p_value=np.nan),
        ),
        "notes": ("Axis 2: it wanders", "Axis 1: it is still", "both are there"),
    }
    used = np.arange(ROWS) != 5
    predicted = np.full((ROWS, 2), np.nan)
    predicted[used] = arcsec_to_rad(np.array([1.0, -2.0]))
    fields = {"found": SimpleNamespace(**found | changes), "used": used, "predicted": predicted}
    fields["found"].rejected = fields["found"].rejected[used]
    return Sensitivity(column="T", names=NAMES, shortest_lag_s=2.0, **fields)


def table(rows=ROWS):
    seconds = np.arange(float(rows))
    return pd.DataFrame({"alpha_arcsec": 10.0 + seconds, "beta_arcsec": 20.0 - seconds})


def test_numbers_are_those_found_rounded_and_ready_for_json():
    alpha, beta = told().numbers().values()
    assert alpha == {
        "arcsec_per_degC": 2.0,
        "interval_95_arcsec_per_degC": [1.9, 2.1],
        "one_lag_arcsec_per_degC": 2.05,
        "lag_s": 60.0,
        "lag_interval_95_s": [50.0, 75.123],
        "lag_state": "identified",
        "one_lag_p_value": 0.25,
        "white_p_value": 1e-12,
        "set_aside": 1,
        "rms_arcsec": 0.01,
    }
    assert beta["arcsec_per_degC"] == -3.123457
    assert beta["lag_interval_95_s"] == [0.0, None]
    assert (beta["lag_s"], beta["one_lag_p_value"], beta["set_aside"]) == (0.0, None, 2)
    assert beta["rms_arcsec"] == 0.3
    json.dumps(told().numbers(), allow_nan=False)


def test_lags_are_told_to_a_millisecond_and_p_values_to_thirty_digits():
    exact = told(
        fitted=SimpleNamespace(coefficients=np.zeros((2, 2)), tau_s=np.array([[0.98765], [9.0]])),
        tau_interval_s=np.array([[[0.5, 3.0]], [[0.0, 9.0]]]),
        lack_of_fit=[SimpleNamespace(f_p_value=1.26e-30, neumann_p_value=1.37e-30)] * 2,
    )
    exact = replace(exact, shortest_lag_s=0.2)
    alpha = exact.numbers()["alpha"]
    assert (alpha["lag_s"], alpha["one_lag_p_value"], alpha["white_p_value"]) == (
        0.988,
        1e-30,
        1e-30,
    )
    assert ", lag 0.0 min" in exact.sentences()[0] and ", no lag" in exact.sentences()[1]


def test_a_lag_is_one_only_if_it_cannot_be_shorter_than_the_shortest():
    assert told().lag_s.tolist() == [60.0, 0.0]
    for shortest, lag in ((49.9, 60.0), (50.0, 0.0)):
        assert replace(told(), shortest_lag_s=shortest).lag_s[0] == lag


def test_without_a_fitted_lag_none_is_given_and_nothing_is_tested():
    none = told(
        tau_s=np.empty((2, 0)), tau_interval_s=np.empty((2, 0, 2)), tau_state=np.empty((2, 0))
    )
    assert none.lag_s.tolist() == [0.0, 0.0]
    assert none.lag_state == ["given", "given"]
    alpha = none.numbers()["alpha"]
    assert alpha["lag_interval_95_s"] == []
    assert alpha["one_lag_p_value"] is None and alpha["white_p_value"] is None


def test_sentences_say_it_a_series_a_line():
    assert told().sentences() == [
        "Sensitivity about X to T: +2.0000 arcsec/degC (95 %: +1.9000 to +2.1000), lag 1.0 min, "
        "0.0100 arcsec rms left after compensation",
        "Sensitivity about Y to T: -3.1235 arcsec/degC (95 %: -3.5000 to -2.5000), no lag, over "
        "all lags: one alone gives +4.0000, not identifiable: one as long as the record fits as "
        "well, 0.3000 arcsec rms left after compensation",
    ]


def test_notes_name_the_series_instead_of_the_axis():
    assert told().notes() == ["About Y: it wanders", "About X: it is still", "both are there"]


def test_what_goes_with_the_temperature_is_taken_out_where_it_is_known():
    left = told().compensated(table())
    assert left["alpha_compensated_arcsec"].round(9).tolist()[:3] == [9.0, 10.0, 11.0]
    assert left["beta_compensated_arcsec"].round(9).tolist()[:3] == [22.0, 21.0, 20.0]
    assert np.flatnonzero(left["beta_compensated_arcsec"].isna()).tolist() == [5]


def test_a_section_shows_a_row_a_series_and_leaves_open_what_is_not_known():
    page = sensitivity_section(told(), "<b>drawn</b>", title=" of it")
    head, *rows = page.replace(SPACE, " ").split("<tr>")[1:]
    assert "95 % interval" in head
    cells = [
        [cell.split("</td>")[0].split(">")[-1] for cell in row.split("<td")[1:]] for row in rows
    ]
    first, second = (["about X", *cells[0]], ["about Y", *cells[1]])
    wanted = ["2.00", "1.90 to 2.10", "2.05", "60", "identified", "0.25", "0.0100", "1"]
    assert first[-8:] == wanted
    assert second[-8:] == [
        "-3.12",
        "-3.50 to -2.50",
        "4.00",
        "0",
        "not identifiable",
        "",
        "0.300",
        "2",
    ]
    assert "<b>drawn</b>" in page and "Sensitivity to temperature of it" in page


def test_an_interval_without_an_end_is_not_shown():
    open_ended = told(
        sensitivity=np.array([[np.nan], [123.4]]),
        interval=np.array([[[np.nan, np.nan]], [[-7.0, np.inf]]]),
    )
    page = sensitivity_section(open_ended)
    assert not any(word in page for word in ("nan", "inf", "-7"))
    assert "123<" in page


@pytest.fixture(scope="module")
def metrics():
    noise = arcsec_to_rad(np.random.default_rng(1).standard_normal((4000, 3)) * [1.0, 20.0, 5.0])
    time_s = 0.1 * np.arange(4000)
    noise[1000] = np.nan
    return pointing_metrics(noise, time_s, 5.0)


def test_metrics_are_told_in_arcseconds_series_by_series(metrics):
    found = metric_numbers(metrics, NAMES)
    assert (found["window_s"], found["windows"]) == (5.0, metrics.windows)
    assert found["dropped"] == metrics.dropped > 0
    for i, key in enumerate(NAMES):
        for name in METRICS:
            metric, series = getattr(metrics, name), found["series"][key]
            value = lb.units.rad_to_arcsec(metric.value[i])
            assert series[f"{name}_arcsec"] == round(float(value), 6)
            ends = lb.units.rad_to_arcsec(metric.interval[i]).round(6).tolist()
            assert series[f"{name}_interval_95_arcsec"] == ends
    first, second = metric_sentences(metrics, NAMES)
    rpe = found["series"]["beta"]
    low, high = rpe["rpe_interval_95_arcsec"]
    assert second.startswith("Pointing about Y in windows of 5 s, arcsec (95 %): APE ")
    assert f", RPE {rpe['rpe_arcsec']:.3g} ({low:.3g} to {high:.3g}), smear" in second
    assert first != second and "no interval" not in first


def test_a_metric_without_an_interval_says_so(metrics):
    unsure = replace(metrics.mpe, interval=np.full((3, 2), np.nan))
    line = metric_sentences(replace(metrics, mpe=unsure), NAMES)[0]
    assert line.count("(no interval)") == 1
    cells = metrics_section(replace(metrics, mpe=unsure), NAMES).split("MPE")[1].split("</tr>")[0]
    assert "nan" not in cells


def test_a_section_of_metrics_holds_every_metric_of_every_series(metrics):
    page = metrics_section(metrics, NAMES, title=" of it").replace(SPACE, " ")
    found = metric_numbers(metrics, NAMES)["series"]
    for name in METRICS:
        word = name.upper() if len(name) == 3 else name
        row = page.split(f">{word}<")[1].split("</tr>")[0]
        for key in NAMES:
            low, high = found[key][f"{name}_interval_95_arcsec"]
            assert f">{found[key][f'{name}_arcsec']:#.3g}".rstrip(".") in row
            assert f"{low:#.3g} to {high:#.3g}".replace(". ", " ") in row
    assert f"{metrics.windows} windows of 5 s" in page
    assert f"{metrics.dropped} dropped for gaps" in page
    assert "about X (arcsec)" in page and "about Y, 95 %" in page


def test_metrics_are_drawn_side_by_side_with_their_intervals(metrics):
    names = NAMES | {"gamma": "about Z"}
    (axis,) = metrics_figure(metrics, names).axes
    lines = axis.get_lines()
    places = np.array([line.get_xdata() for line in lines])
    np.testing.assert_allclose(places.mean(axis=0), np.arange(len(METRICS)), atol=1e-12)
    assert (np.diff(places, axis=0) > 0).all() and np.ptp(places, axis=0).max() < 0.5
    for i, (line, bars) in enumerate(zip(lines, axis.collections, strict=True)):
        value = [lb.units.rad_to_arcsec(getattr(metrics, name).value[i]) for name in METRICS]
        ends = [lb.units.rad_to_arcsec(getattr(metrics, name).interval[i]) for name in METRICS]
        np.testing.assert_allclose(line.get_ydata(), value)
        np.testing.assert_allclose([bar[:, 1] for bar in bars.get_segments()], ends)
        np.testing.assert_allclose(
            [bar[:, 0] for bar in bars.get_segments()], places[i][:, None] + [0, 0]
        )
    assert [line.get_label() for line in lines] == list(names.values())


@pytest.mark.parametrize(("rows", "image"), [(3000, False), (3001, True)])
def test_what_was_measured_and_what_is_left_are_drawn_and_what_was_set_aside_is_marked(rows, image):
    fit, frame = told(), table(rows)
    used, predicted = np.ones(rows, dtype=bool), np.zeros((rows, 2))
    used[5], predicted[:, 1] = False, arcsec_to_rad(1.5)
    fit.found.rejected = np.zeros((rows - 1, 2), dtype=bool)
    fit.found.rejected[[1, 6], 1] = True
    fit = replace(fit, used=used, predicted=predicted)
    axes = np.reshape(compensated_figure(fit, frame, 2.0 * np.arange(rows), "time").axes, (2, 2))
    measured, by_temperature = axes[1, 0].get_lines()
    np.testing.assert_array_equal(measured.get_ydata(), frame["beta_arcsec"])
    np.testing.assert_allclose(by_temperature.get_ydata(), 1.5)
    left, aside = axes[1, 1].get_lines()
    np.testing.assert_allclose(left.get_ydata(), frame["beta_arcsec"] - 1.5)
    assert aside.get_xdata().tolist() == [2.0, 14.0]
    assert aside.get_ydata().tolist() == [17.5, 11.5]
    drawn = (measured, by_temperature, left)
    assert {bool(line.get_rasterized()) for line in drawn} == {image}
    assert [bool(axis.get_legend()) for axis in axes.ravel()] == [True, False, False, True]
    assert [axis.get_xlabel() for axis in axes.ravel()] == ["", "", "time", "time"]
    assert axes[0, 0].get_ylabel() == "about X (arcsec)"


def test_one_series_is_drawn_alone_over_one_time():
    fit = told()
    one = replace(fit, names={"alpha": "about X"}, predicted=fit.predicted[:, :1])
    fit.found.rejected = fit.found.rejected[:, :1]
    left, right = compensated_figure(one, table(), np.arange(ROWS), "time").axes
    assert left.get_shared_x_axes().joined(left, right)
    assert (left.get_xlabel(), right.get_xlabel()) == ("time", "time")


def test_tables_for_files_name_axes_by_their_keys():
    frame = pd.DataFrame({"axis": [1, 2], "value": [0.1234567891, 2.0]})
    assert table_of(frame, NAMES) == "axis,value\nalpha,0.123456789\nbeta,2\n"


def test_times_that_do_not_rise_leave_no_lag_to_fit():
    rows = 60
    celsius = 20.0 + np.sin(np.arange(rows) / 7.0)
    noise = 1e-3 * np.random.default_rng(3).standard_normal((2, rows))
    frame = pd.DataFrame(
        {
            "time_s": 0.5 * np.arange(rows),
            "T": celsius,
            "alpha_arcsec": 2.0 * celsius + noise[0],
            "beta_arcsec": -celsius + noise[1],
        }
    )
    timed = sensitivity_to("T", frame, NAMES)
    assert timed.found.tau_s.shape == (2, 1)
    np.testing.assert_allclose(timed.found.sensitivity[:, 0], [2.0, -1.0], atol=0.2)
    twice = frame.assign(time_s=frame["time_s"].to_numpy().clip(max=25.0))
    assert sensitivity_to("T", twice, NAMES).found.tau_s.shape == (2, 0)
    hidden = frame.assign(alpha_arcsec=frame["alpha_arcsec"].where(np.arange(rows) < 9))
    assert sensitivity_to("T", hidden, NAMES) is None
