"""Limits within the estimates, from either side: leverage, rank, what is shown, what tells noise."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm

import losbench as lb
from losbench.estimation.allan import _exponent, _noises
from losbench.estimation.breakdown import deletion_residuals
from losbench.estimation.highbreakdown.efficient import _s_estimate
from losbench.estimation.highbreakdown.search import Units, least, least_places
from losbench.estimation.highbreakdown.trimmed import _KEPT, _truncated
from losbench.estimation.memory import variance_sampling
from losbench.estimation.robust.problem import read_problem, spd_inverse
from losbench.estimation.robust.scales import ScaleRule
from losbench.estimation.smoothing import _most_likely
from losbench.estimation.streams import Summary, _edges, _histogram


@pytest.mark.parametrize("leverage", [0.5, 0.99, 0.9998, 0.99995, 1.0])
def test_residuals_are_adjusted_for_leverage_up_to_a_ten_thousandth(leverage):
    """A design of one column: the leverage of its first row is a^2 / (a^2 + 9)."""
    a = 3.0 * np.sqrt(leverage / max(1.0 - leverage, 1e-14))
    design = np.array([[a], *[[1.0]] * 9])
    y = np.random.default_rng(1).standard_normal(10)
    seen = []

    def scale(judged):
        seen.append(np.array(judged))
        return np.ones(judged.shape[:-1])

    lb.irls(design, y, scale=scale, leverage=True, max_iter=1, on_fail="ignore")
    plain = y - design @ lb.lstsq(design, y).x
    h = np.array([min(leverage, 0.9999), *[design[1, 0] ** 2 / (a**2 + 9)] * 9])
    expected = np.abs(plain) / np.sqrt(1.0 - h)
    np.testing.assert_allclose(np.abs(seen[0].ravel())[1:], expected[1:], rtol=1e-6)
    if leverage < 1.0:
        assert abs(seen[0].ravel()[0]) == pytest.approx(expected[0], rel=1e-3)


@pytest.mark.parametrize("apart", [1e-2, 1e-5, 1e-8])
def test_what_is_poorly_determined_is_so_and_not_undetermined(apart):
    """Two columns that are nearly parallel, and two that are the same."""
    rng = np.random.default_rng(2)
    first, other, double = rng.standard_normal((3, 40))
    design = np.column_stack([first, first + apart * other, double, double])
    y = design @ [1.0, 2.0, 3.0, 4.0] + rng.standard_normal(40)
    fit = lb.lstsq(design, y, on_fail="ignore")
    assert fit.rank == 3
    assert np.isfinite(fit.std_error[:2]).all() and np.isnan(fit.std_error[2:]).all()
    alone = lb.lstsq(np.column_stack([first, first + apart * other, 2 * double]), y)
    np.testing.assert_allclose(fit.std_error[:2], alone.std_error[:2], rtol=1e-4)


@pytest.mark.parametrize("scale", [1e-90, 1.0, 1e90, 1e140])
def test_units_of_rows_and_columns_carry_through(scale):
    rng = np.random.default_rng(3)
    design, y = rng.standard_normal((12, 3)), rng.standard_normal(12)
    plain = lb.irls(design, y)
    np.testing.assert_allclose(lb.irls(design * scale, y).x * scale, plain.x, rtol=1e-9)
    np.testing.assert_allclose(lb.irls(design, y * scale).x / scale, plain.x, rtol=1e-9)
    assert read_problem(design, y).rank.tolist() == [3]


@pytest.mark.parametrize("unknowns", [6, 7, 10, 11])
def test_ten_rows_and_six_unknowns_are_shown(unknowns):
    rng = np.random.default_rng(4)
    design = rng.standard_normal((60, unknowns))
    y = rng.standard_normal(60)
    y[:12] += 40.0
    summary = lb.irls(design, y).summary()
    lines = summary.splitlines()
    values = [line for line in lines if line[:7].strip().isdigit() and len(line.split()) == 3]
    doubted = [line for line in lines if line[:7].strip().isdigit() and len(line.split()) == 4]
    assert len(values) == min(unknowns, 10) and len(doubted) == 10
    weights = [float(line.split()[2]) for line in doubted]
    assert weights == sorted(weights)
    batch = lb.irls(design, np.stack([y, y]))
    html = batch._repr_html_()
    assert (
        f"<th>x{min(unknowns, 6) - 1}</th>" in html
    ) and f"<th>x{min(unknowns, 6)}</th>" not in html
    shown = batch.summary()
    assert f"x[{min(unknowns, 10) - 1}]" in shown and f"x[{min(unknowns, 10)}]" not in shown


# Memory and Allan deviations


def test_128_means_tell_the_noise_and_fewer_keep_what_was_told_last():
    walk = np.cumsum(np.random.default_rng(5).standard_normal(1280))
    white = np.random.default_rng(5).standard_normal(1280)
    assert _noises(walk, np.array([10])) == [-2]
    assert _noises(walk, np.array([11])) == [0]
    assert _noises(walk, np.array([1, 11])) == [-2, -2]
    assert _noises(white, np.array([11, 1])) == [0, 0]


@pytest.mark.parametrize(
    ("make", "exponent"),
    [
        (lambda w: w, 0),
        (np.cumsum, -2),
        (np.diff, 2),
        (lambda w: np.cumsum(np.cumsum(w)), -2),
    ],
)
def test_the_exponent_of_a_power_law_is_told_by_its_neighbours(make, exponent):
    for seed in range(5):
        white = np.random.default_rng(seed).standard_normal(4000)
        assert _exponent(make(white)) == exponent
    assert _exponent(np.zeros(200)) == 0


@pytest.mark.parametrize("missing", [False, True])
def test_the_sampling_of_a_variance_is_the_sum_over_lags(missing):
    """By loops over pairs, up to the first negative lag, twice with the mean's share put back."""
    series = np.convolve(np.random.default_rng(6).standard_normal(90), np.ones(6), "valid")
    if missing:
        series[[3, 40, 41]] = np.nan
    seen = ~np.isnan(series)
    about = series - np.nanmean(series)
    n = int(seen.sum())
    covariance = []
    for k in range(len(series)):
        products = about[k:] * about[: len(series) - k]
        covariance.append(np.nanmean(products) if np.isfinite(products).any() else 0.0)
    covariance = np.array(covariance)

    def kept(lost):
        raised = covariance + lost
        end = np.argmax(raised <= 0) if (raised <= 0).any() else len(raised)
        return raised[:end]

    lost = 0.0
    for _ in range(2):
        some = kept(lost)
        lost = min((some[0] + 2 * some[1:].sum()) / n, covariance[0])
    some = kept(lost)
    error = np.sqrt(2 * (some[0] ** 2 + 2 * (some[1:] ** 2).sum()) / n)
    np.testing.assert_allclose(variance_sampling(series), (lost, error), rtol=1e-9)


