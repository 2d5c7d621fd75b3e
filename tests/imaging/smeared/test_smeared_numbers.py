"""Smeared stars step by step: windows, model and solvers against loops, differences and least squares
written out, and flags from either side."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.imaging.smeared.cutting import Cut, _window, cut_windows, take_windows
from losbench.imaging.smeared.joint import _normal_equations, _solved, solve_jointly
from losbench.imaging.smeared.measuring import Scene, _blocks, _crowded, _flags
from losbench.imaging.smeared.methods import METHODS
from losbench.imaging.smeared.model import StreakModel, carried
from losbench.imaging.smeared.solvers import (
    Region,
    Solution,
    Stop,
    _gauss_newton,
    _response,
    closed_form,
    iterate,
    least_squares,
)
from losbench.imaging.smeared.windows import Windows, centre_covariance, grey_centre, prepare

RNG = np.random.default_rng(77)
CAMERA = lb.Camera(focal_mm=36.6, pixel_um=10.0, shape=(120, 140))
DETECTOR = lb.Detector(gain_e_per_dn=1.5, read_noise_e=6.0, offset_dn=100.0, bits=12)
SIGMA = np.array([0.7, 0.9])
SHAPE = (11, 13)


def a_path(rate=(0.02, 0.03, 0.0)):
    return lb.motion_path(lb.Vibration(constant_rad_s=list(rate)), 0.025)


PATH = a_path()
STARS = np.array([[40.3, 50.2], [90.8, 30.4], [70.1, 80.9]])


def model_of(stars=STARS, path=PATH, sigma=SIGMA, shape=SHAPE):
    tracks = path.tracks(stars, CAMERA)
    origin = np.rint(tracks.mean(axis=-2)) - np.array(shape[::-1]) // 2
    one = replace(path, turns=path.turns[None], epochs=path.epochs[None])
    return StreakModel.of(one, np.zeros(len(stars), int), CAMERA, sigma, origin, shape)


def data_of(light, origin, *, used=None, dark=4.0, shot=0.0):
    count = len(light)
    used = np.ones(light.shape, bool) if used is None else used
    none = np.zeros(count, bool)
    level = np.zeros(count)
    return Windows(
        np.where(used, light, 0.0), used, origin, level, level + dark, shot, none, none, none
    )


def places_of(shape):
    y, x = np.indices(shape)
    return x, y


# Windows


@pytest.mark.parametrize("shape", [(5, 7), (6, 4)])
def test_moments_are_about_the_middle_of_a_window(shape):
    light = RNG.random((2, *shape))
    data = data_of(light, np.zeros((2, 2)))
    x, y = places_of(shape)
    x, y = x - (shape[1] - 1) / 2, y - (shape[0] - 1) / 2
    for k in range(2):
        expected = [(light[k] * part).sum() for part in (1.0 + 0 * x, x, y, x * x, y * y, x * y)]
        np.testing.assert_allclose(data.moments[k], expected)
    np.testing.assert_allclose(data.flux, light.sum(axis=(1, 2)))
    origin = np.array([[3.0, 5.0], [-2.0, 40.0]])
    x, y = places_of(shape)
    for found, at, image in zip(grey_centre(light, origin), origin, light, strict=True):
        grey = np.array([(image * x).sum(), (image * y).sum()]) / image.sum()
        np.testing.assert_allclose(found, grey + at)
    assert np.isnan(grey_centre(np.zeros((1, *shape)), origin[:1])).all()


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("unit", [1e-3, 1.0])
def test_errors_of_flux_and_centre_are_sums_over_the_pixels_that_count(masked, unit):
    light = unit * (RNG.random((3, 5, 7)) + 0.5)
    used = RNG.random((3, 5, 7)) < 0.8 if masked else np.ones((3, 5, 7), bool)
    origin = np.array([[3.0, 5.0], [-2.0, 40.0], [0.0, 0.0]])
    data = data_of(light, origin, used=used, dark=np.array([0.3, 0.7, 0.1]), shot=0.25)
    centre, cov = centre_covariance(data)
    x, y = places_of((5, 7))
    for k in range(3):
        variance = used[k] * (data.dark_variance[k] + 0.25 * data.light[k])
        flux = data.light[k].sum()
        assert data.flux_error[k] == pytest.approx(np.sqrt(variance.sum()))
        at = centre[k] - origin[k]
        np.testing.assert_allclose(at, grey_centre(data.light, origin)[k] - origin[k])
        arms = np.stack([(x - at[0]).ravel(), (y - at[1]).ravel()])
        np.testing.assert_allclose(cov[k], (arms * variance.ravel()) @ arms.T / flux**2)
    dark = data_of(-light, origin, shot=0.25)
    np.testing.assert_allclose(dark.flux_error, np.sqrt(4.0 * 35))
    assert np.isnan(centre_covariance(dark)[0]).all()


def test_weights_are_inverse_variances_or_one_where_no_noise_is_known():
    light = RNG.random((2, 5, 7))
    used = RNG.random((2, 5, 7)) < 0.8
    data = data_of(light, np.zeros((2, 2)), used=used, dark=np.array([0.3, 0.7]), shot=0.25)
    variance = np.array([0.3, 0.7])[:, None, None] + 0.25 * light
    np.testing.assert_allclose(data.weight(light), used / variance)
    silent = data_of(light, np.zeros((2, 2)), used=used, dark=0.0)
    np.testing.assert_allclose(silent.weight(light), used)


def test_parts_of_windows_count():
    light = RNG.random((3, 5, 7))
    data = data_of(light, np.arange(6.0).reshape(3, 2))
    above = data.above(0.02)
    np.testing.assert_array_equal(above.used, light > 0.02 * light.sum(axis=(1, 2), keepdims=True))
    np.testing.assert_array_equal(above.light, np.where(above.used, light, 0.0))
    some = data.only(np.array([True, False, True]))
    assert some.used.any(axis=(1, 2)).tolist() == [True, False, True] and not some.light[1].any()
    assert some.missing.tolist() == [False, True, False]
    assert data.keep(np.array([2])).origin.tolist() == [[4.0, 5.0]]
    assert data.whole and not above.whole


@pytest.mark.parametrize("detector", [None, DETECTOR])
@pytest.mark.parametrize("background", [None, np.array([130.0, 90.0])])
def test_windows_lose_their_background_and_know_their_noise(detector, background):
    """That of the outermost pixels, if nobody tells: median, and 1.4826 MAD."""
    pixels = RNG.normal(140.0, 3.0, (2, 7, 9))
    found = prepare(
        pixels, np.zeros((2, 2)), background=background, detector=detector, full_scale=1e4
    )
    border = np.ones((7, 9), bool)
    border[1:-1, 1:-1] = False
    edge = pixels[:, border]
    level = np.median(edge, axis=1) if background is None else background
    np.testing.assert_allclose(found.background, level)
    np.testing.assert_allclose(found.light, pixels - level[:, None, None])
    assert found.whole and not (found.saturated | found.incomplete | found.missing).any()
    if detector is None:
        away = np.abs(edge - np.median(edge, axis=1)[:, None])
        scatter = 1.482602218505602 * np.median(away, axis=1)
        np.testing.assert_allclose(found.dark_variance, scatter**2)
        assert found.shot_variance == 0.0
    else:
        read = (6.0 / 1.5) ** 2 + 1.0 / 12.0
        expected = np.maximum((level - 100.0) / 1.5, 0.0) + read
        np.testing.assert_allclose(found.dark_variance, expected)
        assert found.shot_variance == pytest.approx(1.0 / 1.5)


def test_pixels_at_full_scale_and_those_not_read_do_not_count():
    pixels = RNG.normal(140.0, 3.0, (5, 7, 9))
    pixels[1, 3, 4], pixels[2, 2, 5], pixels[3] = 1000.0, np.nan, np.nan
    pixels[4, 0, 0], pixels[4, 3, 4] = np.nan, 1000.1
    given = {"detector": DETECTOR, "full_scale": 1000.0}
    found = prepare(pixels, np.zeros((5, 2)), background=None, **given)
    assert found.saturated.tolist() == [False, True, False, False, True]
    assert found.incomplete.tolist() == [False, False, True, True, True]
    assert found.missing.tolist() == [False, False, False, True, False]
    assert found.used.sum(axis=(1, 2)).tolist() == [63, 62, 62, 0, 61]
    assert not found.light[~found.used].any() and np.isfinite(found.light).all()
    assert found.background[3] == 0.0
    border = np.concatenate([pixels[4, 0], pixels[4, -1], pixels[4, 1:-1, 0], pixels[4, 1:-1, -1]])
    assert found.background[4] == pytest.approx(np.nanmedian(border))
    for k in range(5):  # alone, a window takes no longer way than it has to
        alone = prepare(pixels[k : k + 1], np.zeros((1, 2)), background=np.full(1, 120.0), **given)
        for name in ("saturated", "incomplete", "missing"):
            assert getattr(alone, name)[0] == getattr(found, name)[k]
        np.testing.assert_array_equal(alone.used[0], found.used[k])
    below = prepare(np.full((1, 7, 9), 999.9), np.zeros((1, 2)), background=np.zeros(1), **given)
    assert below.whole and not below.saturated.any()


# Windows cut out, or given


@pytest.mark.parametrize("tilt", [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_a_window_holds_the_longest_track_and_five_sigma_wherever_it_begins(tilt):
    """The longest begins in a corner of the frame."""
    path = a_path((0.02 * tilt[0], 0.02 * tilt[1], 2.0))
    corners = [[0.0, 0.0], [139.0, 0.0], [0.0, 119.0], [139.0, 119.0]]
    half = np.ptp(path.tracks(corners, CAMERA), axis=-2).max() / 2
    for over, more in ((-1e-6, 0), (1e-6, 1)):
        sigma = (10.0 - 0.5 - half + over) / 5.0
        assert _window(path, CAMERA, np.array([sigma, 0.5 * sigma])) == 2 * (10 + more) + 1
    assert _window(PATH, CAMERA, np.array([40.0, 40.0])) == 119  # what fits into the frame
    odd = replace(CAMERA, shape=(121, 140))
    assert _window(PATH, odd, np.array([40.0, 40.0])) == 121


def test_windows_are_cut_around_the_nearest_pixel_of_each_image():
    frames = RNG.random((2, 120, 140))
    start = np.array([[40.4, 50.6], [139.4, 3.0], [-0.6, 3.0]])
    cut = cut_windows(frames, start, window=5, path=PATH, camera=CAMERA, sigma=SIGMA)
    assert (cut.batch, cut.stars, cut.pixels.shape) == ((2,), 3, (6, 5, 5))
    assert cut.image.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_array_equal(cut.pixels[0], frames[0, 49:54, 38:43])
    np.testing.assert_array_equal(cut.pixels[3], frames[1, 49:54, 38:43])
    assert cut.origin[0].tolist() == [38.0, 49.0] and cut.origin[1].tolist() == [137.0, 1.0]
    np.testing.assert_array_equal(cut.pixels[1][:, :3], frames[0, 1:6, 137:])
    assert np.isnan(cut.pixels[1][:, 3:]).all() and np.isnan(cut.pixels[2]).all()
    with pytest.raises(ValueError, match="window must be"):
        cut_windows(frames, start, window=1, path=PATH, camera=CAMERA, sigma=SIGMA)
    least = cut_windows(frames, start, window=3, path=PATH, camera=CAMERA, sigma=SIGMA)
    assert least.pixels.shape == (6, 3, 3)
    small = replace(CAMERA, shape=(9, 11))
    told = "window of 11 x 11 pixels does not fit into frames of 9 x 11"
    with pytest.raises(ValueError, match=told):
        cut_windows(np.ones((9, 11)), start, window=11, path=PATH, camera=small, sigma=SIGMA)
    assert cut_windows(np.ones((9, 11)), start, window=9, path=PATH, camera=small, sigma=SIGMA)


def test_windows_that_are_given_keep_their_order():
    windows = RNG.random((2, 3, 5, 7))
    origin = RNG.integers(0, 90, (2, 3, 2))
    cut = take_windows(windows, origin)
    assert (cut.batch, cut.stars) == ((2,), 3)
    np.testing.assert_array_equal(cut.pixels, windows.reshape(6, 5, 7))
    np.testing.assert_array_equal(cut.origin, origin.reshape(6, 2))
    empty = take_windows(np.zeros((0, 5, 7)), np.zeros((0, 2)))
    assert empty.image.shape == (0,) and empty.stars == 0
    with pytest.raises(ValueError, match="origin must"):
        take_windows(windows, np.where(origin > 0, origin, np.nan) * np.nan)


# The model


def test_images_are_those_of_render_streaks():
    model = model_of()
    tracks = model.tracks(STARS)
    np.testing.assert_allclose(tracks, PATH.tracks(STARS, CAMERA), atol=1e-9)
    expected = lb.render_streaks(tracks[:, None], PATH.share, 1.0, SIGMA, SHAPE, model.origin)
    np.testing.assert_allclose(model.images(tracks), expected.reshape(3, *SHAPE), atol=1e-12)
    centres = grey_centre(model.images(tracks), model.origin)
    np.testing.assert_allclose(model.centres(tracks), centres, atol=1e-9)


def test_a_star_at_the_edge_of_its_window_has_the_centre_of_what_is_in_it():
    model = model_of()
    moved = STARS + np.array([[5.5, -4.0], [-6.0, 3.0], [0.0, 5.0]])
    tracks = model.tracks(moved)
    centres = grey_centre(model.images(tracks), model.origin)
    np.testing.assert_allclose(model.centres(tracks), centres, atol=1e-9)


def test_gradients_are_differences_of_images_of_tracks_that_move():
    model, h = model_of(), 1e-5
    tracks = model.tracks(STARS)
    weight = PATH.share * RNG.random(len(PATH.share))
    for seen, share in (
        (model.gradient(tracks), PATH.share),
        (model.moments(tracks, weight), weight),
    ):
        shared = replace(model, share=share)
        np.testing.assert_allclose(seen.image, shared.images(tracks), atol=1e-12)
        for axis, slope in enumerate((seen.by_x, seen.by_y)):
            step = h * np.eye(2)[axis]
            ends = shared.images(tracks + step) - shared.images(tracks - step)
            np.testing.assert_allclose(slope, ends / (2 * h), atol=1e-8)


def test_positions_are_carried_as_the_path_does():
    turns = np.broadcast_to(PATH.epochs[2], (3, 3, 3))
    np.testing.assert_allclose(carried(CAMERA, STARS, turns), PATH.carry(STARS, CAMERA), atol=1e-9)
    kept = model_of().keep(np.array([2]))
    np.testing.assert_allclose(kept.tracks(STARS[2:]), PATH.tracks(STARS[2:], CAMERA), atol=1e-9)


# Solvers


FLUX = np.array([3e3, 8e3, 5e3])


def noiseless(model=None, flux=FLUX, used=None, **noise):
    model = model or model_of()
    light = model.images(model.tracks(STARS)) * flux[:, None, None]
    return model, data_of(light, model.origin, used=used, **noise)


def first_of(model, data):
    back = np.broadcast_to(PATH.mean_back, (len(data.light), 3, 3))
    return closed_form(data, CAMERA, back)


def test_the_closed_form_takes_the_measured_centre_back_to_the_start():
    model, data = noiseless(shot=0.5)
    found = first_of(model, data)
    np.testing.assert_allclose(found.xy, STARS, atol=0.02)
    np.testing.assert_allclose(found.cov, centre_covariance(data)[1])
    np.testing.assert_allclose(found.flux, FLUX, rtol=1e-3)
    assert found.n_iter.tolist() == [1, 1, 1] and found.converged.all()
    dark = first_of(model, replace(data, light=0.0 * data.light))
    assert np.isnan(dark.xy).all() and not dark.converged.any()


def solution_at(xy, flux=FLUX, converged=True):
    count = len(xy)
    return Solution(
        np.array(xy),
        np.tile(np.eye(2), (count, 1, 1)),
        np.array(flux),
        np.ones(count, int),
        np.full(count, converged),
    )


@pytest.mark.parametrize("counts", ["all", "some", "own"])
@pytest.mark.parametrize("damping", [1.0, 0.5])
def test_a_round_moves_by_the_difference_of_centres_and_at_most_a_pixel(counts, damping):
    used = np.ones((3, *SHAPE), bool)
    if counts == "some":
        used[:, 3:6, 7] = used[:, 0, 0] = False
    model, data = noiseless(used=used)
    begin = STARS + np.array([[0.3, -0.2], [2.5, 0.1], [0.0, -1.6]])
    region = Region(used, 0.02) if counts == "own" else Region(used)
    found = iterate(model, data, region, Stop(1e-6, 1), solution_at(begin), damping=damping)
    image = model.images(model.tracks(begin)) * used
    if counts == "own":
        image = np.where(image > 0.02, image, 0.0)
    step = grey_centre(data.light, data.origin) - grey_centre(image, model.origin)
    np.testing.assert_allclose(found.xy, begin + damping * np.clip(step, -1.0, 1.0), atol=1e-9)
    assert found.n_iter.tolist() == [2, 2, 2] and not found.converged.any()
    if counts == "own":
        return
    whole = iterate(model, data, region, Stop(1e-9, 80), solution_at(begin), damping=damping)
    np.testing.assert_allclose(whole.xy, STARS, atol=1e-7)
    assert whole.converged.all()


def test_a_star_that_has_settled_is_dropped_and_one_that_began_nowhere_is_left():
    model, data = noiseless()
    begin = np.where(np.arange(3)[:, None] == 1, np.nan, STARS)
    start = replace(solution_at(begin), converged=np.array([True, False, True]))
    found = iterate(model, data, Region(data.used), Stop(1e-3, 9), start, damping=1.0)
    assert found.n_iter.tolist() == [2, 1, 2] and found.converged.tolist() == [True, False, True]
    far = solution_at(STARS + np.array([[0.9, 0.0], [0.0, 0.0], [0.0, 0.4]]))
    found = iterate(model, data, Region(data.used), Stop(1e-3, 99), far, damping=1.0)
    assert found.n_iter[1] == 2 and (found.n_iter[[0, 2]] > 2).all() and found.converged.all()
    np.testing.assert_allclose(found.xy, STARS, atol=1e-3)


@pytest.mark.parametrize("off", [0.9, 1.1])
def test_a_round_below_the_tolerance_is_the_last(off):
    model, data = noiseless()
    begin = STARS + np.array([0.01, 0.0])
    image = model.images(model.tracks(begin))
    step = np.abs(grey_centre(data.light, data.origin) - grey_centre(image, model.origin)).max()
    stop = Stop(step / off, 1)
    found = iterate(model, data, Region(data.used), stop, solution_at(begin), damping=1.0)
    assert found.converged.all() == (off < 1.0)


def test_a_centre_that_follows_poorly_has_a_larger_error():
    used = np.ones((3, *SHAPE), bool)
    used[:, :, 6:9] = False
    model, data = noiseless(used=used)
    first = solution_at(STARS)
    region = Region(used)
    found = iterate(model, data, region, Stop(1e-9, 60), first, damping=1.0)
    h, response = 1e-5, np.empty((3, 2, 2))
    for axis in (0, 1):
        ends = [
            grey_centre(
                model.images(model.tracks(STARS + sign * h * np.eye(2)[axis])) * used, model.origin
            )
            for sign in (1, -1)
        ]
        response[:, :, axis] = (ends[0] - ends[1]) / (2 * h)
    told, part = _response(model, region, STARS)
    np.testing.assert_allclose(told, response, atol=1e-3)
    np.testing.assert_allclose(part, (model.images(model.tracks(STARS)) * used).sum(axis=(1, 2)))
    inverse = np.linalg.inv(told)
    np.testing.assert_allclose(found.cov, inverse @ np.swapaxes(inverse, 1, 2), rtol=1e-6)
    np.testing.assert_allclose(found.flux, FLUX / part, rtol=1e-6)


def test_a_region_of_the_model_s_own_is_above_a_part_of_its_light():
    image = RNG.random((2, 4, 5))
    used = RNG.random((2, 4, 5)) < 0.7
    values = RNG.random((2, 4, 5))
    own = Region(used, 0.4)
    np.testing.assert_array_equal(own.of(image), np.where(used & (image > 0.4), image, 0.0))
    np.testing.assert_array_equal(
        own.of(values, image), np.where(used & (image > 0.4), values, 0.0)
    )
    assert not own.whole and not Region(used).whole and Region(np.ones((1, 2, 2), bool)).whole
    assert not Region(np.ones((1, 2, 2), bool), 0.0).whole
    assert own.keep(np.array([1])).own_part == 0.4
    np.testing.assert_array_equal(own.keep(np.array([1])).used, used[1:])


def test_a_centre_that_does_not_follow_has_no_response():
    model = model_of(sigma=np.array([1e-3, 1e-3]), path=a_path((0.0, 0.0, 0.0)))
    response, light = _response(model, Region(np.ones((3, *SHAPE), bool)), STARS)
    assert np.isnan(response).all() and np.isfinite(light).all()
    _, light = _response(model, Region(np.zeros((3, *SHAPE), bool)), STARS)
    assert np.isnan(light).all()
    hardly = model_of(np.round(STARS), a_path((0.0, 0.0, 0.0)), np.array([0.14, 0.14]))
    response, _ = _response(hardly, Region(np.ones((3, *SHAPE), bool)), np.round(STARS))
    assert (np.linalg.det(response) < 1e-4).all() and (np.linalg.det(response) > 1e-6).all()


def test_a_gauss_newton_step_is_weighted_least_squares():
    model = model_of()
    seen = model.gradient(model.tracks(STARS))
    light = RNG.random((3, *SHAPE))
    weight = RNG.random((3, *SHAPE))
    step, inverse = _gauss_newton(seen, light, weight, FLUX)
    for k in range(3):
        columns = np.stack(
            [FLUX[k] * seen.by_x[k].ravel(), FLUX[k] * seen.by_y[k].ravel(), seen.image[k].ravel()],
            axis=-1,
        )
        root = np.sqrt(weight[k].ravel())
        rest = light[k].ravel() - FLUX[k] * seen.image[k].ravel()
        expected = np.linalg.lstsq(columns * root[:, None], rest * root, rcond=None)[0]
        np.testing.assert_allclose(step[k], expected, rtol=1e-6)
        normal = (columns * root[:, None]).T @ (columns * root[:, None])
        np.testing.assert_allclose(inverse[k], np.linalg.inv(normal), rtol=1e-6)
    blank = weight.copy()
    blank[1] = 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        again, told = _gauss_newton(seen, light, blank, FLUX)
    assert not again[1].any() and np.isnan(told[1]).all()
    np.testing.assert_allclose(again[[0, 2]], step[[0, 2]])


def test_least_squares_finds_place_and_flux_with_the_error_of_its_information():
    model, data = noiseless(shot=0.5)
    begin = solution_at(STARS + np.array([0.8, -0.6]), 0.5 * FLUX)
    found = least_squares(model, data, Stop(1e-9, 60), begin)
    np.testing.assert_allclose(found.xy, STARS, atol=1e-7)
    np.testing.assert_allclose(found.flux, FLUX, rtol=1e-7)
    assert found.converged.all()
    detector = lb.Detector(gain_e_per_dn=2.0, read_noise_e=2.0 * np.sqrt(4.0 - 1.0 / 12.0))
    bound = lb.streak_bound(STARS, FLUX, path=PATH, camera=CAMERA, width=SIGMA, detector=detector)
    error = np.sqrt(np.diagonal(found.cov, axis1=1, axis2=2))
    np.testing.assert_allclose(error, bound, rtol=2e-3)


def test_least_squares_moves_by_a_pixel_and_to_a_tenth_of_the_flux_at_a_time():
    model, data = noiseless()
    begin = solution_at(STARS + np.array([2.5, -2.5]), 1e3 * FLUX)
    found = least_squares(model, data, Stop(1e-9, 1), begin)
    assert np.abs(found.xy - begin.xy).max() <= 1.0 + 1e-12
    bright = least_squares(model, data, Stop(1e-9, 1), solution_at(STARS, 1e3 * FLUX))
    assert (bright.flux >= 99.9 * FLUX).all() or np.allclose(bright.flux, FLUX, rtol=1e-6)
    dark = replace(data, light=-data.light)
    found = least_squares(model, dark, Stop(1e-9, 1), solution_at(STARS, FLUX))
    np.testing.assert_allclose(found.flux, 0.1 * FLUX)
    there = least_squares(model, data, Stop(1e-3, 9), solution_at(STARS, 0.9 * FLUX))
    assert there.converged.all() and there.n_iter.tolist() == [1, 1, 1]  # the place has settled
    none = least_squares(model, data, Stop(1e-9, 9), solution_at(STARS, 0.0 * FLUX))
    assert not none.converged.any() and none.n_iter.tolist() == [0, 0, 0]
    assert np.isnan(none.cov).all()


def test_one_solution_stands_where_it_was_chosen_and_counts_the_rounds_of_both():
    one, other = solution_at(STARS), solution_at(STARS + 1.0, 2.0 * FLUX, converged=False)
    found = one.where(np.array([True, False, True]), other)
    np.testing.assert_array_equal(found.xy, STARS + np.array([[0.0], [1.0], [0.0]]))
    assert found.n_iter.tolist() == [1, 2, 1] and found.converged.tolist() == [True, False, True]
    np.testing.assert_array_equal(found.flux, FLUX * np.array([1.0, 2.0, 1.0]))


# All stars of an image


def jointly(turn, rate=(0.0, 0.0, 0.0), *, prior=np.inf, epoch_s=0.0, rounds=50):
    """Stars whose rays have turned by exp(turn + rate (t - epoch)) on top of the path."""
    since = PATH.time_s - epoch_s
    extra = Rotation.from_rotvec(np.array(turn) + since[:, None] * np.array(rate)).as_matrix()
    turns = np.broadcast_to(extra @ PATH.turns, (3, *PATH.turns.shape))
    expected = model_of()
    seen = replace(expected, turns=turns)
    light = seen.images(seen.tracks(STARS)) * FLUX[:, None, None]
    one = replace(PATH, turns=PATH.turns[None], epochs=PATH.epochs[None])
    stop = Stop(1e-7, rounds)
    data = data_of(light, expected.origin)
    return solve_jointly(expected, data, one, epoch_s, STARS[None], stop, rate_prior_rad_s=prior)


def test_stars_of_an_image_tell_the_turn_that_all_have_made():
    turn = (2e-5, -3e-5, 4e-4)
    found = jointly(turn, prior=0.0)
    np.testing.assert_allclose(found.turn_rad[0], turn, atol=1e-9)
    np.testing.assert_allclose(found.flux[0], FLUX, rtol=1e-4)
    assert found.converged.all() and np.abs(found.rate_rad_s).max() < 1e-12
    at, cov = found.positions(CAMERA, STARS[None])
    expected = CAMERA.pixels(lb.optics.camera.rotate(CAMERA.points_mm(STARS), np.array(turn)))
    np.testing.assert_allclose(at[0], expected, atol=1e-6)
    h = 1e-6
    slopes = np.stack(
        [
            (
                CAMERA.pixels(lb.optics.camera.rotate(CAMERA.points_mm(STARS), h * np.eye(3)[k]))
                - STARS
            )
            / h
            for k in range(3)
        ],
        axis=-1,
    )
    expected = slopes @ found.cov[0, :3, :3] @ np.swapaxes(slopes, 1, 2)
    np.testing.assert_allclose(cov[0], expected, rtol=0.02, atol=1e-12)


def test_a_rate_that_the_path_lacks_is_found_unless_it_is_known_to_be_none():
    rate = (0.004, -0.003, 0.02)
    found = jointly((0.0, 0.0, 0.0), rate)
    np.testing.assert_allclose(found.rate_rad_s[0], rate, rtol=1e-5)
    np.testing.assert_allclose(found.turn_rad[0], 0.0, atol=1e-9)
    pulled = jointly((0.0, 0.0, 0.0), rate, prior=1e-9)
    assert np.abs(pulled.rate_rad_s).max() < 1e-9
    half = jointly((0.0, 0.0, 0.0), rate, epoch_s=0.0125)
    np.testing.assert_allclose(half.rate_rad_s[0], rate, rtol=1e-5)
    np.testing.assert_allclose(half.turn_rad[0], 0.0, atol=1e-9)
    assert (np.diag(found.cov[0])[3:] > 0).all()


def test_a_prior_as_wide_as_the_error_pulls_half_of_the_way():
    rate = np.array([0.0, 0.0, 0.02])
    free = jointly((0.0, 0.0, 0.0), rate)
    error = np.sqrt(free.cov[0, 5, 5])
    held = jointly((0.0, 0.0, 0.0), rate, prior=error)
    assert held.rate_rad_s[0, 2] == pytest.approx(0.5 * rate[2], rel=0.05)
    assert held.cov[0, 5, 5] == pytest.approx(0.5 * error**2, rel=0.05)


def test_a_turn_of_one_round_moves_the_axis_by_a_pixel_at_most():
    far = np.array([2.5e-3, 0.0, 0.0])  # nine pixels
    found = jointly(far, prior=0.0, rounds=1)
    assert CAMERA.focal_px * np.linalg.norm(found.turn_rad[0]) == pytest.approx(1.0)
    assert found.n_iter.tolist() == [1] and not found.converged.any()
    near = jointly((1e-5, 0.0, 0.0), prior=0.0, rounds=1)
    np.testing.assert_allclose(near.turn_rad[0], (1e-5, 0.0, 0.0), atol=1e-7)


def test_the_normal_equations_are_those_of_all_pixels_without_what_the_fluxes_explain():
    """Turns and rates by differences of images; a star's flux is eliminated by least squares."""
    model, since = model_of(), PATH.time_s - 0.01
    flux = np.array([3e3, 8e3, 5e3])
    light = 1.1 * model.images(model.tracks(STARS)) * flux[:, None, None]
    light += RNG.normal(0.0, 2.0, light.shape)
    data = data_of(light, model.origin, dark=np.array([4.0, 9.0, 1.0]), shot=0.5)
    turns = np.broadcast_to(PATH.turns, (3, *PATH.turns.shape))
    normal, right, told = _normal_equations(model, data, turns, STARS[None], since, flux)
    h, left = 1e-7, np.zeros((6, 6))
    expected = np.zeros(6)
    for k in range(3):
        image = model.images(model.tracks(STARS))[k]
        root = np.sqrt(1.0 / (data.dark_variance[k] + 0.5 * flux[k] * image)).ravel()
        best = np.linalg.lstsq(root[:, None] * image.reshape(-1, 1), root * light[k].ravel())[0][0]
        assert told[k] == pytest.approx(best, rel=1e-9)
        columns = []
        for axis in range(6):
            ends = []
            for sign in (1, -1):
                small = sign * h * np.eye(3)[axis % 3] * (since[:, None] if axis > 2 else 1.0)
                moved = Rotation.from_rotvec(np.ones((len(since), 1)) * small).as_matrix()
                turned = replace(model, turns=np.broadcast_to(moved @ PATH.turns, turns.shape))
                ends.append(turned.images(turned.tracks(STARS))[k])
            columns.append(best * (ends[0] - ends[1]).ravel() / (2 * h))
        columns, shape = root[:, None] * np.stack(columns, axis=-1), root * image.ravel()
        columns -= np.outer(shape, shape @ columns) / (shape @ shape)
        left += columns.T @ columns
        expected += columns.T @ (root * (light[k] - best * image).ravel())
    scale = np.sqrt(np.outer(np.diag(left), np.diag(left)))
    # One ray stands for a whole track, which a rate about the axis sees.
    np.testing.assert_allclose(normal[0] / scale, left / scale, atol=0.05)
    np.testing.assert_allclose((normal[0] / scale)[:3, :3], (left / scale)[:3, :3], atol=1e-3)
    np.testing.assert_allclose(
        right[0] / np.sqrt(np.diag(left)), expected / np.sqrt(np.diag(left)), atol=0.3
    )


