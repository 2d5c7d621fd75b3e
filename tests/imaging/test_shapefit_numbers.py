"""The fit of a shape, step by step: sums, bands and penalties against dense matrices."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, null_space

from losbench.imaging import shapefit
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.shapefit import _chosen, _error, _Normal, _Seen, _typical
from losbench.imaging.splines import Drawn, spline_count, spline_weights

SIDE, COUNT = 5, spline_count(5)


def windows_of(count=6, floor=4.0, per_dn=0.5, seed=2, side=SIDE):
    rng = np.random.default_rng(seed)
    zeros = np.zeros((count, 2))
    noise = PixelNoise(floor * np.arange(1.0, count + 1.0), per_dn, np.zeros((count, 3)))
    signal = rng.normal(20.0, 6.0, (count, side + 2, side + 2))
    return Windows(signal, side, zeros, zeros.astype(int), noise, zeros + np.nan)


def seen_of(count=6, *, masked=False, side=SIDE, **options):
    rng = np.random.default_rng(7)
    windows = windows_of(count, side=side, **options)
    place, flux = rng.uniform(-0.9, 0.9, (count, 2)), rng.uniform(50.0, 90.0, count)
    light = rng.normal(5.0, 6.0, (count, side, side))
    kept = (rng.random((count, side, side)) < 0.8).astype(float) if masked else None
    return _Seen.of(windows, place, flux, light, kept), light, kept


def design(seen):
    """What each spline adds to each pixel of each window, (M, S * S, K * K)."""
    x = spline_weights(seen.windows.side, seen.place[:, 0])[0]
    y = spline_weights(seen.windows.side, seen.place[:, 1])[0]
    both = np.einsum("myk,mxl->myxkl", y, x) * seen.flux[:, None, None, None, None]
    return both.reshape(len(x), seen.windows.side**2, -1)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_pixels_weigh_by_the_inverse_of_their_variance(masked, per_dn):
    seen, light, kept = seen_of(masked=masked, per_dn=per_dn)
    floor = 4.0 * np.arange(1.0, 7.0)[:, None, None]
    weight = 1.0 / (floor + per_dn * np.maximum(light, 0.0))
    np.testing.assert_allclose(seen.weight, weight if kept is None else weight * kept)
    np.testing.assert_array_equal(seen.pixels, seen.windows.signal[:, 1:-1, 1:-1])
    part = seen.of_some(np.array([4, 1]))
    np.testing.assert_array_equal(part.weight, seen.weight[[4, 1]])
    np.testing.assert_array_equal(part.place, seen.place[[4, 1]])
    assert part.windows.noise.floor.tolist() == [20.0, 8.0] and part.flux[0] == seen.flux[4]
    assert (part.kept is None) == (kept is None)
    silent, *_ = seen_of(floor=0.0, per_dn=0.0)
    assert (silent.weight == 1.0).all()
    dark = _Seen.of(seen.windows, seen.place, -seen.flux, light, kept)
    assert (dark.flux == 0.0).all()


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("penalty", [1e-5, 0.1, 10.0])
def test_splines_are_those_of_penalised_least_squares(masked, penalty):
    """Of all pixels; the penalty and a ridge of 1e-9 are in units of the mean information."""
    seen, *_ = seen_of(masked=masked)
    basis, weight = design(seen), seen.weight.reshape(6, -1)
    normal = np.einsum("msk,ms,msl->kl", basis, weight, basis)
    right = np.einsum("msk,ms->k", basis, weight * seen.pixels.reshape(6, -1))
    unit = np.trace(normal) / COUNT**2
    bent = np.diff(np.eye(COUNT), 2, axis=0)
    stiff = bent.T @ bent
    bending = np.kron(stiff, np.eye(COUNT)) + np.kron(np.eye(COUNT), stiff)
    matrix = normal + unit * (penalty * bending + 1e-9 * np.eye(COUNT**2))
    solved = seen.normal().solved(penalty)
    expected = np.linalg.solve(matrix, right).reshape(COUNT, COUNT)
    size = np.abs(expected).max()
    np.testing.assert_allclose(solved.raw, expected, atol=1e-4 * size)
    some = np.eye(COUNT**2)[:, [0, 7, 150]]
    np.testing.assert_allclose(
        solved.spread(some), np.linalg.solve(matrix, some), rtol=1e-3, atol=1e-6 / unit
    )
    light = solved.splines(SIDE)
    assert light.sum() == pytest.approx(9.0)  # nine splines a pixel, whose light is one
    np.testing.assert_allclose(light / light.sum(), solved.raw / solved.raw.sum())


def test_windows_without_light_leave_splines_of_nothing():
    empty = _Normal(np.zeros((4, COUNT, 4, COUNT)), np.zeros((COUNT, COUNT)))
    assert (empty.solved(0.1).raw == 0.0).all()


@pytest.mark.parametrize("masked", [False, True])
def test_slopes_by_place_and_light_are_sums_over_pixels(masked):
    seen, *_ = seen_of(masked=masked)
    splines = np.random.default_rng(9).random((COUNT, COUNT))
    own, shared = seen.slopes(splines)
    drawn = Drawn.of(SIDE, seen.place, splines[None], np.zeros(6, int), np.float64).columns
    basis = design(seen)
    for m in range(6):
        slopes = drawn[m] * np.array([1.0, seen.flux[m], seen.flux[m]])[:, None, None]
        slopes = slopes.reshape(3, -1)
        weighted = slopes * seen.weight[m].ravel()
        np.testing.assert_allclose(own[m], weighted @ slopes.T)
        np.testing.assert_allclose(shared[m], weighted @ basis[m], atol=1e-9)


def test_a_penalty_is_that_with_which_each_half_foretells_the_other():
    """Every other window, and the squares of both ways; downhill from 0.1."""
    chosen = []
    for noise in (0.0, 1.0, 300.0):
        seen, *_ = seen_of(7)
        light = (design(seen) @ np.random.default_rng(8).random(COUNT**2)).reshape(7, SIDE, SIDE)
        rest = noise * np.random.default_rng(9).normal(0.0, 1.0, light.shape)
        signal = np.pad(light + rest, ((0, 0), (1, 1), (1, 1)))
        seen = replace(seen, windows=replace(seen.windows, signal=signal))
        penalties, left = [1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0], []
        for penalty in penalties:
            left.append(0.0)
            for first in (0, 1):
                known, test = (
                    seen.of_some(slice(first, None, 2)),
                    seen.of_some(slice(1 - first, None, 2)),
                )
                splines = known.normal().solved(penalty).raw.ravel()
                light = (design(test) @ splines).reshape(test.pixels.shape)
                left[-1] += (test.weight * (test.pixels - light) ** 2).sum()
        best = 4
        while min(left[max(best - 1, 0) : best + 2]) < left[best]:
            best += -1 if best and left[best - 1] < min(left[best : best + 2]) else 1
        chosen.append(_chosen(seen))
        assert chosen[-1] == penalties[best]
    assert len(set(chosen)) > 1


def test_typical_windows_have_the_median_light_and_noise():
    for masked in (False, True):
        seen, _, kept = seen_of(7, masked=masked)
        splines = np.random.default_rng(9).random((COUNT, COUNT))
        place = np.array([[0.1, -0.2], [0.4, 0.3]])
        found = _typical(seen, splines, place)
        assert (found.flux == np.median(seen.flux)).all() and len(found.flux) == 2
        light = Drawn.of(SIDE, place, splines[None], np.zeros(2, int), np.float64).light
        variance = 16.0 + 0.5 * np.median(seen.flux) * light
        share = 1.0 if kept is None else kept.mean(axis=0)
        np.testing.assert_allclose(found.weight, share / variance)
        assert replace(found.windows.noise, plane=None).floor.tolist() == [16.0, 16.0]


def test_the_error_of_a_shape_is_that_of_all_unknowns_together():
    """Splines, with a place and a light of each window; but for the mean place and the light of
    all, which are the shape's own. A spot without light tells nothing."""
    seen, *_ = seen_of(5)
    seen = replace(seen, flux=np.append(seen.flux[:4], 0.0))
    penalty = 0.1
    solved = seen.normal().solved(penalty)
    found = _error(seen, solved)
    bright = seen.of_some(np.arange(4))
    basis, weight = design(bright), bright.weight.reshape(4, -1)
    normal = np.einsum("msk,ms,msl->kl", basis, weight, basis)
    unit = np.trace(normal) / COUNT**2
    bent = np.diff(np.eye(COUNT), 2, axis=0)
    stiff = np.kron(bent.T @ bent, np.eye(COUNT)) + np.kron(np.eye(COUNT), bent.T @ bent)
    matrix = normal + unit * (penalty * stiff + 1e-9 * np.eye(COUNT**2))
    own, shared = bright.slopes(solved.raw)
    across, each = shared.reshape(12, -1).T, block_diag(*own)
    common = np.concatenate([np.diag([flux, 1.0, 1.0]) for flux in bright.flux])
    free = null_space(common.T)
    told = across @ free @ np.linalg.solve(free.T @ each @ free, free.T @ across.T)
    covariance = np.linalg.inv(matrix - told)
    pulls = np.linalg.solve(own, shared)[:, 1:].mean(axis=0)
    part = (np.arange(8) + 0.5) / 8 - 0.5
    for row, column in ((0, 0), (2, 5), (7, 3)):
        one = _typical(bright, solved.raw, np.array([[part[column], part[row]]]))
        of_place, with_splines = one.slopes(solved.raw)
        wanted = np.linalg.solve(of_place, with_splines)[0, 1:] - pulls
        variance = np.einsum("ak,kl,al->a", wanted, covariance, wanted)
        np.testing.assert_allclose(found[row, column], np.sqrt(variance), rtol=1e-3)


