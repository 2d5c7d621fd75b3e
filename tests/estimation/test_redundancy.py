"""Designs with one redundant row: one system stands for all, as the loop over each would have it."""

from dataclasses import dataclass

import numpy as np
import pytest

import losbench as lb


@dataclass(frozen=True)
class OneSided:
    """Residuals on one side alone count less."""

    def weights(self, u):
        return np.where(u > 0.5, 0.5 / np.maximum(u, 0.5), 1.0)

    def psi_deriv(self, u):
        return np.where(u > 0.5, 0.0, 1.0)


def design(n, p, rank=None):
    rng = np.random.default_rng(n)
    a = rng.standard_normal((n, p))
    if rank is not None:
        a[:, rank:] = a[:, :1] * np.arange(1, p - rank + 1)
    return a


def observed(n, count=60):
    """Of scales from 1e-3 to 1e3."""
    rng = np.random.default_rng(7)
    return 10.0 ** rng.uniform(-3, 3, (count, 1)) * rng.standard_t(2, (count, n))


def step_by_step(a, y, **choices):
    """From a start that is given, each system takes its own way."""
    start = lb.lstsq(a, y, on_fail="ignore").x
    return lb.irls(a, y, x0=start, on_fail="ignore", **choices)


@pytest.mark.parametrize("scale", ["mad", "std", "std1", "rms"])
@pytest.mark.parametrize(
    "loss",
    [lb.Huber(), lb.Huber(0.4), lb.Cauchy(), lb.Bisquare(3.0), OneSided()],
    ids=["huber", "sharp", "cauchy", "bisquare", "one-sided"],
)
@pytest.mark.parametrize("shape", [(2, 1, None), (4, 3, None), (6, 5, None), (4, 4, 3)])
def test_one_system_stands_for_all(shape, loss, scale):
    a, y = design(*shape), observed(shape[0])
    found = lb.irls(a, y, loss=loss, scale=scale, on_fail="ignore")
    expected = step_by_step(a, y, loss=loss, scale=scale)
    size = np.abs(y).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found.x / size, expected.x / size, atol=1e-8)
    # A median may shrink on and on, until one row has all that is left over, and rounding the rest.
    stands = expected.converged & (expected.scale > 1e-9 * size[:, 0])
    assert stands.all() or scale == "mad"
    assert found.converged[stands].all()
    size = size[stands]
    for name in ("residuals", "scale"):
        ours, theirs = (np.atleast_2d(getattr(fit, name)[stands].T).T for fit in (found, expected))
        np.testing.assert_allclose(ours / size, theirs / size, atol=1e-8, err_msg=name)
    np.testing.assert_allclose(found.weights[stands], expected.weights[stands], atol=1e-7)
    np.testing.assert_allclose(
        found.cov[stands] / size[..., None] ** 2,
        expected.cov[stands] / size[..., None] ** 2,
        atol=1e-6,
        rtol=1e-6,
    )


@pytest.mark.parametrize("choices", [{"leverage": True}, {"group": [0, 0, 1, 1]}])
def test_one_system_stands_for_all_with_leverage_or_pairs(choices):
    a, y = design(4, 3), observed(4)
    found, expected = lb.irls(a, y, **choices), step_by_step(a, y, **choices)
    size = np.abs(y).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found.x / size, expected.x / size, atol=1e-8)
    np.testing.assert_allclose(found.weights, expected.weights, atol=1e-7)


def test_irls_is_then_linear_and_an_outlier_weighs_what_all_do():
    a, y = design(4, 3), observed(4)
    found, added = lb.irls(a, y, scale="std"), lb.irls(a, y[:30] + y[30:], scale="std")
    assert (found.weights == found.weights[0]).all()
    assert 0.0 < found.weights.min() < 0.9
    np.testing.assert_allclose(added.x, found.x[:30] + found.x[30:], rtol=1e-9)
    assert np.abs(found.x - lb.lstsq(a, y).x).max() > 1.0