def test_what_leaves_a_turn_undetermined_is_told():
    rng = np.random.default_rng(3)
    half = rng.normal(0.0, 1.0, (2, 20, 6))
    half[1, :, 4] = half[1, :, 0]
    unit = 10.0 ** rng.integers(-5, 5, 6)
    normal = np.einsum("fki,fkj->fij", half * unit, half * unit)
    right = rng.normal(0.0, 1.0, (2, 6)) * unit
    step, inverse = _solved(normal, right)
    np.testing.assert_allclose(step[0], np.linalg.solve(normal[0], right[0]), rtol=1e-6)
    np.testing.assert_allclose(inverse[0], np.linalg.inv(normal[0]), rtol=1e-6)
    assert not step[1].any() and np.isnan(inverse[1]).all()
    dark, told = _solved(np.zeros((1, 6, 6)), np.zeros((1, 6)))
    assert not dark.any() and np.isnan(told).all()


# What is said of a star


def scene_of(stars=2, sigma=SIGMA, path=PATH):
    cut = Cut(np.ones((stars, *SHAPE)), np.zeros((stars, 2)), (), stars)
    return Scene(path, CAMERA, sigma, cut, None, np.inf)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("sigmas", "near"), [(5.9, True), (6.1, False)])
def test_tracks_meet_within_six_widths(axis, sigmas, near):
    low = np.array([[10.0, 10.0], [10.0, 10.0]])
    high = low + 3.0
    gap = sigmas * SIGMA[axis]
    low[1, axis], high[1, axis] = 13.0 + gap, 20.0
    scene = scene_of()
    boxes = np.stack([low, high], axis=1)
    assert _crowded(boxes, scene).tolist() == [near, near]
    assert _crowded(boxes[::-1], scene).tolist() == [near, near]
    images = replace(scene, cut=replace(scene.cut, batch=(3,)))
    apart = np.stack([boxes[0], boxes[0] + 90.0])
    found = _crowded(np.concatenate([apart, boxes, apart]), images)
    assert found.tolist() == [[False, False], [near, near], [False, False]]
    boxes[1] = np.nan
    assert not _crowded(boxes, scene).any()


