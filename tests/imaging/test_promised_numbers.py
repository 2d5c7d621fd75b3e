"""Numbers that the docstrings of imaging promise, from either side."""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.display import with_error
from losbench.imaging.background import inverse_normal
from losbench.imaging.hotpixels import gate_hot_pixels
from losbench.imaging.sizes import spot_sigma
from losbench.imaging.smeared.cutting import cut_windows

SHAPE = (60, 80)


def spot(xy, flux=3e4, sigma=2.0):
    return (lb.render_spots([xy], flux, sigma, SHAPE) + 100.0).astype(np.float32)


def flags(found):
    return lb.SpotFlag(int(found.flags.ravel()[0]))


@pytest.mark.parametrize(("times", "faint"), [(4.8, True), (5.2, False)])
@pytest.mark.parametrize("read_noise_e", [5.0, 20.0])
def test_too_faint_is_below_five_times_the_error_of_the_flux(times, faint, read_noise_e):
    """Of a sum over N x N pixels: F = k sigma with sigma^2 = N^2 r^2 + F, if gain is one."""
    n, k = 13, times
    flux = (k**2 + np.sqrt(k**4 + 4 * k**2 * (n * read_noise_e) ** 2)) / 2
    frame = (lb.render_spots([[40, 30]], flux, 1.5, SHAPE) + 100.0).astype(np.float32)
    detector = lb.Detector(gain_e_per_dn=1.0, read_noise_e=read_noise_e, offset_dn=100.0)
    method = lb.Grey(window=n, centre="start")
    found = lb.centroid(
        frame, [[40, 30]], method=method, background=lb.Level(100.0), detector=detector
    )
    assert found.flux == pytest.approx(flux, rel=1e-3)
    assert (lb.SpotFlag.TOO_FAINT in flags(found)) == faint
    assert np.isnan(found.xy).all() == faint


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
@pytest.mark.parametrize(
    ("away", "edge", "measured"), [(4, True, False), (7.2, True, True), (11, False, True)]
)
def test_a_window_or_a_ring_beyond_the_frame_is_flagged_on_all_four_sides(
    side, away, edge, measured
):
    xy = {
        "left": (away, 30.0),
        "right": (79.0 - away, 30.0),
        "top": (40.0, away),
        "bottom": (40.0, 59.0 - away),
    }[side]
    found = lb.centroid(spot(xy), [xy], window=13)
    assert (lb.SpotFlag.EDGE in flags(found)) == edge
    assert np.isfinite(found.xy).all() == measured


def test_a_hot_pixel_exceeds_twice_the_median_by_five_sigma():
    stamp = np.full((1, 9, 9), 40.0)
    for level, gated in ((2 * 40.0 + 4.9 * 3.0, False), (2 * 40.0 + 5.1 * 3.0, True)):
        stamp[0, 4, 5] = level
        found = gate_hot_pixels(stamp, np.array([3.0]))[0, 4, 5]
        assert found == (40.0 if gated else level)
    below = np.full((1, 9, 9), -40.0)
    below[0, 4, 5] = 14.0
    np.testing.assert_array_equal(gate_hot_pixels(below, np.array([3.0])), below)
    stamp[0, 0, 4] = 1e4
    assert gate_hot_pixels(stamp, np.array([3.0]))[0, 0, 4] == 1e4, "the border is left as it is"


@pytest.mark.parametrize("step", [(0, 1), (0, -1), (1, 0), (-1, 0)])
def test_a_lone_pixel_is_judged_by_the_four_that_touch_it(step):
    """Hot below 0.3 of its light in the four; the neighbour itself stays below the threshold of 8."""
    sky = np.random.default_rng(4).standard_normal((64, 64))
    sky[30:37, 30:37] = 0.0
    for share, light in ((0.25, 0), (0.35, 1)):
        frame = sky.copy()
        frame[33, 33], frame[33 + step[0], 33 + step[1]] = 20.0, share * 20.0
        assert len(lb.find_spots(frame)) == light
        frame[33 + step[0], 33 + step[1]], frame[33 + 2 * step[0], 33 + 2 * step[1]] = 0.0, 7.0
        assert not len(lb.find_spots(frame)), "farther pixels do not count"


@pytest.mark.parametrize("sigma", [(3.0, 2.0), (2.0, 3.0)])
def test_the_width_of_a_spot_is_that_of_its_wider_axis(sigma):
    frame = lb.render_spots([[40.2, 30.4]], 1e5, sigma, SHAPE)
    assert spot_sigma(frame, [[40.0, 30.0]]) == pytest.approx(3.0, rel=0.06)


def test_theinverse_normal_matrix_is_numpy_s():
    x, y = np.random.default_rng(1).uniform(-9.0, 30.0, (2, 50, 40))
    one = np.ones_like(x)
    sums = np.stack([v.sum(axis=1) for v in (one, x, y, x * x, x * y, y * y)], axis=1)
    basis = np.stack([one, x, y], axis=-1)
    expected = np.linalg.inv(np.swapaxes(basis, 1, 2) @ basis)
    np.testing.assert_allclose(inverse_normal(sums), expected, rtol=1e-5, atol=1e-9)


