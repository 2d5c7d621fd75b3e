"""Gaussian templates against differences, least squares written out, and their limits from either
side."""

from dataclasses import replace

import numpy as np
import pytest

import losbench as lb
from losbench.imaging import template
from losbench.imaging.columns import Templates
from losbench.imaging.noise import PixelNoise
from losbench.imaging.protocols import Windows
from losbench.imaging.template import TemplateFit, _inverse, _misfits

SIDE = 11
CENTRE = np.array([[0.3, -0.4], [-0.2, 0.1]])
WIDTH = np.array([[1.5, 2.0], [1.2, 0.9]])


def light_of(centre, width, side=SIDE, flux=1.0):
    at = np.asarray(centre)[None] + side // 2
    return lb.render_spots(at, flux, np.asarray(width)[None], (side, side))


def columns_of(centre, width, *, free):
    """The light, its slopes by x and y, and by the logarithms of both widths, by differences."""
    found, h = [light_of(centre, width)], 1e-5
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        found.append((light_of(centre + step, width) - light_of(centre - step, width)) / (2 * h))
    for axis in (0, 1) if free else ():
        ratio = np.exp(h * np.eye(2)[axis])
        found.append((light_of(centre, width * ratio) - light_of(centre, width / ratio)) / (2 * h))
    return np.stack([column.ravel() for column in found], axis=-1)


def windows_of(signals, *, floor=4.0, per_dn=0.0, plane=(0.0, 0.0, 0.0), width=2.0, **options):
    signal = np.pad(np.asarray(signals), ((0, 0), (1, 1), (1, 1)))
    count = len(signal)
    noise = PixelNoise(np.full(count, floor), per_dn, np.tile(plane, (count, 1)))
    zeros = np.zeros((count, 2))
    given = Windows(signal, signal.shape[1] - 2, zeros, zeros.astype(int), noise, zeros + width)
    return replace(given, **options)


def fit_template(windows, *, tolerance=1e-3, max_iter=50, **options):
    return template.fit_template(windows, tolerance=tolerance, max_iter=max_iter, **options)


# Columns and their sums