def test_a_track_reaches_from_its_star_as_that_on_the_axis_does():
    scene = scene_of()
    boxes = scene.boxes(STARS[:2], np.zeros(2, int))
    tracks = PATH.tracks(STARS[:2], CAMERA)
    np.testing.assert_allclose(boxes[:, 0], tracks.min(axis=1), atol=2e-3)
    np.testing.assert_allclose(boxes[:, 1], tracks.max(axis=1), atol=2e-3)
    assert scene.shape == (2,)


def flagged(box, *, flux=1e4, converged=True, **states):
    scene = scene_of(1)
    low, high = np.array(box, float)
    data = data_of(np.ones((1, *SHAPE)), np.array([[40.0, 50.0]]), dark=4.0)
    data = replace(data, **{name: np.array([value]) for name, value in states.items()})
    boxes = np.array([[low, high]])
    return SpotFlag(int(_flags(scene, data, np.array([flux]), np.array([converged]), boxes)[0]))


@pytest.mark.parametrize(
    ("low", "high", "edge"),
    [
        ((45.0, 54.0), (46.0, 55.0), False),
        ((41.7, 54.0), (46.0, 55.0), False),  # 39.5 and 3 x 0.7
        ((41.5, 54.0), (46.0, 55.0), True),
        ((45.0, 52.3), (46.0, 55.0), False),  # 49.5 and 3 x 0.9
        ((45.0, 52.1), (46.0, 55.0), True),
        ((45.0, 54.0), (50.3, 55.0), False),  # 52.5 less 2.1
        ((45.0, 54.0), (50.5, 55.0), True),
        ((45.0, 54.0), (46.0, 57.7), False),  # 60.5 less 2.7
        ((45.0, 54.0), (46.0, 57.9), True),
    ],
)
def test_a_window_holds_a_track_with_three_widths_around_it(low, high, edge):
    assert flagged((low, high)) == (SpotFlag.EDGE if edge else SpotFlag(0))


