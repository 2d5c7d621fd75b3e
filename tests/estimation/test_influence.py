"""Efficiency, influence and sensitivity against closed forms, printed tables and simulation."""

import numpy as np
import pytest
from scipy.stats import norm

import losbench as lb
from losbench.estimation.influence import normal_mean

AT_95 = [lb.Huber(1.345), lb.Bisquare(4.685), lb.Cauchy(2.385), lb.Welsch(2.985), lb.Hampel()]


def huber_efficiency(c):
    """Closed form: (2 Phi(c) - 1)^2 / E psi^2."""
    inside = 2 * norm.cdf(c) - 1
    return inside**2 / (inside - 2 * c * norm.pdf(c) + 2 * c**2 * norm.sf(c))


@pytest.mark.parametrize("c", [0.23, 1.0, 1.345, 1.5, 3.0])
def test_hubers_efficiency_is_the_closed_form(c):
    assert lb.efficiency(lb.Huber(c)) == pytest.approx(huber_efficiency(c), abs=1e-12)


@pytest.mark.parametrize(
    ("loss", "percent"), [(lb.Huber(1.345), 95.0), (lb.Huber(1.5), 96.4), (lb.Huber(1.0), 90.3)]
)
def test_hubers_efficiency_is_the_printed_one(loss, percent):
    assert 100 * lb.efficiency(loss) == pytest.approx(percent, abs=0.05)


@pytest.mark.parametrize("loss", AT_95, ids=lambda loss: type(loss).__name__)
def test_the_default_constants_are_those_of_95_percent(loss):
    assert lb.efficiency(loss) == pytest.approx(0.95, abs=5e-5)
    again = lb.tuned(loss, 0.95)
    np.testing.assert_allclose(list(vars(again).values()), list(vars(loss).values()), rtol=1e-3)
    assert lb.efficiency(lb.tuned(loss, 0.85)) == pytest.approx(0.85, abs=1e-9)


@pytest.mark.parametrize("loss", AT_95, ids=lambda loss: type(loss).__name__)
def test_the_efficiency_shows_in_simulation(loss):
    """20 000 samples of 200 with a MAD scale; the mean of the same samples serves as control
    variate.
    """
    y = np.random.default_rng(7).standard_normal((20_000, 200))
    centre = lb.irls(np.ones((200, 1)), y, loss=loss, scale="mad", max_iter=300, tol=1e-7).x[:, 0]
    assert y.mean(axis=1).var() / centre.var() == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize(
    "loss", [lb.Huber(), lb.tuned(lb.Bisquare(), rows=2)], ids=["Huber", "Bisquare"]
)
def test_the_efficiency_of_pairs_with_one_weight_shows_in_simulation(loss):
    pairs = np.repeat(np.arange(60), 2)
    design = np.tile(np.eye(2), (60, 1))
    y = np.random.default_rng(8).standard_normal((8000, 120))
    ratio = (
        lb.lstsq(design, y).x.var() / lb.irls(design, y, loss=loss, scale=1.0, group=pairs).x.var()
    )
    assert ratio == pytest.approx(lb.efficiency(loss, rows=2), abs=0.01)


def test_moments_of_normal_errors():
    assert normal_mean(lambda u: u**4) == pytest.approx(3.0, abs=1e-12)
    for rows in (1, 2, 3, 8):
        assert normal_mean(np.ones_like, rows=rows) == pytest.approx(1.0, abs=1e-12)
        assert normal_mean(lambda u: u**2, rows=rows) == pytest.approx(1.0, abs=1e-12)
        assert normal_mean(lambda u: u**4, rows=rows) == pytest.approx(1.0 + 2.0 / rows, abs=1e-12)


def test_a_foreign_norm_has_an_efficiency_too():
    from statsmodels.robust import norms

    assert lb.efficiency(norms.HuberT(1.345)) == pytest.approx(0.95, abs=1e-4)

    class Unhashable:
        __hash__ = None

        def weights(self, u):
            return lb.Huber().weights(u)

    assert lb.efficiency(Unhashable()) == pytest.approx(0.95, abs=1e-4)
    with pytest.raises(
        ValueError, match="loss must be a dataclass whose fields are its constants, got"
    ):
        lb.tuned(Unhashable())


