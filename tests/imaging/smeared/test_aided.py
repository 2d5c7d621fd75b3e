"""Errors against the Cramer-Rao bound, methods against each other, invariants, and what is flagged
or refused.
"""

import warnings

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag

DETECTOR = lb.Detector(gain_e_per_dn=1.5, read_noise_e=6.0, offset_dn=100.0)
SKY_DN = 30.0
SHAKES = lb.random_vibration(150, 21, max_rate_rad_s=np.radians(3.0), frequency_hz=(1.0, 40.0))


@pytest.fixture(scope="module")
def noisy(expose, camera):
    """150 images of 6 stars of 4000 DN with noise, their path known without error."""
    xy = np.random.default_rng(1).uniform(30, 480, (150, 6, 2))
    shot = expose(SHAKES, xy, sigma=0.6, flux=4000.0, size=15)
    frames = DETECTOR.expose((shot.windows + SKY_DN) * DETECTOR.gain_e_per_dn, 5)
    bound = lb.streak_bound(
        xy,
        4000.0,
        path=shot.path,
        camera=camera,
        sigma=0.6,
        noise=DETECTOR,
        background=100.0 + SKY_DN,
    )
    return shot, frames, bound


def measure(noisy, camera, **choices):
    shot, frames, _ = noisy
    options = {
        "origin": shot.origin,
        "background": 100.0 + SKY_DN,
        "noise": DETECTOR,
        "sigma": 0.6,
    } | choices
    return lb.aided_centroid(frames, path=shot.path, camera=camera, **options)


@pytest.mark.parametrize(
    "choices",
    [{}, {"threshold": 0.02}, {"method": "closed_form"}, {"method": "least_squares"}],
    ids=["iterative", "thresholded", "closed form", "least squares"],
)
def test_predicted_errors_are_those_that_happen(noisy, camera, choices):
    found = measure(noisy, camera, **choices)
    pull = (found.xy - noisy[0].end) / found.sigma_xy
    assert found.converged.all()
    # 1800 numbers: their mean square is known to 1/sqrt(900) = 3.3 %.
    assert np.mean(pull**2) == pytest.approx(1.0, abs=0.12)


def test_least_squares_reaches_the_cramer_rao_bound_within_5_percent(noisy, camera):
    shot, _, bound = noisy
    relative = (measure(noisy, camera, method="least_squares").xy - shot.end) / bound
    assert np.sqrt(np.mean(relative**2)) == pytest.approx(1.0, abs=0.05)
    for other in ({}, {"threshold": 0.02}, {"method": "closed_form"}):
        worse = (measure(noisy, camera, **other).xy - shot.end) / bound
        assert np.mean(worse**2) > np.mean(relative**2)


def test_the_bound_of_a_bright_star_at_rest_is_sigma_over_root_n_and_that_of_a_faint_one_the_background_limit(
    camera,
):
    rest = lb.gyro_path(np.zeros((5, 3)), interval_s=0.005, exposure_s=0.025)
    at = [[100.3, 99.6]]
    bright = lb.streak_bound(at, 1e9, path=rest, camera=camera, sigma=3.0, noise=lb.Detector())
    # Pixels add their 1/12 to the variance.
    assert bright[0] == pytest.approx(np.sqrt((9 + 1 / 12) / 1e9), rel=2e-3)
    loud = lb.Detector(read_noise_e=1000.0)
    faint = lb.streak_bound(at, 10.0, path=rest, camera=camera, sigma=3.0, noise=loud)
    assert faint[0] == pytest.approx(np.sqrt(8 * np.pi) * 9 * 1000.0 / 10.0, rel=2e-2)


def test_all_stars_together_beat_single_ones(noisy, camera):
    shot = noisy[0]
    wrong = lb.random_attitudes(1, 1)[0] @ np.array([1e-4, 1e-4, 1e-3])
    rays = camera.points_mm(shot.end) + np.cross(wrong, camera.points_mm(shot.end))
    predicted = camera.pixels(rays)
    single = measure(noisy, camera, method="least_squares")
    joint = measure(noisy, camera, method="joint", predicted=predicted)
    error = {
        name: np.sqrt(np.mean((r.xy - shot.end) ** 2))
        for name, r in (("single", single), ("joint", joint))
    }
    # Three unknowns instead of twelve per image: half the error.
    assert error["joint"] / error["single"] == pytest.approx(0.5, abs=0.1)
    assert np.mean(((joint.xy - shot.end) / joint.sigma_xy) ** 2) == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(joint.turn_rad.mean(axis=0)[:2], -wrong[:2], atol=2e-6)
    np.testing.assert_allclose(joint.rate_rad_s, 0.0, atol=1e-15)


