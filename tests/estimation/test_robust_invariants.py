"""What every regression estimator owes: equivariance, and a batch that is the loop."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import losbench as lb
from losbench.estimation.robust import iterate

FITS = {
    "least squares": lb.lstsq,
    "Huber mad": lambda a, y: lb.irls(a, y, on_fail="ignore"),
    "Huber std": lambda a, y: lb.irls(a, y, scale="std", on_fail="ignore"),
    "Huber pairs": lambda a, y: lb.irls(
        a, y, scale="rms", group=np.arange(12) // 2, on_fail="ignore"
    ),
    "bisquare": lambda a, y: lb.irls(a, y, loss=lb.Bisquare(), on_fail="ignore"),
}
every_fit = pytest.mark.parametrize("name", FITS)
seeds = st.integers(0, 2**32 - 1)


def system(seed, batch=()):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((*batch, 12, 3)), rng.standard_t(3, (*batch, 12)), rng


def settled(*fits):
    """Whether all fits settled; one that cycles has no answer to compare."""
    return all(bool(fit.converged) for fit in fits)


@every_fit
@settings(deadline=None, max_examples=25)
@given(seed=seeds)
def test_adding_a_model_moves_the_unknowns_by_it(name, seed):
    a, y, rng = system(seed)
    shift = rng.uniform(-5, 5, 3)
    plain, moved = FITS[name](a, y), FITS[name](a, y + a @ shift)
    if settled(plain, moved):
        np.testing.assert_allclose(moved.x, plain.x + shift, atol=1e-6)
        np.testing.assert_allclose(moved.weights, plain.weights, atol=1e-6)


@every_fit
@settings(deadline=None, max_examples=25)
@given(seed=seeds, exponent=st.integers(-290, 290))
def test_units_of_y_do_not_matter(name, seed, exponent):
    a, y, _ = system(seed)
    unit = 10.0**exponent
    plain, scaled = FITS[name](a, y), FITS[name](a, y * unit)
    np.testing.assert_allclose(scaled.x / unit, plain.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.weights, plain.weights, atol=1e-9)
    assert scaled.scale / unit == pytest.approx(float(plain.scale), rel=1e-9)


@every_fit
@settings(deadline=None, max_examples=25)
@given(seed=seeds)
def test_a_change_of_unknowns_changes_only_the_unknowns(name, seed):
    a, y, rng = system(seed)
    mix = np.linalg.qr(rng.standard_normal((3, 3)))[0] * 10.0 ** rng.uniform(-4, 4, 3)
    plain, mixed = FITS[name](a, y), FITS[name](a @ mix, y)
    if settled(plain, mixed):
        np.testing.assert_allclose(mix @ mixed.x, plain.x, atol=1e-6)
        np.testing.assert_allclose(mixed.leverage, plain.leverage, atol=1e-9)
        np.testing.assert_allclose(mix @ mixed.cov @ mix.T, plain.cov, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize("name", [*FITS, "started", "LTS", "MM"])
@pytest.mark.parametrize("p", [2, 4])
@settings(deadline=None, max_examples=15)
@given(seed=seeds)
def test_units_of_the_unknowns_do_not_matter(name, p, seed):
    fit = {
        "started": lambda a, y: lb.irls(
            a, y, loss=lb.Bisquare(), x0=lb.lstsq(a, y).x, max_iter=1000, on_fail="ignore"
        ),
        "LTS": lb.lts,
        "MM": lambda a, y: lb.mm(a, y, on_fail="ignore"),
        **FITS,
    }[name]
    rng = np.random.default_rng(seed)
    a, y, unit = (
        rng.standard_normal((12, p)),
        rng.standard_t(3, 12),
        10.0 ** rng.uniform(-60, 60, p),
    )
    plain, scaled = fit(a, y), fit(a * unit, y)
    if settled(plain, scaled):
        np.testing.assert_allclose(scaled.x * unit, plain.x, atol=1e-6)
        np.testing.assert_allclose(scaled.weights, plain.weights, atol=1e-5)


@every_fit
@settings(deadline=None, max_examples=25)
@given(seed=seeds)
def test_the_order_of_rows_does_not_matter(name, seed):
    a, y, rng = system(seed)
    order = (2 * rng.permutation(6)[:, None] + [0, 1]).ravel()  # pairs stay together
    plain, shuffled = FITS[name](a, y), FITS[name](a[order], y[order])
    if settled(plain, shuffled):
        np.testing.assert_allclose(shuffled.x, plain.x, atol=1e-7)
        np.testing.assert_allclose(shuffled.weights, plain.weights[order], atol=1e-6)


@every_fit
@pytest.mark.parametrize("shared", [True, False])
def test_a_batch_is_the_loop(name, shared):
    a, y, _ = system(7, (3, 5))
    a = a[0, 0] if shared else a
    batch = FITS[name](a, y)
    for i in np.ndindex(3, 5):
        one = FITS[name](a if shared else a[i], y[i])
        assert np.array_equal(batch.converged[i], one.converged)
        for field in ("x", "residuals", "weights", "scale", "cov", "leverage"):
            np.testing.assert_allclose(
                getattr(batch, field)[i], getattr(one, field), atol=1e-9, err_msg=field
            )
        assert (batch.dof[i], batch.rank[i]) == (one.dof, one.rank)


def test_a_batch_larger_than_the_pool_is_the_loop():
    rng = np.random.default_rng(11)
    a = rng.standard_normal((900, 200, 2))
    y = rng.standard_t(2, (900, 200))
    batch = lb.irls(a, y, scale=np.linspace(0.5, 2.0, 900))
    for i in (0, 163, 164, 450, 899):
        one = lb.irls(a[i], y[i], scale=0.5 + 1.5 * i / 899)
        np.testing.assert_allclose(batch.x[i], one.x, atol=1e-10)
        assert batch.n_iter[i] == one.n_iter


def test_batch_axes_broadcast():
    a, y, _ = system(5, (4, 1))
    many = lb.irls(a, np.broadcast_to(y[0], (4, 2, 12)))
    assert many.x.shape == (4, 2, 3)
    np.testing.assert_allclose(many.x[2, 1], lb.irls(a[2, 0], y[0, 0]).x, atol=1e-10)


@every_fit
def test_a_design_that_was_met_before_is_the_same_and_one_that_was_changed_is_another(name):
    a, y, rng = system(3, (4,))
    a, before = a[0].copy(), FITS[name](a[0], y)
    for _ in range(10):  # as many as push out what is kept
        FITS[name](rng.standard_normal((12, 3)), y)
    for again in (FITS[name](a, y), FITS[name](a, y), FITS[name](np.asfortranarray(a), y)):
        for field in ("x", "weights", "scale", "cov", "leverage", "rank"):
            np.testing.assert_array_equal(getattr(again, field), getattr(before, field))
    a[0] *= 2.0
    other = FITS[name](a, y)
    np.testing.assert_allclose(other.residuals, other.x @ a.T - y, atol=1e-12)
    assert not np.allclose(other.leverage, before.leverage, atol=1e-3)


def test_residuals_are_those_of_the_unknowns():
    a, y, _ = system(9, (6,))
    for fit in (lb.lstsq(a, y), lb.irls(a, y)):
        np.testing.assert_allclose(fit.residuals, np.matvec(a, fit.x) - y, atol=1e-13)


@pytest.mark.parametrize("scale", ["std", "mad", 1.0])
@pytest.mark.parametrize("loss", [lb.Huber(), lb.Bisquare()])
@pytest.mark.parametrize(("n", "p"), [(6, 1), (12, 3), (20, 5)])
def test_corrected_steps_settle_where_plain_ones_do_and_sooner(loss, scale, n, p, monkeypatch):
    rng = np.random.default_rng(n)
    a, y = rng.standard_normal((300, n, p)), rng.standard_t(2, (300, n))
    quick = lb.irls(a, y, loss=loss, scale=scale, max_iter=2000, tol=1e-12, on_fail="ignore")
    monkeypatch.setattr(iterate, "_NEAR", 0.0)
    plain = lb.irls(a, y, loss=loss, scale=scale, max_iter=2000, tol=1e-12, on_fail="ignore")
    both = quick.converged & plain.converged
    assert np.count_nonzero(~quick.converged) <= np.count_nonzero(~plain.converged) <= 3
    np.testing.assert_allclose(quick.x[both], plain.x[both], rtol=0, atol=1e-8)
    assert quick.n_iter.mean() < 0.8 * plain.n_iter.mean()


@every_fit
def test_what_is_computed_on_demand_does_not_depend_on_when(name):
    a, y, _ = system(13, (4,))
    at_once, later = FITS[name](a, y), FITS[name](a, y)
    cov, leverage = at_once.cov, at_once.leverage
    copied = pickle.loads(pickle.dumps(FITS[name](a, y)))
    a[:] = y[:] = later.residuals[:] = later.scale[:] = later.x[:] = np.nan
    for fit in (later, copied, replace(copied, loss="another name")):
        np.testing.assert_array_equal(fit.cov, cov)
        np.testing.assert_array_equal(fit.leverage, leverage)
        assert fit.cov is fit.cov
