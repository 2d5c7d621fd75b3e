"""Level and noise of a sky are found whatever a camera does to it: clipping, steps, taps, gradients."""

import numpy as np
import pytest
from scipy.spatial import KDTree

import losbench as lb
from losbench.imaging.levels import sky_of
from losbench.imaging.ranks import digit_step, level_and_noise

SPOTS = np.array([[0.3, 0.4], [0.72, 0.6]])


def sky(size, level, noise, seed, *, flux=8e3, tap=0.0, bayer=False, odd=0.0):
    """Whole numbers of two spots on a sky that is clipped at zero."""
    rng = np.random.default_rng(seed)
    shape = (size, size + 30)
    gain = np.ones(shape)
    if bayer:
        gain[::2, ::2], gain[1::2, 1::2] = 1.4, 0.7
    light = lb.render_spots(SPOTS * shape[0], flux, 2.0, shape)
    image = (light + rng.normal(level, noise, shape)) * gain
    image += tap * (np.arange(shape[1]) >= shape[1] // 2) + odd * (np.arange(shape[1]) % 2)
    return np.clip(np.rint(image), 0, 4095).astype(np.uint16)


@pytest.mark.parametrize("level", [-6.0, -2.0, 0.0, 5.0, 30.0])
@pytest.mark.parametrize("size", [100, 128, 256, 700])
@pytest.mark.parametrize(
    "pattern", [{}, {"tap": 40.0}, {"tap": 100.0, "bayer": True}, {"odd": 40.0}], ids=str
)
def test_two_spots_are_two_on_a_sky_clipped_at_black_with_taps_and_bayer_gains(
    level, size, pattern
):
    for seed in range(3):
        found = lb.find_spots(sky(size, level, 4.0, seed, **pattern), order="x")
        np.testing.assert_allclose(found, SPOTS * size, atol=1.0)


@pytest.mark.parametrize("level", [-4.0, -0.2, 4.0, 12.0])
def test_level_and_noise_of_a_clipped_normal_are_those_before_it_was_clipped(level):
    noise = 4.0
    values = np.random.default_rng(3).normal(level, noise, (200, 4096)).round().clip(0)
    found_level, found_noise = level_and_noise(values, 1.0, values <= 0)
    assert abs(found_noise.mean() / noise - 1) < 0.07
    assert abs(found_level.mean() - level) < 0.7


def test_a_fifth_of_the_pixels_in_spots_hardly_changes_the_noise():
    rng = np.random.default_rng(4)
    values = rng.normal(100.0, 3.0, (50, 4000))
    values[:, :800] += rng.exponential(200.0, (50, 800))
    _, noise = level_and_noise(values, 0.0, np.zeros(values.shape, dtype=bool))
    assert 3.0 < noise.mean() < 4.5


def test_the_step_of_left_aligned_numbers_is_known():
    whole = np.arange(100, 160, dtype=np.float64)
    assert [digit_step(f * whole) for f in (1.0, 16.0, 0.5)] == [1.0, 16.0, 0.0]
    assert digit_step(np.full(9, 7.0)) == 1.0


@pytest.mark.parametrize("per_px", [1 / 16, 1 / 4, 1 / 2])
def test_a_steep_gradient_finds_what_a_flat_sky_finds(per_px):
    """Slopes in noises per pixel; the peers lose every spot at a quarter."""
    rng = np.random.default_rng(6)
    shape, noise = (400, 600), 3.0
    cells = np.stack(np.meshgrid(np.arange(20, 580, 60), np.arange(20, 380, 60)), -1).reshape(-1, 2)
    xy = cells + rng.uniform(-8, 8, cells.shape)
    light = lb.render_spots(xy, 15 * noise * 2 * np.pi * 1.5**2 * 1.1, 1.5, shape)
    image = light + rng.normal(1000.0, noise, shape)
    flat = lb.find_spots(np.rint(image).astype(np.uint16))
    slope = per_px * noise * np.arange(shape[1])
    steep = lb.find_spots(np.rint(image + slope).astype(np.uint16))
    assert len(flat) == len(xy)
    assert KDTree(steep).query(flat)[0].max() < 1.0
    assert len(steep) <= len(flat) + 1


@pytest.mark.parametrize(("sigma", "amplitude", "least"), [(0.7, 15, 0.96), (1.5, 10, 0.9)])
def test_stars_are_complete_and_nothing_else_is_found(sigma, amplitude, least):
    rng = np.random.default_rng(8)
    shape, noise = (700, 900), 5.0
    cells = np.stack(np.meshgrid(np.arange(15, 885, 24), np.arange(15, 685, 24)), -1).reshape(-1, 2)
    xy = cells + rng.uniform(-0.5, 0.5, cells.shape)
    peak = lb.render_spots([[10.0, 10.0]], 1.0, sigma, (21, 21)).max()
    image = rng.normal(700.0, noise, shape) + lb.render_spots(
        xy, amplitude * noise / peak, sigma, shape
    )
    found = lb.find_spots(np.rint(image).astype(np.uint16))
    assert np.mean(KDTree(found).query(xy)[0] < 1.2) > least
    assert np.count_nonzero(KDTree(xy).query(found)[0] > 3) <= 2


def test_smoothing_finds_what_noise_hides_and_makes_one_of_a_speckled_beam():
    rng = np.random.default_rng(9)
    y, x = np.mgrid[:512, :512]
    beam = np.exp(-((x - 250.0) ** 2 + (y - 260.0) ** 2) / 2 / 45.0**2)
    speckle = np.rint(
        2000.0 * beam * rng.exponential(1.0, beam.shape) + rng.normal(50, 3, beam.shape)
    )
    image = speckle.clip(0).astype(np.uint16)
    found = lb.find_spots(image, smooth=10.0)
    np.testing.assert_allclose(found, [[250.0, 260.0]], atol=4.0)
    assert len(lb.find_spots(image)) > 20
    faint = rng.normal(100.0, 4.0, (200, 300))
    faint += lb.render_spots([[150.0, 100.0]], 5 * 4.0 * 2 * np.pi * 9.0, 3.0, faint.shape)
    np.testing.assert_allclose(lb.find_spots(faint, smooth=3.0), [[150.0, 100.0]], atol=1.5)


@pytest.mark.parametrize("sigma", [20.0, 60.0])
def test_a_wide_beam_is_one_spot(sigma):
    rng = np.random.default_rng(10)
    shape = (480, 640)
    light = lb.render_spots([[330.0, 250.0]], 2 * np.pi * sigma**2 * 2000.0, sigma, shape)
    found = lb.find_spots(np.rint(light + rng.normal(20.0, 3.0, shape)).clip(0).astype(np.uint16))
    np.testing.assert_allclose(found[0], [330.0, 250.0], atol=2.0)
    assert len(found) <= 2


def test_two_equal_spots_are_numbered_by_place_or_by_light_as_asked():
    rng = np.random.default_rng(11)
    xy = np.array([[90.0, 30.0], [30.0, 50.0]])
    light = lb.render_spots(xy, [9e3, 4e3], 2.0, (80, 120))
    image = light + rng.normal(50.0, 2.0, light.shape)
    for order, expected in (("light", xy), ("peak", xy), ("x", xy[::-1])):
        np.testing.assert_allclose(lb.find_spots(image, order=order), expected, atol=0.5)
    np.testing.assert_allclose(lb.find_spots(image, 1, order="x"), xy[:1], atol=0.5)


def test_what_is_no_frame_of_spots_is_said(monkeypatch):
    xy = np.stack(np.meshgrid(np.arange(30, 300, 60), np.arange(30, 300, 60)), -1).reshape(-1, 2)
    image = np.random.default_rng(12).normal(100.0, 5.0, (300, 300))
    image += lb.render_spots(xy, 4e3, 2.0, image.shape)
    with pytest.raises(ValueError, match=r"25 candidates at threshold 8: not a frame of spots\?"):
        lb.find_spots(image, most=24)
    assert len(lb.find_spots(image, most=25)) == 25
    monkeypatch.setattr("losbench.imaging.finder._CROWDED", 0.001)
    with pytest.raises(ValueError, match="of 90000 pixels stand out at threshold 8: not a frame"):
        lb.find_spots(image)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"smooth": -1.0}, "smooth must be"),
        ({"order": "y"}, "order must be one of 'light', 'peak', 'x', got 'y'"),
        ({"most": 0}, "most must be"),
    ],
)
def test_an_option_of_finding_out_of_range_is_named(options, message):
    with pytest.raises(ValueError, match=message):
        lb.find_spots(np.zeros((20, 20)), **options)
    with pytest.raises(ValueError, match=message):
        lb.Find(**options)


def test_a_sky_of_one_level_is_flat_and_one_of_many_is_not():
    rng = np.random.default_rng(13)
    even = rng.normal(100.0, 3.0, (600, 800))
    assert sky_of(even, 110.0, 8.0).flat
    tilted = sky_of(even + np.arange(800) / 4, 300.0, 8.0)
    assert not tilted.flat
    level, noise = tilted.at(np.array([5, 300]), np.array([3, 797]))
    np.testing.assert_allclose(level, [100.75, 299.25], atol=2.0)
    np.testing.assert_allclose(noise, 3.0, rtol=0.15)
