"""Defined results where arithmetic runs out, and messages where the input cannot be meant."""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import losbench as lb

RNG = np.random.default_rng(5)
A, Y = RNG.standard_normal((8, 3)), RNG.standard_normal(8)
LOSSES = [lb.Huber(), lb.Bisquare()]
DEFICIENT = pytest.warns(RuntimeWarning, match="1 of 1 systems do not determine every unknown")
SCALES = ["mad", "std", "std1", "rms", 1.0, lambda r: np.median(np.abs(r), axis=-1)]


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("scale", SCALES)
def test_a_perfect_fit_keeps_every_row(loss, scale):
    fit = lb.irls(A, A @ [1.0, -2.0, 3.0], loss=loss, scale=scale)
    np.testing.assert_allclose(fit.x, [1.0, -2.0, 3.0], rtol=1e-13)
    np.testing.assert_allclose(fit.weights, 1.0, atol=1e-4)
    assert fit.converged
    assert np.isfinite(fit.cov).all()


@pytest.mark.parametrize("loss", LOSSES)
def test_a_perfect_majority_wins_against_gross_errors(loss):
    y = A @ [1.0, -2.0, 3.0]
    y[:2] += 1e6
    fit = lb.irls(A, y, loss=loss, max_iter=1000)
    assert fit.outliers().tolist() == [True] * 2 + [False] * 6
    assert not np.isnan(fit.weights).any()


@pytest.mark.parametrize("scale", SCALES)
def test_zero_observations_give_zero(scale):
    fit = lb.irls(A, np.zeros(8), scale=scale)
    np.testing.assert_array_equal(fit.x, 0.0)
    np.testing.assert_array_equal(fit.weights, 1.0)
    assert not fit.outliers().any()


@pytest.mark.parametrize("p", [1, 2, 3, 5])
def test_as_many_rows_as_unknowns_is_an_equation(p):
    a, x = np.random.default_rng(p).standard_normal((p, p)), np.arange(1.0, p + 1)
    for fit in (lb.lstsq(a, a @ x), lb.irls(a, a @ x), lb.irls(a, a @ x, scale="std1")):
        np.testing.assert_allclose(fit.x, x, rtol=1e-9)
        np.testing.assert_array_equal(fit.weights, 1.0)
        assert fit.dof == 0
        assert np.isnan(fit.cov).all()
    known = lb.irls(a, a @ x, scale=0.1)
    np.testing.assert_allclose(known.cov, 0.01 * np.linalg.inv(a.T @ a), rtol=1e-7)


@pytest.mark.parametrize("p", [2, 3, 5])
def test_short_rank_is_reported_and_solved_with_the_smallest_unknowns(p):
    rng = np.random.default_rng(p)
    column = rng.standard_normal((9, 1))
    a = np.concatenate([np.repeat(column, p - 1, axis=1), np.ones((9, 1))], axis=1)
    y = rng.standard_t(2, 9)
    with DEFICIENT if p > 2 else nullcontext():
        fit = lb.lstsq(a, y)
    np.testing.assert_allclose(fit.x, np.linalg.pinv(a) @ y, atol=1e-12)
    with DEFICIENT if p > 2 else nullcontext():
        robust = lb.irls(a, y)
    slim = lb.irls(a[:, -2:], y)
    assert fit.rank == robust.rank == slim.rank == 2
    assert fit.dof == robust.dof == 7
    np.testing.assert_allclose(robust.x[: p - 1], slim.x[0] / (p - 1), atol=1e-8)
    np.testing.assert_allclose(robust.residuals, slim.residuals, atol=1e-8)
    for each in (fit, robust):
        assert np.isnan(each.std_error[: p - 1]).all() == (p > 2)
    np.testing.assert_allclose(robust.std_error[-1], slim.std_error[-1], rtol=1e-6)


def test_a_column_of_zeros_has_no_say():
    with DEFICIENT:
        fit = lb.irls(np.column_stack([A[:, :2], np.zeros(8)]), Y)
    assert fit.rank == 2
    np.testing.assert_array_equal(np.isnan(fit.std_error), [False, False, True])
    assert fit.x[2] == 0.0
    np.testing.assert_allclose(fit.x[:2], lb.irls(A[:, :2], Y).x, atol=1e-9)