@pytest.mark.parametrize(
    ("low", "high", "edge"),
    [
        ((-0.4, 60.0), (3.0, 61.0), False),
        ((-0.6, 60.0), (3.0, 61.0), True),
        ((60.0, -0.4), (61.0, 3.0), False),
        ((60.0, -0.6), (61.0, 3.0), True),
        ((60.0, 60.0), (139.4, 61.0), False),
        ((60.0, 60.0), (139.6, 61.0), True),
        ((60.0, 60.0), (61.0, 119.4), False),
        ((60.0, 60.0), (61.0, 119.6), True),
    ],
)
def test_a_track_leaves_the_frame_where_its_pixels_end(low, high, edge):
    scene = scene_of(1, sigma=np.array([1e-3, 1e-3]))
    data = data_of(np.ones((1, 400, 400)), np.array([[-150.0, -150.0]]))
    boxes = np.array([[low, high]])
    found = _flags(scene, data, np.array([1e6]), np.array([True]), boxes)
    assert found.tolist() == [SpotFlag.EDGE if edge else 0]


def test_flags_of_a_star_say_what_was_seen():
    box = ((45.0, 54.0), (46.0, 55.0))
    error = np.sqrt(4.0 * 11 * 13)
    assert flagged(box, flux=5.05 * error) == SpotFlag(0)
    assert flagged(box, flux=4.95 * error) == SpotFlag.TOO_FAINT
    assert flagged(box, flux=np.nan) == SpotFlag.TOO_FAINT
    assert flagged(box, converged=False) == SpotFlag.NOT_CONVERGED
    nowhere = ((np.nan, np.nan), (np.nan, np.nan))
    assert flagged(nowhere, converged=False, flux=0.0) == SpotFlag.TOO_FAINT
    assert flagged(box, saturated=True) == SpotFlag.SATURATED
    assert flagged(box, incomplete=True) == SpotFlag.EDGE
    missing = {"missing": True, "incomplete": True, "flux": 0.0, "converged": False}
    assert flagged(nowhere, **missing) == SpotFlag.MISSING