# Candidates


def test_the_least_of_many_candidates_are_kept_with_their_places():
    objective = np.random.default_rng(7).random((3, 9))
    z = np.random.default_rng(8).random((3, 9, 2))
    for count in (1, 4, 9, 20):
        places = np.sort(least_places(objective, count), axis=1)
        expected = np.sort(np.argsort(objective, axis=1)[:, :count], axis=1)
        np.testing.assert_array_equal(places, expected)
        chosen, values = least(z, objective, count)
        for k in range(3):
            np.testing.assert_allclose(np.sort(values[k]), np.sort(objective[k])[:count])
            where = [np.flatnonzero(objective[k] == v)[0] for v in values[k]]
            np.testing.assert_array_equal(chosen[k], z[k, where])


@pytest.mark.parametrize(
    ("sizes", "rank", "needed", "majority"),
    [
        ([1] * 7, 2, 2, 5),
        ([1] * 8, 3, 3, 6),
        ([2] * 5, 3, 2, 4),
        ([2] * 5, 4, 2, 4),
        ([2] * 5, 5, 3, 4),
        ([1, 1, 3, 3], 2, 2, 3),
        ([1, 1, 3, 3], 3, 3, 4),
        ([4], 3, 1, 1),
    ],
)
def test_units_needed_and_their_majority(sizes, rank, needed, majority):
    """Whichever units they are, the smallest too; and floor((m + q + 1) / 2) of them."""
    units = Units.read(np.repeat(np.arange(len(sizes)), sizes), sum(sizes))
    assert (units.needed(rank), units.majority(rank)) == (needed, majority)
    assert units.rows == max(1, round(np.mean(sizes)))
    values = np.arange(float(sum(sizes)))
    expected = [part.sum() for part in np.split(values, np.cumsum(sizes)[:-1])]
    np.testing.assert_array_equal(units.sums(values), expected)
    np.testing.assert_array_equal(
        units.spread(np.arange(float(len(sizes)))), np.repeat(np.arange(len(sizes)), sizes)
    )


