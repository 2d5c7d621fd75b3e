"""Pixel sums against numerical integration and closed-form moments; windows, batches and
symmetries.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import dblquad

import losbench as lb

coordinate = st.floats(6.0, 14.0)


def test_each_pixel_holds_the_integral_of_the_gaussian():
    image = lb.render_spots([[2.3, 1.6]], 700.0, (0.7, 1.1), (4, 5))

    def density(y, x):
        return (
            700
            / (2 * np.pi * 0.7 * 1.1)
            * np.exp(-((x - 2.3) ** 2) / (2 * 0.7**2) - (y - 1.6) ** 2 / (2 * 1.1**2))
        )

    for row, column in [(0, 0), (2, 2), (3, 4)]:
        expected, _ = dblquad(density, column - 0.5, column + 0.5, row - 0.5, row + 0.5)
        assert image[row, column] == pytest.approx(expected, rel=1e-10)


@given(x=coordinate, y=coordinate, sx=st.floats(0.8, 1.2), sy=st.floats(0.8, 1.2))
def test_sum_centre_and_spread_are_those_of_a_gaussian_seen_through_pixels(x, y, sx, sy):
    image = lb.render_spots([[x, y]], 1.0, (sx, sy), (21, 21))
    columns, rows = image.sum(axis=0), image.sum(axis=1)
    pixel = np.arange(21)
    assert image.sum() == pytest.approx(1.0, abs=1e-6)
    # Aliasing of the mean is of order exp(-2 pi^2 sigma^2), 1e-6 px at 0.8; the variance gains
    # Sheppard's 1/12.
    assert columns @ pixel == pytest.approx(x, abs=2e-5)
    assert rows @ pixel == pytest.approx(y, abs=2e-5)
    assert columns @ (pixel - x) ** 2 == pytest.approx(sx**2 + 1 / 12, abs=2e-4)


def test_a_window_is_a_cutting_of_the_frame_each_with_its_own_origin():
    xy = np.array([[[8.2, 9.1], [14.0, 5.5]], [[7.0, 6.0], [12.5, 11.0]]])
    frames = lb.render_spots(xy, [900.0, 400.0], [[1.5], [0.9]], (20, 24))
    windows = lb.render_spots(xy, [900.0, 400.0], [[1.5], [0.9]], (7, 9), origin=[(4, 6), (9, 3)])
    np.testing.assert_allclose(windows[0], frames[0, 6:13, 4:13], rtol=1e-12)
    np.testing.assert_allclose(windows[1], frames[1, 3:10, 9:18], rtol=1e-12)


def test_spots_add_up_and_a_batch_is_a_loop():
    xy = np.random.default_rng(3).uniform(4, 12, (5, 3, 2))
    flux = np.array([100.0, 300.0, 50.0])
    together = lb.render_spots(xy, flux, 1.3, (16, 17))
    for frame, centres in zip(together, xy, strict=True):
        alone = sum(
            lb.render_spots([c], f, 1.3, (16, 17)) for c, f in zip(centres, flux, strict=True)
        )
        np.testing.assert_allclose(frame, alone, atol=1e-13)


def test_no_spots_make_a_dark_frame():
    np.testing.assert_array_equal(
        lb.render_spots(np.empty((0, 2)), 1.0, 1.0, (3, 4)), np.zeros((3, 4))
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"xy": [1.0, 2.0, 3.0]}, r"xy must have shape \(\.\.\., n, 2\), got \(3,\)"),
        ({"xy": [[np.nan, 1.0]]}, "xy must be finite, got 1 NaN or infinite of 2 values"),
        ({"sigma": 0.0}, "sigma must be positive, got 0"),
        (
            {"sigma": [1.0, 1.0, 1.0]},
            r"sigma must broadcast to \(1, 2\) to match xy, got shape \(3,\)",
        ),
        ({"flux": -1.0}, "flux must not be negative, got -1"),
        ({"flux": [1.0, 2.0]}, r"flux must broadcast to \(1,\) to match xy, got shape \(2,\)"),
        ({"shape": 20}, r"shape must be \(rows, columns\), got 20"),
        ({"shape": (1, 2, 3)}, r"shape must be \(rows, columns\), got \(1, 2, 3\)"),
        ({"shape": (0, 5)}, "shape must be a whole number of at least 1, got 0"),
        ({"origin": (0, 0, 0)}, r"origin must have shape \(\.\.\., 2\), got \(3,\)"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(change, message):
    arguments = {"xy": [[2.0, 2.0]], "flux": 1.0, "sigma": 1.0, "shape": (5, 5)} | change
    with pytest.raises(ValueError, match=message):
        lb.render_spots(**arguments)


def test_a_streak_is_the_mean_of_its_moments_and_each_star_has_its_own():
    tracks = np.random.default_rng(7).uniform(5, 14, (2, 3, 4, 2))
    share, flux = np.array([0.1, 0.4, 0.3, 0.2]), np.array([100.0, 30.0, 500.0])
    streaks = lb.render_streaks(tracks, share, flux, 0.9, (20, 20))
    moments = [
        part * lb.render_spots(tracks[..., k, :], flux, 0.9, (20, 20))
        for k, part in enumerate(share)
    ]
    np.testing.assert_allclose(streaks, np.sum(moments, axis=0), atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"tracks": np.zeros((1, 5, 2))},
            r"tracks must have shape \(\.\.\., n, 4, 2\) to match 4 shares, got \(1, 5, 2\)",
        ),
        ({"share": [np.nan] * 4}, "share must be finite"),
        ({"flux": [1.0, 2.0]}, r"flux must broadcast to \(1,\)"),
        ({"sigma": 0.0}, "sigma must be positive"),
    ],
)
def test_a_streak_that_does_not_fit_is_refused_by_name(change, message):
    arguments = {
        "tracks": np.zeros((1, 4, 2)),
        "share": np.full(4, 0.25),
        "flux": 1.0,
        "sigma": 1.0,
        "shape": (5, 5),
    }
    with pytest.raises(ValueError, match=message):
        lb.render_streaks(**(arguments | change))
