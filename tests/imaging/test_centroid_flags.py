"""What can be wrong with a spot is flagged, and gives NaN where there is no number worth having;
bad input is named.
"""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.centroid import default_window, window_path
from losbench.imaging.places import peak_pixels
from losbench.imaging.results import SpotFlag
from losbench.imaging.sizes import spot_sigma

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)


def image(xy, flux=3e4, sigma=2.0, shape=(60, 80), camera=CAMERA, seed=1):
    return camera.expose(lb.render_spots(xy, flux, sigma, shape) + 60, seed)


def flags(*args, **kwargs):
    return SpotFlag(int(lb.centroid(*args, **{"window": 13} | kwargs).flags.reshape(-1)[0]))


def test_a_spot_without_reproach_has_no_flag():
    assert flags(image([[40, 30]]), [[40, 30]], noise=CAMERA) == SpotFlag(0)


def test_without_a_detector_fewer_than_three_frames_give_a_lower_bound_and_say_so():
    """Of a spot with wings, which a Gaussian does not explain."""
    away = np.hypot(*(np.mgrid[:60, :80] - np.array([30.0, 40.0])[:, None, None]))
    light = 6e3 * (1.0 + (away / 3.0) ** 2) ** -2.5 + 30.0
    frames = CAMERA.expose(np.stack([light] * 3), 1)
    one, two, three = (lb.centroid(frames[:n], [[40, 30]], window=13) for n in (1, 2, 3))
    low = SpotFlag.LOWER_BOUND
    assert (one.flags & low > 0).all() and (two.flags & low > 0).all()
    assert not one.noise.known and not (three.flags & low).any()
    assert three.sigma_xy.mean() > 1.15 * two.sigma_xy.mean()


@pytest.mark.parametrize("method", ["eiwa", "grey", "weighted", "gaussian", "likelihood", "auto"])
def test_a_start_on_nothing_in_a_frame_without_noise_is_too_faint_and_no_warning(method):
    """Its light adds up to zero."""
    frame = np.float32(lb.render_spots([[40.0, 30.0]], 3e4, 2.0, (60, 80)) + 100.0)
    options = {"width": 2.0} if method in ("weighted", "gaussian", "likelihood") else {}
    found = lb.centroid(frame, [[40, 30], [20, 40]], method=method, window=13, **options)
    assert found.flags[1] & SpotFlag.TOO_FAINT and np.isnan(found.xy[1]).all()
    np.testing.assert_allclose(found.xy[0], [40.0, 30.0], atol=1e-3)


@pytest.mark.parametrize(
    ("x", "flag", "measured"),
    [(4.0, SpotFlag.EDGE, False), (7.2, SpotFlag.EDGE, True), (11.0, SpotFlag(0), True)],
)
def test_a_spot_near_the_border(x, flag, measured):
    found = lb.centroid(image([[x, 30]]), [[x, 30]], window=13, noise=CAMERA)
    assert SpotFlag(int(found.flags[0])) == flag
    assert np.isfinite(found.xy).all() == measured
    if measured:
        np.testing.assert_allclose(found.xy[0], [x, 30], atol=0.05)


@pytest.mark.parametrize(
    "xy", [[[-5.0, 30.0]], [[80.0, 30.0]], [[40.0, 1e9]], [[np.nan, 30.0]], [[np.inf, 3.0]]]
)
def test_a_start_outside_the_frame_is_a_missing_spot(xy):
    found = lb.centroid(image([[40, 30]]), xy, window=13)
    assert found.flags.tolist() == [SpotFlag.MISSING]
    assert np.isnan(found.xy).all()
    assert np.isnan(found.sigma_xy).all()


def test_a_spot_that_is_lost_for_some_frames_comes_back():
    frames = np.stack([image([[40, 30]], flux=f, seed=k) for k, f in enumerate([3e4, 0.0, 3e4])])
    found = lb.centroid(frames, [[40, 30]], window=13, noise=CAMERA)
    assert np.isnan(found.xy[:, 0, 0]).tolist() == [False, True, False]
    assert SpotFlag.TOO_FAINT in SpotFlag(int(found.flags[1, 0]))
    assert not found.flags[[0, 2]].any()


