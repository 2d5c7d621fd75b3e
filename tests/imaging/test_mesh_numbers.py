"""Tiles of few rows, of slopes beside flat sky, and of sensors with a pattern."""

import numpy as np
import pytest
from scipy.special import ndtri

from losbench.imaging.mesh import _smooth_tiles, _surface, mesh
from losbench.imaging.pattern import Pattern
from losbench.imaging.ranks import level_and_noise


def test_a_pattern_is_taken_off_before_the_tiles_and_put_back():
    y, x = np.mgrid[:200, :220]
    phase = np.array([[4.0, -8.0], [12.0, -8.0]])
    added = phase[y % 2, x % 2] + 30.0 * (y >= 100) - 20.0 * (x >= 110)
    truth = 500.0 + 0.3 * x + 0.1 * y + added
    noise = np.random.default_rng(1).normal(0.0, 2.0, truth.shape)
    sky = mesh(truth + noise, 0.0, 2.0, 0.1)
    level, spread = sky.at(y.ravel(), x.ravel())
    np.testing.assert_allclose(level, truth.ravel(), atol=2.0)
    np.testing.assert_allclose(spread, 2.0, rtol=0.25)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_slope_beside_a_flat_sky_is_no_noise(axis):
    """One half rises by 10 noises a pixel."""
    along = np.indices((240, 240))[axis]
    truth = 300.0 + 20.0 * np.maximum(along - 120.0, 0.0)
    noise = np.random.default_rng(2).normal(0.0, 2.0, truth.shape)
    sky = mesh(truth + noise, 0.0, 2.0, 0.1)
    np.testing.assert_allclose(np.median(sky.noise), 2.0, rtol=0.5)
    inner = sky.noise if axis == 0 else sky.noise.T
    np.testing.assert_allclose(inner[-3:-1], 2.0, rtol=0.5)
    np.testing.assert_allclose(inner[1:3], 2.0, rtol=0.5)


@pytest.mark.parametrize(
    ("shape", "across", "curved"),
    [((2, 9), False, (True, True)), ((3, 9), True, (False, True)), ((9, 4), True, (True, True))],
)
def test_a_surface_has_the_terms_that_its_tiles_can_tell(shape, across, curved):
    """A curve from four tiles on (of two it is a level), a twist from three either way."""
    y, x = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in shape), indexing="ij")
    noise = np.full(shape, 1e-9)

    def held(extra):
        level = 50.0 + 3.0 * y - 2.0 * x
        return np.abs(_surface(level - extra, noise) - (level - extra)).max() < 1e-6

    assert held(0.0)
    assert held(2.0 * x * y) == across
    assert held(4.0 * y**2) == curved[0] and held(4.0 * x**2) == curved[1]


@pytest.mark.parametrize("values", [[1.0, 2.0, 9.0], [5.0, 1.0]])
def test_tiles_too_few_for_a_plane_have_the_level_of_the_darkest_fifth(values):
    level = np.array([values])
    for tiles in (level, level.T):
        found = _surface(tiles, np.full(tiles.shape, 0.1))
        np.testing.assert_allclose(found, np.quantile(values, 0.2))


def test_what_is_broader_than_a_tile_and_no_object_stays():
    """A step of one and a half noises."""
    level = np.zeros((9, 9))
    level[:, 6:] = 3.0
    smooth, _ = _smooth_tiles(level, np.full((9, 9), 2.0))
    np.testing.assert_allclose(smooth[:, 7:], 3.0, atol=0.1)
    np.testing.assert_allclose(smooth[:, :5], 0.0, atol=0.1)


@pytest.mark.parametrize("tap", [(7.0, 0.0), (0.0, -4.0), (7.0, -4.0)])
def test_rows_of_a_pattern_are_its_pixels(tap):
    pattern = Pattern(np.array([[1.0, -2.0], [3.0, -2.0]]), np.array(tap), (10.0, 15.0))
    y, x = np.mgrid[:20, :30]
    np.testing.assert_array_equal(pattern.rows(0, 20, 30), pattern.at(y, x))
    np.testing.assert_array_equal(pattern.rows(7, 13, 30), pattern.at(y, x)[7:13])


