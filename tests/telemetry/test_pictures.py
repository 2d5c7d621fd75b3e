"""What the pictures of a pair's telemetry show of its table."""

import numpy as np
import pandas as pd
import pytest

from losbench.figures import COLOURS, png, styled
from losbench.telemetry.pictures import angle_figure, drift_figure


def table(tracks, *, samples=30, every_s=86400.0):
    """Tracks of ``samples`` seconds, a day apart, every column different."""
    time = np.add.outer(every_s * np.arange(tracks), np.arange(float(samples))).ravel()
    names = ["before", "after"] + [f"drift_{head}_{axis}" for head in (1, 2) for axis in "xyz"]
    columns = {f"{name}_arcsec": k + np.sin(time + k) for k, name in enumerate(names)}
    return pd.DataFrame(
        {"time_s": time, "track": np.repeat(1 + np.arange(tracks), samples), **columns}
    )


def points(axis, label):
    (line,) = (line for line in axis.lines if line.get_label() == label)
    return np.array(line.get_xdata()), np.array(line.get_ydata())


@pytest.mark.parametrize("tracks", [1, 2, 13])
def test_every_component_of_both_heads_is_drawn_on_a_scale_of_its_own(tracks):
    angle = table(tracks)
    fig = drift_figure(angle, (1, 2))
    assert len(fig.axes) == 3
    for axis, name in zip(fig.axes, "xyz", strict=True):
        for head in (1, 2):
            _, drawn = points(axis, f"head {head}")
            np.testing.assert_array_equal(drawn, angle[f"drift_{head}_{name}_arcsec"])
            low, high = axis.get_ylim()
            assert low < drawn.min() < drawn.max() < high
    assert len({axis.get_ylim() for axis in fig.axes}) == 3


def test_tracks_keep_their_length_and_order_and_lose_the_gaps():
    angle = table(4)
    place, _ = points(drift_figure(angle, (1, 2)).axes[0], "head 1")
    steps = np.diff(place)
    gap = np.diff(angle["track"]) > 0
    np.testing.assert_allclose(steps[~gap], 1.0, atol=1e-9)
    assert np.all((steps[gap] > 0) & (steps[gap] < 0.1 * 30))


@pytest.mark.parametrize("samples", [1, 30])
def test_a_divider_stands_between_any_two_tracks(samples):
    angle = table(5, samples=samples)
    axis = drift_figure(angle, (1, 2)).axes[0]
    place, _ = points(axis, "head 1")
    dividers = [
        line.get_xdata()[0] for line in axis.lines if not line.get_label().startswith("head")
    ]
    np.testing.assert_array_equal(np.searchsorted(dividers, place), angle["track"] - 1)


def test_the_angle_keeps_the_colours_of_the_paper_s_figures():
    angle = table(2)
    fig = angle_figure(angle)
    for axis, (_, samples) in zip(fig.axes, angle.groupby("track"), strict=True):
        for label, column, colour in (
            ("uncorrected", "before", "vermilion"),
            ("corrected", "after", "blue"),
        ):
            np.testing.assert_array_equal(points(axis, label)[1], samples[f"{column}_arcsec"])
            (line,) = (line for line in axis.lines if line.get_label() == label)
            assert line.get_color() == COLOURS[colour]


@pytest.mark.parametrize("tracks", [1, 6, 7, 40])
def test_many_tracks_leave_few_panels_and_few_labels(tracks):
    angle = table(tracks, samples=3)
    assert 1 <= len(angle_figure(angle).axes) <= 6
    if tracks > 1:
        assert 1 < len(drift_figure(angle, (1, 2)).axes[-1].get_xticks()) <= 10


@pytest.mark.parametrize("tracks", [1, 3])
def test_missing_angles_are_left_out_without_a_warning(tracks):
    angle = table(tracks)
    angle.loc[angle["track"] == tracks, angle.columns[2:]] = np.nan
    with styled():
        assert png(angle_figure(angle))[:4] == png(drift_figure(angle, (1, 2)))[:4] == b"\x89PNG"
