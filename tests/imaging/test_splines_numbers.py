"""Splines as a template, number by number: weights, slopes, sums, and what a shape tells of itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from losbench.imaging.splines import (
    Drawn,
    SpotShape,
    knots_per_pixel,
    spline_count,
    spline_weights,
)


def shape_of(side=5, frames=20, spread=(0.1, 0.2), place=(10.3, 20.6), **fields):
    error = np.arange(128.0).reshape(8, 8, 2)
    values = gaussian(side, 1.5), error, frames, np.array(place), np.array(spread)
    return replace(SpotShape(side, *values), **fields)


def gaussian(side, sigma):
    """Splines of a spot of that sigma, but for what a spline adds: a third of a knot squared."""
    each, count = knots_per_pixel(side), spline_count(side)
    off = (np.arange(count) - (count - 1) / 2) / each
    line = np.exp(-0.5 * off**2 / (sigma**2 - 1.0 / 3.0 / each**2))
    both = line[:, None] * line
    return both * each**2 / both.sum()


# Weights


@pytest.mark.parametrize(
    ("side", "knots", "count"),
    [(3, 3, 18), (5, 3, 24), (11, 3, 42), (13, 2, 33), (61, 2, 129), (63, 1, 68), (121, 1, 126)],
)
def test_three_knots_are_in_a_pixel_up_to_11_of_a_window_two_up_to_61_and_one_beyond(
    side, knots, count
):
    """A pixel and a half of room on either side, and three more splines than knots' spaces."""
    assert (knots_per_pixel(side), spline_count(side)) == (knots, count)


@pytest.mark.parametrize("side", [5, 13, 63])
@pytest.mark.parametrize("centre", [-1.49, -0.5, -0.2, 0.0, 0.3, 0.75, 1.5])
def test_weights_are_those_of_cubic_b_splines_and_their_slopes(side, centre):
    """Pixels are knots apart; the first pixel of a spot at 1.5 stands on the first knot."""
    each, count = knots_per_pixel(side), spline_count(side)
    found, slopes = spline_weights(side, np.array([centre]))
    at = np.minimum((1.5 - centre) * each, 3 * each - 1e-6) + each * np.arange(side)
    basis = BSpline(np.arange(-3.0, count + 1.0), np.eye(count), 3)
    np.testing.assert_allclose(found[0], basis(at), atol=1e-9)
    np.testing.assert_allclose(slopes[0], -each * basis(at, 1), atol=1e-5)
    np.testing.assert_allclose(found.sum(axis=-1), 1.0)


@pytest.mark.parametrize("side", [5, 13, 63])
def test_a_spot_further_off_is_drawn_as_if_it_stood_a_pixel_and_a_half_off(side):
    far, near = (spline_weights(side, np.array([at, -at]))[0] for at in (4.0, 1.5))
    np.testing.assert_array_equal(far, near)
    inner = spline_weights(side, np.array([1.45, -1.45]))[0]
    assert not np.allclose(inner, near, atol=1e-3)


def test_weights_of_many_places_stand_as_those_do():
    centre = np.random.default_rng(4).uniform(-1.4, 1.4, (2, 3))
    found, slopes = spline_weights(5, centre)
    for place in np.ndindex(2, 3):
        one, slope = spline_weights(5, centre[place][None])
        np.testing.assert_allclose(found[place], one[0], atol=1e-12)
        np.testing.assert_allclose(slopes[place], slope[0], atol=1e-12)


# Drawn


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("side", [5, 13, 63])
def test_spots_are_drawn_by_the_splines_of_their_own_shape(side, dtype):
    rng = np.random.default_rng(5)
    centre = rng.uniform(-1.4, 1.4, (9, 2))
    which = rng.integers(0, 3, 9)
    count = spline_count(side)
    splines = rng.normal(0.0, 1.0, (3, count, count))
    found = Drawn.of(side, centre, splines, which, dtype)
    assert found.columns.dtype == dtype and found.columns.shape == (9, 3, side, side)
    x, by_x = spline_weights(side, centre[:, 0])
    y, by_y = spline_weights(side, centre[:, 1])
    for m in range(9):
        own = splines[which[m]]
        expected = np.stack([y[m] @ own @ x[m].T, y[m] @ own @ by_x[m].T, by_y[m] @ own @ x[m].T])
        np.testing.assert_allclose(
            found.columns[m], expected, atol=1e-10 if dtype is np.float64 else 1e-4
        )
    assert (found.light == np.maximum(found.columns[:, 0], 0.0)).all() and (found.light == 0).any()