@pytest.mark.parametrize(("count", "sizes"), [(0, [0]), (3, [3]), (4, [4]), (9, [4, 4, 1])])
def test_blocks_cover_all_and_there_is_always_one(count, sizes):
    parts = list(_blocks(count, 4))
    assert [part.stop - part.start for part in parts] == sizes
    assert parts[0].start == 0 and parts[-1].stop == count


@pytest.mark.parametrize(("width", "slow"), [(0.24, True), (0.26, False)])
@pytest.mark.parametrize("method", ["iterative", "closed_form", "least_squares", "joint"])
def test_widths_below_a_quarter_of_a_pixel_are_slow_to_iterate(width, slow, method):
    stars = np.array([[40.0, 50.0], [90.0, 30.0]])
    frame = lb.render_streaks(PATH.tracks(stars, CAMERA), PATH.share, 3e4, 0.7, CAMERA.shape)
    found = lb.aided_centroid(
        frame,
        stars,
        path=PATH,
        camera=CAMERA,
        width=(width, 0.7),
        method=method,
        max_iter=200,
        tolerance=0.9,
        **({"predicted": stars} if method == "joint" else {}),
    )
    assert (found.flags & SpotFlag.SLOW > 0).all() == (slow and method == "iterative")


def test_full_scale_is_told_or_that_of_the_numbers(monkeypatch):
    seen = []
    monkeypatch.setattr(
        "losbench.imaging.smeared.aided.measure_singly",
        lambda scene, *_: seen.append(scene.full_scale),
    )
    given = {"start": [[40.0, 50.0]], "path": PATH, "camera": CAMERA, "width": 0.7}
    for dtype, more in (
        (np.uint8, {}),
        (np.uint16, {}),
        (float, {}),
        (float, {"detector": DETECTOR}),
        (float, {"detector": lb.Detector(full_well_e=500.7)}),
        (np.uint16, {"detector": DETECTOR, "full_scale_dn": 900.0}),
    ):
        lb.aided_centroid(np.zeros(CAMERA.shape, dtype), **given, **more)
    assert seen == [255.0, 65535.0, np.inf, 4095.0, 500.0, 900.0]