def test_unread_pixels_in_the_window_make_a_spot_missing_and_in_the_ring_they_do_not():
    frames = np.stack([image([[40, 30]])] * 3).astype(np.float32)
    frames[0, 28, 41] = np.nan
    frames[1, 22:25, 20:50] = np.nan
    frames[2] = np.nan
    found = lb.centroid(frames, [[40, 30]], window=11, noise=CAMERA)
    assert SpotFlag.MISSING in SpotFlag(int(found.flags[0, 0]))
    assert found.flags[1, 0] == 0
    assert SpotFlag.MISSING in SpotFlag(int(found.flags[2, 0]))
    assert np.isnan(found.xy[:, 0, 0]).tolist() == [True, False, True]


def test_a_frame_that_was_not_read_at_all_is_missing_and_no_warning():
    frames = np.stack([image([[40, 30]])] * 2).astype(np.float32) / 3.0
    frames[1] = np.nan
    for method in ("eiwa", "weighted", "grey"):
        found = lb.centroid(frames, [[40, 30]], method=method, window=13)
        assert np.isnan(found.xy[1]).all() and np.isfinite(found.xy[0]).all()
        assert found.flags[1] & SpotFlag.MISSING and not found.flags[0] & SpotFlag.MISSING


def test_saturation_at_full_scale_and_on_a_plateau_below_it():
    full = image([[40, 30]], flux=1e8)
    assert SpotFlag.SATURATED in flags(full, [[40, 30]])
    clipped = np.minimum(image([[40, 30]]), 500)
    assert SpotFlag.SATURATED in flags(clipped, [[40, 30]])
    assert SpotFlag.SATURATED in flags(clipped.astype(np.float32) * 0.37, [[40, 30]])
    bright = image([[40, 30]], flux=6e4)
    assert SpotFlag.SATURATED not in flags(bright, [[40, 30]])
    assert SpotFlag.SATURATED in flags(bright, [[40, 30]], full_scale_dn=900)
    twelve = lb.Detector(gain_e_per_dn=2.0, offset_dn=100.0, bits=12)
    assert SpotFlag.SATURATED in flags(
        image([[40, 30]], flux=3e5, camera=twelve), [[40, 30]], noise=twelve
    )


def test_coarse_steps_are_not_taken_for_a_plateau():
    coarse = lb.Detector(gain_e_per_dn=100.0, read_noise_e=30.0, offset_dn=10.0, bits=8)
    frames = np.stack(
        [image([[40, 30]], flux=8e4, sigma=3.0, camera=coarse, seed=k) for k in range(100)]
    )
    found = lb.centroid(frames, [[40, 30]], window=19)
    assert np.mean(found.flags & SpotFlag.SATURATED > 0) < 0.03


def test_neighbours_are_flagged_by_the_distance_of_their_starts():
    xy = np.array([[20.0, 30.0], [32.0, 30.0], [60.0, 30.0]])
    found = lb.centroid(image(xy), xy, window=13)
    assert (found.flags & SpotFlag.NEIGHBOUR > 0).tolist() == [True, True, False]


def test_too_few_iterations_are_not_converged():
    frame = image([[40, 30]], flux=3e3)
    assert SpotFlag.NOT_CONVERGED in flags(
        frame, [[39, 31]], stop="step", background="none", max_iter=2
    )
    assert SpotFlag.NOT_CONVERGED not in flags(
        frame, [[39, 31]], stop="step", background="none", max_iter=200
    )


def test_a_window_that_wanders_to_another_spot_is_not_converged():
    found = lb.centroid(image([[40, 30]]), [[32.0, 30.0]], window=13)
    assert SpotFlag.NOT_CONVERGED in SpotFlag(int(found.flags[0]))


def test_a_window_on_a_high_pedestal_is_slow():
    frame = image([[40, 30]], flux=2e3).astype(np.float32) + 5000
    assert SpotFlag.SLOW in flags(frame, [[40, 30]], background="none")
    assert SpotFlag.SLOW not in flags(frame, [[40, 30]])


def test_small_stamps_are_measured_with_a_small_window():
    stamp = lb.render_spots([[2.8, 1.7]], 1e4, 0.7, (4, 6)).astype(np.float32)
    found = lb.centroid(stamp, [[3, 2]], window=3, background="none")
    assert np.isfinite(found.xy).all()
    assert default_window(stamp, [[3, 2]]) == 3
    assert lb.centroid(stamp, [[3, 2]], background="none").window == 3
    off_centre = lb.render_spots([[3.3, 2.2]], 1e4, 0.8, (6, 6))
    assert np.isfinite(lb.centroid(off_centre, [[3.3, 2.2]], background="none").xy).all()


