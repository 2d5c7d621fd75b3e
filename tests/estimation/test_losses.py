"""Losses against their definitions, statsmodels' norms and the efficiency they promise."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

import losbench as lb
from losbench.estimation.losses import psi_deriv

LOSSES = [lb.Huber(), lb.Huber(0.7), lb.Bisquare(), lb.Bisquare(3.0)]
U = np.array([-30.0, -4.0, -1.2, -0.3, 0.0, 0.5, 1.0, 2.2, 7.0])


@pytest.mark.parametrize("loss", LOSSES)
def test_psi_is_the_slope_of_rho_and_weight_is_psi_over_u(loss):
    step = 1e-6
    np.testing.assert_allclose((loss.rho(U + step) - loss.rho(U - step)) / (2 * step), loss.psi(U), atol=1e-8)
    np.testing.assert_allclose((loss.psi(U + step) - loss.psi(U - step)) / (2 * step), loss.psi_deriv(U), atol=1e-8)
    np.testing.assert_allclose(loss.weights(U) * U, loss.psi(U), atol=1e-15)
    assert loss.weights(np.zeros(1))[0] == 1.0
    assert np.isfinite(loss.weights(np.array([1e300, -np.inf]))).all()


@pytest.mark.parametrize(("ours", "theirs"), [(lb.Huber(1.2), "HuberT"), (lb.Bisquare(4.0), "TukeyBiweight")])
def test_losses_agree_with_statsmodels(ours, theirs):
    from statsmodels.robust import norms

    peer = getattr(norms, theirs)(ours.c)
    for name in ("rho", "psi", "weights", "psi_deriv"):
        np.testing.assert_allclose(getattr(ours, name)(U), getattr(peer, name)(U), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("loss", "percent"), [(lb.Huber(1.345), 95.0), (lb.Huber(1.5), 96.4), (lb.Huber(1.0), 90.3), (lb.Bisquare(), 95.0)]
)
def test_tuning_constants_keep_the_efficiency_they_promise(loss, percent):
    def mean(f):
        edges = [-9.0, -loss.c, loss.c, 9.0]
        return sum(quad(lambda u: float(f(np.array(u))) * norm.pdf(u), a, b)[0] for a, b in pairwise(edges))

    efficiency = mean(loss.psi_deriv) ** 2 / mean(lambda u: loss.psi(u) ** 2)
    assert 100 * efficiency == pytest.approx(percent, abs=0.05)


def test_a_loss_without_a_slope_gets_one_by_differences():
    class Weights:
        def weights(self, u):
            return lb.Bisquare().weights(u)

    np.testing.assert_allclose(psi_deriv(Weights(), U), lb.Bisquare().psi_deriv(U), atol=1e-8)


@pytest.mark.parametrize("bad", [0, -1.0, np.nan, "wide"])
@pytest.mark.parametrize("kind", [lb.Huber, lb.Bisquare])
def test_a_constant_must_be_positive(kind, bad):
    with pytest.raises(ValueError, match=r"c must be (positive|a number|a finite number)"):
        kind(bad)