FOUR = np.array([[40.3, 50.2], [90.8, 30.4], [70.1, 80.9], [30.5, 90.2]])


@pytest.mark.parametrize("epoch", ["start", "middle", "end"])
def test_a_joint_turn_is_that_at_the_epoch(epoch):
    """The rays turn by a rate that the path lacks, about the moment of the epoch."""
    rate = np.array([0.004, -0.003, 0.02])
    moment = {"start": 0.0, "middle": 0.0125, "end": 0.025}[epoch]
    turns = Rotation.from_rotvec((PATH.time_s - moment)[:, None] * rate).as_matrix() @ PATH.turns
    start = PATH.carry(FOUR, CAMERA, start=epoch, end="start")
    tracks = replace(PATH, turns=turns).tracks(start, CAMERA)
    frame = lb.render_streaks(tracks, PATH.share, 3e4, SIGMA, CAMERA.shape)
    found = lb.aided_centroid(
        frame,
        np.rint(tracks.mean(axis=1)),
        path=PATH,
        camera=CAMERA,
        width=SIGMA,
        method="joint",
        epoch=epoch,
        predicted=FOUR + 0.05,
        background=0.0,
        detector=lb.Detector(read_noise_e=5.0),
        rate_prior_rad_s=np.inf,
    )
    np.testing.assert_allclose(found.rate_rad_s, rate, rtol=1e-3)
    np.testing.assert_allclose(found.xy, FOUR, atol=1e-3)
    assert not found.flags.any()