def test_deletion_residuals_are_those_without_the_row():
    rng = np.random.default_rng(9)
    design, y = rng.standard_normal((9, 2)), rng.standard_normal(9)
    found = deletion_residuals(lb.lstsq(design, y))
    for k in range(9):
        rest = np.delete(np.arange(9), k)
        fit = lb.lstsq(design[rest], y[rest])
        ahead = design[k] @ fit.cov @ design[k]
        error = np.sqrt(fit.scale**2 + ahead)
        assert found[k] == pytest.approx((y[k] - design[k] @ fit.x) / error, rel=1e-9)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_an_unknown_that_only_a_doubted_row_fixes_is_open_and_the_others_are_not(scale):
    """The third is seen by the first row alone, which is doubted with the second."""
    rng = np.random.default_rng(10)
    design = np.column_stack([np.ones(14), rng.standard_normal(14), np.eye(14)[0]]) * scale
    y = design @ [1.0, 2.0, 3.0] + 1e-3 * scale * rng.standard_normal(14)
    y[1] += 1e3 * scale
    fit = lb.irls(
        design,
        y,
        loss=lb.Bisquare(),
        scale=1e-3 * scale,
        group=[0, 0, *range(1, 13)],
        x0=np.array([1.0, 2.0, 3.0]),
        on_fail="ignore",
    )
    assert not fit.weights[:2].any()
    assert np.isfinite(fit.std_error[:2]).all() and np.isnan(fit.std_error[2])
    rest = lb.lstsq(design[2:, :2], y[2:], scale=1e-3 * scale)
    np.testing.assert_allclose(fit.x[:2], rest.x, rtol=1e-3)


def test_bins_of_a_summary_hold_what_lies_between_their_ends():
    rng = np.random.default_rng(11)
    z = np.concatenate(
        [
            rng.normal(0.0, 3.0, 4000),
            10.0 ** rng.uniform(0, 4, 900),
            -(10.0 ** rng.uniform(0, 4, 900)),
        ]
    ).astype(np.float32)
    edges = _edges()
    assert (np.diff(edges) > 0).all()
    inside = z[(np.abs(z) < edges[-1]) & ~np.isin(z, edges)].astype(np.float64)
    (counts,) = _histogram(inside[None])
    np.testing.assert_array_equal(counts, np.histogram(inside, edges)[0])
    (ends,) = _histogram(np.array([[-1e30, 1e30]]))
    assert ends[0] == ends[-1] == 1 and ends.sum() == 2


