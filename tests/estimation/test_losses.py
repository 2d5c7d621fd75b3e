"""Losses against their definitions, statsmodels' norms and the efficiency they promise."""

import numpy as np
import pytest

import losbench as lb
from losbench.estimation.losses import psi_deriv

LOSSES = [
    lb.Huber(),
    lb.Huber(0.7),
    lb.Bisquare(),
    lb.Bisquare(3.0),
    lb.Cauchy(),
    lb.Cauchy(1.1),
    lb.Welsch(),
]
LOSSES += [lb.Welsch(0.9), lb.Hampel(), lb.Hampel(1.1, 1.1, 3.0)]
U = np.array([-30.0, -4.0, -1.2, -0.3, 0.0, 0.5, 1.0, 2.2, 7.0])


@pytest.mark.parametrize("loss", LOSSES)
def test_psi_is_the_slope_of_rho_and_weight_is_psi_over_u(loss):
    step = 1e-6
    np.testing.assert_allclose(
        (loss.rho(U + step) - loss.rho(U - step)) / (2 * step), loss.psi(U), atol=1e-8
    )
    np.testing.assert_allclose(
        (loss.psi(U + step) - loss.psi(U - step)) / (2 * step), loss.psi_deriv(U), atol=1e-8
    )
    np.testing.assert_allclose(loss.weights(U) * U, loss.psi(U), atol=1e-15)
    assert loss.weights(np.zeros(1))[0] == 1.0
    assert np.isfinite(loss.weights(np.array([1e300, -np.inf]))).all()


@pytest.mark.parametrize(
    ("ours", "theirs", "constants"),
    [
        (lb.Huber(1.2), "HuberT", (1.2,)),
        (lb.Bisquare(4.0), "TukeyBiweight", (4.0,)),
        (lb.Hampel(1.5, 3.5, 8.0), "Hampel", (1.5, 3.5, 8.0)),
    ],
)
def test_losses_agree_with_statsmodels(ours, theirs, constants):
    from statsmodels.robust import norms

    peer = getattr(norms, theirs)(*constants)
    for name in ("rho", "psi", "weights", "psi_deriv"):
        np.testing.assert_allclose(
            getattr(ours, name)(U), getattr(peer, name)(U), rtol=1e-12, atol=1e-14
        )


def test_cauchy_is_students_t_with_one_degree_of_freedom():
    from scipy.stats import cauchy, t

    log_density = t(1).logpdf(U / 2.0)
    np.testing.assert_allclose(log_density, cauchy.logpdf(U / 2.0), rtol=1e-12)
    np.testing.assert_allclose(
        lb.Cauchy(2.0).rho(U), 2.0 * (t(1).logpdf(0.0) - log_density), atol=1e-12
    )


@pytest.mark.parametrize("loss", LOSSES)
def test_what_lies_far_out_is_never_nan(loss):
    far = np.array([-1.0, 1.0]) * np.geomspace(1.0, 1e300, 400)[:, None]
    for name in ("rho", "psi", "weights", "psi_deriv"):
        assert np.isfinite(getattr(loss, name)(far)).all(), name


def test_a_loss_without_a_slope_gets_one_by_differences():
    class Weights:
        def weights(self, u):
            return lb.Bisquare().weights(u)

    np.testing.assert_allclose(psi_deriv(Weights(), U), lb.Bisquare().psi_deriv(U), atol=1e-8)

    class Slow:
        def weights(self, u):
            return lb.Cauchy().weights(u)

    far = np.array([-1e9, 1e6])
    np.testing.assert_allclose(psi_deriv(Slow(), far), lb.Cauchy().psi_deriv(far), rtol=1e-3)


@pytest.mark.parametrize("bad", [0, -1.0, np.nan, "wide"])
@pytest.mark.parametrize("kind", [lb.Huber, lb.Bisquare, lb.Cauchy, lb.Welsch])
def test_a_constant_must_be_positive(kind, bad):
    with pytest.raises(ValueError, match=r"c must be (positive|a number|a finite number)"):
        kind(bad)


def test_the_corners_of_hampel_must_rise():
    with pytest.raises(ValueError, match="a must be positive, got 0"):
        lb.Hampel(0.0, 1.0, 2.0)
    with pytest.raises(ValueError, match="a, b, c must rise, a <= b < c, got 1, 3, 3"):
        lb.Hampel(1.0, 3.0, 3.0)


def test_the_corners_of_hampel_are_in_the_ratio_of_its_book():
    loss = lb.Hampel()
    np.testing.assert_allclose(np.array([loss.a, loss.b, loss.c]) / loss.a, [1, 3.5 / 1.5, 8 / 1.5])