def test_the_joint_fit_finds_a_rate_that_the_gyro_has_missed(camera, expose, sense):
    missed = np.array([0.004, -0.003, 0.0])
    turn = lb.Vibration(constant_rad_s=np.array([0.03, 0.01, 0.0]))
    shot = expose(turn, [[100.2, 80.3], [400.1, 90.4], [250.7, 420.0]], sigma=0.6, flux=1e5)
    poor = lb.Vibration(constant_rad_s=np.array([0.03, 0.01, 0.0]) - missed)
    found = lb.aided_centroid(
        shot.windows,
        origin=shot.origin,
        path=sense(poor),
        camera=camera,
        sigma=0.6,
        method="joint",
        predicted=shot.end,
        rate_prior_rad_s=np.inf,
    )
    np.testing.assert_allclose(
        found.rate_rad_s[:2], -missed[:2], atol=1e-6
    )  # rays turn against the camera
    np.testing.assert_allclose(found.xy, shot.end, atol=1e-3)


def test_methods_agree_without_noise_on_a_smooth_spot(camera, expose):
    shot = expose(SHAKES, np.full((150, 1, 2), [310.2, 99.7]), sigma=0.7, size=21)
    for method in ("iterative", "closed_form", "least_squares"):
        found = lb.aided_centroid(
            shot.windows,
            origin=shot.origin,
            path=shot.path,
            camera=camera,
            sigma=0.7,
            method=method,
        )
        np.testing.assert_allclose(found.xy, shot.end, atol=2e-4)
        np.testing.assert_allclose(found.flux, 1.0, atol=1e-4)


@pytest.mark.parametrize("method", ["iterative", "closed_form", "least_squares"])
def test_a_batch_is_a_loop_and_windows_are_cut_from_frames(camera, method):
    path = lb.motion_path(lb.random_vibration(3, 4, max_rate_rad_s=0.05), 0.025)
    xy = np.random.default_rng(9).uniform(30, 480, (3, 4, 2))
    tracks = path.tracks(xy, camera)
    light = lb.render_streaks(tracks, path.share, 3e4, 0.6, camera.shape) + SKY_DN
    frames = DETECTOR.expose(light, 1)
    options = {"camera": camera, "sigma": 0.6, "method": method, "noise": DETECTOR, "window": 13}
    together = lb.aided_centroid(frames, tracks.mean(axis=-2), path=path, **options)
    assert together.flags.tolist() == np.zeros((3, 4), dtype=int).tolist()
    assert np.abs(together.xy - path.carry(xy, camera)).max() < 0.1
    for k in range(3):
        alone = lb.aided_centroid(frames[k], tracks[k].mean(axis=-2), path=path.part(k), **options)
        np.testing.assert_allclose(alone.xy, together.xy[k], atol=1e-10)
        np.testing.assert_allclose(alone.sigma_xy, together.sigma_xy[k], rtol=1e-9)


def test_epochs_are_moments_of_one_solution(noisy, camera):
    shot = noisy[0]
    start = measure(noisy, camera, epoch="start").xy
    for epoch in ("middle", "end"):
        expected = shot.path.carry(start, camera, end=epoch)
        np.testing.assert_allclose(measure(noisy, camera, epoch=epoch).xy, expected, atol=1e-9)


def test_whole_pixel_shifts_and_brightness_change_nothing(noisy, camera):
    shot, frames, _ = noisy
    shifted = lb.Camera(camera.focal_mm, camera.pixel_um, camera.shape, principal_px=(265.5, 250.5))
    plain = measure(noisy, camera, noise=None)
    moved = lb.aided_centroid(
        (frames - (100.0 + SKY_DN)) * 7.0,
        origin=shot.origin + np.array([10.0, -5.0]),
        path=shot.path,
        camera=shifted,
        sigma=0.6,
        background=0.0,
    )
    np.testing.assert_allclose(moved.xy, plain.xy + np.array([10.0, -5.0]), atol=1e-9)
    np.testing.assert_allclose(moved.flux, 7.0 * plain.flux)