FITS = {
    "lstsq": lb.lstsq,
    "lstsq, known": lambda A, y, **how: lb.lstsq(A, y, scale=0.3, **how),
    "irls": lb.irls,
    "irls, known": lambda A, y, **how: lb.irls(A, y, scale=0.3, **how),
    "irls, pooled": lambda A, y, **how: lb.irls(A, y, scale="pooled", **how),
    "irls, bisquare": lambda A, y, **how: lb.irls(A, y, loss="bisquare", max_iter=500, **how),
    "lts": lb.lts,
    "lts, known": lambda A, y, **how: lb.lts(A, y, scale=0.3, **how),
    "mm": lb.mm,
    "mm, known": lambda A, y, **how: lb.mm(A, y, scale=0.3, **how),
}


@pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
def test_what_a_design_leaves_open_has_no_error_and_the_rest_keeps_its_own(fit):
    t = np.linspace(-1.0, 1.0, 10)
    ones = np.ones(10)
    y = np.random.default_rng(2).standard_normal(10)
    cases = {
        (True, True): ([ones, ones], None),
        (True, False, True): ([t, ones, 3.0 * t], [ones, t]),
        (False, True, True): ([ones, t, -1e7 * t], [ones, t]),
        (True, True, True): ([ones, t, ones + t], None),
        (True, False, False): ([0.0 * t, ones, t], [ones, t]),
        (True, True, False, True): ([t**2, ones, t, 2.0 - t**2], [ones, t, t**2]),
    }
    for lost, (columns, slim) in cases.items():
        with DEFICIENT as told:
            found = fit(np.stack(columns, axis=1), y)
        assert len(told) == 1
        assert tuple(np.isnan(found.std_error).tolist()) == lost
        assert np.isfinite(found.x).all()
        if slim is not None:
            other = fit(np.stack(slim, axis=1), y)
            kept = [k for k, gone in enumerate(lost) if not gone]
            same = [j for j, each in enumerate(slim) if any(each is columns[k] for k in kept)]
            np.testing.assert_allclose(found.std_error[kept], other.std_error[same], rtol=1e-5)
        np.testing.assert_array_equal(
            np.isnan(fit(np.stack(columns, axis=1), y, on_fail="ignore").std_error), lost
        )
        with pytest.raises(RuntimeError, match="do not determine every unknown"):
            fit(np.stack(columns, axis=1), y, on_fail="raise")


@pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
def test_deficient_systems_of_a_batch_are_counted_and_leave_the_others_alone(fit):
    rng = np.random.default_rng(7)
    a, y = rng.standard_normal((5, 12, 3)), rng.standard_normal((5, 12))
    whole = fit(a, y)
    a[1, :, 2] = a[1, :, 0]
    a[3] = 0.0
    message = "2 of 5 systems do not determine every unknown; errors of what they leave open are"
    with pytest.warns(RuntimeWarning, match=message) as told:
        part = fit(a, y)
    assert len(told) == 1
    np.testing.assert_array_equal(
        np.isnan(part.std_error),
        [[False] * 3, [True, False, True], [False] * 3, [True] * 3, [False] * 3],
    )
    if whole.scale_method != "pooled":
        np.testing.assert_allclose(part.cov[::2], whole.cov[::2], rtol=1e-6)


def test_an_unknown_that_hangs_on_rejected_rows_has_no_error():
    a = np.column_stack([np.ones(12), np.arange(12) == 0])
    y = np.random.default_rng(4).standard_normal(12)
    y[0] = 40.0
    for scale in (1.0, "mad"):
        fit = lb.irls(a, y, loss="bisquare", scale=scale, x0=[0.0, 0.0], max_iter=500)
        assert fit.weights[0] == 0
        np.testing.assert_array_equal(np.isnan(fit.std_error), [False, True])
        kept = lb.irls(a, y, scale=scale)
        assert np.isfinite(kept.std_error).all()