def test_without_a_word_the_path_lacks_no_rate():
    """The prior is zero wide unless it is given."""
    tracks = PATH.tracks(FOUR, CAMERA, epoch="end")
    frame = lb.render_streaks(tracks, PATH.share, 3e4, SIGMA, CAMERA.shape)
    frame = np.random.default_rng(6).normal(frame, 5.0)
    given = {"path": PATH, "camera": CAMERA, "width": SIGMA, "method": "joint"}
    given |= {"predicted": FOUR + 0.05, "detector": lb.Detector(read_noise_e=5.0)}
    start = np.rint(tracks.mean(axis=1))
    held = lb.aided_centroid(frame, start, **given)
    free = lb.aided_centroid(frame, start, **given, rate_prior_rad_s=np.inf)
    assert np.abs(held.rate_rad_s).max() < 1e-9 < 1e-5 < np.abs(free.rate_rad_s).max()
    assert (held.sigma_xy < free.sigma_xy).all()


def test_one_star_of_several_images_is_cut_out_of_each():
    frames = RNG.random((3, 120, 140))
    cut = cut_windows(frames, [[40.0, 50.0]], window=5, path=PATH, camera=CAMERA, sigma=SIGMA)
    np.testing.assert_array_equal(cut.pixels, frames[:, 48:53, 38:43])
    assert cut.image.tolist() == [0, 1, 2]


