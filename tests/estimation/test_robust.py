"""IRLS against R, against statsmodels and against what its covariance predicts."""

import numpy as np
import pytest
from statsmodels.datasets import stackloss
from statsmodels.robust import norms
from statsmodels.robust.robust_linear_model import RLM

import losbench as lb

DATA = stackloss.load_pandas()
A = np.column_stack([np.ones(21), DATA.exog.to_numpy()])
Y = DATA.endog.to_numpy()
EXACT = {"tol": 1e-13, "max_iter": 1000}


def r_mad(residuals):
    return np.median(np.abs(residuals), axis=-1) / 0.6745


# Coefficients: intercept, air flow, water temperature, acid concentration. R 4, MASS::rlm run to
# convergence.
STACKLOSS = {
    "R Huber": (
        {"scale": r_mad},
        [-41.0264853733, 0.8293857703, 0.9260594155, -0.1278463180],
        2.44048904599,
    ),
    "mad": (
        {"scale": "mad"},
        [-41.0264983524, 0.8293843346, 0.9260659662, -0.1278467249],
        2.4405360917,
    ),
    "std": (
        {"scale": "std"},
        [-41.1756905761, 0.8128817813, 1.0013643580, -0.1325248831],
        2.9813173476,
    ),
    "std1": (
        {"scale": "std1"},
        [-41.1898662492, 0.8106142562, 1.0111953207, -0.1331259997],
        3.0513810978,
    ),
    "rms": (
        {"scale": "rms"},
        [-41.1762332327, 0.8128217566, 1.0016382407, -0.1325418989],
        2.9832843305,
    ),
    "fixed": ({"scale": 2.5}, [-41.0429034193, 0.8275697260, 0.9343457219, -0.1283611318], 2.5),
    "R bisquare": (
        {"scale": r_mad, "loss": lb.Bisquare(4.685)},
        [-42.2853215365, 0.9275589928, 0.6507111984, -0.1123331230],
        2.28185331457,
    ),
}


@pytest.mark.parametrize("name", STACKLOSS)
def test_stackloss(name):
    options, coefficients, scale = STACKLOSS[name]
    fit = lb.irls(A, Y, **EXACT, **options)
    np.testing.assert_allclose(fit.x, coefficients, rtol=0, atol=1.5e-10)
    assert fit.scale == pytest.approx(scale, abs=1e-10)
    assert fit.converged


def test_stackloss_least_squares_as_r_lm():
    fit = lb.lstsq(A, Y)
    np.testing.assert_allclose(
        fit.x, [-39.9196744201, 0.7156402005, 1.2952861244, -0.1521225191], atol=1e-10
    )
    assert fit.scale == pytest.approx(3.243363918, abs=1e-9)
    np.testing.assert_allclose(fit.cov, 3.243363918**2 * np.linalg.inv(A.T @ A), rtol=1e-8)
    np.testing.assert_allclose(fit.leverage, np.diag(A @ np.linalg.pinv(A)), atol=1e-12)
    assert (fit.dof, fit.rank, fit.n_iter) == (17, 4, 0)


def test_r_weights_and_standard_error():
    fit = lb.irls(A, Y, scale=r_mad, **EXACT)
    expected = np.ones(21)
    expected[[2, 3, 20]] = 0.7857966125, 0.5048559249, 0.3680837818
    np.testing.assert_allclose(fit.weights, expected, atol=1e-9)
    assert fit.outliers().nonzero()[0].tolist() == [20]
    # summary(rlm(stack.loss ~ .)), which R stops at a relative change of 1e-4.
    assert fit.std_error[0] == pytest.approx(9.8073471964, rel=1e-4)


class PopulationScale(RLM):
    """RLM with the paper's scale; its own way of taking a callable is broken."""

    def _estimate_scale(self, resid, *unused):
        return np.std(resid)


@pytest.mark.parametrize(("scale", "model"), [("mad", RLM), ("std", PopulationScale)])
@pytest.mark.parametrize(("n", "p"), [(16, 3), (9, 2), (25, 5), (12, 1)])
def test_a_batch_agrees_with_statsmodels(scale, model, n, p):
    rng = np.random.default_rng(n)
    design = rng.standard_normal((30, n, p))
    y = design @ np.arange(1.0, p + 1) + rng.standard_t(3, (30, n))
    ours = lb.irls(design, y, scale=scale, tol=1e-13, max_iter=5000)
    for i in range(30):
        theirs = model(y[i], design[i], M=norms.HuberT(1.345)).fit(
            conv="coefs", tol=1e-13, maxiter=5000
        )
        np.testing.assert_allclose(ours.x[i], theirs.params, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.weights[i], theirs.weights, rtol=0, atol=1e-8)


def test_leverage_as_the_gnu_scientific_library():
    fit = lb.irls(A, Y, leverage=True, **EXACT)
    np.testing.assert_allclose(
        fit.x, [-41.34693336, 0.815330852, 0.9996681733, -0.1315225194], atol=1e-8
    )
    judged = np.abs(fit.residuals) / np.sqrt(1 - fit.leverage)
    assert fit.scale == pytest.approx(np.median(np.sort(judged)[3:]) / 0.6745, rel=1e-9)
    np.testing.assert_allclose(fit.weights, np.minimum(1, 1.345 * fit.scale / judged), rtol=1e-9)


