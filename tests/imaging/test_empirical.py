"""Spots of any shape by a template of their own frames: against the Cramer-Rao bound, their errors
against their scatter, and what is not like the template.

Seeds were fixed before the first run.
"""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

import losbench as lb
from losbench.imaging.results import SpotFlag
from losbench.imaging.splines import Drawn, spline_count, spline_weights

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SIDE, HALF, WINDOW, SKY = 33, 16, 21, 100.0
FINE = (np.arange(5 * SIDE) + 0.5) / 5 - 0.5 - HALF
SHAPES = {
    "disc": lambda x, y: 1.0 / (1.0 + np.exp((np.hypot(x, y) - 5.0) / 0.3)),
    "ring": lambda x, y: np.exp(-0.5 * ((np.hypot(x, y) - 5.0) / 0.8) ** 2),
    "coma": lambda x, y: (
        np.exp(-0.125 * (x**2 + y**2))
        + 0.4 * np.exp(-(((x - 2.5) / 3.0) ** 2 + (y / 2.0) ** 2) / 2)
    ),
    "two lobes": lambda x, y: (
        np.exp(-((x - 3.0) ** 2 + y**2) / 8) + 0.7 * np.exp(-((x + 3.0) ** 2 + y**2) / 8)
    ),
}


def light_of(shape, xy, peak=5e3):
    """Electrons (F, 33, 33) of a shape at (F, 2) from the middle."""
    x, y = FINE - xy[:, :1, None], FINE[:, None] - xy[:, 1:, None]
    return peak * SHAPES[shape](x, y).reshape(-1, SIDE, 5, SIDE, 5).mean(axis=(2, 4)) + SKY


