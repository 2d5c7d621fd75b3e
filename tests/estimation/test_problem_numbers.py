"""How systems are brought into a safe form, each limit from either side: null spaces made by hand."""

import numpy as np
import pytest
from scipy.stats import norm

import losbench as lb
from losbench.estimation.highbreakdown.mscale import MScale, _half
from losbench.estimation.highbreakdown.search import Units
from losbench.estimation.influence import _tuned, normal_mean
from losbench.estimation.robust.problem import (
    _by_svd,
    _design,
    _design_of_one,
    _in_range,
    _triangle,
    gram,
    places,
    read_problem,
    spd_inverse,
)
from losbench.estimation.robust.scales import ScaleRule


@pytest.mark.parametrize("order", [1, -1])
def test_what_the_weights_leave_open_is_told_for_each_system_of_a_batch(order):
    """Three rows of two unknowns; without the last one the second unknown is open."""
    problem = read_problem([[1.0, 0.0], [2.0, 0.0], [0.0, 3.0]], np.ones((2, 3)))
    weights = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0]])[::order]
    normal = gram(problem.basis, weights, problem.rank)
    left = problem.left_by(spd_inverse(normal, 2), normal)
    assert left.tolist() == [[True, True], [True, False]][::order]


@pytest.mark.parametrize(("tilt", "left"), [(1e-7, False), (3e-9, False), (3e-10, True)])
def test_an_unknown_is_left_open_by_a_billionth_of_it(tilt, left):
    """One of two orthogonal rows is kept, which lies along the first unknown up to a tilt."""
    problem = read_problem([[1.0, tilt], [-tilt, 1.0]], np.ones((1, 2)))
    normal = gram(problem.basis, np.array([[1.0, 0.0]]), problem.rank)
    assert problem.left_by(spd_inverse(normal, 2), normal).tolist() == [[left, False]]


@pytest.mark.parametrize(("share", "determined"), [(1.5e-9, False), (0.7e-9, True)])
def test_an_unknown_that_a_null_vector_moves_by_a_billionth_is_not_determined(share, determined):
    """Two unit columns that are the same but for a share of a third."""
    rng = np.random.default_rng(1)
    first, second = np.linalg.qr(rng.standard_normal((30, 2)))[0].T
    columns = np.stack([first, second, first + np.sqrt(2.0) * share * second])
    assert _by_svd(columns[None])[2][0].tolist() == [False, determined, False]


@pytest.mark.parametrize(("times", "determined"), [(7.5, True), (13.0, False)])
def test_a_small_direction_tilts_the_null_space_by_ten_times_its_rounding(times, determined):
    """Beside a pair of columns a millionth apart, rounding itself moves more than a billionth."""
    axes = np.linalg.qr(np.random.default_rng(2).standard_normal((40, 4)))[0].T
    one, other, apart, beside = axes
    pair = np.stack([apart, apart + 1e-6 * beside])
    pair /= np.linalg.norm(pair, axis=1)[:, None]
    singular = np.linalg.svd(np.stack([one, other, one, *pair]))[1]
    rounding = 40 * np.finfo(float).eps * singular[0] / singular[3]
    share = times * rounding
    columns = np.stack([one, other, one + np.sqrt(2.0) * share * other, *pair])
    assert 10.0 * rounding > 2e-9
    known = _by_svd(columns[None])[2][0]
    assert known.tolist() == [False, determined, False, True, True]


def test_rows_whose_squares_keep_their_digits_have_the_unit_one():
    for size in (1e-98, 1.0, 1e98):
        rows, unit, norm = _in_range(np.array([[3.0 * size, 4.0 * size]]))
        assert unit.tolist() == [1.0] and norm[0] == pytest.approx(5.0 * size)
        assert (rows == [[3.0 * size, 4.0 * size]]).all()
    for sizes in ([1e-102, 1.0], [1.0, 1e102], [1e-320, 1e300]):
        given = np.array([[3.0, 4.0]]) * np.array(sizes)[:, None]
        rows, unit, norm = _in_range(given)
        assert (np.frexp(unit)[0] == 0.5).all() and (unit[:, None] * rows == given).all()
        np.testing.assert_allclose(norm * unit, 1.25 * given[:, 1], rtol=1e-3)
        assert (norm > 1e-30).all() and (norm < 2.0).all()