@pytest.mark.parametrize("free", [False, True])
def test_columns_are_the_slopes_of_the_light(free):
    at = Templates.of(SIDE, CENTRE, WIDTH, np.float64, free=free)
    kinds = [(0, 0), (1, 0), (0, 1), (2, 0), (0, 2)][: 5 if free else 3]
    for k in range(2):
        expected = columns_of(CENTRE[k], WIDTH[k], free=free)
        for column, (i, j) in zip(expected.T, kinds, strict=True):
            product = np.outer(at.profiles[k, 1, j], at.profiles[k, 0, i])
            np.testing.assert_allclose(product.ravel(), column, atol=2e-8)
        np.testing.assert_allclose(at.light[k].ravel(), expected[:, 0], atol=1e-12)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_sums_are_those_over_all_pixels(free, weighted, dtype):
    rng = np.random.default_rng(3)
    reading = rng.random((2, SIDE, SIDE)).astype(dtype)
    weight = rng.random((2, SIDE, SIDE)).astype(dtype) if weighted else None
    at = Templates.of(SIDE, CENTRE, WIDTH, dtype, free=free)
    sums = at.sums(reading, weight)
    y, x = (part.ravel() - SIDE // 2 for part in np.indices((SIDE, SIDE)))
    lever = np.stack([np.ones(SIDE**2), x, y], axis=-1)
    for k in range(2):
        columns = columns_of(CENTRE[k], WIDTH[k], free=free)
        each = columns if weight is None else columns * weight[k].reshape(-1, 1)
        tolerance = {"rtol": 1e-4, "atol": 1e-5}
        np.testing.assert_allclose(sums.normal[k], each.T @ columns, **tolerance)
        np.testing.assert_allclose(sums.reading[k], each.T @ reading[k].ravel(), **tolerance)
        np.testing.assert_allclose(sums.plane[k], each.T @ lever, **tolerance)


@pytest.mark.parametrize("size", [3, 5])
def test_an_inverse_is_numpy_s_in_any_unit(size):
    rng = np.random.default_rng(4)
    half = rng.normal(0.0, 1.0, (6, 20, size))
    unit = 10.0 ** rng.integers(-6, 6, (6, 1, size))
    normal = np.einsum("mki,mkj->mij", half * unit, half * unit)
    found = _inverse(normal) * unit.swapaxes(1, 2) * unit
    np.testing.assert_allclose(
        found, np.linalg.inv(normal / (unit.swapaxes(1, 2) * unit)), rtol=1e-5
    )


def test_a_column_without_light_spoils_no_other():
    normal = np.diag([4.0, 0.0, 9.0])[None]
    np.testing.assert_allclose(_inverse(normal)[0][[0, 2], [0, 2]], [0.25, 1.0 / 9.0], rtol=1e-6)


# One step


def expected_step(signal, start, width, flux, *, free, equal, kept, floor, per_dn, plane):
    """Weighted least squares on the columns: values and variances of flux, x and y."""
    columns = columns_of(start, width, free=free)
    variance = floor + per_dn * max(flux, 0.0) * columns[:, 0]
    weight = kept / (np.ones_like(variance) if equal else variance)
    inverse = np.linalg.inv(columns.T @ (weight[:, None] * columns))
    values = inverse @ columns.T @ (weight * signal.ravel())
    rows = inverse @ columns.T * weight
    y, x = (part.ravel() - SIDE // 2 for part in np.indices((SIDE, SIDE)))
    lever = rows @ np.stack([np.ones(SIDE**2), x, y], axis=-1)
    variances = (rows**2 * variance).sum(axis=1) + lever**2 @ np.array(plane)
    return values, variances[:3]


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("equal", [False, True])
@pytest.mark.parametrize("per_dn", [0.0, 0.7])
@pytest.mark.parametrize(("masked", "floor"), [(False, 4.0), (True, 4.0), (False, 0.5)])
def test_one_step_is_weighted_least_squares_with_the_error_of_its_weights(
    free, equal, per_dn, masked, floor
):
    """Errors of equal weights are those of the noise that is there; the plane adds its own."""
    rng = np.random.default_rng(5)
    start, width = np.array([0.1, 0.2]), np.array([1.5, 1.8])
    signal = light_of([0.3, -0.1], [1.6, 1.7], flux=5e3) + rng.normal(0.0, 2.0, (SIDE, SIDE))
    kept = (rng.random((SIDE, SIDE)) < 0.9) if masked else np.ones((SIDE, SIDE), bool)
    flux = signal[kept].sum()
    plane = (0.3, 0.02, 0.05)
    given = {"floor": floor, "per_dn": per_dn, "plane": plane}
    values, variances = expected_step(
        signal, start, width, flux, free=free, equal=equal, kept=kept.ravel() * 1.0, **given
    )
    windows = windows_of([signal], **given, width=width, start=start[None])
    if masked:
        windows = replace(windows, kept=np.pad(kept * 1.0, 1)[None])
    fit = fit_template(windows, free=free, equal=equal, max_iter=1)
    assert fit.flux[0] == pytest.approx(values[0], rel=1e-5)
    np.testing.assert_allclose(fit.centre[0], start + values[1:3] / values[0], atol=1e-5)
    np.testing.assert_allclose(fit.variance[0], variances, rtol=1e-4)
    if free:
        np.testing.assert_allclose(fit.width[0], width * (1.0 + values[3:] / values[0]), rtol=1e-4)
    else:
        np.testing.assert_array_equal(fit.width[0], width)
    assert fit.n_iter.tolist() == [1]


def test_a_window_without_light_has_weights_without_its_shot_noise():
    signal = np.random.default_rng(6).normal(-5.0, 2.0, (SIDE, SIDE))
    fit = fit_template(windows_of([signal], per_dn=0.7), max_iter=1)
    values, variances = expected_step(
        signal,
        np.zeros(2),
        np.array([2.0, 2.0]),
        0.0,
        free=False,
        equal=False,
        kept=np.ones(SIDE**2),
        floor=4.0,
        per_dn=0.7,
        plane=(0.0, 0.0, 0.0),
    )
    assert values[0] < 0 and fit.flux[0] == pytest.approx(values[0], rel=1e-6)
    np.testing.assert_allclose(fit.variance[0], variances, rtol=1e-6)
    assert fit.centre.tolist() == [[0.0, 0.0]]  # negative light pulls nowhere
    estimate = fit.estimate(windows_of([signal], per_dn=0.7))
    assert not estimate.converged.any() and np.isnan(estimate.sigma).all()
    assert estimate.sigma_flux[0] == pytest.approx(np.sqrt(variances[0]), rel=1e-6)


# Steps are short


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_is_at_most_a_pixel(axis, sign):
    centre = 3.0 * sign * np.eye(2)[axis]
    signal = light_of(centre, [1.5, 1.5], flux=1e4)
    for rounds in (1, 2):
        fit = fit_template(windows_of([signal], width=1.5, leave=9.0), max_iter=rounds)
        assert np.abs(fit.centre[0]).max() == pytest.approx(rounds, abs=1e-9)
    whole = fit_template(windows_of([signal], width=1.5, leave=9.0), tolerance=1e-12)
    np.testing.assert_allclose(whole.centre[0], centre, atol=1e-5)
    assert whole.converged.all() and whole.flux[0] == pytest.approx(1e4, rel=1e-6)


def test_a_width_changes_by_three_tenths_at_a_time_and_stays_within_the_window():
    wide = light_of([0.0, 0.0], [6.0, 1.5], flux=1e4)
    fit = fit_template(windows_of([wide], width=1.5), free=True, max_iter=1)
    assert fit.width[0, 0] == pytest.approx(1.3 * 1.5)
    sharp = np.zeros((SIDE, SIDE))
    sharp[SIDE // 2, SIDE // 2] = 1e4
    fit = fit_template(windows_of([sharp], width=1.5), free=True, max_iter=1)
    np.testing.assert_allclose(fit.width[0], 0.7 * 1.5)
    fit = fit_template(windows_of([sharp], width=1.5), free=True, max_iter=60)
    np.testing.assert_allclose(fit.width[0], 0.3)
    flat = np.ones((SIDE, SIDE)) + np.add.outer(np.linspace(-1, 1, SIDE) ** 2, np.zeros(SIDE))
    fit = fit_template(windows_of([flat], width=4.0), free=True, max_iter=60)
    assert fit.width.max() == SIDE


@pytest.mark.parametrize(("leave", "stays"), [(1.9, False), (3.1, True)])
def test_a_fit_that_leaves_its_window_stops_there(leave, stays):
    signal = light_of([3.0, 0.0], [1.5, 1.5], flux=1e4)
    fit = fit_template(windows_of([signal], width=1.5, leave=leave), tolerance=1e-9)
    assert fit.converged.tolist() == [stays]
    assert fit.centre[0, 0] == pytest.approx(3.0 if stays else 2.0, abs=1e-4)


def test_a_fit_ends_when_the_square_of_its_step_is_below_the_tolerance():
    signal = light_of([0.5, 0.0], [1.5, 1.5], flux=1e4)
    steps = [
        fit_template(windows_of([signal], width=1.5), max_iter=k, tolerance=0.0).centre[0, 0]
        for k in (1, 2, 3)
    ]
    squares = np.diff([0.0, *steps]) ** 2
    for k, square in enumerate(squares[:2], 1):
        done = fit_template(windows_of([signal], width=1.5), tolerance=1.01 * square)
        more = fit_template(windows_of([signal], width=1.5), tolerance=0.99 * square)
        assert done.n_iter.tolist() == [k] and more.n_iter.tolist() == [k + 1]
        assert done.converged.all() and more.converged.all()
    never = fit_template(windows_of([signal], width=1.5), tolerance=0.0, max_iter=3)
    assert never.n_iter.tolist() == [3] and not never.converged.any()


def test_a_width_that_still_changes_is_not_done():
    signal = light_of([0.0, 0.0], [1.5, 1.8], flux=1e4)
    fit = fit_template(windows_of([signal], width=1.5), free=True, tolerance=1e-3)
    assert fit.n_iter[0] > 1 and fit.converged.all()
    np.testing.assert_allclose(fit.width[0], [1.5, 1.8], rtol=1e-2)


def test_windows_are_fitted_as_if_each_were_alone():
    rng = np.random.default_rng(7)
    signals = [
        light_of(c, w, flux=f) + rng.normal(0.0, 2.0, (SIDE, SIDE))
        for c, w, f in (
            ([0.4, 0.1], [1.5, 1.5], 1e3),
            ([-1.4, 0.9], [2.0, 1.2], 1e5),
            ([0, 0], [1.5, 2.5], 5e3),
        )
    ]
    together = fit_template(windows_of(signals, per_dn=0.5), free=True)
    for k, signal in enumerate(signals):
        alone = fit_template(windows_of([signal], per_dn=0.5), free=True)
        for name in ("centre", "width", "flux", "variance", "n_iter", "converged"):
            np.testing.assert_allclose(
                getattr(together, name)[k], getattr(alone, name)[0], rtol=1e-9
            )


@pytest.mark.parametrize("unit", [1e-7, 1e7])
@pytest.mark.parametrize("per_dn", [0.0, 0.5])
def test_a_fit_does_not_depend_on_the_unit_of_the_light(unit, per_dn):
    signal = light_of([0.4, 0.1], [1.5, 1.7], flux=1e3)
    signal += np.random.default_rng(8).normal(0.0, 2.0, signal.shape)
    one, other = (
        windows_of([k * signal], floor=4.0 * k**2, per_dn=per_dn * k) for k in (1.0, unit)
    )
    expected, found = (fit_template(w, free=True).estimate(w) for w in (one, other))
    np.testing.assert_allclose(found.centroid, expected.centroid, rtol=1e-6)
    np.testing.assert_allclose(found.width, expected.width, rtol=1e-6)
    np.testing.assert_allclose(found.sigma, expected.sigma, rtol=1e-6)
    np.testing.assert_allclose(found.flux, unit * expected.flux, rtol=1e-6)
    np.testing.assert_allclose(found.sigma_flux, unit * expected.sigma_flux, rtol=1e-6)
    assert found.converged.tolist() == expected.converged.tolist() == [True]


@pytest.mark.parametrize("per_dn", [0.0, 0.5])
@pytest.mark.parametrize("floor", [0.0, 4.0])
def test_a_window_of_nothing_stays_where_it_is(per_dn, floor):
    windows = windows_of([np.zeros((SIDE, SIDE))], per_dn=per_dn, floor=floor)
    fit = fit_template(windows)
    assert fit.centre.tolist() == [[0.0, 0.0]] and fit.flux.tolist() == [0.0]
    assert not fit.estimate(windows).converged.any()


# What is made of a fit


def fit_of(centre=(0.0, 0.0), width=(1.5, 1.5), flux=1e4, variance=(100.0, 400.0, 900.0)):
    return TemplateFit(
        np.array([centre]),
        np.array([width]),
        np.array([flux]),
        np.array([variance]),
        np.array([4]),
        np.array([True]),
    )


def test_errors_are_those_of_the_slopes_over_the_flux():
    windows = windows_of([light_of([0.0, 0.0], [1.5, 1.5], flux=1e4)])
    found = fit_of().estimate(windows)
    np.testing.assert_allclose(found.sigma, [[20.0 / 1e4, 30.0 / 1e4]])
    assert found.sigma_flux.tolist() == [10.0] and found.converged.all()
    assert not found.slow.any() and not found.middle.any() and found.n_iter.tolist() == [4]
    for variance in ((-1.0, 4.0, 9.0), (1.0, -4.0, 9.0), (1.0, 4.0, np.nan)):
        bad = fit_of(variance=variance).estimate(windows)
        assert not bad.converged.any() and np.isnan(bad.sigma).all() and np.isnan(bad.sigma_flux)
    exact = fit_of(variance=(0.0, 0.0, 0.0)).estimate(windows)
    assert exact.converged.all() and not exact.sigma.any()


def misfit(signal, fit, **options):
    return bool(_misfits(fit, windows_of([signal], **options))[0])


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("part", ["window", "middle"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("noise", [(2500.0, 0.0, 0.0), (1.0, 9.0, 0.0), (1.0, 0.0, 9.0)])
def test_a_template_may_be_wrong_by_a_tenth_of_the_light_and_five_errors(masked, part, sign, noise):
    """Of the window, and of its middle, half as wide: of 13 pixels the inner 7."""
    centre, width, size = (0.2, -0.1), (1.2, 1.4), 13
    own = light_of(centre, width, size, flux=1e4)
    kept = np.ones((size, size))
    if masked:
        kept[5, 6] = kept[1, 9] = 0.0
    share = np.ones((size, size))
    if part == "middle":
        share[:3] = share[-3:] = share[:, :3] = share[:, -3:] = 0.0
    floor, per_dn, level = noise
    held, count = (own * share * kept).sum(), share.sum()
    options = {"kept": np.pad(kept, 1)[None]} if masked else {}
    options |= {"floor": floor, "per_dn": per_dn, "plane": (level, 5.0, 5.0)}
    for excess in np.linspace(0.0, 8e3, 81):
        signal = own.copy()
        signal[(0, 4) if part == "window" else (6, 4)] += sign * excess
        total = (signal * share * kept).sum()
        error = np.sqrt(count * floor + per_dn * max(total, 0.0) + count**2 * level)
        limit = 0.1 * abs(total) + 5.0 * error
        if part == "middle":
            signal[0, 4] -= sign * excess  # the whole window has what it should
        if not 0.98 < abs(held - total) / limit < 1.02:
            told = misfit(signal, fit_of(centre, width), **options)
            assert told == (abs(held - total) > limit), excess


def test_a_template_of_another_width_shows_in_the_middle():
    for width, told in ((1.5, False), (2.4, True)):
        signal = light_of([0.0, 0.0], [1.5, 1.5], flux=1e6)
        assert misfit(signal, fit_of(width=(width, width), flux=1e6)) == told