def test_a_time_in_nanoseconds_hides_the_slope_and_says_so():
    t = 1.7e18 + 1e3 * np.arange(24.0)
    with DEFICIENT:
        fit = lb.irls(np.stack([t, np.ones_like(t)], axis=1), 0.5 * (t - t[0]))
    assert np.isnan(fit.std_error).all()


@given(exponent=st.integers(1, 12))
def test_close_to_deficient_errors_are_large_before_they_are_not_given(exponent):
    t = np.linspace(0.0, 1.0, 30)
    third = t + 10.0**-exponent * t**2
    fit = lb.lstsq(np.stack([np.ones(30), t, third], axis=1), t + np.sin(50.0 * t))
    assert fit.rank == 3
    assert fit.std_error[1] > 0.5 * 10.0**exponent


def test_nearly_parallel_columns_are_still_solved():
    base = np.linspace(0.0, 1.0, 20)
    a = np.column_stack([np.ones(20), base, base + 1e-7 * base**2])
    np.testing.assert_allclose(lb.lstsq(a, a @ [1.0, 2.0, 3.0]).x, [1.0, 2.0, 3.0], rtol=1e-6)
    np.testing.assert_allclose(lb.irls(a, a @ [1.0, 2.0, 3.0]).x, [1.0, 2.0, 3.0], rtol=1e-6)


def test_a_start_that_rejects_every_row_is_not_called_converged():
    fit = lb.irls(A, Y, loss=lb.Bisquare(), scale=1e-3, x0=[1e3, 1e3, 1e3], on_fail="ignore")
    assert not fit.converged
    np.testing.assert_array_equal(fit.weights, 0.0)
    np.testing.assert_allclose(fit.x, 1e3)


@settings(deadline=None, max_examples=200)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 7),
    p=st.integers(1, 5),
    size=st.integers(-300, 290),
    kind=st.sampled_from(["ties", "zeros", "normal", "outliers", "equal rows"]),
    scale=st.sampled_from(["mad", "std", "rms"]),
    loss=st.sampled_from(LOSSES),
)
def test_weights_and_unknowns_are_always_numbers(seed, n, p, size, kind, scale, loss):
    n = max(n, p)
    rng = np.random.default_rng(seed)
    a = rng.integers(-2, 3, (n, p)).astype(float)
    y = {
        "ties": rng.integers(-1, 2, n).astype(float),
        "zeros": np.zeros(n),
        "normal": rng.standard_normal(n),
        "outliers": np.where(np.arange(n) > 0, 1e9 * rng.standard_normal(n), 1.0),
        "equal rows": np.ones(n),
    }[kind]
    if kind == "equal rows":
        a[:] = a[0]
    fit = lb.irls(a, y * 10.0**size, loss=loss, scale=scale, max_iter=50, on_fail="ignore")
    assert np.isfinite(fit.x).all()
    assert ((fit.weights >= 0.0) & (fit.weights <= 1.0)).all()
    assert np.isfinite(fit.residuals).all()
    assert fit.scale >= 0.0