def test_a_summary_counts_what_it_left_out_and_finds_quantiles():
    values = np.random.default_rng(12).standard_normal((2, 20_000))
    values[0, 5], values[1, 9] = np.nan, np.inf
    few = Summary.of(values)
    whole = values[:, np.isfinite(values).all(axis=0)]
    assert (few.n, few.left_out, few.unconverged) == (19_998, 2, 0)
    assert Summary.of(values, 7).unconverged == 7
    wanted = [0.0, 0.01, 0.5, 0.9, 1.0]
    np.testing.assert_allclose(
        few.quantiles(wanted), np.quantile(whole, wanted, axis=1).T, atol=0.02
    )
    np.testing.assert_array_equal(few.quantiles([0.0, 1.0])[:, 0], whole.min(axis=1))


# Scales, covariances and searches


def test_quantiles_of_a_study_are_one_and_three_sigma_of_a_gaussian():
    table = lb.study(lambda rng, size: {"x": rng.random(size)}, {}, 9, seed=1).to_frame()
    shown = [float(name[1:]) for name in table if name.startswith("q0")]
    np.testing.assert_allclose(shown, norm.cdf([-3, -1, 0, 1, 3]), atol=1e-5)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_cut_errors_are_as_much_smaller_as_a_chi_square_says(rows):
    end = chi2(rows).ppf(0.9)
    inside = quad(lambda q: q * chi2(rows).pdf(q), 0.0, end)[0] / 0.9 / rows
    assert _truncated(0.9, rows) == pytest.approx(inside, rel=1e-6)