@pytest.mark.parametrize("method", ["iterative", "closed_form", "least_squares", "joint"])
def test_blocks_of_stars_ask_nothing_of_each_other(monkeypatch, method):
    tracks = PATH.tracks(FOUR, CAMERA, epoch="end")
    one = lb.render_streaks(tracks, PATH.share, 3e4, SIGMA, CAMERA.shape) + 40.0
    frames = np.random.default_rng(5).normal(one, 3.0, (3, *one.shape))
    frames[1, 50:60, 40:44] = np.nan
    given = {"path": PATH, "camera": CAMERA, "width": SIGMA, "method": method, "window": 15}
    if method == "joint":
        given["predicted"] = np.broadcast_to(FOUR + 0.05, (3, 4, 2))

    def measured():
        return lb.aided_centroid(frames, np.rint(tracks.mean(axis=1)), **given)

    whole = measured()
    monkeypatch.setattr(type(METHODS[method]), "block", 4 if method == "joint" else 5)
    parts = measured()
    for name in ("xy", "sigma_xy", "flux", "n_iter", "converged", "flags"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-4)
    assert (whole.flags[1] != 0).any() and not whole.flags[[0, 2]].any()


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_a_star_without_its_core_beside_a_whole_one_is_measured_as_if_it_were_alone(order):
    """By the pixels that are left, which the iteration follows poorly."""
    stars = np.array([[40.3, 50.2], [90.8, 30.4]])
    tracks = PATH.tracks(stars, CAMERA, epoch="end")
    light = lb.render_streaks(tracks, PATH.share, [6e4, 2e4], SIGMA, CAMERA.shape)
    full = 0.4 * light.max()
    frame = np.minimum(light, full)
    given = {"path": PATH, "camera": CAMERA, "width": SIGMA, "full_scale_dn": full, "window": 15}
    together = lb.aided_centroid(frame, stars[order], method="iterative", **given)
    for k, star in enumerate(order):
        alone = lb.aided_centroid(frame, stars[[star]], method="iterative", **given)
        np.testing.assert_allclose(together.xy[k], alone.xy[0], atol=1e-9)
        np.testing.assert_allclose(alone.xy[0], stars[star], atol=0.02)
    assert (together.flags & SpotFlag.SATURATED > 0).tolist() == [star == 0 for star in order]