def test_with_a_known_scale_each_system_has_its_own_weights():
    a, y = design(4, 3), observed(4)
    for scale in (1.0, lambda residuals: np.full(len(residuals), 1.0), "pooled"):
        found = lb.irls(a, y, scale=scale, on_fail="ignore")
        assert len(np.unique(found.weights.min(axis=1).round(6))) > 5


def test_two_redundant_rows_and_designs_of_their_own_give_own_weights():
    y = observed(4)
    own = np.stack([design(4, 3) + 0.1 * k for k in range(60)])
    for a in (design(4, 2), own):
        assert (
            len(
                np.unique(lb.irls(a, y, scale="std", on_fail="ignore").weights.min(axis=1).round(6))
            )
            > 10
        )


def test_a_batch_is_the_loop():
    a, y = design(4, 3), observed(4)
    batch = lb.irls(a, y, scale="std")
    for k in range(0, 60, 7):
        one = lb.irls(a, y[k], scale="std")
        np.testing.assert_allclose(one.x, batch.x[k], rtol=1e-13)
        assert (one.n_iter, one.converged) == (batch.n_iter[k], batch.converged[k])


def test_what_fits_exactly_has_the_weights_of_what_rounding_leaves():
    a, y = design(4, 3), observed(4)
    y[::2] = 1e3 * (a @ np.random.default_rng(3).standard_normal((3, 30))).T
    found, expected = (fit(a, y, scale="std") for fit in (lb.irls, step_by_step))
    np.testing.assert_allclose(found.x[::2], lb.lstsq(a, y[::2]).x, rtol=1e-12)
    np.testing.assert_array_equal(found.scale[::2], expected.scale[::2])
    np.testing.assert_allclose(found.x[1::2], expected.x[1::2], rtol=1e-7)
    assert found.converged.all()
    nothing = lb.irls(a, np.zeros((3, 4)))
    assert not nothing.x.any() and (nothing.weights == 1.0).all() and nothing.converged.all()


def test_a_median_of_zero_tells_no_scale():
    """Of (c, 0, 0) left over, half is nothing."""
    a = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    y = observed(3)
    found, expected = lb.irls(a, y), step_by_step(a, y)
    np.testing.assert_array_equal(found.scale, expected.scale)
    np.testing.assert_array_equal(found.x, y[:, 1:])
    assert found.converged.all() == expected.converged.all()


@pytest.mark.parametrize(
    ("shape", "choices"),
    [((4, 3), {}), ((5, 4), {}), ((2, 1), {"scale": "std", "leverage": True})],
)
def test_what_settles_beside_a_large_model_settles(shape, choices):
    """The tolerance is one of the fitted values, too, where residuals shrink for ever."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        a = rng.standard_normal(shape)
        y = a @ np.full(shape[1], 100.0) + rng.standard_normal((20, shape[0]))
        found, expected = lb.irls(a, y, on_fail="ignore", **choices), step_by_step(a, y, **choices)
        assert (found.converged >= expected.converged).all()
        np.testing.assert_allclose(found.x, expected.x, rtol=1e-5)


def test_residuals_that_are_all_alike_have_no_scatter_and_stay_at_least_squares():
    """Adjusted for leverage, what one redundant row leaves over is alike in size; here in sign."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        normal = rng.uniform(0.5, 2.0, 4)
        a = np.linalg.svd(normal[None])[2][1:].T @ rng.standard_normal((3, 3))
        y = rng.standard_normal((5, 4))
        found = lb.irls(a, y, loss="cauchy", scale="std", leverage=True, on_fail="ignore")
        np.testing.assert_allclose(found.x, lb.lstsq(a, y).x, rtol=1e-6, atol=1e-6)


def test_steps_that_are_not_enough_are_said_of_all():
    a, y = design(4, 3), observed(4)
    with pytest.warns(RuntimeWarning, match="60 of 60 systems did not converge in 2 iterations"):
        found = lb.irls(a, y, scale="std", max_iter=2)
    assert not found.converged.any() and (found.n_iter == 2).all()