def test_a_saturated_core_is_left_out_of_data_and_model(camera, expose, sense):
    turn = lb.Vibration(constant_rad_s=[0.02, 0.01, 0.0])
    shot = expose(turn, [[100.4, 200.3]], sigma=0.8, flux=1e5)
    burnt = np.minimum(shot.windows, 0.8 * shot.windows.max())
    for method in ("iterative", "least_squares"):
        found = lb.aided_centroid(
            burnt,
            origin=shot.origin,
            path=sense(turn),
            camera=camera,
            sigma=0.8,
            method=method,
            full_scale=burnt.max(),
        )
        assert found.flags[0] == SpotFlag.SATURATED
        np.testing.assert_allclose(found.xy, shot.end, atol=1e-3)
        np.testing.assert_allclose(found.flux, 1e5, rtol=1e-3)


def test_thresholding_the_model_by_itself_is_worse(noisy, camera):
    shared = measure(noisy, camera, threshold=0.03)
    with pytest.warns(RuntimeWarning, match="of 900 stars did not converge in 50 rounds"):
        own = measure(noisy, camera, threshold=0.03, region="own")
    rms = {
        name: np.sqrt(np.mean((r.xy - noisy[0].end) ** 2))
        for name, r in (("shared", shared), ("own", own))
    }
    assert rms["own"] > 1.1 * rms["shared"]
    assert ((own.flags & SpotFlag.NOT_CONVERGED > 0) == ~own.converged).all()


def test_a_narrow_spot_is_flagged_and_finite(camera, expose, sense):
    shot = expose(SHAKES, np.full((150, 1, 2), 255.3), sigma=0.15, nodes=8)
    found = lb.aided_centroid(
        shot.windows,
        origin=shot.origin,
        path=sense(SHAKES, nodes=12),
        camera=camera,
        sigma=0.15,
        background=0.0,
        max_iter=300,
    )
    assert (found.flags & SpotFlag.SLOW > 0).all()
    assert np.linalg.norm(found.xy - shot.end, axis=-1).mean() < 0.1


def test_what_is_wrong_with_a_star_is_flagged_and_nothing_raises(camera):
    path = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.04, 0.0]), 0.025)
    stars = np.array(
        [
            [1.5, 100.0],
            [200.0, 100.0],
            [206.0, 101.0],
            [400.0, 300.0],
            [300.0, 400.0],
            [250.0, 250.0],
        ]
    )
    tracks = path.tracks(stars, camera)
    light = lb.render_streaks(
        tracks, path.share, [3e4, 3e4, 3e4, 3e4, 30.0, 3e4], 0.6, camera.shape
    )
    frame = DETECTOR.expose(light + SKY_DN, 2).astype(float)
    frame[300, 398] = np.nan
    start = tracks.mean(axis=-2)
    start[5] = np.nan
    found = lb.aided_centroid(frame, start, path=path, camera=camera, sigma=0.6, noise=DETECTOR)
    flags = [SpotFlag(int(bits)) for bits in found.flags]
    assert SpotFlag.EDGE in flags[0]
    assert flags[1] == flags[2] == SpotFlag.NEIGHBOUR
    assert flags[3] == SpotFlag.EDGE
    assert SpotFlag.TOO_FAINT in flags[4]
    assert flags[5] == SpotFlag.MISSING and np.isnan(found.xy[5]).all()
    np.testing.assert_allclose(found.xy[3], path.carry(stars, camera)[3], atol=0.1)


