"""The plane through a ring against least squares of NumPy, and its thresholds from either side."""

import numpy as np
import pytest

import losbench as lb
from losbench.imaging.background import RING, Level, Ring, _median_and_scatter, fit_ring
from losbench.imaging.stamps import ring_places

SIDE = 9
X, Y = ring_places(SIDE)
BASIS = np.stack([np.ones(len(X)), X, Y], axis=-1)
EDGE = np.maximum(abs(X), abs(Y))
MAD = 1.482602218505602


def plane_of(values, kept):
    """Coefficients, variances in units of the scatter squared, and residuals."""
    some = BASIS[kept]
    plane = np.linalg.lstsq(some, values[kept], rcond=None)[0]
    return plane, np.diag(np.linalg.inv(some.T @ some)), values - BASIS @ plane


def clipped(values):
    """Without what lies beyond three sigma, first of the median, then of the plane."""
    some = values[::4]
    some = some[np.isfinite(some)]
    # Of an even number the upper of the two middle ones; of what has gaps their mean.
    gaps = not np.isfinite(values[::4]).all()
    middle = np.median(some) if gaps else np.sort(some)[len(some) // 2]
    away = np.abs(some - middle)
    spread = np.median(away) if gaps else np.sort(away)[len(some) // 2]
    scatter = max(MAD * spread, away.mean() / 3.0)
    there = np.isfinite(values)
    kept = there & (np.abs(np.where(there, values, 0.0) - middle) <= 3.0 * scatter)
    rests = []
    for _ in range(2):
        plane, variance, rest = plane_of(values, kept)
        rests.append(rest)
        # Of a Gaussian cut at three sigma 0.9733 of the variance are left.
        scatter = np.sqrt((rest[kept] ** 2).sum() / (kept.sum() - 3) / 0.9733)
        last, kept = kept, there & (np.abs(np.where(there, rest, 0.0)) <= 3.0 * scatter)
        if np.array_equal(last, kept):
            break
    return plane, variance, scatter, np.nanmax(np.abs(rests[0])) / scatter


def ring(seed=0, noise=2.0, slope=(0.3, -0.2), level=100.0):
    values = np.random.default_rng(seed).normal(0.0, noise, len(X))
    return level + slope[0] * X + slope[1] * Y + values


def quiet(seed=3):
    """Noise that no pixel stands out of."""
    return 100.0 + 0.3 * X - 0.2 * Y + np.random.default_rng(seed).uniform(-3.0, 3.0, len(X))


def fitted(*rings):
    return fit_ring(np.array(rings), SIDE)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_quiet_ring_has_the_plane_of_least_squares(dtype):
    rings = np.array([quiet(1), quiet(2)])
    found = fit_ring(rings.astype(dtype), SIDE)
    for k, values in enumerate(rings):
        plane, variance, rest = plane_of(values, np.ones(len(X), bool))
        scatter = np.sqrt((rest**2).sum() / (len(X) - 3))
        np.testing.assert_allclose([found.level[k], *found.slope[k]], plane, rtol=1e-4)
        assert found.scatter[k] == pytest.approx(scatter, rel=1e-4)
        np.testing.assert_allclose(
            [found.level_variance[k], *found.slope_variance[k]], variance, rtol=1e-6
        )
        inner, outer = EDGE == SIDE // 2 + 1, EDGE == SIDE // 2 + RING
        excess = values[inner].mean() - values[outer].mean()
        assert found.excess[k] == pytest.approx(excess, abs=1e-4)
        error = scatter * np.sqrt(1.0 / inner.sum() + 1.0 / outer.sum())
        assert found.excess_error[k] == pytest.approx(error, rel=1e-4)
        assert found.outlier[k] == 0.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "kind", ["hot", "dead", "neighbour", "gap", "corner", "first", "whole numbers"]
)
def test_what_stands_out_of_a_ring_does_not_tilt_it(seed, kind):
    values = ring(seed)
    if kind in ("hot", "dead"):
        values[37] += 400.0 if kind == "hot" else -400.0
    elif kind == "neighbour":
        values += 300.0 * np.exp(-0.5 * ((X - 7.0) ** 2 + (Y + 6.0) ** 2))
    elif kind == "gap":
        values[10:14], values[50] = np.nan, 900.0
    elif kind == "first":
        values[0] = np.nan
    elif kind == "corner":
        values[(X < -3) | (Y < -3)], values[-5] = np.nan, -900.0
    else:
        values = np.rint(values / 2.0)
        values[50] += 30.0
    found = fitted(values, quiet())
    plane, variance, scatter, outlier = clipped(values)
    np.testing.assert_allclose([found.level[0], *found.slope[0]], plane, rtol=1e-4, atol=1e-5)
    assert found.scatter[0] == pytest.approx(scatter, rel=1e-4)
    np.testing.assert_allclose(
        [found.level_variance[0], *found.slope_variance[0]], variance, rtol=1e-4
    )
    # How far the worst lies off is told by the plane of the first pass.
    assert found.outlier.tolist() == pytest.approx([outlier, 0.0], rel=1e-3)
    seen = np.where(np.isfinite(values), values, np.median(values[::4][np.isfinite(values[::4])]))
    inner, outer = EDGE == SIDE // 2 + 1, EDGE == SIDE // 2 + RING
    assert found.excess[0] == pytest.approx(seen[inner].mean() - seen[outer].mean(), rel=1e-4)


def is_clipped(values):
    """Whether the scatter is that of a Gaussian cut at three sigma."""
    rest = plane_of(values, np.ones(len(X), bool))[2]
    plain = np.sqrt((rest**2).sum() / (len(X) - 3))
    return fitted(values).scatter[0] != pytest.approx(plain, rel=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_pixel_stands_out_of_a_ring_by_three_and_a_half_scatters(sign):
    for target, out in ((3.45, False), (3.55, True)):
        values = quiet()
        for height in np.linspace(3.0, 12.0, 500):
            values[40] = 100.0 + 0.3 * X[40] - 0.2 * Y[40] + sign * height
            rest = plane_of(values, np.ones(len(X), bool))[2]
            if abs(rest[40]) / np.sqrt((rest**2).sum() / (len(X) - 3)) >= target:
                break
        assert is_clipped(values) == out


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ring_is_lopsided_from_six_tenths_of_its_scatter_cubed(sign):
    """A share of pixels above the others, none of which stands out."""
    rng, tried = np.random.default_rng(5), []
    order = rng.permutation(len(X))
    for n in range(20, 104, 2):
        values = rng.uniform(-0.2, 0.2, len(X))
        values[order[:n]] += sign * 3.0
        rest = plane_of(values, np.ones(len(X), bool))[2]
        scatter = np.sqrt((rest**2).sum() / (len(X) - 3))
        third = abs((rest**3).sum()) / len(X) / scatter**3
        if np.abs(rest).max() > 3.4 * scatter or 0.58 < third < 0.62:
            continue
        assert is_clipped(values) == (third > 0.6), third
        tried.append(third)
    assert min(tried) < 0.58 and max(tried) > 0.62


def test_an_empty_ring_knows_nothing_and_spoils_no_other():
    found = fitted(np.full(len(X), np.nan), ring(1))
    alone = fitted(ring(1))
    assert np.isnan([found.level[0], found.scatter[0]]).all() and found.outlier[0] == 0.0
    np.testing.assert_allclose(found.level[1], alone.level[0])
    np.testing.assert_allclose(found.slope[1], alone.slope[0], atol=1e-12)


def test_five_pixels_of_a_ring_tell_a_plane_without_scatter():
    values = np.full(len(X), np.nan)
    for k in (0, 48, 96, 144, 200):
        values[k] = 50.0 + 2.0 * X[k]
    found = fitted(values)
    np.testing.assert_allclose(found.slope[0], [2.0, 0.0], atol=1e-4)
    assert found.scatter[0] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("gaps", [False, True])
def test_the_scatter_of_a_ring_is_1_4826_mad_or_a_third_of_the_mean_deviation(gaps):
    """The last where most whole numbers are the same: here 4 of 41 stand 9 above."""
    noisy = np.random.default_rng(2).normal(10.0, 3.0, 41)
    same = np.full(41, 7.0)
    same[:4] += 9.0
    rows = np.array([noisy, same, noisy])
    if gaps:
        rows[2, 20:] = np.nan
    middle, scatter = _median_and_scatter(rows)
    rest = noisy[:20] if gaps else noisy
    expected = [np.median(np.abs(v - np.median(v))) * MAD for v in (noisy, rest)]
    np.testing.assert_allclose(middle, [np.median(noisy), 7.0, np.median(rest)])
    np.testing.assert_allclose(scatter, [expected[0], 9.0 * 4 / 41 / 3.0, expected[1]])


def test_a_plane_is_taken_off_where_it_lies():
    plane = fitted(quiet(1), quiet(2))
    stamps = np.random.default_rng(4).random((2, 7, 7))
    off = plane.off(stamps)
    for k in range(2):
        for (row, column), value in np.ndenumerate(stamps[k]):
            at = np.array([[column - 3, row - 3]] * 2)
            under = plane.level[k] + plane.slope[k] @ at[0]
            assert off[k, row, column] == pytest.approx(value - under)
            assert plane.at(at)[k] == pytest.approx(under)
    known = Level(40.0).under(np.array([quiet(1), ring(2)]), SIDE)
    np.testing.assert_array_equal(known.off(stamps), stamps - 40.0)
    assert known.at(np.full((2, 2), np.nan)).tolist() == [40.0, 40.0]
    assert not known.level_variance.any() and not known.slope_variance.any()
    assert not known.excess.any() and (known.scatter > 1.0).all()
    assert plane.of(np.array([1])).level.tolist() == [plane.level[1]]


def test_a_plane_that_slopes_down_alone_is_taken_off():
    values = 50.0 + 2.0 * Y
    stamps = np.zeros((1, 5, 5))
    expected = -(50.0 + 2.0 * np.arange(-2, 3))
    np.testing.assert_allclose(fitted(values).off(stamps)[0], np.repeat(expected[:, None], 5, 1))


def test_a_ring_is_around_three_pixels_at_least():
    assert Ring(3).side == 3
    for side in (1, 4):
        with pytest.raises(ValueError, match="ring must be"):
            Ring(side)
    with pytest.raises(ValueError, match="background must be a finite number"):
        Level(np.nan)
    assert lb.Level(-3.0).dn == -3.0
    assert lb.Ring.tilts and not lb.Level.tilts  # a known level is the same wherever it is taken


@pytest.mark.parametrize("side", [3, 9, 15])
def test_a_ring_grows_brighter_from_its_outermost_pixels_to_its_innermost(side):
    ring = np.random.default_rng(8).uniform(-1.0, 1.0, (2, (side + 8) ** 2 - side**2)) + 50.0
    x, y = ring_places(side)
    edge = np.maximum(abs(x), abs(y)) - side // 2
    expected = ring[:, edge == 1].mean(axis=1) - ring[:, edge == 4].mean(axis=1)
    found = fit_ring(ring.copy(), side)
    np.testing.assert_allclose(found.excess, expected)
    error = np.sqrt(1.0 / (edge == 1).sum() + 1.0 / (edge == 4).sum())
    np.testing.assert_allclose(found.excess_error, error * found.scatter)