@pytest.mark.parametrize("weighted", [False, True])
def test_sums_are_over_all_pixels_of_a_window(weighted):
    rng = np.random.default_rng(6)
    columns, reading = rng.normal(0.0, 1.0, (2, 3, 5, 5)), rng.normal(0.0, 1.0, (2, 5, 5))
    weight = rng.random((2, 5, 5)) if weighted else None
    found = Drawn(columns).sums(reading, weight)
    y, x = np.mgrid[-2:3, -2:3]
    for m in range(2):
        w = weight[m] if weighted else 1.0
        for i in range(3):
            assert found.reading[m, i] == pytest.approx((w * columns[m, i] * reading[m]).sum())
            for j in range(3):
                product = w * columns[m, i] * columns[m, j]
                assert found.normal[m, i, j] == pytest.approx(product.sum())
            for j, lever in enumerate((np.ones((5, 5)), x, y)):
                assert found.plane[m, i, j] == pytest.approx((w * columns[m, i] * lever).sum())


# What a shape tells of itself


@pytest.mark.parametrize(
    ("frames", "own"), [(1, 1.0), (23, 1.0), (24, 576 / 600), (100, 576 / 2500)]
)
def test_a_shape_brings_in_as_much_as_it_has_splines_for_the_pixels_that_made_it(frames, own):
    """24 x 24 splines, 5 x 5 pixels of each frame."""
    assert shape_of(frames=frames).own == pytest.approx(own)


@pytest.mark.parametrize("whole", [-3.0, 0.0, 7.0])
def test_an_error_is_told_for_eight_places_along_a_pixel(whole):
    shape = shape_of()
    part = (np.arange(8) + 0.5) / 8 - 0.5
    for k, x in enumerate(part):
        for n, y in enumerate(part):
            for nudge in (-0.06, 0.0, 0.06):
                at = np.array([[x + nudge + whole, y - nudge]])
                np.testing.assert_array_equal(shape.error_at(at)[0], shape.error[n, k])
    edge = shape.error_at(np.array([[0.4999, -0.5001], [np.nan, 0.1]]))
    np.testing.assert_array_equal(edge, shape.error[[7, 4], [7, 4]])


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("whole", [-2.0, 0.0, 5.0])
def test_a_place_is_beyond_what_frames_tell_by_three_spreads_and_two_hundredths(axis, whole):
    shape = shape_of()
    limit = 0.02 + 3.0 * shape.spread[axis]
    for sign in (-1.0, 1.0):
        for share, beyond in ((-0.001, False), (0.001, True)):
            if limit + share > 0.5:
                continue
            at = shape.place.copy()
            at[axis] += whole + sign * (limit + share)
            assert shape.beyond(at[None]).tolist() == [beyond]
    still = shape_of(spread=(0.0, 0.0))
    for off, beyond in ((0.019, False), (0.021, True)):
        at = still.place.copy()
        at[axis] += off
        assert still.beyond(at[None]).tolist() == [beyond]


def test_shapes_are_the_same_where_all_their_numbers_are():
    one = shape_of()
    assert one == shape_of() and hash(one) == hash(shape_of()) and one != "shape"
    others = [
        shape_of(frames=21),
        shape_of(spread=(0.1, 0.21)),
        shape_of(place=(10.3, 20.7)),
        shape_of(error=np.zeros((8, 8, 2))),
        shape_of(coefficients=np.ones((24, 24))),
    ]
    assert len({one, *others}) == 6
    assert repr(one) == f"<SpotShape {one.digest}, 5 pixels, of 20 windows>"
    assert len(one.digest) == 12


@pytest.mark.parametrize(("side", "sigma"), [(9, 1.1), (21, 2.0), (65, 4.0)])
def test_the_width_of_a_shape_is_the_sigma_of_a_gaussian(side, sigma):
    assert shape_of(side, coefficients=gaussian(side, sigma)).width == pytest.approx(
        sigma, rel=0.01
    )


@pytest.mark.parametrize(("side", "least"), [(9, 0.8), (13, 0.8), (63, 1.6)])
def test_a_sharp_shape_tells_no_place_between_pixels(side, least):
    """0.8 pixels, and 1.6 knots."""
    for share, sharp in ((0.97, True), (1.03, False)):
        shape = shape_of(side)
        shape = replace(shape, coefficients=gaussian(side, share * least))
        shape = replace(
            shape, coefficients=gaussian(side, share * least * share * least / shape.width)
        )
        assert (shape.width < least) == sharp
        assert shape.beyond(np.stack([shape.place, shape.place + 5.0])).tolist() == [sharp] * 2


@pytest.mark.parametrize("finer", [1, 2, 3])
def test_a_shape_is_drawn_by_readings_between_its_pixels(finer):
    shape = shape_of(9, coefficients=np.random.default_rng(2).random((36, 36)))
    found = shape.image(finer)
    assert found.shape == (9 * finer, 9 * finer)
    off = (np.arange(finer) + 0.5) / finer - 0.5
    for i, down in enumerate(off):
        for j, right in enumerate(off):
            place = np.array([[-right, -down]])
            drawn = Drawn.of(9, place, shape.coefficients[None], np.zeros(1, int), np.float64)
            np.testing.assert_allclose(found[i::finer, j::finer], drawn.columns[0, 0], atol=1e-9)