@pytest.mark.parametrize("size", [0.0, 1e-200, 1.0, 1e6])
def test_a_perfect_fit_is_one_to_sixteen_roundings_of_the_observations(size):
    """In working units, which are the user's here but for the smallest."""
    problem = read_problem(np.ones((2, 1)), np.array([3.0, 4.0]) * size)
    rounding = 16 * np.finfo(float).eps * 5.0 * size
    tiny = np.finfo(float).tiny
    np.testing.assert_allclose(problem.floor * problem.y_unit, max(rounding, tiny), rtol=1e-9)


@pytest.mark.parametrize("p", [1, 2, 3, 4])
def test_directions_of_next_to_no_weight_are_inverted_down_to_1e_14_of_the_greatest(p):
    rng = np.random.default_rng(p)
    axes = np.linalg.qr(rng.standard_normal((p, p)))[0]
    upper = np.triu_indices(p)
    for least, kept in ((1e-13, True), (1e-16, False)):
        matrix = np.diag([*[1.0] * (p - 1), least])
        inverse = spd_inverse(matrix[upper][None], p)[0]
        expected = 1.0 / least if kept or p == 1 else 0.0
        assert inverse[-1, -1] == pytest.approx(expected, rel=1e-6)
    matrix = axes @ np.diag(np.geomspace(1.0, 1e-3, p)) @ axes.T
    np.testing.assert_allclose(
        spd_inverse(matrix[upper][None], p)[0], np.linalg.inv(matrix), rtol=1e-9, atol=1e-9
    )


# Scales of residuals


@pytest.mark.parametrize("mean", [0.0, 3.0, -30.0, 1e3, 1e9])
@pytest.mark.parametrize("n", [2, 3, 8])
def test_a_standard_deviation_is_about_the_mean_however_far_that_is(mean, n):
    residuals = mean + np.random.default_rng(n).standard_normal((5, n))
    for name, ddof in (("std", 0), ("std1", 1)):
        rule = ScaleRule(name, (5,), np.ones(5))
        expected = residuals.std(axis=1, ddof=ddof)
        np.testing.assert_allclose(rule(residuals, np.arange(5)), expected, rtol=1e-6)
    mixed = residuals * [[1e-9], [1.0], [1.0], [1.0], [1.0]] + [[7.0], [0.0], [0.0], [0.0], [0.0]]
    found = ScaleRule("std", (5,), np.ones(5))(mixed, np.arange(5))
    np.testing.assert_allclose(found, mixed.std(axis=1), rtol=1e-3)
    rms = ScaleRule("rms", (5,), np.ones(5))(residuals, np.arange(5))
    np.testing.assert_allclose(rms, np.sqrt(np.mean(residuals**2, axis=1)), rtol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 5, 6])
def test_a_median_absolute_residual_is_that_of_numpy_and_of_the_rest(n):
    residuals = np.random.default_rng(n).standard_normal((4, n))
    ordered = np.sort(np.abs(residuals), axis=1)
    plain = ScaleRule("mad", (4,), np.ones(4))(residuals, np.arange(4))
    np.testing.assert_allclose(plain * norm.ppf(0.75), np.median(ordered, axis=1), rtol=1e-12)
    if n > 2:
        rest = ScaleRule("mad", (4,), np.ones(4), dropped=2)(residuals, np.arange(4))
        np.testing.assert_allclose(rest * 0.6745, np.median(ordered[:, 2:], axis=1), rtol=1e-12)


def test_a_table_counts_the_rows_of_less_than_full_weight():
    design, rng = np.ones((9, 1)), np.random.default_rng(3)
    y = rng.standard_normal((3, 9))
    y[1, :2] += 30.0
    y[2, 4] -= 30.0
    fit = lb.irls(design, y)
    frame = fit.to_frame()
    assert frame["doubted"].tolist() == [int((row < 1.0).sum()) for row in fit.weights]
    assert frame["doubted"].tolist()[1:] != [0, 0]
    np.testing.assert_array_equal(frame["x0"], fit.x[:, 0])
    np.testing.assert_array_equal(frame["std_error0"], fit.std_error[:, 0])
    assert lb.lstsq(design, y).to_frame()["doubted"].tolist() == [0, 0, 0]


# What is made once and kept, made anew


