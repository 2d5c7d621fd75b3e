"""Spots where they were put, on frames and stamps, in every type; nothing where there is
nothing.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.special import ndtr

import losbench as lb

DETECTOR = lb.Detector(gain_e_per_dn=2.0, read_noise_e=6.0, offset_dn=100.0)


def frame(xy, flux, sigma, shape=(120, 160), seed=1, detector=DETECTOR):
    return detector.expose(lb.render_spots(xy, flux, sigma, shape) + 50.0, seed)


@pytest.mark.parametrize("dtype", ["uint16", "float32", "float64", ">f4"])
@pytest.mark.parametrize("sigma", [0.6, 2.0, 5.0])
def test_two_spots_are_found_within_a_pixel_brightest_first(dtype, sigma):
    xy = np.array([[30.3, 40.7], [110.6, 70.2]])
    light = 400.0 * 2 * np.pi * (sigma**2 + 1 / 12)
    found = lb.find_spots(frame(xy, [light, 2 * light], sigma).astype(dtype))
    assert found.shape == (2, 2)
    np.testing.assert_allclose(found, xy[::-1], atol=0.7)


def test_eight_bit_frames_with_less_noise_than_a_step():
    quiet = lb.Detector(gain_e_per_dn=50.0, read_noise_e=5.0, offset_dn=10.0, bits=8)
    found = lb.find_spots(frame([[60.0, 50.0]], 4e5, 2.5, detector=quiet))
    np.testing.assert_allclose(found, [[60.0, 50.0]], atol=0.5)


@pytest.mark.parametrize("seed", range(5))
def test_no_spot_is_an_empty_answer(seed):
    image = frame([[60.0, 50.0]], 0.0, 2.0, shape=(540, 960), seed=seed)
    assert lb.find_spots(image).shape == (0, 2)


def test_fewer_than_asked_for_is_an_error_that_counts_them():
    image = frame([[60.0, 50.0]], 2e4, 2.0)
    assert lb.find_spots(image, n=1).shape == (1, 2)
    with pytest.raises(ValueError, match="found 1 of the 2 spots asked for at threshold 8"):
        lb.find_spots(image, n=2)


@pytest.mark.parametrize("centre", [(0.0, 0.0), (159.0, 119.0), (80.0, 0.3), (0.2, 60.0)])
def test_a_spot_at_the_border_is_found_where_it_is_seen(centre):
    found = lb.find_spots(frame([centre], 3e4, 2.0))
    assert len(found) == 1
    np.testing.assert_allclose(found[0], centre, atol=1.7)


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.9, -0.4)])
def test_touching_spots_are_told_apart(axis):
    xy = np.array([60.0, 55.0]) + np.outer([-1, 1], 5.0 * np.array(axis) / np.hypot(*axis))
    found = lb.find_spots(frame(xy, [4e4, 3e4], 3.0))
    assert len(found) == 2
    np.testing.assert_allclose(found, xy, atol=1.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_noisy_wide_spot_is_one_spot(seed):
    for peak_e in (120.0, 400.0):
        found = lb.find_spots(
            frame([[60.4, 55.8]], peak_e * 2 * np.pi * 36, 6.0, seed=seed), threshold=6.0
        )
        assert len(found) == 1
        np.testing.assert_allclose(found[0], [60.4, 55.8], atol=1.0)


def test_a_ring_is_one_spot_at_its_centre():
    y, x = np.mgrid[:80, :90]
    radius = np.hypot(x - 40.0, y - 35.0)
    image = DETECTOR.expose(2000.0 * np.exp(-((radius - 7.0) ** 2) / 4.0) + 50.0, 3)
    found = lb.find_spots(image)
    assert len(found) == 1
    np.testing.assert_allclose(found[0], [40.0, 35.0], atol=0.3)


def test_a_saturated_plateau_is_one_spot_at_its_centre():
    image = frame([[70.0, 60.0]], 5e7, 4.0)
    assert np.count_nonzero(image == 65535) > 50
    found = lb.find_spots(image)
    assert len(found) == 1
    np.testing.assert_allclose(found[0], [70.0, 60.0], atol=0.1)


def test_a_hot_pixel_is_not_a_spot_but_a_sharp_star_is():
    hot = lb.Detector(
        gain_e_per_dn=2.0,
        read_noise_e=6.0,
        offset_dn=100.0,
        hot_pixels=((20, 30, 9000.0), (0, 0, 9000.0)),
    )
    found = lb.find_spots(frame([[100.0, 80.0]], 2000.0, 0.5, detector=hot))
    np.testing.assert_allclose(found, [[100.0, 80.0]], atol=0.5)


@pytest.mark.parametrize("shape", [(4, 6), (9, 8)])
def test_a_stamp_that_the_star_nearly_fills(shape):
    centre = np.array([shape[1] / 2 - 0.4, shape[0] / 2 - 0.3])
    stamp = lb.render_spots([centre], 4e4, 0.8, shape) + np.random.default_rng(2).normal(
        0, 10, shape
    )
    stamp = stamp.astype(np.float32)
    stamp[0, 0] = np.nan
    np.testing.assert_allclose(lb.find_spots(stamp, n=1), [centre], atol=0.5)


# the share that is found at 8, 10, 12, 15 and 20 noises of amplitude
COMPLETE = {0.7: (0.0, 0.3, 0.77, 0.96, 1.0), 1.5: (0.25, 1.0, 1.0, 1.0, 1.0)}


@pytest.mark.parametrize(("noise", "size", "seed"), [(7.0, 600, 31415), (1.7, 900, 27182)])
@pytest.mark.parametrize("sigma", [0.7, 1.5])
def test_faint_spots_are_found_in_known_shares_and_nothing_else(sigma, noise, size, seed):
    false = 0
    for height, share in zip((8, 10, 12, 15, 20), COMPLETE[sigma], strict=True):
        rng = np.random.default_rng([seed, height])
        grid = np.stack(np.meshgrid(*[np.arange(20.0, size - 20.0, 20.0)] * 2), axis=-1)
        xy = grid.reshape(-1, 2) + rng.uniform(-3.0, 3.0, (grid[..., 0].size, 2))
        light = height * noise * 2 * np.pi * sigma**2
        image = lb.render_spots(xy, light, sigma, (size, size)) + rng.normal(
            200.0, noise, (size,) * 2
        )
        found = KDTree(lb.find_spots(image.astype(np.float32)))
        assert (found.query(xy)[0] < 1.5).mean() == pytest.approx(share, abs=0.1)
        false += np.count_nonzero(KDTree(xy).query(found.data)[0] > 3.0)
    assert false <= 3e-6 * 5 * size**2


@pytest.mark.parametrize(("noise", "size", "seed"), [(7.0, 600, 31415), (1.7, 900, 27182)])
@pytest.mark.parametrize(
    ("height", "least"), [(8, 0.0), (10, 0.0), (12, 0.19), (15, 0.59), (20, 0.99)]
)
def test_a_spot_in_one_pixel_is_found_as_often_as_that_rises_above_eight_noises(
    height, least, noise, size, seed
):
    """Of sigma 0.5, anywhere on its pixel, against the chance that any of the four brightest does;
    no less than was promised.
    """
    rng = np.random.default_rng([seed, height])
    grid = np.stack(np.meshgrid(*[np.arange(20.0, size - 20.0, 20.0)] * 2), axis=-1)
    xy = grid.reshape(-1, 2) + rng.uniform(-3.0, 3.0, (grid[..., 0].size, 2))
    flux = height * 2 * np.pi * 0.5**2
    image = lb.render_spots(xy, noise * flux, 0.5, (size, size))
    found = lb.find_spots(image + rng.normal(200.0, noise, image.shape))
    alone = lb.render_spots(10.0 + rng.uniform(-0.5, 0.5, (1000, 1, 2)), flux, 0.5, (21, 21))
    four = np.sort(alone.reshape(1000, -1), axis=1)[:, -4:]
    chance = float(np.mean(1.0 - np.prod(ndtr(8.0 - four), axis=1)))
    share = np.mean(KDTree(found).query(xy)[0] < 1.5) if len(found) else 0.0
    # The light of so many spots raises the noise of the frame by a percent or two.
    assert chance - 0.08 < share < chance + 0.04 and share >= least - 0.03
    assert len(found) == 0 or np.count_nonzero(KDTree(xy).query(found)[0] > 3.0) <= 3e-6 * size**2


@pytest.mark.parametrize(
    ("noise", "shape", "seed"), [(7.0, (640, 700), 16180), (1.7, (900, 800), 14142)]
)
@pytest.mark.parametrize(
    ("sigma", "height", "least"), [(1.5, 3, 0.13), (1.5, 5, 0.99), (3.0, 3, 0.99), (3.0, 5, 0.99)]
)
def test_smoothing_by_their_own_width_finds_spots_of_three_to_five_noises(
    sigma, height, least, noise, shape, seed
):
    """On a field that is not crowded: fourteen sigma apart. Of three noises and sigma 1.5 a fifth,
    within the scatter of 200 spots.
    """
    rng = np.random.default_rng([seed, height])
    pitch = 14.0 * sigma + 6.0
    grid = np.stack(
        np.meshgrid(*[np.arange(25.0, side - 25.0, pitch) for side in shape[::-1]]), axis=-1
    )
    xy = grid.reshape(-1, 2) + rng.uniform(-3.0, 3.0, (grid[..., 0].size, 2))
    light = lb.render_spots(xy, height * noise * 2 * np.pi * sigma**2, sigma, shape)
    image = np.rint(light + rng.normal(200.0, noise, shape)).astype(np.uint16)
    found = KDTree(lb.find_spots(image, smooth=sigma))
    assert (found.query(xy)[0] < 0.5 * sigma + 1.2).mean() >= least
    assert np.count_nonzero(KDTree(xy).query(found.data)[0] > 3.0 + sigma) <= 3e-6 * image.size
    plain = lb.find_spots(image)
    assert len(plain) < 0.1 * len(xy)


def test_unread_pixels_are_not_spots():
    image = frame([[60.0, 50.0]], 2e4, 2.0).astype(np.float32)
    image[:, 100] = np.nan
    image[10, 10] = np.inf
    np.testing.assert_allclose(lb.find_spots(image), [[60.0, 50.0]], atol=0.5)
    assert lb.find_spots(np.full((5, 6), np.nan)).shape == (0, 2)


@settings(deadline=None)  # the first call imports
@given(dx=st.integers(-15, 15), dy=st.integers(-15, 15), lift=st.integers(0, 500))
def test_found_spots_follow_a_shift_and_ignore_a_level(dx, dy, lift):
    image = frame([[60.0, 50.0], [90.5, 70.2]], [3e4, 2e4], 2.0)
    moved = np.roll(image, (dy, dx), axis=(0, 1)) + np.uint16(lift)
    np.testing.assert_allclose(
        lb.find_spots(moved), lb.find_spots(image) + np.array([dx, dy]), atol=0.2
    )


@pytest.mark.parametrize(
    ("image", "kwargs", "message"),
    [
        (np.zeros(5), {}, r"image must have shape \(rows, columns\), got \(5,\)"),
        (np.zeros((2, 5, 5)), {}, r"image must have shape \(rows, columns\), got \(2, 5, 5\)"),
        (np.zeros((0, 5)), {}, r"image must hold at least one pixel, got shape \(0, 5\)"),
        (np.zeros((5, 5)), {"n": 0}, "n must be a whole number of at least 1, got 0"),
        (
            np.zeros((5, 5)),
            {"threshold": -1},
            "threshold must be a finite number of at least 0, got -1",
        ),
        (np.array([["a", "b"]]), {}, "image must be an array of numbers, got str"),
    ],
)
def test_bad_input_is_refused_by_name(image, kwargs, message):
    with pytest.raises(ValueError, match=message):
        lb.find_spots(image, **kwargs)