def test_where_spots_are_most_of_what_is_left_the_lower_ranks_tell():
    """If the noise comes out 1.5 times smaller by them: least squares over normal scores."""
    n, share = 2000, 0.2
    rank = (np.arange(n) + 0.5) / n
    score = ndtri(rank)

    def line(values, low, high):
        some = (rank >= low) & (rank <= high)
        slope, level = np.polyfit(score[some], values[some], 1)
        return level, slope

    ratios = []
    for steep in np.linspace(1.0, 6.0, 101):
        values = 10.0 + score
        bent = score[rank <= 0.48].max()
        values = np.where(rank <= 0.48, values, 10.0 + bent + steep * (score - bent))
        values[rank < share] = lowest = values[rank >= share][0] - 0.01
        clipped = values == lowest
        wide = line(values, share + 0.1 * 0.8, 0.76)
        low = line(values, share + 0.1 * 0.8, share + 0.35 * 0.8)
        ratio = wide[1] / low[1]
        if abs(ratio - 1.5) < 0.01:
            continue
        ratios.append(ratio)
        found = level_and_noise(values[None], 0.0, clipped[None])
        np.testing.assert_allclose(np.ravel(found), low if ratio > 1.5 else wide, rtol=1e-6)
    assert min(ratios) < 1.1 and max(ratios) > 2.5
    assert any(1.4 < ratio < 1.5 for ratio in ratios) and any(1.5 < r < 1.6 for r in ratios)


@pytest.mark.parametrize("turned", [False, True])
def test_tiles_beside_a_big_object_are_those_of_the_surface_and_no_others(turned):
    """By their noise, that of the others: a median of three tiles keeps two that are alike."""
    noise = np.tile([1.0, 1.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0], (12, 1))
    level = np.zeros((12, 12))
    level[:, 5] = 60.0
    if turned:
        noise, level = noise.T, level.T
    smooth, found = _smooth_tiles(level, noise)
    expected = np.tile([1.0, 1.0, 3.0, 3.0, 1.0, 1.0, 1.0, 3.0, 3.0, 1.0, 1.0, 1.0], (12, 1))
    np.testing.assert_array_equal(found, expected.T if turned else expected)
    np.testing.assert_allclose(smooth, 0.0, atol=1e-9)


def test_tiles_that_tell_nothing_have_level_and_noise_of_the_frame(monkeypatch):
    asked = []

    def told(*given, **options):
        asked.append((options, level_and_noise(*given, **options)))
        return asked[-1][1]

    monkeypatch.setattr("losbench.imaging.mesh.level_and_noise", told)
    frame = np.random.default_rng(5).normal(50.0, 3.0, (300, 300))
    frame[:, :150] += 20.0
    mesh(frame, 0.0, 3.0, 0.1)
    (first, (level, noise)), (second, _) = asked[:2]
    assert not first and second == {"unknown": (float(level[0]), float(noise[0]))}
    assert level[0] > 40.0 > 20.0 > noise[0]


@pytest.mark.parametrize(
    ("noise", "digit", "least"), [(3.0, 0.0, 1.5), (3.0, 1.0, 1.5), (3.0, 2.0, 2.0)]
)
def test_a_pattern_is_at_least_half_of_the_noise_and_a_step(monkeypatch, noise, digit, least):
    asked = []

    def of(sample, step, shape, least):
        asked.append((step, shape, least))
        return Pattern(np.zeros((2, 2)), np.zeros(2), (0.0, 0.0))

    monkeypatch.setattr("losbench.imaging.mesh.Pattern.of", of)
    for size, step in ((255, 3), (256, 5)):
        frame = np.random.default_rng(6).normal(50.0, 3.0, (size, 300)).round()
        mesh(frame, digit, noise, 0.1)
        assert asked.pop() == (step, (size, 300), least)