# Windows that are not like the others


class Numbered:
    """Windows that are known by their numbers."""

    def __init__(self, numbers):
        self.numbers = np.asarray(numbers)

    def of(self, some):
        return Numbered(self.numbers[some])


@pytest.mark.parametrize(
    ("first", "second", "made_of"),
    [
        ([], None, range(9)),  # all are alike
        ([8], [8], range(8)),
        ([8], [0, 8], range(1, 8)),  # those that are like the half decide
        ([8], range(5, 9), range(5)),
        ([8], range(4, 9), range(9)),  # less than half of them: all make it
        ([0], [], range(9)),
    ],
)
def test_a_shape_is_made_by_those_that_are_like_the_half_that_fits_best(
    monkeypatch, first, second, made_of
):
    left, fitted = np.array([9.0, 1, 8, 2, 7, 3, 6, 4, 5]), []

    def judged(shape, windows):
        others = first if len(fitted) == 1 else second
        assert windows.numbers.tolist() == list(range(9)) and shape is fitted[-1]
        return np.isin(np.arange(9), list(others)), left

    def fit(windows):
        fitted.append(windows.numbers.tolist())
        return fitted[-1]

    monkeypatch.setattr(shapefit, "_judged", judged)
    monkeypatch.setattr(shapefit, "_fitted", fit)
    assert shapefit.fit_shape(Numbered(range(9))) == list(made_of)
    # Five of nine are half of them, in their order.
    assert fitted[0] == list(range(9)) and fitted[1:2] == (
        [] if second is None else [[1, 3, 5, 7, 8]]
    )