def frames_of(shape, count, seed, peak=5e3):
    """Frames (F, 33, 33) of a spot that wanders by half a pixel, and where it is (F, 2)."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-0.5, 0.5, (count, 2))
    return CAMERA.expose(light_of(shape, xy, peak), rng), xy + HALF


def measured(frames, method=None, **options):
    how = {"method": method or lb.Empirical(window=WINDOW), "detector": CAMERA} | options
    return lb.centroid(frames, [[HALF, HALF]], **how)


def bound_of(shape, peak=5e3):
    """Least error of x and y, mean of both, with light and level found as well, pixels."""
    h, nowhere = 0.01, np.zeros((1, 2))
    at = light_of(shape, nowhere, peak)[0]
    slopes = [
        (light_of(shape, nowhere + d, peak) - light_of(shape, nowhere - d, peak))[0] / (2 * h)
        for d in ((h, 0.0), (0.0, h))
    ]
    basis = np.stack([*slopes, at - SKY, np.ones_like(at)], axis=-1).reshape(-1, 4)
    basis /= np.sqrt(at + 25.0).reshape(-1, 1)
    return np.sqrt(np.linalg.inv(basis.T @ basis).diagonal()[:2].mean())


def off(found, truth):
    """Errors (F, 2) about a common offset."""
    error = found.xy[:, 0] - truth
    return error - np.nanmean(error, axis=0)


def pulls(found, truth):
    return off(found, truth) / found.sigma_xy[:, 0]


@pytest.mark.parametrize("count", [30, 100])
@pytest.mark.parametrize("shape", SHAPES)
def test_it_comes_within_three_tenths_of_the_bound_where_eiwa_does_not(shape, count):
    frames, truth = frames_of(shape, count, 1)
    found = measured(frames)
    bound = bound_of(shape)
    assert 0.8 < off(found, truth).std() / bound < 1.3
    assert off(measured(frames, lb.EIWA(WINDOW)), truth).std() / bound > 1.4
    assert not found.flags.any()


@pytest.mark.parametrize("count", [10, 30])
def test_of_many_recordings_it_comes_within_a_tenth_of_the_bound(count):
    ratios = []
    for k, shape in enumerate(SHAPES):
        for seed in range(100 * k, 100 * k + 60 // count):
            frames, truth = frames_of(shape, count, seed)
            # Of few frames the common offset takes a part of the scatter.
            scale = bound_of(shape) * np.sqrt(1.0 - 1.0 / count)
            ratios.append(off(measured(frames), truth) / scale)
    assert 0.95 < np.concatenate(ratios).std() < 1.1


@pytest.mark.parametrize("count", [30, 100, 300])
@pytest.mark.parametrize("peak", [5e3, 5e2])
def test_the_stated_error_is_the_scatter_of_frames_that_made_the_shape_or_did_not(count, peak):
    own, others = [], []
    for k, shape in enumerate(SHAPES):
        for seed in range(20 * k, 20 * k + max(1, 60 // count)):
            frames, truth = frames_of(shape, count, seed, peak)
            found = measured(frames)
            own.append(pulls(found, truth))
            frames, truth = frames_of(shape, 150, 1000 + seed, peak)
            others.append(pulls(measured(frames, found.method), truth))
    for each in (own, others):
        assert 0.9 < 1.0 / np.concatenate(each).std() < 1.15


def test_the_shape_is_that_of_64_frames_and_the_frames_that_made_it_are_told():
    frames, _ = frames_of("coma", 100, 3)
    found = measured(frames)
    (shape,) = found.method.shape
    assert shape.frames == 64 and shape.side == WINDOW and found.window == WINDOW
    again = measured(frames[np.linspace(0, 99, 64).astype(int)])
    assert again.method.shape == found.method.shape
    assert found.width_px is None and found.flux.mean() == pytest.approx(
        (light_of("coma", np.zeros((1, 2))) - SKY).sum() / 2.0, rel=0.01
    )


def test_its_origin_is_the_mean_place_that_eiwa_finds():
    frames, truth = frames_of("coma", 64, 4)
    found, window = measured(frames), measured(frames, lb.EIWA(WINDOW))
    apart = (found.xy - window.xy)[:, 0].mean(axis=0)
    assert np.abs(apart).max() < 2e-3
    assert np.abs((found.xy[:, 0] - truth).mean(axis=0)).max() > 0.1  # not the peak's


def test_a_shape_measures_other_frames_and_is_the_same_wherever_it_goes():
    frames, _ = frames_of("ring", 30, 5)
    found = measured(frames)
    method = found.method
    copy = pickle.loads(pickle.dumps(method))
    assert copy == method and hash(copy) == hash(method)
    np.testing.assert_array_equal(measured(frames, copy).xy, found.xy)
    (shape,) = method.shape
    assert repr(shape) == f"<SpotShape {shape.digest}, 21 pixels, of 30 windows>"
    other = replace(shape, error=2.0 * shape.error)
    assert other != shape and other.digest != shape.digest and shape != "shape"
    one = lb.Empirical(shape)
    assert one.window == WINDOW
    np.testing.assert_array_equal(measured(frames[:3], one).xy, found.xy[:3])


@pytest.mark.parametrize("finer", [1, 4])
def test_the_shape_can_be_looked_at(finer):
    frames, truth = frames_of("coma", 64, 4)
    found = measured(frames)
    origin = (truth - found.xy[:, 0]).mean(axis=0)
    (shape,) = found.method.shape
    image = shape.image(finer)
    assert image.shape == (WINDOW * finer, WINDOW * finer)
    fine = (np.arange(WINDOW * finer * 5) + 0.5) / (5 * finer) - WINDOW / 2.0
    light = SHAPES["coma"](fine - origin[0], fine[:, None] - origin[1])
    means = light.reshape(WINDOW * finer, 5, -1, 5).mean(axis=(1, 3))
    expected = means / means.sum() * finer**2
    assert np.abs(image - expected).max() < 0.05 * expected.max()
    with pytest.raises(ValueError, match="finer must be a whole number of at least 1, got 0"):
        shape.image(0)


def test_a_batch_is_a_loop():
    frames, _ = frames_of("two lobes", 30, 6)
    together = measured(frames)
    for k in (0, 7, 29):
        alone = measured(frames[k], together.method)
        for name in ("xy", "sigma_xy", "flux", "n_iter", "flags"):
            np.testing.assert_allclose(
                getattr(alone, name), getattr(together, name)[k], rtol=1e-5, atol=1e-6
            )


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_places_follow_transposition_shifts_and_units(factor):
    frames, _ = frames_of("coma", 20, 7)
    frames = frames.astype(np.float64)
    how = {"method": "empirical", "window": WINDOW}
    expected = lb.centroid(frames, [[HALF, HALF]], **how)
    wide = np.pad(frames, ((0, 0), (5, 2), (3, 8)), mode="wrap")
    moved = factor * wide[:, 2:-2, 1:-1].swapaxes(1, 2)
    found = lb.centroid(moved, [[HALF + 3, HALF + 2]], **how)
    np.testing.assert_allclose(found.xy[..., ::-1] - [2, 3], expected.xy, atol=3e-4)
    np.testing.assert_allclose(found.sigma_xy[..., ::-1], expected.sigma_xy, rtol=0.02)
    np.testing.assert_allclose(found.flux, factor * expected.flux, rtol=1e-3)


def test_ten_windows_make_a_shape_and_nine_do_not():
    frames, truth = frames_of("ring", 10, 8)
    found = measured(frames)
    assert np.abs(pulls(found, truth)).max() < 4.0
    with pytest.raises(
        ValueError,
        match=r"^method=Empirical\(\) needs 10 windows of one size .* got 9: give a shape",
    ):
        measured(frames[:9])


def test_stars_of_one_image_share_a_shape():
    rng = np.random.default_rng(9)
    stars = np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(-1, 2)
    places = rng.uniform(-0.5, 0.5, (16, 2))
    light = np.zeros((4 * SIDE, 4 * SIDE))
    for (column, row), place in zip(stars, places, strict=True):
        part = light_of("coma", place[None])[0]
        light[row * SIDE : (row + 1) * SIDE, column * SIDE : (column + 1) * SIDE] = part
    frame, truth = CAMERA.expose(light, rng), stars * SIDE + HALF + places
    found = lb.centroid(frame, np.rint(truth), method=lb.Empirical(window=WINDOW), detector=CAMERA)
    assert len(set(found.method.shape)) == 1 and found.method.shape[0].frames == 16
    error = found.xy - truth
    spread = (error - error.mean(axis=0)) / found.sigma_xy
    assert 0.7 < spread.std() < 1.3 and not found.flags.any()


def test_a_spot_that_no_frame_shows_has_no_shape_and_no_centroid():
    frames, _ = frames_of("ring", 12, 10)
    wide = np.concatenate([frames, CAMERA.expose(np.full(frames.shape, SKY), 1)], axis=2)
    spots = [[HALF, HALF], [SIDE + HALF, HALF]]
    method = lb.Empirical(window=WINDOW)
    found = lb.centroid(wide, spots, method=method, detector=CAMERA)
    assert found.method.shape[1] is None
    assert np.isfinite(found.xy[:, 0]).all() and np.isnan(found.xy[:, 1]).all()
    assert (found.flags[:, 1] & SpotFlag.TOO_FAINT).all()


@pytest.mark.parametrize(
    ("method", "said"),
    [
        (lambda shape: lb.Empirical("ring"), "shape must be a SpotShape, or a tuple of one for"),
        (lambda shape: lb.Empirical(shape, window=13), "shape must be that of windows of 13 pix"),
        (lambda shape: lb.Empirical((shape, shape)), "shape must be one, or one for each of 1 sp"),
        (lambda shape: lb.Empirical(window=123), "window must be at most 121 pixels for a shape"),
        (lambda shape: lb.Empirical(window=20), "window must be odd"),
    ],
)
def test_what_does_not_fit_is_refused(method, said):
    frames, _ = frames_of("ring", 10, 11)
    (shape,) = measured(frames).method.shape
    wide = np.pad(frames, ((0, 0), (100, 100), (100, 100)), mode="edge")
    with pytest.raises(ValueError, match=said):
        lb.centroid(wide, [[116, 116]], method=method(shape), detector=CAMERA)


@pytest.mark.parametrize("share", [0.01, 0.1])
def test_a_neighbour_and_a_change_of_shape_are_told_from_three_hundredths_on(share):
    frames, truth = frames_of("coma", 64, 12)
    method = measured(frames).method
    light = light_of("coma", truth - HALF)
    beside = light_of("disc", truth - HALF, share * 5e3) - SKY
    found = measured(CAMERA.expose(light + beside, 13), method)
    assert ((found.flags & SpotFlag.MISFIT) > 0).mean() == (share > 0.05)


def test_the_windows_that_are_not_like_the_others_have_no_part_in_the_shape():
    light = light_of("ring", np.random.default_rng(14).uniform(-0.5, 0.5, (40, 2)))
    light[:6] += light_of("coma", np.full((6, 2), 1.0), 1.5e3) - SKY
    found = measured(CAMERA.expose(light, 14))
    assert found.method.shape[0].frames == 34
    np.testing.assert_array_equal((found.flags[:, 0] & SpotFlag.MISFIT) > 0, np.arange(40) < 6)


def test_bad_pixels_are_left_out_and_counted():
    frames, truth = frames_of("ring", 40, 15)
    clean = measured(frames)
    bad = frames.astype(np.float32)
    bad[::4, HALF + 5, HALF + 1] += 3000.0
    bad[1::4, HALF - 3, HALF - 4] = np.nan
    bad[2::4, HALF + 2, HALF - 4] = 100.0
    found = measured(bad, full_scale_dn=65535.0)
    hit = np.arange(40) % 4 < 3
    np.testing.assert_array_equal(found.flags[:, 0], np.where(hit, int(SpotFlag.BAD_PIXEL), 0))
    np.testing.assert_array_equal(found.n_bad[:, 0], hit)
    assert np.abs(off(found, truth) - off(clean, truth)).max() < 4.0 * clean.sigma_xy.max()
    assert pulls(found, truth).std() == pytest.approx(1.0, abs=0.2)


def test_a_saturated_core_is_left_out_of_shape_and_place():
    frames, truth = frames_of("two lobes", 64, 16)
    full = int(0.7 * frames.max())
    found = measured(np.minimum(frames, full), full_scale_dn=full)
    assert (found.flags & SpotFlag.SATURATED).mean() > 0.9 * SpotFlag.SATURATED
    assert pulls(found, truth).std() == pytest.approx(1.0, abs=0.2)
    eiwa = measured(np.minimum(frames, full), lb.EIWA(WINDOW), full_scale_dn=full)
    assert off(found, truth).std() < 0.8 * off(eiwa, truth).std()


def test_without_a_detector_the_frames_tell_the_noise():
    frames, truth = frames_of("ring", 100, 17)
    found = measured(frames, detector=None)
    assert pulls(found, truth).std() == pytest.approx(1.0, abs=0.15)
    assert not found.flags.any()


@pytest.mark.parametrize("wander", [0.0, 0.1])
@pytest.mark.parametrize("shape", ["disc", "ring"])
def test_a_spot_that_moves_on_to_where_no_frame_has_shown_it_is_flagged(shape, wander):
    """A shape of sharp spots that stood still knows nothing of its slopes."""
    rng = np.random.default_rng(18)
    still = light_of(shape, rng.uniform(-wander, wander, (40, 2)))
    method = measured(CAMERA.expose(still, rng)).method
    frames, truth = frames_of(shape, 400, 19)
    found = measured(frames, method)
    far = np.abs(truth - HALF).max(axis=1)
    misfit = (found.flags[:, 0] & SpotFlag.MISFIT) > 0
    assert misfit[far > 0.05 + 1.9 * wander].all()
    assert not misfit[far < 0.01 + 1.5 * wander].any()
    error = found.xy[~misfit, 0] - truth[~misfit]
    spread = (error - error.mean(axis=0)) / found.sigma_xy[~misfit, 0]
    assert spread.std() < 1.4


@pytest.mark.parametrize(("sigma", "side", "sharp"), [(0.65, 7, True), (0.85, 7, False)])
def test_a_spot_that_is_too_sharp_for_its_splines_is_flagged(sigma, side, sharp):
    rng = np.random.default_rng(21)
    truth = HALF + rng.uniform(-0.5, 0.5, (60, 2))
    light = lb.render_spots(truth[:, None], 1e5, sigma, (SIDE, SIDE)) + SKY
    found = measured(CAMERA.expose(light, rng), lb.Empirical(window=side))
    assert found.method.shape[0].width == pytest.approx(np.hypot(sigma, 12.0**-0.5), rel=0.1)
    assert ((found.flags & SpotFlag.MISFIT) > 0).mean() == sharp


@pytest.mark.slow
@pytest.mark.parametrize("window", [61, 63])
def test_a_sharp_ring_in_a_wide_window_is_measured_or_flagged(window):
    rng = np.random.default_rng(22)
    truth = 40 + rng.uniform(-0.5, 0.5, (24, 2))
    y, x = np.mgrid[:81, :81]
    r = np.hypot(x - truth[:, 0, None, None], y - truth[:, 1, None, None])
    frames = CAMERA.expose(5e3 * np.exp(-0.5 * ((r - 15.0) / 0.9) ** 2) + SKY, rng)
    method = lb.Empirical(window=window)
    found = lb.centroid(frames, [[40, 40]], method=method, detector=CAMERA)
    if window == 63:
        assert ((found.flags & SpotFlag.MISFIT) > 0).all()
    else:
        assert not found.flags.any() and 0.8 < pulls(found, truth).std() < 1.2


@pytest.mark.parametrize(("side", "each"), [(11, 3), (13, 2), (61, 2), (63, 1)])
def test_what_is_drawn_are_cubic_splines_and_their_slopes(side, each):
    """Three knots to a pixel up to 11 pixels, two up to 61, one beyond."""
    rng = np.random.default_rng(20)
    count = (side + 2) * each + 3
    assert spline_count(side) == count
    splines, centre = rng.normal(size=(2, count, count)), rng.uniform(-1.4, 1.4, (6, 2))
    which = np.array([0, 1, 1, 0, 1, 0])
    drawn = Drawn.of(side, centre, splines, which, np.float64)
    knots = (np.arange(count + 4) - 3) / each - (side // 2 + 1.5)
    basis, pixel = BSpline(knots, np.eye(count), 3), np.arange(side) - side // 2
    for k, (x, y) in enumerate(centre):
        down, along = (basis(pixel - at) for at in (y, x))
        slope_y, slope_x = (-basis(pixel - at, 1) for at in (y, x))
        c = splines[which[k]]
        expected = [down @ c @ along.T, down @ c @ slope_x.T, slope_y @ c @ along.T]
        np.testing.assert_allclose(drawn.columns[k], expected, atol=1e-12)
    for axis in range(2):
        weights, slopes = spline_weights(side, centre[:, axis])
        at = pixel - centre[:, axis, None]
        np.testing.assert_allclose(weights, basis(at), atol=1e-13)
        np.testing.assert_allclose(slopes, -basis(at, 1), atol=1e-12)
    far = Drawn.of(side, np.array([[9.0, -9.0]]), splines, which[:1], np.float64)
    edge = Drawn.of(side, np.array([[1.5, -1.5]]), splines, which[:1], np.float64)
    np.testing.assert_allclose(far.columns, edge.columns, atol=1e-4)