BAD = [
    ({"A": A[:2]}, r"y must have shape \(\.\.\., 2\) to match the 2 rows of A, got \(8,\)"),
    (
        {"A": A[:2], "y": Y[:2]},
        r"A must have at least as many rows as columns, got 2 rows and 3 columns",
    ),
    ({"A": A[0]}, r"A must have shape \(\.\.\., n, p\), got \(3,\)"),
    ({"A": np.zeros((0, 3))}, r"A must hold at least one sample, got shape \(0, 3\)"),
    ({"A": np.where(A > 1, np.nan, A)}, r"A must be finite, got \d+ NaN or infinite of 24 values"),
    ({"y": np.full(8, np.nan)}, r"y must be finite, got 8 NaN or infinite of 8 values"),
    ({"y": np.float64(3.0)}, r"y must have shape \(\.\.\., 8\) to match the 8 rows of A, got \(\)"),
    (
        {"A": np.zeros((4, 8, 3)), "y": np.zeros((5, 8))},
        r"A and y must share their batch axes, got \(4, 8, 3\) and \(5, 8\)",
    ),
    (
        {"A": 1e-200 * A, "y": 1e200 * Y},
        r"y must not exceed A by a factor of 1e308 or more: the unknowns would be infinite",
    ),
    ({"scale": "iqr"}, r"scale must be one of 'std', 'std1', 'rms', 'mad', 'pooled', got 'iqr'"),
    ({"scale": 0.0}, r"scale must be positive, got 0"),
    ({"scale": [1.0, 2.0]}, r"scale must broadcast to the batch \(\), got shape \(2,\)"),
    (
        {"scale": np.median},
        r"scale must turn residuals .* into one non-negative number for each system",
    ),
    ({"scale": lambda r: np.full(len(r), np.nan)}, r"scale must turn residuals .*"),
    ({"loss": lb.Huber}, r"loss must be an object, Huber\(\.\.\.\), got the class Huber itself"),
    ({"loss": 3.0}, r"loss must have a method weights\(u\), got 3\.0"),
    ({"group": [1, 2]}, r"group must have shape \(8,\) to match the 8 rows of A, got \(2,\)"),
    ({"x0": [1.0, 2.0]}, r"x0 must broadcast to \(3,\), got \(2,\)"),
    ({"x0": [1.0, 2.0, np.inf]}, r"x0 must be finite, got 1 NaN or infinite of 3 values"),
    ({"max_iter": 0}, r"max_iter must be a whole number of at least 1, got 0"),
    ({"tol": -1.0}, r"tol must be a finite number of at least 0, got -1"),
    ({"on_fail": "shrug"}, r"on_fail must be one of 'warn', 'raise', 'ignore', got 'shrug'"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_input_is_refused_by_name(change, message):
    arguments = {"A": A, "y": Y} | change
    with pytest.raises(ValueError, match=message):
        lb.irls(**arguments)
    if set(change) <= {"A", "y"}:
        with pytest.raises(ValueError, match=message):
            lb.lstsq(**arguments)


def test_failure_to_converge_is_said_once_and_the_last_iterate_kept():
    y = np.random.default_rng(1).standard_t(2, (6, 8))
    with pytest.warns(
        RuntimeWarning,
        match=r"irls: 6 of 6 systems did not converge in 2 iterations; .* \.converged",
    ):
        fit = lb.irls(A, y, scale="std", max_iter=2, tol=0.0)
    assert not fit.converged.any()
    assert (fit.n_iter == 2).all()
    assert "NOT CONVERGED in 2 iterations" in repr(
        lb.irls(A, y[0], scale="std", max_iter=2, tol=0.0, on_fail="ignore")
    )
    with pytest.raises(RuntimeError, match="6 of 6 systems did not converge in 2 iterations"):
        lb.irls(A, y, scale="std", max_iter=2, tol=0.0, on_fail="raise")


class Ratio:
    def weights(self, u):
        return np.tanh(u) / u


class Flat:
    def weights(self, u):
        return np.ones(u.size)


def test_a_loss_must_weigh_a_perfect_residual_and_any_shape():
    from statsmodels.robust import norms

    with pytest.raises(
        ValueError,
        match=r"loss must give each u a finite weight, u = 0 of a perfect fit too, got .*nan",
    ):
        lb.irls(A, A @ [1.0, -2.0, 3.0], loss=Ratio())
    with pytest.raises(
        ValueError, match=r"loss must give each u a finite weight, .* for zeros of shape \(2, 3\)"
    ):
        lb.irls(A, Y, loss=Flat())
    with pytest.raises(
        ValueError,
        match=r"loss must have weights\(u\) for arrays u of any shape, those of .*MQuantile",
    ):
        lb.irls(A, Y, loss=norms.MQuantileNorm(0.5, norms.HuberT()))


def test_a_start_must_be_a_number_of_scales_away():
    with pytest.raises(ValueError, match=r"A x0 must be finite, got 8 NaN or infinite of 8 values"):
        lb.irls(1e200 * np.ones((8, 1)), Y, x0=[1e200])
