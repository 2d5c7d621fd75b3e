"""Where a report's pictures put what they show."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import losbench as lb
from losbench.recording import pictures
from losbench.recording.stamps import Stamp
from losbench.units import arcsec_to_rad

RNG = np.random.default_rng(83)
FRAMES = RNG.integers(90, 1000, (3, 60, 300)).astype(np.uint16)


def recording():
    return lb.read_recording(FRAMES, period_s=1.0)


def spots(n, window=None):
    """Spots in a row of a measurement whose second frame is the first to show all."""
    xy = np.tile(np.array([20.4, 30.3]) + np.outer(np.arange(n), [21.0, 0.0]), (3, 1, 1))
    xy[0, -1] = np.nan
    surveys = () if window is None else (SimpleNamespace(method=lb.EIWA(window)),)
    return SimpleNamespace(xy_px=xy, surveys=surveys)


@pytest.mark.parametrize(
    ("n", "shown", "rows", "columns"),
    [(1, 1, 1, 1), (5, 5, 1, 5), (6, 6, 1, 6), (7, 7, 2, 4), (12, 12, 2, 6), (13, 12, 2, 6)],
)
def test_twelve_spots_are_shown_near_to_below_the_frame_six_beside_each_other(
    n, shown, rows, columns
):
    whole, *near = pictures.frame_figure(spots(n), recording()).axes
    assert len(near) == shown and len(whole.patches) == n
    for k, axis in enumerate(near):
        place = axis.get_subplotspec()
        assert place.get_geometry()[:2] == (rows + 1, columns)
        assert (place.rowspan.start, place.colspan.start) == (1 + k // columns, k % columns)
        assert axis.get_title() == f"spot {k + 1}"
    place = whole.get_subplotspec()
    assert (place.rowspan.start, place.colspan.start, place.colspan.stop) == (0, 0, columns)
    heights = place.get_gridspec().get_height_ratios()
    side = 8.0 / max(columns, 3)
    np.testing.assert_allclose(heights, [8.0 * 60 / 300, *[side] * rows])
    assert whole.figure.get_size_inches().tolist() == pytest.approx([8.0, sum(heights) + 0.4])


def test_a_tall_frame_is_nine_inches_high():
    tall = lb.read_recording(np.swapaxes(FRAMES, 1, 2), period_s=1.0)
    known = spots(1)
    known.xy_px = known.xy_px[..., ::-1].copy()
    heights = pictures.frame_figure(known, tall).axes[0].get_subplotspec().get_gridspec()
    assert heights.get_height_ratios()[0] == 9.0


def test_a_spot_is_shown_with_its_window_and_four_pixels_around_it():
    _, first, second = pictures.frame_figure(spots(2, 9), recording()).axes
    for axis, x in ((first, 20), (second, 41)):
        assert axis.images[0].get_extent() == [x - 8.5, x + 8.5, 38.5, 21.5]
        np.testing.assert_array_equal(axis.images[0].get_array(), FRAMES[1, 22:39, x - 8 : x + 9])
        (square,) = axis.patches
        assert square.get_xy() == (x - 4.5, 25.5)
        assert (square.get_width(), square.get_height()) == (9, 9)
    assert not pictures.frame_figure(spots(2), recording()).axes[1].patches


def test_spots_are_numbered_beside_their_circles():
    whole = pictures.frame_figure(spots(2), recording()).axes[0]
    radius = 0.02 * 300
    for k, (circle, text) in enumerate(zip(whole.patches, whole.texts, strict=True)):
        x, y = 20.4 + 21.0 * k, 30.3
        assert circle.radius == pytest.approx(radius)
        assert text.get_position() == pytest.approx((x + 1.2 * radius, y - 1.2 * radius))
        assert text.get_text() == f"{k + 1}"


@pytest.mark.parametrize("flat", [False, True])
def test_brightness_goes_from_the_first_to_the_last_thousandth(flat):
    """At least a step, where all pixels read the same."""
    frames = np.full_like(FRAMES, 100) if flat else FRAMES
    image = pictures.frame_figure(spots(1), lb.read_recording(frames)).axes[0].images[0]
    low, high = (100.0, 101.0) if flat else np.percentile(FRAMES[1], [1.0, 99.9])
    assert image.get_clim() == pytest.approx((low, high))


def test_stamps_are_shown_each_by_itself_at_its_place():
    whole = recording()
    stamps = tuple(Stamp(f"{k}", whole.stamps[0].frames, (100.0 * k, 7.0)) for k in range(2))
    several = SimpleNamespace(stamps=stamps, label=whole.label)
    known = spots(2, 9)
    axes = pictures.frame_figure(known, several).axes
    assert len(axes) == 2
    for k, axis in enumerate(axes):
        assert axis.images[0].get_extent() == [100 * k - 0.5, 100 * k + 299.5, 66.5, 6.5]
        np.testing.assert_array_equal(axis.images[0].get_array(), FRAMES[1])
        assert axis.get_subplotspec().get_geometry()[:2] == (1, 2)


@pytest.mark.parametrize("timed", [False, True])
def test_pictures_are_over_time_or_over_the_number_of_the_frame(timed):
    columns = {"frame": np.arange(4)} | ({"time_s": 0.5 * np.arange(4.0)} if timed else {})
    known = SimpleNamespace(
        shifts_px=RNG.random((4, 2, 2)), attitude=None, table=pd.DataFrame(columns)
    )
    first, second = pictures.shifts_figure(known).axes
    along = columns["time_s"] if timed else columns["frame"]
    np.testing.assert_array_equal(first.lines[1].get_xdata(), along)
    assert second.get_xlabel() == ("time (s)" if timed else "frame") and not first.get_xlabel()
    assert [axis.get_ylabel() for axis in (first, second)] == [
        "shift along x (px)",
        "shift along y (px)",
    ]
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["spot 1", "spot 2"]
    assert not second.get_legend()


@pytest.mark.parametrize(("lag_s", "label"), [([0.0, 0.0], "fit"), ([0.0, 3.0], "fit with lag")])
def test_angles_are_drawn_over_their_temperature_with_the_fit(lag_s, label):
    celsius = np.linspace(18.0, 21.0, 5)
    angles = RNG.random((5, 3))
    names = ("alpha_arcsec", "beta_arcsec", "gamma_arcsec")
    table = {"frame": np.arange(5), "temperature_box_degC": celsius}
    known = SimpleNamespace(table=pd.DataFrame(table | dict(zip(names, angles.T, strict=True))))
    fit = SimpleNamespace(
        column="temperature_box_degC",
        lag_s=np.array(lag_s),
        predicted=arcsec_to_rad(angles + 1.0),
    )
    axes = pictures.over_temperature_figure(known, fit).axes
    for i, axis in enumerate(axes):
        measured, fitted = axis.lines
        np.testing.assert_array_equal(measured.get_xydata(), np.stack([celsius, angles[:, i]], -1))
        np.testing.assert_allclose(fitted.get_ydata(), angles[:, i] + 1.0)
        assert axis.get_ylabel() == f"about {'XYZ'[i]} (arcsec)"
        assert not measured.get_rasterized() and not fitted.get_rasterized()
    assert axes[-1].get_xlabel() == "temperature_box (degC)"
    texts = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert texts == ["measured", label]


def test_every_sensor_has_a_line_under_its_name():
    table = {"frame": np.arange(4), "temperature_T_$1$_degC": np.arange(4.0)}
    table["temperature_wall_degC"] = 20.0 - np.arange(4.0)
    (axis,) = pictures.temperature_figure(SimpleNamespace(table=pd.DataFrame(table))).axes
    assert [line.get_label() for line in axis.lines] == ["T_$1$", "wall"]
    assert axis.get_ylabel() == "temperature (degC)"
    assert not any(text.get_parse_math() for text in axis.get_legend().get_texts())
    np.testing.assert_array_equal(axis.lines[1].get_ydata(), table["temperature_wall_degC"])


@pytest.mark.parametrize("sides", [[], [9], [9, 11, 13]])
def test_windows_are_those_of_each_stamp_or_of_all_spots(sides):
    known = spots(3)
    known.surveys = tuple(SimpleNamespace(method=lb.EIWA(side)) for side in sides)
    expected = [None] * 3 if not sides else sides * (3 // len(sides))
    assert pictures.windows_px(known) == expected
