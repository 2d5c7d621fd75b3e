"""Spots of several sizes in one call: each has the window and the width that it would have alone.

Seeds were fixed before the first run.
"""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.groups import grouped
from losbench.imaging.results import SpotFlag
from losbench.imaging.sizes import default_window, spot_sigma

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SPOTS = np.array([[40.0, 40.0], [120.0, 90.0], [60.0, 135.0]])
SIGMA, FLUX, WINDOW = (1.5, 12.0, 3.0), (4e4, 2e6, 1e5), [9, 73, 19]
METHODS = ("auto", "eiwa", "grey", "weighted", "likelihood", "gaussian")


def frames_of(truth, seed, sigma=SIGMA, flux=FLUX, shape=(180, 220)):
    light = sum(
        lb.render_spots(truth[..., [k], :], flux[k], sigma[k], shape) for k in range(len(sigma))
    )
    return CAMERA.expose(light + 30.0, seed)


def moving(n, seed=21):
    rng = np.random.default_rng(seed)
    truth = SPOTS + rng.normal(0.0, 0.2, (n, 3, 2))
    return frames_of(truth, rng), truth


@pytest.mark.parametrize("method", METHODS)
def test_each_spot_is_measured_as_if_it_were_alone(method):
    frames, _ = moving(5)
    together = lb.centroid(frames, SPOTS, method=method, detector=CAMERA)
    assert together.window.tolist() == WINDOW
    for k in range(3):
        alone = lb.centroid(frames, SPOTS[[k]], method=method, detector=CAMERA)
        assert alone.window == WINDOW[k]
        for name in ("xy", "sigma_xy", "flux", "background", "n_iter"):
            np.testing.assert_array_equal(
                getattr(together, name)[:, k], getattr(alone, name)[:, 0], err_msg=name
            )
        if together.width_px is not None:
            np.testing.assert_array_equal(together.width_px[k], alone.width_px[0])
            np.testing.assert_allclose(together.width_px[k], SIGMA[k], rtol=0.03)


@pytest.mark.parametrize("detector", [CAMERA, None])
def test_errors_of_spots_of_several_sizes_are_those_that_are_made(detector):
    frames, truth = moving(120)
    found = lb.centroid(frames, SPOTS, method="auto", detector=detector)
    pulls = (found.xy - truth) / found.sigma_xy
    np.testing.assert_allclose(np.sqrt(np.mean(pulls**2, axis=(0, 2))), 1.0, atol=0.15)
    assert "windows 9 to 73 px" in found._repr_html_()


def test_spots_that_are_much_alike_have_one_window():
    """Within two pixels of window, or a tenth of it, the width of one spot is no news."""
    sigma = (2.0, 2.2, 1.9)
    frames = frames_of(SPOTS, 3, sigma, (1e5, 1e5, 1e5))
    assert lb.centroid(frames, SPOTS).window == 13
    frames = frames_of(SPOTS, 3, (12.0, 12.6, 12.3), (2e6, 2e6, 2e6), (220, 260))
    assert isinstance(lb.centroid(frames, SPOTS).window, int)


def test_windows_can_be_given_for_each_spot():
    frames, _ = moving(2)
    given = lb.EIWA((9, 73, 19))
    assert lb.EIWA([9, 73, 19]) == given and lb.EIWA([13, 13]).window == 13
    found = lb.centroid(frames, SPOTS, method=given, detector=CAMERA)
    np.testing.assert_array_equal(found.xy, lb.centroid(frames, SPOTS, detector=CAMERA).xy)
    with pytest.raises(ValueError, match=r"one for each of 3 spots, got \(9, 73\)"):
        lb.centroid(frames, SPOTS, method=lb.EIWA((9, 73)))
    with pytest.raises(ValueError, match="window must be odd, got 12"):
        lb.EIWA((9, 12))
    with pytest.raises(ValueError, match=r"width .* of 0.1 to 9 pixels, the window"):
        lb.centroid(frames, SPOTS, method=lb.Weighted(12.0, window=(9, 73, 19)))


@pytest.mark.parametrize(
    ("odd_one", "sigma", "window"), [(25, 6.0, 37), (7, 0.7, 5), (19, 12.0, 73)]
)
def test_one_spot_of_many_that_is_unlike_the_others_is_found(odd_one, sigma, window):
    """Beyond 16 spots not all are sized: the others are looked at, and 25 is none of the 16."""
    rng = np.random.default_rng(31)
    grid = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2) * 60.0 + 50.0
    xy = grid + rng.uniform(-3, 3, grid.shape)
    sigmas = np.where(np.arange(40) == odd_one, sigma, 2.0)
    flux = 2 * np.pi * sigmas**2 * rng.uniform(1e3, 6e3, 40)
    found = default_window(frames_of(xy, rng, sigmas, flux, (350, 530)), np.rint(xy))
    assert found[odd_one] == pytest.approx(window, abs=2)
    assert np.unique(np.delete(found, odd_one)).tolist() == [13]