@pytest.mark.parametrize("p", [1, 2, 3, 4, 6])
def test_packed_elements_have_their_places(p):
    place, triangle = places.__wrapped__(p), _triangle.__wrapped__(p)
    pairs = [(i, j) for i in range(p) for j in range(i, p)]
    assert triangle.tolist() == [i * p + j for i, j in pairs]
    for k, (i, j) in enumerate(pairs):
        assert place[i, j] == place[j, i] == k


@pytest.mark.parametrize("rows", [1, 2, 3, 8])
def test_the_mean_loss_of_an_s_estimate_is_half_of_its_greatest(rows):
    loss = _half.__wrapped__(rows)
    assert normal_mean(loss.rho, rows=rows, corners=(loss.c,)) == pytest.approx(
        loss.c**2 / 12.0, rel=1e-9
    )
    if rows == 1:
        assert loss.c == pytest.approx(1.5476, abs=1e-4)


@pytest.mark.parametrize("loss", [lb.Huber(2.0), lb.Bisquare(), lb.Cauchy()])
@pytest.mark.parametrize("wanted", [0.7, 0.9, 0.999])
def test_a_tuned_loss_has_the_efficiency_that_was_asked_for(loss, wanted):
    found = _tuned.__wrapped__(loss, wanted, 1)
    power = normal_mean(lambda u: (u * found.weights(u)) ** 2, corners=(found.c,))
    slope = normal_mean(lambda u: u**2 * found.weights(u), corners=(found.c,))
    assert slope**2 / power == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("loss", [lb.Huber(), lb.Bisquare(), lb.Cauchy()])
def test_constants_are_sought_from_a_twelfth_to_seven_times(loss):
    ends = [lb.efficiency(type(loss)(loss.c * np.exp(power))) for power in (-2.5, 2.0)]
    beyond = 0.01 if ends[0] > 0.02 else 1.0 - 1e-9
    with pytest.raises(ValueError, match=f"{ends[0]:.3f} to {ends[1]:.5f}, got {beyond:g}"):
        _tuned.__wrapped__(loss, beyond, 1)
    for wanted in (ends[0] + 1e-6, ends[1] - 1e-9):
        assert lb.efficiency(_tuned.__wrapped__(loss, wanted, 1)) == pytest.approx(wanted, abs=1e-8)


def test_one_design_is_factorised_as_many_are():
    matrix = np.random.default_rng(4).standard_normal((7, 3)) * [1.0, 1e-3, 1e3]
    one, many = _design_of_one.__wrapped__(matrix.tobytes(), 7, 3), _design(matrix[None])
    for name, array in vars(one).items():
        np.testing.assert_array_equal(array, getattr(many, name))
        assert not array.flags.writeable
    np.testing.assert_allclose(one.basis[0] @ one.basis[0].T, np.eye(3), atol=1e-12)
    x = np.array([1.0, -2.0, 3.0])
    np.testing.assert_allclose(one.to_x[0] @ (one.basis[0] @ (matrix @ x)) / one.unit[0], x)


@pytest.mark.parametrize("unit", [1e-110, 1.0, 1e110])
@pytest.mark.parametrize("scale", ["pooled", "mad", "std"])
def test_covariances_follow_the_unit_however_small_or_large(unit, scale):
    rng = np.random.default_rng(5)
    design, y = rng.standard_normal((12, 2)), rng.standard_normal((4, 12))
    plain, found = (lb.irls(design, each, scale=scale) for each in (y, unit * y))
    np.testing.assert_allclose(found.cov / unit / unit, plain.cov, rtol=1e-6)
    np.testing.assert_allclose(found.x / unit, plain.x, rtol=1e-6)


@pytest.mark.parametrize(("survive", "counted"), [(0, 4.0), (3, 4.0), (4, 4.25), (6, 6.25)])
def test_an_m_scale_gives_way_to_as_many_bad_units_as_it_must_survive(survive, counted):
    """Half of ten units less two unknowns, or a quarter of a unit beyond those to be survived."""
    problem = read_problem(np.vander(np.arange(10.0), 2), np.ones((1, 10)))
    measure = MScale(problem, Units.read(None, 10), survive)
    np.testing.assert_allclose(measure._wanted, counted * _half(1).c ** 2 / 6.0, rtol=1e-12)