@pytest.mark.parametrize("group", [None, np.arange(30) // 2])
def test_the_covariance_of_an_mm_estimate_is_that_of_its_docstring(group):
    """kappa^2 sum psi^2 / (n - p) / m^2 times mean(w) (A'WA)^-1, over two systems of one design."""
    rng = np.random.default_rng(12)
    design, y = rng.standard_normal((30, 2)), rng.standard_normal((2, 30)) * [[1.0], [7.0]]
    y[:, 4] += 60.0
    fits = lb.mm(design, y, group=group)
    rows = 1 if group is None else 2
    loss = lb.tuned(lb.Bisquare(), 0.95, rows=rows)
    for k in range(2):
        u, w = fits.residuals[k] / fits.scale[k], fits.weights[k]
        size = np.sqrt((u**2).reshape(-1, rows).mean(axis=1)).repeat(rows)
        slope = w + (loss.psi_deriv(size) - w) / rows
        kappa = 1 + 2 * slope.var() / 29 / slope.mean() ** 2
        spread = (w * fits.residuals[k]) @ (w * fits.residuals[k]) / 28 * w.mean()
        inverse = np.linalg.inv(design.T @ (w[:, None] * design))
        expected = spread * kappa**2 / slope.mean() ** 2 * inverse
        np.testing.assert_allclose(fits.cov[k], expected, rtol=1e-6)


@pytest.mark.parametrize("unit", [1e-120, 1e-9, 1e9, 1e120])
@pytest.mark.parametrize("fit", [lb.mm, lb.lts])
def test_a_scale_is_found_to_nine_digits_in_any_unit(fit, unit):
    rng = np.random.default_rng(13)
    design, y = rng.standard_normal((14, 3)), rng.standard_t(2, 14)
    plain, other = fit(design, y), fit(design, unit * y)
    assert other.scale / unit == pytest.approx(plain.scale, rel=1e-9)
    np.testing.assert_allclose(other.x / unit, plain.x, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(other.std_error / unit, plain.std_error, rtol=1e-8)


def test_one_system_with_rows_that_tell_the_same_leaves_the_others_of_its_batch_alone():
    rng = np.random.default_rng(14)
    design, y = rng.standard_normal((5, 9, 4)), rng.standard_normal((5, 9))
    y[:, 2] += 40.0
    design[3, :7, 0] = design[3, :7, 1]  # a subset of it is singular
    together = lb.lts(design, y)
    for k in range(5):
        alone = lb.lts(design[k], y[k])
        np.testing.assert_array_equal(together.weights[k], alone.weights)
        np.testing.assert_allclose(together.x[k], alone.x, rtol=1e-9)


@pytest.mark.parametrize("p", [2, 3, 4])
def test_an_unknown_of_next_to_no_weight_has_a_large_error(p):
    """Two rows that contradict each other by a million scales see the last unknown alone."""
    design = np.concatenate([np.eye(p)[: p - 1].repeat(6, axis=0), np.eye(p)[-1:], np.eye(p)[-1:]])
    y = np.concatenate([np.random.default_rng(15).standard_normal(6 * (p - 1)), [1e6, -1e6]])
    fit = lb.irls(design, y, loss=lb.Cauchy(1.0), scale=1.0, max_iter=1, on_fail="ignore")
    assert fit.std_error[-1] == pytest.approx(1e6 / np.sqrt(2), rel=1e-3)
    assert (fit.std_error[:-1] < 1.5).all()


def test_a_row_that_a_millionth_touches_is_touched():
    """Five rows say nothing about the slope; a sixth says a ten-millionth."""
    x = np.array([0.0] * 5 + [1e-7, 1.0, 2.0, 3.0, 4.0])
    assert lb.design_breakdown(np.column_stack([np.ones(10), x])).any == 2
    x[5] = 0.0
    assert lb.design_breakdown(np.column_stack([np.ones(10), x])).any == 1


def test_a_pooled_scale_is_first_sought_where_the_residuals_put_it(monkeypatch):
    rng = np.random.default_rng(16)
    design, y = rng.standard_normal((9, 2)), rng.standard_t(3, (40, 9))
    tried, at = [], ScaleRule.at
    monkeypatch.setattr(ScaleRule, "at", lambda rule, size: tried.append(size) or at(rule, size))
    lb.irls(design, y, scale="pooled")
    assert len(tried) < 7  # secants: to put one for the other takes longer
    left = [lb.irls(design, y, scale=size).residuals for size in tried[:1]]
    assert tried[0] == pytest.approx(np.sqrt(np.mean(lb.lstsq(design, y).residuals ** 2)))
    assert tried[1] == pytest.approx(np.sqrt(np.mean(left[0] ** 2)), rel=1e-6)


@pytest.mark.parametrize(("apart", "converged"), [(0.009, True), (0.011, False)])
def test_a_maximum_is_one_if_another_start_found_it_to_a_hundredth(apart, converged):
    found = iter(
        [
            SimpleNamespace(llf=5.0, params=[1.0], mle_retvals={"converged": False}),
            SimpleNamespace(llf=5.0 - apart, params=[2.0], mle_retvals={"converged": True}),
        ]
    )
    model = SimpleNamespace(fit=lambda *_, **__: next(found))
    best, settled = _most_likely(model)
    assert (best.tolist(), settled) == ([1.0], converged)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_reweighting_keeps_as_many_good_units_as_it_says(rows):
    y = np.random.default_rng(17).standard_normal(1500 * rows)
    fit = lb.lts(np.ones((len(y), 1)), y, group=np.arange(len(y)) // rows, starts=20)
    assert fit.weights.mean() == pytest.approx(_KEPT, abs=0.008)
    assert norm.cdf(2.5) - norm.cdf(-2.5) == pytest.approx(_KEPT, abs=1e-5)
    assert fit.scale == pytest.approx(1.0, abs=0.06)


def test_groups_that_see_a_plane_each_leave_a_direction_untouched():
    rng = np.random.default_rng(18)
    seen = rng.standard_normal((5, 3, 2)) @ rng.standard_normal((5, 2, 3))
    assert lb.design_breakdown(seen.reshape(15, 3), group=np.arange(15) // 3).any == 1


def test_a_design_that_is_kept_cannot_be_changed():
    problem = read_problem(np.ones((4, 1)), np.zeros(4))
    for array in (problem.basis, problem.to_x, problem.rank, problem.estimable):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize(("n", "p"), [(3, 1), (4, 2), (7, 2), (40, 3)])
def test_the_scale_of_an_mm_estimate_solves_its_equation(n, p):
    """sum rho(r / s) = (n - p) rho(inf) / 2 at the S-estimate, from where 95 % stray little; with
    the constant of half the greatest loss.
    """
    rng = np.random.default_rng(19)
    design, y = rng.standard_normal((n, p)), rng.standard_normal(n)
    problem = read_problem(design, y)
    z, size = _s_estimate(problem, Units.read(None, n), None, np.random.default_rng(0))
    u = np.abs(problem.residuals(z)[0]) / size[0] / 1.54764
    rho = (1.0 - (1.0 - np.minimum(u, 1.0) ** 2) ** 3).sum()
    assert rho == pytest.approx((n - p) / 2, rel=1e-5)
    assert lb.mm(design, y).scale == pytest.approx(size[0], rel=1e-9)


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e8])
def test_a_pooled_scale_follows_the_unit(unit):
    rng = np.random.default_rng(20)
    design, y = rng.standard_normal((9, 2)), rng.standard_t(3, (30, 9))
    plain, other = (
        lb.irls(design, k * y, scale="pooled", x0=[9.0 * k, -9.0 * k]) for k in (1.0, unit)
    )
    assert other.converged.all()
    np.testing.assert_allclose(other.scale / unit, plain.scale, rtol=1e-8)


def test_matrices_that_no_row_determines_are_inverted_as_far_as_they_can_be_beside_others():
    """Negative off the diagonal and positive; the pseudo-inverse is the authority."""
    vectors = np.array([[3.0, -1.0, 0.0], [1.0, 2.0, 3.0]])
    matrices = [np.outer(v, v) for v in vectors] + [np.eye(3), np.diag([1.0, 5.0, 2.0]) + 0.5]
    packed = np.array([matrix[np.triu_indices(3)] for matrix in matrices])
    for found, matrix in zip(spd_inverse(packed, 3), matrices, strict=True):
        np.testing.assert_allclose(found, np.linalg.pinv(matrix), atol=1e-9)
    np.testing.assert_allclose(
        spd_inverse(np.array([[4.0, -2.0, 1.0]]), 2)[0],
        np.linalg.pinv(np.array([[4.0, -2.0], [-2.0, 1.0]])),
        atol=1e-9,
    )
    near = np.array([[1.0, 1.0 - 2e-15], [1.0 - 2e-15, 1.0]])
    found = spd_inverse(near[np.triu_indices(2)][None], 2)[0]
    np.testing.assert_allclose(found, np.linalg.pinv(near, rcond=1e-14), rtol=1e-9)


def test_outliers_may_be_asked_for_below_a_scale():
    fit = lb.lstsq(np.ones((4, 1)), [0.0, 0.0, 1.0, 7.0])
    size = np.abs(fit.residuals) / fit.scale
    for threshold in (0.0, 0.4, 0.9):
        np.testing.assert_array_equal(fit.outliers(threshold), size > threshold)


def test_quantiles_where_more_than_half_of_the_numbers_are_equal():
    """Their median absolute deviation is zero: the standard deviation is the unit."""
    rest = 1e-6 * np.random.default_rng(21).uniform(1.0, 2.0, (1, 180))
    values = np.concatenate([np.zeros((1, 320)), rest], axis=1)
    found = Summary.of(values).quantiles([0.7, 0.9])[0]
    np.testing.assert_allclose(found, np.quantile(values[0], [0.7, 0.9]), rtol=0.02)


@pytest.mark.parametrize("fit", [lb.lstsq, lb.irls, lb.lts, lb.mm])
def test_one_set_of_observations_is_solved_by_each_of_several_designs(fit):
    rng = np.random.default_rng(22)
    designs, y = rng.standard_normal((3, 12, 2)), rng.standard_normal(12)
    y[3] += 30.0
    together = fit(designs, y)
    for k, design in enumerate(designs):
        alone = fit(design, y)
        for name in ("x", "residuals", "weights", "scale", "cov", "leverage"):
            np.testing.assert_allclose(
                getattr(together, name)[k], getattr(alone, name), rtol=1e-7, atol=1e-12
            )


def test_two_long_systems_of_their_own_designs_are_solved_one_by_one():
    rng = np.random.default_rng(23)
    design, y = rng.standard_normal((2, 1500, 2)), rng.standard_normal((2, 1500))
    y[:, :400] += 30.0
    for fit in (lb.lts, lb.mm):
        together = fit(design, y)
        for k in range(2):
            np.testing.assert_allclose(together.x[k], fit(design[k], y[k]).x, rtol=1e-6, atol=1e-9)


def test_trials_may_come_one_by_one():
    def trial(rng, size):
        return {"x": rng.random(size)}

    drawn = lb.monte_carlo(trial, 3, seed=1, chunk=1)["x"]
    assert len(set(drawn.tolist())) == 3
    mean = lb.study(trial, {}, 3, seed=1, chunk=1).to_frame()["mean"].iloc[0]
    assert mean == pytest.approx(drawn.mean(), rel=1e-12)


def test_samples_beyond_four_robust_sigma_say_nothing_of_the_memory_and_others_do():
    def sigma(outlier):
        series = np.random.default_rng(24).standard_normal(600)
        series[300] = outlier
        return lb.split_error(series, scale="mad").total_sigma

    assert sigma(5.0) == sigma(500.0)
    assert sigma(3.0) != sigma(3.6)


# What is taken where nothing is said


def drawn(rng, size):
    return {"x": rng.random(size)}


def test_trials_come_in_thousands_and_those_of_a_study_in_tens_of_thousands():
    plain, said = (lb.monte_carlo(drawn, 1500, seed=1, **k)["x"] for k in ({}, {"chunk": 1000}))
    np.testing.assert_array_equal(plain, said)
    plain, said = (lb.study(drawn, {}, 10_500, seed=1, **k) for k in ({}, {"chunk": 10_000}))
    np.testing.assert_array_equal(plain.summaries[0].mean, said.summaries[0].mean)


@pytest.mark.parametrize("name", ["lsfe", "nea", "split_error"])
def test_a_sliding_mean_is_over_five_samples_and_biased_as_in_the_paper(name):
    series = np.random.default_rng(25).standard_normal(60)
    more = {"method": "residual"} if name == "nea" else {}
    split = getattr(lb, name)
    found, said = (
        split(series, **more),
        split(series, window=5, unbiased=False, scale="std", **more),
    )
    assert found == said


def test_reweighting_stops_after_a_hundred_steps_and_at_ten_digits():
    """Two pairs that pull apart under a loss that takes long to decide."""

    class Slow:
        def weights(self, u):
            return np.maximum(np.abs(u), 1e-3) ** -0.999 * 1e-3**0.999

    y = np.array([0.0, 0.0, 0.3, 1.0, 1.0, 7.0])
    for call in (lb.irls, lambda A, y, **k: lb.IRLS(**k).fit(A, y)):
        with pytest.warns(RuntimeWarning, match="did not converge in 100 iterations"):
            fit = call(np.ones((6, 1)), y, loss=Slow(), scale=1.0, tolerance=0.0)
        assert fit.n_iter == 100
    design = np.random.default_rng(26).standard_normal((40, 2))
    y = np.random.default_rng(27).standard_t(1, (200, 40))
    for loss in (lb.Huber(), lb.Cauchy()):
        plain, said = (
            lb.irls(design, y, loss=loss, on_fail="ignore", **k) for k in ({}, {"tolerance": 1e-10})
        )
        np.testing.assert_array_equal(plain.n_iter, said.n_iter)
        np.testing.assert_array_equal(lb.IRLS(loss, on_fail="ignore").fit(design, y).x, plain.x)