@pytest.mark.parametrize("sigma", [0.7, 1.5, 2.0, 3.5, 5.0])
def test_the_width_is_read_from_the_data(sigma):
    rng = np.random.default_rng(4)
    xy = np.array([[40, 40], [120, 45]]) + rng.uniform(-0.5, 0.5, (30, 2, 2))
    frames = CAMERA.expose(lb.render_spots(xy, 3e4 * sigma**2, sigma, (85, 160)) + 60, rng)
    start = np.rint(xy)
    # Sharper than a pixel, the pixel itself and the whole-pixel cuts show.
    assert spot_sigma(frames, start) == pytest.approx(sigma, rel=0.08 if sigma > 1 else 0.15)
    assert spot_sigma(frames[:1], start[:1]) == pytest.approx(sigma, rel=0.12 if sigma > 1 else 0.4)


@pytest.mark.parametrize("sigma", [1.5, 2.0, 3.5])
def test_the_default_window_is_the_first_odd_one_of_six_sigma(sigma):
    frames = np.stack([image([[40.2, 30.3]], flux=1e5, sigma=sigma, seed=k) for k in range(10)])
    window = lb.centroid(frames, [[40, 30]]).window
    assert window % 2 == 1
    assert 6 * sigma - 0.5 <= window < 6 * sigma + 2.5


def test_the_peak_is_found_frame_by_frame():
    frames = np.zeros((3, 20, 30), dtype=np.uint16)
    frames[0, 8, 12], frames[1, 11, 14], frames[2, 0, 29] = 9, 9, 9
    places = np.array([[[13.0, 9.0]], [[13.0, 9.0]], [[27.0, 1.0]]])
    assert peak_pixels(frames, places, 3)[:, 0].tolist() == [[12, 8], [14, 11], [29, 0]]
    places[1] = np.nan
    assert np.isnan(peak_pixels(frames, places, 3)[1]).all()
    assert np.isnan(peak_pixels(np.full((5, 5), np.nan), [[2, 2]], 1)).all()


def test_the_path_starts_at_the_start_and_ends_at_the_centroid():
    frame = image([[40.3, 30.6]])
    path = window_path(frame, [37.5, 33.0], window=13)
    np.testing.assert_array_equal(path[0], [37.5, 33.0])
    np.testing.assert_allclose(
        path[-1], lb.centroid(frame, [[37.5, 33.0]], window=13, stop="step").xy[0], atol=1e-9
    )
    assert (np.hypot(*np.diff(path, axis=0).T) > 0).all()


GOOD = np.zeros((2, 30, 40), dtype=np.uint16)


@pytest.mark.parametrize(
    ("frames", "start", "kwargs", "message"),
    [
        (np.zeros(5), [[1, 1]], {}, r"frames must have shape \(F, H, W\) or \(H, W\), got \(5,\)"),
        (
            np.zeros((0, 9, 9)),
            [[1, 1]],
            {},
            r"frames must hold at least one pixel, got shape \(0, 9, 9\)",
        ),
        (
            np.zeros((9, 9), dtype=complex),
            [[1, 1]],
            {},
            "frames must be of an integer or float type, got complex128",
        ),
        (
            GOOD,
            [1.0, 2.0],
            {},
            r"start must have shape \(n, 2\) or \(2, n, 2\) to match 2 frames, got \(2,\)",
        ),
        (
            GOOD,
            np.zeros((3, 1, 2)),
            {},
            r"start must have shape .* to match 2 frames, got \(3, 1, 2\)",
        ),
        (GOOD, np.zeros((0, 2)), {}, r"start must have shape .* got \(0, 2\)"),
        (GOOD, [[9, 9]], {"window": 12}, "window must be odd, got 12"),
        (GOOD, [[9, 9]], {"window": 1}, "window must be a whole number of at least 3, got 1"),
        (
            GOOD,
            [[9, 9]],
            {"window": 31},
            "window of 31 x 31 pixels does not fit into frames of 30 x 40 pixels",
        ),
        (
            GOOD[:, :2],
            [[9, 1]],
            {},
            "window of 3 x 3 pixels does not fit into frames of 2 x 40 pixels",
        ),
        (
            GOOD,
            [[9, 9]],
            {"window": 13, "ring": 11},
            "ring must be a whole number of at least 13, got 11",
        ),
        (
            GOOD,
            [[9, 9]],
            {"method": "moments"},
            "method must be one of 'auto', 'eiwa', 'grey', 'weighted', 'likelihood', 'gaussian', 'empirical', got 'moments'",
        ),
        (GOOD, [[9, 9]], {"stop": "never"}, "stop must be one of 'error', 'step', got 'never'"),
        (
            GOOD,
            [[9, 9]],
            {"centre": "middle"},
            "centre must be one of 'start', 'peak', got 'middle'",
        ),
        (
            GOOD,
            [[9, 9]],
            {"background": "median"},
            "background must be one of 'ring', 'none', got 'median'",
        ),
        (GOOD, [[9, 9]], {"max_iter": 0}, "max_iter must be a whole number of at least 1, got 0"),
        (
            GOOD,
            [[9, 9]],
            {"tolerance": 0.0},
            "tolerance must be a finite number of at least 1e-12, got 0",
        ),
    ],
)
def test_bad_input_is_refused_by_name(frames, start, kwargs, message):
    with pytest.raises(ValueError, match=message):
        lb.centroid(frames, start, **kwargs)


