"""Template centroids against Cramer-Rao, against an independent fit, and their errors against their
scatter.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from noisy_spots import BACKGROUND_E, CAMERA, cramer_rao, first_odd, rms, spots
from scipy.optimize import least_squares

import losbench as lb
from losbench.imaging.columns import Templates
from losbench.imaging.results import SpotFlag
from losbench.imaging.stamps import cut_stamps, ring_of

TEMPLATES = ("weighted", "likelihood", "gaussian")


@pytest.mark.parametrize("snr", [10, 30, 100])
@pytest.mark.parametrize("sigma", [1.5, 2.0, 4.0])
def test_the_weighted_centroid_reaches_the_cramer_rao_bound(sigma, snr):
    frames, xy, flux = spots(sigma, snr, n=4000)
    how = {"method": "weighted", "window": first_odd(6 * sigma), "noise": CAMERA}
    known = lb.centroid(frames, np.rint(xy), background=BACKGROUND_E + 50.0, **how)
    assert 0.97 < rms(known.xy - xy) / cramer_rao(sigma, flux) < 1.03
    # The plane's own error comes on top, and matters for wide faint spots.
    found = lb.centroid(frames, np.rint(xy), **how)
    assert (
        0.97
        < rms(found.xy - xy) / cramer_rao(sigma, flux)
        < (1.06 if sigma == 4.0 and snr == 10 else 1.04)
    )
    assert not found.flags.any()
    assert found.n_iter.mean() < 3.6


@pytest.mark.parametrize("snr", [10, 30, 200])
@pytest.mark.parametrize("sigma", [0.8, 1.5, 2.5])
def test_the_likeliest_gaussian_reaches_it_and_states_its_scatter(sigma, snr):
    frames, xy, flux = spots(sigma, snr, n=4000)
    window = max(7, first_odd(6 * sigma))
    found = lb.centroid(frames, np.rint(xy), method="likelihood", window=window, noise=CAMERA)
    assert 0.97 < rms(found.xy - xy) / cramer_rao(sigma, flux) < 1.05
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.05)
    assert not found.flags.any()


@pytest.mark.parametrize(("snr", "highest"), [(10, 1.12), (30, 1.15), (100, 1.4)])
def test_the_least_squares_fit_comes_near_it(snr, highest):
    frames, xy, flux = spots(2.0, snr, n=500)
    found = lb.centroid(frames, np.rint(xy), method="gaussian", window=13, noise=CAMERA)
    assert 0.95 < rms(found.xy - xy) / cramer_rao(2.0, flux) < highest


@pytest.mark.parametrize("snr", [10, 30, 100])
def test_undersampled_stars_are_no_exception(snr):
    frames, xy, flux = spots(0.65, snr, n=4000)
    found = lb.centroid(frames, np.rint(xy), method="weighted", window=7, noise=CAMERA)
    assert 0.97 < rms(found.xy - xy) / cramer_rao(0.65, flux) < 1.06


@pytest.mark.parametrize("method", TEMPLATES)
@pytest.mark.parametrize(("sigma", "snr"), [(0.65, 30), (1.5, 10), (2.0, 100), (4.0, 30)])
def test_the_predicted_error_is_the_scatter(method, sigma, snr):
    n = 1000 if method == "gaussian" else 4000
    frames, xy, _ = spots(sigma, snr, n=n)
    found = lb.centroid(
        frames, np.rint(xy), method=method, window=max(7, first_odd(6 * sigma)), noise=CAMERA
    )
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(
        1.0, abs=0.07 if method == "gaussian" else 0.04
    )


@pytest.mark.parametrize("method", TEMPLATES)
@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.5])
def test_there_is_no_s_curve(method, sigma):
    phase = np.linspace(-0.5, 0.5, 21)
    xy = np.stack([30 + phase, np.full(21, 30.2)], axis=-1)[:, None]
    frames = lb.render_spots(xy, 1e5, sigma, (61, 61)) + 20.0
    found = lb.centroid(
        frames, np.rint(xy), method=method, window=max(7, first_odd(6 * sigma)), ring=23
    )
    assert 1e3 * np.abs(found.xy - xy).max() < 0.5


def test_the_fit_agrees_with_one_written_down_by_hand():
    frames, xy, flux = spots(2.0, 50, n=10)
    found = lb.centroid(frames, np.rint(xy), method="gaussian", window=13, background=150.0)
    for frame, fitted in zip(frames, found.xy[:, 0], strict=True):
        column, row = np.rint(xy[0, 0]).astype(int)
        data = frame[row - 6 : row + 7, column - 6 : column + 7] - 150.0

        def misfit(p, data=data):
            return (
                lb.render_spots(p[None, :2], abs(p[2]), np.abs(p[3:]), data.shape) - data
            ).ravel()

        by_hand = least_squares(misfit, [6.0, 6.0, flux, 2.2, 2.2], x_scale=[1, 1, flux, 1, 1]).x
        np.testing.assert_allclose(fitted, by_hand[:2] + np.array([column - 6, row - 6]), atol=1e-4)


@pytest.mark.parametrize("width", [0.6, 2.0, (1.6, 2.4)])
def test_the_width_is_the_median_of_the_call(width):
    rng = np.random.default_rng(3)
    xy = 12 + rng.uniform(-0.5, 0.5, (300, 1, 2))
    frames = CAMERA.expose(lb.render_spots(xy, 3e4, width, (25, 25)) + BACKGROUND_E, rng)
    how = {"method": "weighted", "window": 13, "noise": CAMERA}
    told = lb.centroid(frames, np.rint(xy), sigma=width, **how)
    found = lb.centroid(frames, np.rint(xy), **how)
    assert rms(found.xy - told.xy) < 0.02 * rms(told.xy - xy)
    assert found.flux.mean() == pytest.approx(3e4, rel=0.003)


def test_a_star_of_its_own_width_does_not_change_the_others():
    rng = np.random.default_rng(4)
    xy = np.array([[20.2, 20.4], [60.1, 20.3], [100.4, 19.8]])
    image = CAMERA.expose(
        lb.render_spots(xy, [3e4, 3e4, 9e4], [[1.2], [1.2], [3.0]], (41, 121)) + BACKGROUND_E, rng
    )
    found = lb.centroid(image, np.rint(xy), method="weighted", window=9, ring=19, noise=CAMERA)
    assert np.abs(found.xy[:2] - xy[:2]).max() < 0.05


@pytest.mark.parametrize("method", TEMPLATES)
def test_a_gradient_of_the_background_is_taken_off(method):
    image = lb.render_spots([[20.2, 19.9]], 2e4, 2.0, (41, 41)) + 3.0 * np.arange(41.0) + 50.0
    found = lb.centroid(image, [[20, 20]], method=method, window=13, ring=17)
    np.testing.assert_allclose(found.xy, [[20.2, 19.9]], atol=2e-3)
    assert found.background[0] == pytest.approx(50.0 + 3.0 * 20.2, abs=0.5)


@settings(max_examples=15, deadline=None)
@given(
    dx=st.integers(-6, 6),
    dy=st.integers(-6, 6),
    transpose=st.booleans(),
    factor=st.sampled_from([1e-12, 1.0, 1e15]),
)
def test_weighted_centroids_follow_shifts_transposition_and_units(dx, dy, transpose, factor):
    rng = np.random.default_rng(5)
    xy = np.array([[24.3, 25.1], [58.8, 30.6]])
    image = CAMERA.expose(lb.render_spots(xy, 3e4, 2.0, (56, 84)) + 80, rng).astype(np.float64)
    how = {"method": "weighted", "window": 13, "tolerance": 1e-9}
    shift = np.array([dx, dy])
    expected = lb.centroid(image, np.rint(xy), **how).xy + shift
    moved, start = factor * np.roll(image, (dy, dx), axis=(0, 1)), np.rint(xy) + shift
    if transpose:
        moved, start, expected = moved.T, start[:, ::-1], expected[:, ::-1]
    found = lb.centroid(moved, start, **how)
    np.testing.assert_allclose(found.xy, expected, atol=1e-8 if not transpose else 5e-3)


@pytest.mark.parametrize("method", TEMPLATES)
def test_a_batch_is_a_loop(method):
    rng = np.random.default_rng(1)
    xy = np.array([[20.3, 18.7], [45.1, 22.2]]) + rng.uniform(-0.4, 0.4, (10, 2, 2))
    frames = CAMERA.expose(lb.render_spots(xy, [2e4, 2e3], 2.0, (41, 64)) + 80, rng)
    how = {"method": method, "window": 13, "sigma": 2.0, "noise": CAMERA}
    together = lb.centroid(frames, np.rint(xy), **how)
    for k, frame in enumerate(frames):
        alone = lb.centroid(frame, np.rint(xy[k]), **how)
        for name in ("xy", "sigma_xy", "flux", "background", "n_iter", "flags"):
            np.testing.assert_allclose(
                getattr(alone, name), getattr(together, name)[k], rtol=1e-5, atol=1e-5
            )


@pytest.mark.parametrize("method", TEMPLATES)
def test_the_start_matters_less_than_a_tenth_of_the_error(method):
    frames, xy, _ = spots(2.0, 50, n=100)
    how = {"method": method, "window": 13, "sigma": 2.0, "noise": CAMERA}
    near = lb.centroid(frames, xy, **how)
    far = lb.centroid(frames, xy + np.array([1.6, -1.7]), **how)
    assert rms((near.xy - far.xy) / near.sigma_xy) < 0.1
    assert not far.flags.any()


@pytest.mark.parametrize("method", TEMPLATES)
def test_what_is_wrong_is_flagged(method):
    rng = np.random.default_rng(2)
    xy = np.array([[20.0, 20.0], [50.0, 20.0], [80.0, 20.0], [3.0, 50.0], [50.0, 50.0]])
    image = lb.render_spots(xy, [3e4, 60.0, 3e6, 3e4, 3e4], 2.0, (70, 110)) + BACKGROUND_E
    frame = CAMERA.expose(image, rng).astype(np.float32)
    frame[50, 51], frame[45:55, 72:78] = np.nan, np.nan
    xy = np.concatenate([xy, [[76.0, 50.0]]])
    found = lb.centroid(frame, xy, method=method, window=13, noise=CAMERA, full_scale_dn=60000.0)
    flags = [SpotFlag(int(bits)) for bits in found.flags]
    assert flags[0] == 0
    assert SpotFlag.TOO_FAINT in flags[1]
    assert SpotFlag.SATURATED in flags[2]
    assert SpotFlag.EDGE in flags[3]
    assert flags[4] == SpotFlag.BAD_PIXEL and flags[5] == SpotFlag.MISSING
    lost = [False, True, False, True, False, True]
    np.testing.assert_array_equal(np.isnan(found.xy).any(axis=1), lost)
    assert found.n_bad[4] == 1 and not found.n_bad[[0, 5]].any()
    assert (np.abs(found.xy[4] - xy[4]) < 4 * found.sigma_xy[4]).all()


@pytest.mark.parametrize("method", TEMPLATES)
def test_frames_without_light_or_noise_give_no_centroid_and_no_warning(method):
    for frames in (
        np.zeros((30, 30)),
        np.full((30, 30), 7, dtype=np.uint8),
        np.full((30, 30), np.nan),
    ):
        found = lb.centroid(frames, [[15, 15]], method=method, window=9)
        assert np.isnan(found.xy).all()
        assert found.flags[0] & (SpotFlag.TOO_FAINT | SpotFlag.MISSING)


@pytest.mark.parametrize("sigma", [0.0, -1.0, 14.0, np.nan, [1.0, 2.0, 3.0], "wide"])
def test_a_width_that_makes_no_sense_is_refused(sigma):
    with pytest.raises(ValueError, match="sigma"):
        lb.centroid(np.zeros((30, 30)), [[15, 15]], method="weighted", window=13, sigma=sigma)


def test_the_width_that_was_found_is_told():
    frames, xy, _ = spots(2.0, 50, n=200)
    found = lb.centroid(frames, np.rint(xy), method="weighted", window=13, noise=CAMERA)
    np.testing.assert_allclose(found.width_px, [[2.0, 2.0]], rtol=0.02)
    one = lb.centroid(frames[0], np.rint(xy[0]), method="weighted", window=13, sigma=(1.9, 2.1))
    assert one.width_px.tolist() == [[1.9, 2.1]]
    assert lb.centroid(frames, np.rint(xy), window=13).width_px is None


def test_every_spot_of_a_recording_has_its_own_width():
    rng = np.random.default_rng(6)
    xy = np.array([[30.3, 30.1], [90.2, 29.8]]) + rng.uniform(-0.4, 0.4, (200, 2, 2))
    frames = CAMERA.expose(lb.render_spots(xy, 3e4, [[1.5], [4.0]], (61, 121)) + BACKGROUND_E, rng)
    found = lb.centroid(frames, np.rint(xy), method="weighted", window=25, noise=CAMERA)
    np.testing.assert_allclose(found.width_px, [[1.5, 1.5], [4.0, 4.0]], rtol=0.03)
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.1)
    assert not found.flags.any()


def test_a_blocked_beam_has_no_vote():
    rng = np.random.default_rng(7)
    xy = np.array([[20.3, 20.1], [60.2, 19.8]]) + rng.uniform(-0.4, 0.4, (30, 2, 2))
    flux = np.stack([np.full(30, 3e4), np.where(np.arange(30) < 20, 0.0, 3e4)], axis=-1)
    frames = CAMERA.expose(lb.render_spots(xy, flux, 2.0, (41, 81)) + BACKGROUND_E, rng)
    found = lb.centroid(frames, np.rint(xy), method="weighted", window=13, noise=CAMERA)
    np.testing.assert_allclose(found.width_px, 2.0, rtol=0.05)
    assert rms((found.xy[:, 0] - xy[:, 0]) / found.sigma_xy[:, 0]) == pytest.approx(1.0, abs=0.25)
    assert (found.flags[:20, 1] & SpotFlag.TOO_FAINT).all()


@pytest.mark.parametrize("sigma", [1.0, 4.0])
def test_a_template_of_a_wrong_width_is_flagged(sigma):
    frames, xy, _ = spots(2.0, 50, n=20)
    found = lb.centroid(
        frames, np.rint(xy), method="weighted", window=13, sigma=sigma, noise=CAMERA
    )
    assert (found.flags & SpotFlag.MISFIT).all()


@pytest.mark.parametrize("factor", [1e-12, 1.0, 1e12])
def test_a_fitted_gaussian_does_not_depend_on_the_unit(factor):
    frames, xy, _ = spots(2.0, 50, n=5)
    how = {"method": "gaussian", "window": 13}
    expected = lb.centroid(frames.astype(np.float64), np.rint(xy), **how)
    found = lb.centroid(factor * frames.astype(np.float64), np.rint(xy), **how)
    np.testing.assert_allclose(found.xy, expected.xy, atol=1e-6)
    np.testing.assert_allclose(found.sigma_xy, expected.sigma_xy, rtol=1e-3)
    np.testing.assert_allclose(found.flux, factor * expected.flux, rtol=1e-5)


def test_templates_in_single_precision_are_those_in_double():
    rng = np.random.default_rng(0)
    centre, width = rng.uniform(-4.0, 4.0, (500, 2)), rng.uniform(0.3, 6.0, (500, 2))
    single, double = (
        Templates.of(21, centre, width, kind, free=True).profiles for kind in (np.float32, float)
    )
    assert single.dtype == np.float32
    # Sums up to an edge, whose errors the docstring bounds; and what single numbers round.
    assert np.abs(np.cumsum(single[:, :, 0] - double[:, :, 0], axis=2)).max() < 2 * 3e-7 + 4e-7
    assert np.abs(single[:, :, 0] - double[:, :, 0]).max() < 2 * 3e-7


@pytest.mark.parametrize("strided", [False, True])
def test_stamps_are_cut_out_of_frames_that_go_on_as_nan(strided):
    rng = np.random.default_rng(1)
    stack = rng.integers(0, 4096, (3, 24, 60), dtype=np.uint16)[:, :, :: 2 if strided else 1]
    _, rows, columns = stack.shape
    frame, y, x = (index.ravel() for index in np.indices((3, rows, columns)))
    stamps = cut_stamps(stack, frame, np.column_stack([x, y]), 5)
    wide = np.pad(stack.astype(np.float32), ((0, 0), (5, 5), (5, 5)), constant_values=np.nan)
    expected = np.lib.stride_tricks.sliding_window_view(wide, (11, 11), axis=(1, 2))
    np.testing.assert_array_equal(stamps, expected.reshape(-1, 11, 11))
    assert ring_of(stamps[:0], 3).shape == (0, 11**2 - 3**2)
    ring = ring_of(stamps, 3)
    outside = np.ones((11, 11), dtype=bool)
    outside[4:7, 4:7] = False
    np.testing.assert_array_equal(ring, stamps[:, outside])