def test_a_template_is_at_least_a_tenth_of_a_pixel_wide():
    assert lb.Weighted(0.1).width == 0.1
    assert lb.Weighted([[0.1, 2.0]]).width == ((0.1, 2.0),)
    for width in (0.099, [2.0, 0.099], [[2.0, 2.0], [2.0, 0.099]]):
        with pytest.raises(ValueError, match="of at least 0.1 pixels"):
            lb.Weighted(width)


@pytest.mark.parametrize("kind", [lb.Weighted, lb.Gaussian, lb.EIWA])
def test_one_iteration_is_allowed_and_none_is_not(kind):
    assert kind(max_iter=1).max_iter == 1
    with pytest.raises(ValueError, match="max_iter must be a whole number of at least 1, got 0"):
        kind(max_iter=0)


@pytest.mark.parametrize("kind", [lb.Weighted, lb.EIWA])
def test_no_tolerance_is_below_a_millionth_of_a_millionth(kind):
    assert kind(tolerance=1e-12).tolerance == 1e-12
    with pytest.raises(ValueError, match="tolerance must be a finite number"):
        kind(tolerance=0.9e-12)


def test_centroids_show_x_beside_y():
    html = lb.centroid(spot((40.0, 30.0)), [[40, 30]], window=13)._repr_html_()
    assert html.index("40.0") < html.index("30.0")


@pytest.mark.parametrize(("frames", "note"), [(1, ""), (2, "; frame 0")])
def test_centroids_show_each_coordinate_with_its_own_error(frames, note):
    """Of the first frame, and say so where there are more."""
    found = lb.centroid(np.stack([spot((40.0, 30.0))] * frames), [[40, 30], [45, 30]], window=13)
    xy = np.arange(4.0 * frames).reshape(frames, 2, 2) + 10.25
    sigma = 10.0 ** -np.arange(1.0, 5.0)[: 2 * 2].reshape(2, 2) * np.ones((frames, 1, 1))
    html = replace(found, xy=xy, sigma_xy=sigma)._repr_html_()
    shown = [with_error(*pair) for pair in zip(xy[0].ravel(), sigma[0].ravel(), strict=True)]
    places = [html.index(each) for each in shown]
    assert len(set(shown)) == 4 and places == sorted(places)
    assert f"2 spots in {frames} frames, window 13 px{note}<" in html


@pytest.mark.parametrize(
    ("apart", "near"), [((12.9, 0.0), True), ((13.0, 0.0), False), ((12.0, 5.0), False)]
)
def test_a_neighbour_is_nearer_than_one_window(apart, near):
    frame = spot((25.0, 30.0))  # a start tells of a neighbour that the image does not show
    found = lb.centroid(frame, [[25.0, 30.0], np.add((25.0, 30.0), apart)], window=13)
    assert (lb.SpotFlag.NEIGHBOUR in flags(found)) == near


def test_a_neighbour_is_one_of_the_same_frame():
    one, beside, other = (25.0, 30.0), (33.0, 30.0), (45.0, 30.0)
    starts = [[one, other], [one, beside], [other, one]]
    found = lb.centroid(np.stack([spot(one)] * 3), starts, window=13)
    near = found.flags & lb.SpotFlag.NEIGHBOUR > 0
    assert near.tolist() == [[False, False], [True, True], [False, False]]


@pytest.mark.parametrize(("outside", "inside"), [(0.6, False), (0.4, True)])
@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_a_star_is_in_the_frame_as_far_as_its_pixels_reach(side, outside, inside):
    camera = lb.Camera(focal_mm=100.0, pixel_um=10.0, shape=SHAPE)
    path = lb.motion_path(
        lb.Vibration(amplitude_rad_s=np.zeros((1, 3)), frequency_hz=1.0, phase_rad=0.0), 0.01
    )
    xy = {
        "left": (-outside, 30.0),
        "right": (79.0 + outside, 30.0),
        "top": (40.0, -outside),
        "bottom": (40.0, 59.0 + outside),
    }[side]
    cut = cut_windows(
        np.ones(SHAPE), [xy], window=5, path=path, camera=camera, sigma=np.array([0.5, 0.5])
    )
    assert np.isfinite(cut.pixels).any() == inside


@pytest.mark.parametrize(("top", "saturated"), [(999.0, False), (1000.0, True), (1001.0, True)])
def test_saturation_begins_at_full_scale(top, saturated):
    frame = spot((40.0, 30.0), flux=3e3)
    frame[30, 40] = top
    found = lb.centroid(frame, [[40, 30]], window=13, full_scale_dn=1000.0)
    assert (lb.SpotFlag.SATURATED in flags(found)) == saturated