def test_a_path_needs_one_start_in_one_image():
    with pytest.raises(
        ValueError, match=r"start must be one point within one image, got \[99, 3\]"
    ):
        window_path(GOOD[0], [99, 3], window=13)
    with pytest.raises(ValueError, match="radius must be a whole number of at least 0, got -1"):
        peak_pixels(GOOD, [[3, 3]], -1)


@pytest.mark.parametrize("method", ["eiwa", "grey", "weighted", "gaussian"])
def test_no_start_in_any_frame_gives_nothing_but_missing(method):
    for start in ([[np.nan, np.nan]], [[500.0, 3.0]]):
        found = lb.centroid(np.ones((3, 20, 20)), start, method=method, window=9)
        assert (found.flags == SpotFlag.MISSING).all()
        assert np.isnan(found.xy).all()


def test_a_masked_pixel_was_not_read():
    frame = image([[40.0, 30.0]])
    masked = np.ma.masked_array(frame, mask=np.zeros(frame.shape, dtype=bool))
    masked[30, 44] = np.ma.masked
    assert flags(masked, [[40, 30]], window=13) == SpotFlag.MISSING
    masked.mask[30, 44], masked.mask[30, 60] = False, True
    np.testing.assert_allclose(
        lb.centroid(masked, [[40, 30]], window=13).xy,
        lb.centroid(frame, [[40, 30]], window=13).xy,
        atol=1e-5,
    )


def test_infinity_near_a_spot_is_refused():
    frame = image([[40.0, 30.0]]).astype(np.float32)
    frame[30, 41] = np.inf
    with pytest.raises(
        ValueError, match="frames must be finite, or NaN where a pixel was not read, got infinity"
    ):
        lb.centroid(frame, [[40, 30]], window=13)


@pytest.mark.parametrize(
    ("window", "ring", "leaks"),
    [(9, None, True), (13, None, True), (9, 19, False), (19, None, False)],
)
def test_light_of_the_spot_in_the_ring_is_flagged(window, ring, leaks):
    frame = image([[40.0, 30.0]], flux=2e5, sigma=3.0)
    found = lb.centroid(frame, [[40, 30]], window=window, ring=ring)
    assert bool(found.flags[0] & SpotFlag.RING) == leaks


def test_frames_without_noise_have_a_small_error_and_not_none():
    frame = lb.render_spots([[20.3, 19.8]], 1e4, 0.8, (41, 41)).astype(np.float32)
    for method in ("eiwa", "grey", "weighted", "gaussian"):
        found = lb.centroid(frame, [[20, 20]], method=method, window=25)
        assert (found.sigma_xy > 0).all()


@pytest.mark.parametrize("step", [1, 4, 16])
@pytest.mark.parametrize("method", ["eiwa", "weighted"])
def test_readings_that_count_in_steps_have_the_noise_of_their_steps(step, method):
    """Twelve bits aligned to the left: the ring may be all of one number."""
    rng = np.random.default_rng(step)
    xy = 20.0 + rng.uniform(-0.5, 0.5, (400, 1, 2))
    light = lb.render_spots(xy, 900.0 * 2 * np.pi * 4.0, 2.0, (41, 41))
    reading = light + rng.normal(403.0, 3.0, light.shape)
    frames = (step * np.rint(reading / step)).astype(np.uint16)
    found = lb.centroid(frames, np.rint(xy), method=method, window=13)
    actual = np.sqrt(np.mean((found.xy - xy) ** 2))
    stated = np.sqrt(np.mean(found.sigma_xy**2))
    assert 0.85 < stated / actual < 1.6
