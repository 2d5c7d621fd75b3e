"""The rounds of a width, against the same written out in loops: where they begin, end and are held."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import moment
from losbench.imaging.moment import (
    _kept_variance,
    _Light,
    _long_arm,
    _matched,
    moment_sigma,
    plane_under,
)

ARMS = np.arange(61.0)


def spot(sigma, at=(30.0, 30.0), flux=1e4, shape=(61, 61)):
    return lb.render_spots([at], flux, sigma, shape)


def disc(radius, squeezed=1.0, size=61):
    y, x = np.mgrid[:size, :size] - size // 2
    return 100.0 * np.clip(radius + 0.5 - np.hypot(x * squeezed, y), 0.0, 1.0)


def cusp():
    y, x = ARMS[:, None] - 30.0, ARMS - 30.0
    return 1.0 / (1.0 + np.hypot(x, y)) ** 1.5


def noisy(light, noise=0.5, seed=4):
    return light + np.random.default_rng(seed).normal(0.0, noise, light.shape)


# Matched moments


def matched_by_loops(light, at, sigma):
    """Twelve rounds at most, until both variances change by less than a fifth of a percent."""
    at, variance = np.array(at), np.array(sigma) ** 2 + 1.0 / 12.0
    for _ in range(12):
        x, y = ARMS - at[0], ARMS[:, None] - at[1]
        weighted = light * np.exp(-0.5 * (x**2 / variance[0] + y**2 / variance[1]))
        total = weighted.sum()
        mean = np.array([(weighted * x).sum(), (weighted * y).sum()]) / total
        square = np.array([(weighted * x**2).sum(), (weighted * y**2).sum()]) / total - mean**2
        if not ((square > 0.04) & (square < variance)).all():
            return np.full(2, np.nan)
        found = 1.0 / (1.0 / square - 1.0 / variance)
        at, done = at + 2.0 * mean, (np.abs(variance / found - 1.0) < 0.002).all()
        variance = found
        if done:
            break
    return np.sqrt(np.maximum(variance - 1.0 / 12.0, 0.04))


@pytest.mark.parametrize(
    ("light", "begin"),
    [
        (spot(2.0), (2.0, 2.0)),
        (spot((2.0, 3.0)), (2.001, 2.2)),  # one axis is there long before the other
        (spot((3.0, 2.0)), (2.2, 2.001)),
        (noisy(disc(7.0)), (3.0, 4.0)),
        (noisy(disc(7.0, 1.8)), (1.5, 3.4)),
        (disc(7.0) ** 4 - 5e6, (2.0, 2.0)),
        (disc(12.0), (1.2, 1.2)),  # the twelfth round ends it
        (spot(0.3, (30.0, 30.2)), (0.5, 0.4)),
        (cusp(), (1.0, 1.0)),  # it would go on
    ],
)
def test_matched_moments_are_those_of_a_loop(light, begin):
    at = np.array([30.2, 29.9])
    found = _matched(_Light(light, ARMS, ARMS, 1), at, np.array(begin))
    np.testing.assert_allclose(found, matched_by_loops(light, at, begin), rtol=1e-9)


# The plane


@pytest.mark.parametrize("axis", [0, 1])
def test_a_ring_on_one_line_tells_its_slope_along_it(axis):
    ring = np.zeros((15, 15), bool)
    ring[7] = True
    pixels = np.broadcast_to(20.0 + 3.0 * np.arange(15.0), (15, 15))
    if axis:
        ring, pixels = ring.T, pixels.T
    np.testing.assert_allclose(plane_under(pixels, ring)[ring], pixels[ring], atol=1e-5)


def test_a_plane_stays_that_of_the_pixels_before_fewer_than_twelve_were_left():
    ring = np.zeros((5, 5), bool)
    ring.ravel()[:13] = True
    pixels = np.zeros((5, 5))
    pixels.ravel()[:13] = np.arange(13) % 2
    pixels[0, 0], pixels[1, 2] = 30.0, -30.0
    y, x = np.indices(ring.shape)
    basis = np.stack([np.ones(13), x[ring], y[ring]], axis=-1)
    first = np.linalg.lstsq(basis, pixels[ring], rcond=None)[0]
    found = plane_under(pixels, ring)
    np.testing.assert_allclose(found, first[0] + first[1] * x + first[2] * y, atol=1e-6)


def test_a_ring_that_is_no_ring_leaves_the_level_as_unsure_as_one_pixel():
    seen = _Light(np.zeros((5, 7)), np.arange(7.0), np.arange(5.0), 0)
    square = (seen.x - 3.0) ** 2
    every = np.repeat(square, 5)
    for ring, expected in ((0, every.sum() ** 2), (1, every.sum() ** 2), (2, every.sum() ** 2 / 2)):
        seen = _Light(seen.light, seen.x, seen.y, ring)
        assert _long_arm(square, seen) == pytest.approx(np.sqrt((every**2).sum() + expected))


# The second moment


def sigma_by_loops(signal, noise, core, first, rounds=12):
    """Rounds of the second moment, until both axes change by less than 2 %, and what it is then."""
    row, column = np.nonzero(core)
    centre, sigma, error = np.array([column.mean(), row.mean()]), np.full(2, first), np.inf
    least = max(0.05 * signal[core].max(), np.sqrt(2.0) * 5.0 * noise)
    for _ in range(rounds):
        half = max(int(np.rint(3.0 * sigma.max())), 1)
        seen = _Light.around(signal, centre, half).alone(centre, least, noise)
        light, flux = seen.light, seen.light.sum()
        if flux < 20.0 * noise * np.sqrt(light.size):
            error, sigma = np.inf, np.full(2, first)
            break
        centre = np.array([(light * seen.x).sum(), (light * seen.y[:, None]).sum()]) / flux
        square = (seen.x - centre[0]) ** 2, (seen.y - centre[1]) ** 2
        kept = _kept_variance((half + 0.5) / sigma)
        summed = np.array([(light * square[0]).sum(), (light * square[1][:, None]).sum()])
        variance = summed / flux / kept - 1.0 / 12.0
        error = noise * np.array([_long_arm(arm, seen) for arm in square]) / kept / flux
        found = np.sqrt(np.maximum(variance, 0.04)).clip(0.6 * first, 3.0 * first)
        change, sigma = np.abs(found - sigma) / sigma, found
        if (change < 0.02).all():
            break
    matched = _matched(seen, centre, sigma)
    if (np.abs(matched**2 - sigma**2) <= 3.0 * error).all():
        sigma = matched.clip(0.6 * first, 3.0 * first)
    return sigma.max() if sigma.max() > 1.2 * sigma.min() else sigma.mean()


@pytest.mark.parametrize(
    ("light", "noise", "first"),
    [
        (noisy(disc(7.0)), 0.5, 3.4),
        (noisy(disc(7.0)), 0.5, 2.0),
        (noisy(disc(7.0, 1.8)), 0.5, 3.0),  # one axis settles before the other
        (noisy(disc(7.0, 1.8).T), 0.5, 3.0),
        (noisy(disc(9.0, 3.0)), 0.5, 2.5),
        (noisy(spot((1.5, 2.0)), 2.0), 2.0, 1.6),
        (noisy(spot(1.5, flux=300.0), 2.0), 2.0, 1.6),
        (noisy(disc(4.0), 9.0), 9.0, 2.0),
        (disc(0.4), 1e-6, 0.3),  # in one pixel
        (disc(20.0), 1e-6, 4.0),  # held by three times the first
    ],
)
def test_a_width_is_that_of_a_loop(light, noise, first):
    core = light > light.max() / 2
    found = moment_sigma(light, noise, core, first)
    assert found == pytest.approx(sigma_by_loops(light, noise, core, first), rel=1e-9)


def spied(monkeypatch, light, noise, first):
    """What is handed on to those that take the light of others off."""
    asked, standing = [], moment.without_others

    def without_others(light, centre, least, noise):
        asked.append((len(light), least))
        return standing(light, centre, least, noise)

    monkeypatch.setattr(moment, "without_others", without_others)
    moment_sigma(light, noise, light > light.max() / 2, first)
    return asked


def test_twelve_windows_are_looked_at_where_none_settles(monkeypatch):
    """A window that is half as wide whenever its spot is twice as wide."""
    widths = iter(np.tile([0.5, 2.0], 20))
    monkeypatch.setattr(moment, "_kept_variance", lambda reach: np.full(2, next(widths)))
    assert len(spied(monkeypatch, spot(2.0), 1e-6, 2.0)) == 12


@pytest.mark.parametrize(("first", "side"), [(0.1, 3), (0.49, 3), (0.51, 5), (2.0, 13), (2.2, 15)])
def test_a_window_is_three_sigma_either_way_and_three_pixels_at_least(monkeypatch, first, side):
    assert spied(monkeypatch, spot(2.0), 1e-6, first)[0][0] == side


@pytest.mark.parametrize("noise", [1e-3, 0.5, 3.0, 30.0])
def test_light_of_others_is_a_twentieth_of_the_peak_and_five_noises_of_two_pixels(
    monkeypatch, noise
):
    light = spot(2.0)
    least = max(0.05 * light.max(), np.sqrt(2.0) * 5.0 * noise)
    assert {asked for _, asked in spied(monkeypatch, light, noise, 2.0)} == {least}


@pytest.mark.parametrize(("matched", "found"), [(0.1, 0.6), (1.3, 1.3), (2.9, 2.9), (40.0, 3.0)])
def test_a_matched_width_is_held_within_three_fifths_and_three_times_the_first(
    monkeypatch, matched, found
):
    """Of a spot too faint for a second moment, whose error is infinite."""
    monkeypatch.setattr(moment, "_matched", lambda *_: np.full(2, matched))
    light = spot(1.0, flux=10.0)
    assert moment_sigma(light, 1e3, light > light.max() / 2, 1.0) == pytest.approx(found)