def test_a_spot_that_another_widens_keeps_the_window_of_the_others():
    rng = np.random.default_rng(32)
    xy = np.array([[40.0, 40.0], [90.0, 40.0], [140.0, 40.0], [40.0, 100.0], [90.0, 100.0]])
    xy = np.concatenate([xy, xy[:1] + np.array([5.0, 0.0])])
    frame = frames_of(xy, rng, (2.0,) * 6, (1e5,) * 6)
    assert spot_sigma(frame, xy)[0] > 2.6
    assert default_window(frame, xy).tolist() == [13] * 6


def test_a_spot_in_the_window_of_a_larger_one_is_its_neighbour():
    frames = frames_of(SPOTS, 3)
    near = np.concatenate([SPOTS, [[150.0, 90.0]]])
    found = lb.centroid(frames, near, method=lb.EIWA((9, 73, 19, 9)), detector=CAMERA)
    crowded = found.flags & SpotFlag.NEIGHBOUR > 0
    assert crowded.tolist()[1::2] == [True, True] and not crowded[0]
    apart = np.concatenate([SPOTS, [[60.0, 20.0]]])
    found = lb.centroid(frames, apart, method=lb.EIWA((9, 73, 19, 9)), detector=CAMERA)
    assert not (found.flags[[0, 2]] & SpotFlag.NEIGHBOUR).any()


def test_what_is_chosen_for_all_rests_on_the_spots_of_every_size():
    """Two discs and a star: more than half of the spots are no Gaussians."""
    frames = frames_of(SPOTS[:1], 4, SIGMA[:1], FLUX[:1]).astype(float)
    y, x = np.mgrid[:180, :220]
    for at in SPOTS[1:]:
        frames += 3000.0 * np.clip(12.5 - np.hypot(x - at[0], y - at[1]), 0.0, 1.0)
    found = lb.centroid(frames.round().astype(np.uint16), SPOTS, method="auto")
    assert isinstance(found.method, lb.EIWA) and len(np.unique(found.window)) == 2


def test_windows_of_many_spots_bear_spots_that_are_missing_and_frames_without_any():
    rng = np.random.default_rng(33)
    xy = rng.uniform(20, 180, (30, 2))
    frames = frames_of(np.repeat(xy[None], 3, axis=0), rng, (2.0,), (1e5,), (200, 200)) * 1.0
    for k in range(1, 30):
        frames += frames_of(xy[None, [k]].repeat(3, 0), rng, (2.0,), (1e5,), (200, 200))
    start = np.repeat(xy[None], 3, axis=0)
    for seen in (0, 1):  # in the first frame: none, or one
        start[0, seen:] = np.nan
        assert lb.centroid(frames, start).window == 13
    frames[:, 100:] = np.nan
    away = np.abs(xy[:, 1] - 100.0) > 6.0  # a star cut in two is as narrow as it looks
    assert (default_window(frames, xy)[away] == 13).all()
    flat = lb.centroid(np.full((60, 60), 7.0), rng.uniform(0, 60, (40, 2)))
    assert flat.window == 3 and (flat.flags > 0).all()


@pytest.mark.parametrize(("side", "reach"), [(3, 2), (9, 2), (11, 2), (13, 3), (16, 4), (23, 5)])
def test_a_window_on_the_peak_is_put_on_it_within_a_quarter_of_its_side(side, reach):
    """And two pixels at least."""
    for away in ((reach, 0), (0, -reach), (reach + 1, 0), (0, -reach - 1)):
        frame = np.zeros((1, 60, 70))
        frame[0, 30 + away[1], 35 + away[0]] = 9.0
        at = np.array([[[35.2, 29.7]]])
        given = frame, at, np.array([side]), lb.Grey(centre="peak"), lb.Ring(), None, None
        (group,) = grouped(*given)
        found = (group.at[0, 0] == np.array([35, 30]) + away).all()
        assert found == (max(map(abs, away)) <= reach)
        (group,) = grouped(*given[:3], lb.Grey(centre="start"), *given[4:])
        np.testing.assert_array_equal(group.at, at)


@pytest.mark.parametrize(
    ("method", "on_peak"),
    [(lb.Grey(), True), (lb.EIWA(), False), (lb.EIWA(centre="peak"), True), (lb.Gaussian(), False)],
)
def test_a_window_that_stays_is_put_on_the_peak_unless_told_otherwise(method, on_peak):
    frame = np.zeros((1, 60, 70))
    frame[0, 31, 36] = 9.0
    at = np.array([[[35.2, 29.7]]])
    (group,) = grouped(frame, at, np.array([9]), method, lb.Ring(), None, None)
    np.testing.assert_array_equal(group.at, [[[36.0, 31.0]]] if on_peak else at)


def test_of_pixels_that_are_as_bright_the_first_is_the_peak():
    """Row by row."""
    frame = np.zeros((1, 60, 70))
    frame[0, [31, 29, 29], [34, 36, 33]] = 9.0
    given = frame, np.array([[[35.2, 30.1]]]), np.array([13]), lb.Grey(), lb.Ring(), None, None
    assert grouped(*given)[0].at.tolist() == [[[33.0, 29.0]]]