def test_an_efficiency_out_of_reach_is_refused():
    with pytest.raises(
        ValueError,
        match=r"efficiency must be within what Huber can have, 0\.6.* to 1\.0.*, got 0\.5",
    ):
        lb.tuned(lb.Huber(), 0.5)
    with pytest.raises(ValueError, match="efficiency must be a finite number from 0 to 1, got 1.2"):
        lb.tuned(lb.Huber(), 1.2)


def test_an_efficiency_is_95_percent_unless_said():
    assert lb.tuned(lb.Bisquare(3.0)) == lb.tuned(lb.Bisquare(3.0), 0.95, rows=1)


def test_the_influence_function_is_the_limit_of_sensitivity_curves():
    quantiles = norm.ppf((np.arange(4000) + 0.5) / 4000)
    at = np.array([-8.0, -2.0, -0.5, 0.0, 1.0, 3.0, 20.0])
    for loss in AT_95:

        def centre(y, loss=loss):
            return lb.irls(
                np.ones((y.shape[-1], 1)), y, loss=loss, scale=1.0, tol=1e-13, max_iter=500
            ).x[..., 0]

        found = lb.sensitivity_curve(centre, quantiles, at)
        np.testing.assert_allclose(found, lb.influence_function(loss, at), atol=4e-3)


def test_the_median_has_a_step_and_the_mean_no_bound():
    quantiles = norm.ppf((np.arange(999) + 0.5) / 999)
    median = lb.sensitivity_curve(lambda y: np.median(y, axis=-1), quantiles, [-9.0, 9.0, 1e9])
    np.testing.assert_allclose(np.abs(median), np.sqrt(np.pi / 2), rtol=0.01)
    mean = lb.sensitivity_curve(lambda y: y.mean(axis=-1), quantiles, [-9.0, 9.0, 1e9])
    np.testing.assert_allclose(mean, [-9.0, 9.0, 1e9], rtol=1e-9)


def test_a_sensitivity_curve_asks_for_one_number_for_each_sample():
    message = (
        r"estimate must work along axis=-1 and return one number for each sample, shape \(3,\) for "
        r"samples \(3, 5\)"
    )
    for estimate in (np.median, lambda y: np.median(y, axis=0), lambda y: y):
        with pytest.raises(ValueError, match=message):
            lb.sensitivity_curve(estimate, [1.0, 2.0, 4.0, 7.0], [-6.0, 0.0, 60.0])
    with pytest.raises(ValueError, match="estimate must work along axis=-1"):
        lb.sensitivity_curve(lambda y: np.median(y, axis=0), [1.0, 2.0, 4.0, 7.0], np.arange(5.0))


def test_a_sensitivity_curve_is_the_change_that_one_more_observation_makes():
    found = lb.sensitivity_curve(lambda y: y.mean(axis=-1), [4.0, 6.0, 11.0], [19.0])
    np.testing.assert_allclose(found, [4 * (10.0 - 7.0)], rtol=1e-12)


def test_gross_error_sensitivities():
    c = 1.345
    assert lb.gross_error_sensitivity(lb.Huber(c)) == pytest.approx(
        c / (2 * norm.cdf(c) - 1), rel=1e-9
    )
    small = lb.gross_error_sensitivity(lb.Huber(1e-3))
    assert small == pytest.approx(np.sqrt(np.pi / 2), rel=1e-3)
    for loss in AT_95:
        u = np.linspace(0, 30, 3001)
        assert lb.gross_error_sensitivity(loss) == pytest.approx(
            lb.influence_function(loss, u).max(), rel=1e-4
        )

    class Squares:
        def weights(self, u):
            return np.ones_like(u)

    assert lb.gross_error_sensitivity(Squares()) == np.inf


def test_a_loss_may_be_given_by_its_name():
    assert lb.efficiency("cauchy") == lb.efficiency(lb.Cauchy())
    assert lb.tuned("bisquare", 0.9) == lb.tuned(lb.Bisquare(), 0.9)
    assert lb.gross_error_sensitivity("huber") == lb.gross_error_sensitivity(lb.Huber())
    errors = [-3.0, 0.5, 2.0]
    np.testing.assert_array_equal(
        lb.influence_function("welsch", errors), lb.influence_function(lb.Welsch(), errors)
    )
    with pytest.raises(ValueError, match="loss must be one of"):
        lb.efficiency("tukey's")
