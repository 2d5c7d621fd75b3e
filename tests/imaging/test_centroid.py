"""Centroids against Cramer-Rao, closed forms and a least-squares fit; their errors against their
scatter.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from noisy_spots import CAMERA, cramer_rao, first_odd, rms, spots
from scipy.optimize import least_squares

import losbench as lb
from losbench.imaging.centroid import window_path


@pytest.mark.parametrize(
    ("snr", "lowest", "highest"),
    [(10, 1.5, 2.4), (30, 1.15, 1.7), (100, 1.0, 1.2)],
)
@pytest.mark.parametrize("sigma", [1.5, 2.0, 4.0])
def test_eiwa_over_six_sigma_is_this_far_from_cramer_rao(sigma, snr, lowest, highest):
    frames, xy, flux = spots(sigma, snr)
    found = lb.centroid(frames, np.rint(xy), window=first_odd(6 * sigma), noise=CAMERA)
    assert lowest < rms(found.xy - xy) / cramer_rao(sigma, flux) < highest


@pytest.mark.parametrize("snr", [10, 30])
@pytest.mark.parametrize("sigma", [1.5, 2.0, 4.0])
def test_a_window_of_four_sigma_is_better_on_faint_spots(sigma, snr):
    frames, xy, flux = spots(sigma, snr)
    window = {"window": first_odd(4 * sigma), "ring": first_odd(6 * sigma)}
    found = lb.centroid(frames, np.rint(xy), **window, noise=CAMERA)
    assert 1.0 < rms(found.xy - xy) / cramer_rao(sigma, flux) < 1.35


@pytest.mark.parametrize(
    ("sigma", "snr"), [(1.5, 10), (1.5, 30), (2.0, 100), (3.0, 10), (3.0, 30), (4.0, 30)]
)
def test_the_predicted_error_is_the_scatter(sigma, snr):
    frames, xy, _ = spots(sigma, snr, n=4000)
    found = lb.centroid(frames, np.rint(xy), window=first_odd(6 * sigma), noise=CAMERA)
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.04)


def test_the_predicted_error_knows_how_much_a_tight_window_follows_the_spot():
    frames, xy, _ = spots(2.0, 20, n=4000)
    found = lb.centroid(frames, np.rint(xy), window=7, ring=13, noise=CAMERA)
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.06)


def test_without_a_detector_the_ring_gives_the_error_of_a_faint_spot():
    frames, xy, _ = spots(2.0, 5, n=4000)
    found = lb.centroid(frames, np.rint(xy), window=9, ring=13)
    seen = np.isfinite(found.xy)
    assert rms(((found.xy - xy) / found.sigma_xy)[seen]) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("snr", [10, 100])
def test_the_error_of_a_grey_window_includes_its_pull(snr):
    frames, xy, _ = spots(2.0, snr, n=4000)
    found = lb.centroid(frames, np.rint(xy), method="grey", window=13, noise=CAMERA)
    assert rms((found.xy - xy) / found.sigma_xy) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("sigma", "largest_mpx"), [(1.5, 1.4), (2.0, 0.5), (4.0, 1.5)])
def test_the_s_curve_of_six_sigma_is_a_millipixel(sigma, largest_mpx):
    phase = np.linspace(-0.5, 0.5, 41)
    xy = np.stack([30 + phase, np.full(41, 30.0)], axis=-1)[:, None]
    frames = lb.render_spots(xy, 1e5, sigma, (61, 61)) + 20.0
    found = lb.centroid(frames, np.rint(xy), window=first_odd(6 * sigma), tolerance=1e-8)
    assert 1e3 * np.abs(found.xy - xy).max() < largest_mpx


def test_eiwa_agrees_with_a_least_squares_fit_on_a_bright_spot():
    frames, xy, flux = spots(2.0, 300, n=20)
    found = lb.centroid(frames, np.rint(xy), window=13, noise=CAMERA)
    for frame, eiwa, sigma in zip(frames, found.xy[:, 0], found.sigma_xy[:, 0], strict=True):
        data = frame - 50.0

        def misfit(p, data=data):
            model = lb.render_spots(p[None, :2], abs(p[2]), abs(p[3]), data.shape) + p[4]
            return ((model - data) / np.sqrt(data + 25.0)).ravel()

        fit = least_squares(misfit, [*eiwa, flux, 2.2, 90.0], x_scale=[1, 1, flux, 1, 100])
        assert np.abs(eiwa - fit.x[:2]).max() < 4 * sigma.max() + 1e-3


@settings(max_examples=20, deadline=None)
@given(level=st.floats(0, 500), x=st.floats(19.5, 20.5), y=st.floats(19.5, 20.5))
def test_the_fixed_point_ignores_a_constant_background(level, x, y):
    image = lb.render_spots([[x, y]], 2e4, 2.0, (41, 41))
    fixed = {"window": 13, "tolerance": 1e-10, "max_iter": 3000}
    bare = lb.centroid(image, [[20, 20]], background=0.0, **fixed)
    raised = lb.centroid(image + level, [[20, 20]], background="none", **fixed)
    np.testing.assert_allclose(raised.xy, bare.xy, atol=1e-7)


@pytest.mark.parametrize(("snr", "lowest", "highest"), [(10, 8.0, 18.0), (30, 1.2, 2.4)])
def test_the_step_rule_stops_early_on_a_pedestal_and_says_by_how_much(snr, lowest, highest):
    frames, xy, _ = spots(2.0, snr)
    raw = frames.astype(np.float32) - 50
    at_rest = lb.centroid(
        raw, np.rint(xy), window=13, background="none", tolerance=1e-7, max_iter=1000
    ).xy
    early = lb.centroid(
        raw, np.rint(xy), window=13, background="none", stop="step", centre="peak", noise=CAMERA
    )
    newton = lb.centroid(raw, np.rint(xy), window=13, background="none", centre="peak")
    assert lowest < 1e3 * rms(early.xy - at_rest) < highest
    assert 1e3 * rms(newton.xy - at_rest) < 1.0
    subtracted = lb.centroid(
        raw, np.rint(xy), window=13, background=100.0, stop="step", centre="peak"
    )
    assert 1e3 * rms(subtracted.xy - at_rest) < 0.3


def test_an_untreated_gradient_moves_the_centroid_by_the_closed_form():
    n, slope, flux = 13, 0.3, 2e4
    image = lb.render_spots([[20, 20]], flux, 2.0, (41, 41))
    edge = image[14:27, 26:28].sum(axis=0).mean()
    tilted = image + slope * (np.arange(41.0) - 20)
    shift = lb.centroid(tilted, [[20, 20]], window=n, background="none", tolerance=1e-9).xy[0] - 20
    assert shift[0] == pytest.approx(slope * n**4 / (12 * (flux - n * edge)), rel=0.03)
    assert shift[1] == pytest.approx(0.0, abs=1e-9)
    treated = lb.centroid(tilted, [[20, 20]], window=n, tolerance=1e-9).xy[0]
    np.testing.assert_allclose(treated, 20.0, atol=1e-3)


def naive_twin():
    path = Path(__file__).parents[2] / "benchmarks" / "bench_centroid.py"
    spec = importlib.util.spec_from_file_location("bench_centroid", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_plain_loop_of_the_benchmark_gives_the_same_answers():
    twin = naive_twin()
    frames, xy = twin.two_spots(20)
    start = np.rint(xy)
    plain = np.array(
        [
            [twin.naive_eiwa(f, p, 15, tolerance=1e-8) for p in ps]
            for f, ps in zip(frames, start, strict=True)
        ]
    )
    np.testing.assert_allclose(
        lb.centroid(frames, start, window=15, tolerance=1e-8).xy, plain, atol=1e-5
    )


def test_the_step_rule_is_the_paper_to_the_letter():
    frames, _, _ = spots(2.0, 30, n=5)
    x = np.arange(frames.shape[2])
    for frame in frames:
        pixels, centre, path = frame.astype(float), np.array([14.0, 15.0]), []
        for _ in range(100):
            weight = [np.clip(7.0 - abs(x - c), 0, 1) for c in centre]
            window = pixels * weight[0] * weight[1][:, None]
            new = np.array([(window * x).sum(), (window * x[:, None]).sum()]) / window.sum()
            path.append(centre)
            done = np.hypot(*(new - centre)) < 0.005
            centre = new
            if done:
                break
        found = lb.centroid(frame, [[14.0, 15.0]], window=13, stop="step", background="none")
        np.testing.assert_allclose(found.xy[0], centre, atol=1e-5)
        np.testing.assert_allclose(
            window_path(frame, [14.0, 15.0], window=13, background="none")[:3], path[:3], atol=1e-5
        )


def test_a_grey_window_is_the_paper_to_the_letter():
    frames, _, _ = spots(2.0, 30, n=5)
    x = np.arange(13)
    for frame in frames:
        row, column = np.unravel_index(frame.argmax(), frame.shape)
        window = frame[row - 6 : row + 7, column - 6 : column + 7] - 150.0
        expected = np.array([(window * x).sum(), (window * x[:, None]).sum()]) / window.sum() + [
            column - 6,
            row - 6,
        ]
        found = lb.centroid(frame, [[14, 15]], method="grey", window=13, background=150.0)
        np.testing.assert_allclose(found.xy[0], expected, atol=1e-5)
    stays = lb.centroid(
        frames, [[15.2, 14.9]], method="grey", window=13, centre="start", background=150.0
    )
    fixed = frames[:, 9:22, 9:22].astype(float) - 150.0
    expected = (fixed * x).sum(axis=(1, 2)) / fixed.sum(axis=(1, 2)) + 9
    np.testing.assert_allclose(stays.xy[:, 0, 0], expected, atol=1e-5)


def test_eiwa_beats_grey_because_noise_moves_the_peak_pixel():
    light = lb.render_spots([[20, 20]], 2000 * 2 * np.pi * 9, 3.0, (41, 41)) + 50
    frames = CAMERA.expose(np.broadcast_to(light, (2000, 41, 41)), 8)
    scatter = {
        name: lb.centroid(frames, [[20, 20]], window=19, **how).xy.std()
        for name, how in {
            "eiwa": {},
            "peak": {"method": "grey"},
            "fixed": {"method": "grey", "centre": "start"},
        }.items()
    }
    assert 0.85 < scatter["eiwa"] / scatter["peak"] < 0.97
    assert scatter["eiwa"] / scatter["fixed"] == pytest.approx(1.0, abs=0.06)


@settings(max_examples=15, deadline=None)
@given(dx=st.integers(-6, 6), dy=st.integers(-6, 6), transpose=st.booleans(), flip=st.booleans())
def test_centroids_follow_shifts_flips_and_transposition(dx, dy, transpose, flip):
    rng = np.random.default_rng(5)
    xy = np.array([[24.3, 25.1], [58.8, 30.6]])
    image = CAMERA.expose(lb.render_spots(xy, 3e4, 2.0, (56, 84)) + 80, rng).astype(np.float64)
    shift = np.array([dx, dy])
    moved, start = np.roll(image, (dy, dx), axis=(0, 1)), np.rint(xy) + shift
    expected = lb.centroid(image, np.rint(xy), window=13, tolerance=1e-9).xy + shift
    if flip:
        moved, start, expected = (
            moved[:, ::-1],
            [83, 0] + start * [-1, 1],
            [83, 0] + expected * [-1, 1],
        )
    if transpose:
        moved, start, expected = moved.T, start[:, ::-1], expected[:, ::-1]
    # The clip of the ring starts from the median of every fourth pixel, whose choice a flip
    # changes.
    tolerance = 1e-8 if not (flip or transpose) else 5e-3
    np.testing.assert_allclose(
        lb.centroid(moved, start, window=13, tolerance=1e-9).xy, expected, atol=tolerance
    )


@pytest.mark.parametrize(
    "dtype", [np.uint8, np.uint16, np.int32, np.float32, np.float64, ">f4", ">u2"]
)
def test_every_type_gives_the_same_centroid(dtype):
    image = lb.Detector(gain_e_per_dn=8.0, read_noise_e=10.0, offset_dn=20.0, bits=8).expose(
        lb.render_spots([[20.3, 18.7]], 2e4, 2.0, (40, 42)) + 40, 2
    )
    reference = lb.centroid(image.astype(np.float64), [[20, 19]], window=13)
    found = lb.centroid(image.astype(dtype), [[20, 19]], window=13)
    np.testing.assert_allclose(found.xy, reference.xy, atol=1e-5)
    np.testing.assert_allclose(found.sigma_xy, reference.sigma_xy, rtol=1e-3)


def test_a_batch_is_a_loop():
    rng = np.random.default_rng(1)
    xy = np.array([[20.3, 18.7], [45.1, 22.2]]) + rng.uniform(-0.4, 0.4, (40, 2, 2))
    frames = CAMERA.expose(lb.render_spots(xy, [2e4, 900.0], 2.0, (41, 64)) + 80, rng)
    together = lb.centroid(frames, np.rint(xy), window=13, noise=CAMERA)
    for k, frame in enumerate(frames):
        alone = lb.centroid(frame, np.rint(xy[k]), window=13, noise=CAMERA)
        for name in ("xy", "sigma_xy", "flux", "background", "n_iter", "flags"):
            np.testing.assert_allclose(
                getattr(alone, name), getattr(together, name)[k], rtol=1e-5, atol=1e-5
            )


def test_the_start_matters_less_than_a_tenth_of_the_error():
    frames, xy, _ = spots(2.0, 50, n=300)
    near = lb.centroid(frames, xy, window=13, noise=CAMERA)
    far = lb.centroid(frames, xy + np.array([2.6, -1.7]), window=13, noise=CAMERA)
    assert rms((near.xy - far.xy) / near.sigma_xy) < 0.1
    assert not far.flags.any()


def test_flux_and_background_are_what_was_put_in():
    frames, xy, flux = spots(2.0, 100, n=500)
    found = lb.centroid(frames, np.rint(xy), window=15, ring=21)
    assert found.flux.mean() == pytest.approx(flux, rel=0.003)
    assert found.background.mean() == pytest.approx(150.0, abs=0.2)


def test_newton_needs_two_or_three_evaluations_where_the_paper_needs_many():
    frames, xy, _ = spots(2.0, 30)
    raw = {"window": 13, "background": "none"}
    assert lb.centroid(frames, np.rint(xy), window=13).n_iter.mean() < 3.2
    assert lb.centroid(frames, np.rint(xy), stop="step", tolerance=1e-3, **raw).n_iter.mean() > 6


def test_the_gate_takes_out_a_hot_pixel_and_newton_s_window_needs_none():
    """The paper's window, to the letter, weighs what it sees."""
    frames, xy, _ = spots(2.0, 30, n=300)
    clean = rms(lb.centroid(frames, np.rint(xy), window=13).xy - xy)
    frames[:, 11, 19] += 3000
    struck, gated = (
        rms(lb.centroid(frames, np.rint(xy), window=13, stop="step", hot_pixel_gate=gate).xy - xy)
        for gate in (False, True)
    )
    assert struck > 5 * clean
    assert gated < 1.5 * clean
    assert rms(lb.centroid(frames, np.rint(xy), window=13).xy - xy) < 1.05 * clean


def test_the_table_names_the_flags():
    frames, xy, _ = spots(2.0, 50, n=3)
    start = np.rint(np.concatenate([xy, xy + 100], axis=1))
    table = lb.centroid(frames, start, window=13).to_frame()
    assert table.columns.tolist() == [
        *("frame", "spot", "x", "y", "sigma_x", "sigma_y", "flux", "background", "n_iter", "flags")
    ]
    assert table["flags"].tolist() == ["", "MISSING"] * 3
    assert table["frame"].tolist() == [0, 0, 1, 1, 2, 2]
    assert len(lb.centroid(frames[0], start[0], window=13).to_frame()) == 2