@pytest.mark.parametrize("method", ["iterative", "closed_form", "least_squares"])
@pytest.mark.parametrize(("window", "holds"), [(3, False), (5, False), (13, True), (None, True)])
def test_a_window_that_cuts_the_track_is_flagged(camera, window, holds, method):
    path = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.02, 0.0]), 0.025)
    tracks = path.tracks([[200.0, 100.0]], camera)
    assert 1.5 < np.ptp(tracks[..., 0]) < 2.0
    frame = lb.render_streaks(tracks, path.share, 3e4, 0.6, camera.shape)
    start = np.rint(tracks.mean(axis=-2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # what is cut may not settle
        found = lb.aided_centroid(
            frame, start, path=path, camera=camera, sigma=0.6, window=window, method=method
        )
    assert bool(found.flags[0] & SpotFlag.EDGE) is not holds


def test_the_usual_window_fits_into_the_frame():
    small = lb.Camera(focal_mm=36.6, pixel_um=10.0, shape=(20, 24))
    path = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.1, 0.0]), 0.025)
    tracks = path.tracks([[17.0, 10.0]], small)
    frame = lb.render_streaks(tracks, path.share, 3e4, 1.0, small.shape)
    found = lb.aided_centroid(
        frame, tracks.mean(axis=-2), path=path, camera=small, sigma=1.0, background=0.0
    )
    assert found.flags[0] == 0
    np.testing.assert_allclose(found.xy, path.carry([[17.0, 10.0]], small), atol=0.05)


def test_an_empty_field_gives_an_empty_answer(camera, sense):
    path = sense(lb.Vibration())
    found = lb.aided_centroid(
        np.zeros(camera.shape), np.empty((0, 2)), path=path, camera=camera, sigma=0.6
    )
    assert found.xy.shape == (0, 2) and found.flags.shape == (0,)


def test_a_dark_frame_has_no_stars(camera, sense):
    found = lb.aided_centroid(
        np.zeros(camera.shape),
        [[50.0, 50.0]],
        path=sense(lb.Vibration()),
        camera=camera,
        sigma=0.6,
        method="closed_form",
    )
    assert np.isnan(found.xy).all() and found.flags[0] & SpotFlag.TOO_FAINT


def test_a_joint_fit_leaves_out_what_is_not_predicted_and_says_where_the_unseen_are(camera):
    path = lb.motion_path(lb.Vibration(constant_rad_s=[0.0, 0.04, 0.0]), 0.025)
    stars = np.array([[100.0, 100.0], [400.0, 150.0], [300.0, 400.0], [60.0, 450.0]])
    tracks = path.tracks(stars, camera, epoch="end")
    frame = lb.render_streaks(tracks, path.share, 3e4, 0.6, camera.shape)
    start, predicted = tracks.mean(axis=-2), stars + 0.2
    start[2], predicted[3] = np.nan, np.nan
    found = lb.aided_centroid(
        frame,
        start,
        path=path,
        camera=camera,
        sigma=0.6,
        method="joint",
        predicted=predicted,
        background=0.0,
    )
    np.testing.assert_allclose(found.xy[:3], stars[:3], atol=0.02)
    assert np.isnan(found.xy[3]).all() and np.isnan(found.sigma_xy[3]).all()
    assert found.flags.tolist() == [0, 0, SpotFlag.MISSING, SpotFlag.MISSING]


def test_a_joint_fit_of_one_star_in_sight_tells_nothing(camera, sense):
    stars = np.array([[100.0, 100.0], [400.0, 150.0]])
    frame = lb.render_spots(stars[:1], 3e4, 0.6, camera.shape)
    start = [[100.0, 100.0], [np.nan, np.nan]]
    with pytest.warns(RuntimeWarning, match="2 of 2 stars did not converge"):
        found = lb.aided_centroid(
            frame,
            start,
            path=sense(lb.Vibration()),
            camera=camera,
            sigma=0.6,
            method="joint",
            predicted=stars,
        )
    assert np.isnan(found.xy).all() and (found.flags & SpotFlag.NOT_CONVERGED > 0).all()


def test_a_start_beside_the_star_does_not_settle_on_nothing(camera, sense):
    frame = lb.render_spots([[100.0, 100.0]], 3e4, 0.6, camera.shape)
    with pytest.warns(RuntimeWarning, match="1 of 1 stars did not converge"):
        found = lb.aided_centroid(
            frame,
            [[105.0, 105.0]],
            path=sense(lb.Vibration()),
            camera=camera,
            sigma=0.6,
            window=7,
            method="least_squares",
            background=0.0,
        )
    assert found.flags[0] & SpotFlag.NOT_CONVERGED and not found.converged[0]