def test_leverage_in_a_batch_is_that_of_each_system():
    rng = np.random.default_rng(12)
    design, y = rng.standard_normal((3, 4, 15, 3)), rng.standard_t(2, (3, 4, 15))
    design[..., 0, :] *= 20.0
    options = EXACT | {"leverage": True, "group": np.arange(15) // 3}
    for scale in ("mad", "std", 0.8):
        whole = lb.irls(design, y, scale=scale, **options)
        for i, j in np.ndindex(3, 4):
            single = lb.irls(design[i, j], y[i, j], scale=scale, **options)
            np.testing.assert_allclose(whole.x[i, j], single.x, rtol=1e-8)
            np.testing.assert_allclose(whole.cov[i, j], single.cov, rtol=1e-6)
    shared = lb.irls(design[0, 0], y, leverage=True, **EXACT)
    np.testing.assert_allclose(
        shared.x[2, 1], lb.irls(design[0, 0], y[2, 1], leverage=True, **EXACT).x, rtol=1e-8
    )


def test_a_row_that_fixes_an_unknown_alone_is_no_division_by_zero():
    design = np.column_stack([np.ones(8), np.eye(8)[:, 0]])
    fit = lb.irls(design, np.arange(8.0), leverage=True)
    assert np.isfinite(fit.x).all()
    assert np.isfinite(fit.weights).all()
    with pytest.raises(ValueError, match="leverage must be True or False, got 'yes'"):
        lb.irls(design, np.arange(8.0), leverage="yes")


def test_a_norm_of_statsmodels_serves_as_loss():
    ours, theirs = (
        lb.irls(A, Y, loss=loss) for loss in (lb.Bisquare(4.685), norms.TukeyBiweight(4.685))
    )
    np.testing.assert_allclose(ours.x, theirs.x, rtol=1e-12)
    np.testing.assert_allclose(ours.cov, theirs.cov, rtol=1e-9)


def scatter(fit):
    """Empirical over predicted standard deviation of the unknowns, over a batch with true unknowns
    of 0.
    """
    return np.sqrt(
        np.mean(fit.x**2, axis=0) / np.mean(np.diagonal(fit.cov, axis1=1, axis2=2), axis=0)
    )


@pytest.mark.parametrize(
    "solve",
    [
        pytest.param(lb.lstsq, id="least squares"),
        pytest.param(lambda a, y: lb.lstsq(a, y, scale=2.0), id="least squares, known scale"),
        pytest.param(lambda a, y: lb.irls(a, y, scale="mad"), id="Huber"),
        pytest.param(lambda a, y: lb.irls(a, y, scale=2.0), id="Huber, known scale"),
        pytest.param(
            lambda a, y: lb.irls(a, y, scale=2.0, group=np.arange(40) // 2), id="Huber, pairs"
        ),
        pytest.param(
            lambda a, y: lb.irls(a, y, scale="mad", group=np.arange(40) // 2),
            id="Huber, pairs, mad",
        ),
        pytest.param(lambda a, y: lb.irls(a, y, loss=lb.Bisquare(), max_iter=1000), id="bisquare"),
    ],
)
def test_predicted_errors_are_the_scatter_on_normal_errors(solve):
    rng = np.random.default_rng(40)
    design = rng.standard_normal((40, 3))
    fit = solve(design, 2.0 * rng.standard_normal((4000, 40)))
    np.testing.assert_allclose(scatter(fit), 1.0, atol=0.04)


def test_grouped_rows_share_one_weight_set_by_their_root_mean_square():
    rng = np.random.default_rng(3)
    group = np.array([2, 0, 1, 0, 2, 1, 2, 5, 5, 5])
    design, y = rng.standard_normal((10, 2)), 5 * rng.standard_normal(10)
    fit = lb.irls(design, y, scale=1.5, group=group, **EXACT)
    for label in np.unique(group):
        rows = group == label
        size = np.sqrt(np.mean(fit.residuals[rows] ** 2)) / 1.5
        np.testing.assert_allclose(fit.weights[rows], min(1.0, 1.345 / size), rtol=1e-12)
    np.testing.assert_allclose(design.T @ (fit.weights * fit.residuals), 0.0, atol=1e-10)


def test_a_start_decides_for_a_redescending_loss():
    y = np.array([0.0, 0.1, -0.1, 0.05, 10.0, 10.1, 9.9, 10.05])
    design = np.ones((8, 1))
    low, high = (lb.irls(design, y, loss=lb.Bisquare(), scale=0.2, x0=[x0]) for x0 in (0.0, 10.0))
    assert low.x[0] == pytest.approx(0.0125, abs=0.01)
    assert high.x[0] == pytest.approx(10.0125, abs=0.01)


def test_the_summary_names_loss_scale_state_and_doubted_rows():
    fit = lb.irls(A, Y, scale="std")
    assert repr(fit).startswith(
        "RobustFit(21 x 4, loss Huber(c=1.345), scale std = 2.98132, converged in "
    )
    text = fit.summary()
    assert (
        f"{np.count_nonzero(fit.weights < 1)} of 21 rows have a weight below 1, lowest first:"
        in text
    )
    assert len(text.splitlines()) <= 25
    assert f"{fit.x[0]:.6g}" in text
    batch = lb.irls(A, np.stack([Y, 2 * Y]), scale=r_mad)
    assert "(2,) systems of 21 x 4" in repr(batch)
    assert "scale r_mad, 2 of 2 converged" in batch.summary()
