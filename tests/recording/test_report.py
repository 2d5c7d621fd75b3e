"""What the report says of a sensitivity: no number outside its own interval."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.recording.sensitivity import numbers, sentences


@pytest.fixture
def series():
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, 3600.0, 30.0)
    celsius = 20.0 + 3.0 * np.sin(time_s / 500.0)
    angles = 1e-6 * (celsius - 20.0)[:, None] * [1.0, 2.0, 3.0]
    fit = lb.fit_sensitivity(
        celsius, angles + 1e-7 * rng.standard_normal((120, 3)), time_s=time_s, lag_s="fit"
    )
    return fit, pd.DataFrame({"time_s": time_s, "temperature_degC": celsius})


def test_a_sensitivity_inside_its_interval_is_the_solvers(series):
    fit, table = series
    low, high = np.moveaxis(fit.k_interval, -1, 0)
    assert ((low < fit.k) & (fit.k < high)).all()
    for axis, k in zip(numbers(fit, table).values(), fit.k_arcsec_per_degC, strict=True):
        assert axis["arcsec_per_degC"] == pytest.approx(k, abs=1e-6)
    assert "one alone" not in " ".join(sentences(fit, table))


def test_where_one_lag_leaves_the_interval_its_middle_is_printed_and_both_are_named(series):
    fit, table = series
    away = fit.k_interval[:, 1] + 1e-6
    moved = replace(fit, k=away)
    middle = lb.units.rad_to_arcsec(fit.k_interval.mean(axis=-1))
    lines = sentences(moved, table)
    for axis, line, k, rest in zip(
        numbers(moved, table).values(), lines, moved.k_arcsec_per_degC, middle, strict=True
    ):
        assert axis["arcsec_per_degC"] == pytest.approx(rest, abs=1e-6)
        assert f"{rest:+.4f} arcsec/degC" in line
        assert f"one alone gives {k:+.4f}" in line


def test_a_lag_that_cannot_be_told_is_said(series):
    fit, table = series
    unknown = replace(fit, lag_state=np.array(["not identifiable", "weak", "identified"]))
    states = [axis["lag_state"] for axis in numbers(unknown, table).values()]
    assert states == ["not identifiable", "weak", "identified"]
    assert ["not identifiable" in line for line in sentences(unknown, table)] == [
        True,
        False,
        False,
    ]