@pytest.mark.parametrize("choices", [{}, {"threshold": 0.02}])
def test_a_star_that_is_missing_raises_no_warning(camera, sense, choices):
    frame = lb.render_spots([[100.0, 100.0]], 3e4, 0.6, camera.shape)
    start = [[100.0, 100.0], [np.nan, np.nan]]
    found = lb.aided_centroid(
        frame, start, path=sense(lb.Vibration()), camera=camera, sigma=0.6, **choices
    )
    assert found.flags.tolist() == [0, SpotFlag.MISSING]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"frames": np.zeros((100, 512))},
            r"frames must have shape \(\.\.\., 512, 512\) to match the camera, got \(100, 512\)",
        ),
        (
            {"frames": np.zeros((512, 512), complex)},
            "frames must be of an integer or float type, got complex128",
        ),
        (
            {"start": np.zeros((3, 4, 2))},
            r"start must have shape \(n, 2\) or \('n', 2\) to match frames, got \(3, 4, 2\)",
        ),
        ({"start": None}, "give start with whole frames, or origin with windows, and not both"),
        (
            {"start": None, "origin": np.zeros((2, 2))},
            r"frames must have shape \(\.\.\., n, h, w\) to be windows",
        ),
        (
            {"path": lb.motion_path(SHAKES, 0.025)},
            r"path must be of one exposure or of \(\) to match frames, got \(150,\)",
        ),
        ({"width": None, "sigma": -0.5}, "sigma must be positive, got -0.5"),
        (
            {"width": None, "sigma": [0.5, 0.5, 0.5]},
            r"sigma must be one number or \(sx, sy\), got shape \(3,\)",
        ),
        (
            {"method": "magic"},
            "method must be one of 'iterative', 'closed_form', 'least_squares', 'joint'",
        ),
        ({"epoch": "later"}, "epoch must be one of 'start', 'middle', 'end'"),
        ({"window": 12}, "window must be odd, got 12"),
        (
            {"window": 601},
            "window of 601 x 601 pixels does not fit into frames of 512 x 512 pixels",
        ),
        ({"noise": 3.0}, "noise must be a Detector, got 3.0"),
        ({"background": "plane"}, "background must be one of 'border'"),
        ({"background": np.zeros(3)}, r"background must broadcast to \(1,\), got shape \(3,\)"),
        ({"threshold": 2.0}, "threshold must be a finite number from 0 to 1, got 2"),
        ({"region": "own"}, "region 'own' needs a threshold"),
        ({"method": "joint"}, "predicted must be given for method 'joint', and for no other"),
        (
            {"method": "joint", "predicted": [[50.0, 50.0]]},
            "joint needs at least 2 stars in an image, got 1",
        ),
        ({"max_iter": 0}, "max_iter must be a whole number of at least 1, got 0"),
        ({"width": -1.0}, "width must be positive, got -1"),
        ({"width": [1.0, 2.0, 3.0]}, r"width must be one number or \(sx, sy\), got shape \(3,\)"),
        ({"width": None}, "width must be given"),
        ({"width": np.ones(2), "sigma": 0.6}, "width and sigma are one thing, got both"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(camera, sense, change, message):
    arguments = {
        "frames": np.zeros((512, 512)),
        "start": [[50.0, 50.0]],
        "path": sense(lb.Vibration()),
        "camera": camera,
        "width": 0.6,
    } | change
    with pytest.raises(ValueError, match=message):
        lb.aided_centroid(**arguments)


def test_width_and_sigma_are_one_thing(camera, sense):
    path, at = sense(lb.Vibration()), [[50.5, 49.5]]
    how = {"path": path, "camera": camera, "detector": lb.Detector()}
    bounds = [lb.streak_bound(at, 1e5, **how, **word) for word in ({"width": 0.6}, {"sigma": 0.6})]
    np.testing.assert_array_equal(*bounds)
    frame = lb.render_spots(at, 1e5, 0.6, camera.shape)
    found = [
        lb.aided_centroid(frame, at, **how, **word).xy for word in ({"width": 0.6}, {"sigma": 0.6})
    ]
    np.testing.assert_array_equal(*found)
