"""How many bad spots a layout survives: the table of rings, and estimates that do and do not."""

import numpy as np
import pytest

import losbench as lb


def ring(count):
    angle = 2 * np.pi * np.arange(count) / count
    u, v, one, zero = np.cos(angle), np.sin(angle), np.ones(count), np.zeros(count)
    design = np.stack([np.stack([one, zero, -v], axis=1), np.stack([zero, one, u], axis=1)], axis=1)
    return design.reshape(-1, 3), np.repeat(np.arange(count), 2)


@pytest.mark.parametrize("count", range(2, 13))
def test_a_ring_of_spots(count):
    design, spot = ring(count)
    found = lb.design_breakdown(design, group=spot)
    assert found.monotone == (0 if count < 4 else (count - 1) // 3)
    assert found.any == (count - 2) // 2
    assert found.units == count
    assert found.shares[0] == 0.0
    assert found.shares[-1] == pytest.approx(1.0)


def test_the_worst_turn_of_a_ring_is_about_one_of_its_spots():
    design, spot = ring(6)
    found = lb.design_breakdown(design, group=spot)
    assert found.shares[2] == pytest.approx((2 + np.sqrt(3)) / (4 + 2 * np.sqrt(3)), abs=1e-6)


@pytest.mark.parametrize("n", range(1, 12))
def test_a_location_survives_fewer_than_half(n):
    found = lb.design_breakdown(np.ones((n, 1)))
    assert (found.monotone, found.any) == ((n - 1) // 2, (n - 1) // 2)


def test_a_line_through_equal_abscissae_is_fixed_by_the_few_others():
    design = np.column_stack([np.ones(10), [0.0] * 7 + [1.0, 2.0, 3.0]])
    found = lb.design_breakdown(design)
    assert found.any == 1
    assert found.monotone <= 1
    np.testing.assert_allclose(design[:7] @ found.direction, 0.0, atol=1e-9)


def pulls(design, group, direction):
    return np.sqrt(np.bincount(group, (design @ direction) ** 2))


def lumpy(seed):
    rng = np.random.default_rng(seed)
    p = int(rng.choice([4, 5, 6, 6]))
    m = int(rng.integers(p + 3, 16))
    return rng.standard_normal((2 * m, p)) * np.exp(
        0.4 * rng.standard_normal((2 * m, 1))
    ), np.arange(2 * m) // 2


@pytest.mark.parametrize("seed", [3, 43, 179, 236])
def test_no_other_climb_finds_a_worse_direction(seed):
    from scipy.optimize import minimize

    design, spot = lumpy(seed)
    found = lb.design_breakdown(design, group=spot)
    assert (np.diff(found.shares) >= 0.0).all()
    basis = np.linalg.qr(design)[0]
    tries = np.random.default_rng(seed).standard_normal((4000, basis.shape[1]))
    for k in (1, 2, 3):

        def missing(direction, k=k):
            size = np.sort(pulls(basis, spot, direction))
            return -size[-k:].sum() / size.sum()

        for start in sorted(tries, key=missing)[:3]:
            best = minimize(
                missing, start, method="Nelder-Mead", options={"maxiter": 2000, "fatol": 1e-12}
            )
            assert -best.fun <= found.shares[k] + 1e-6


@pytest.mark.parametrize("seed", [1, 2, 43])
def test_the_direction_does_what_is_said_of_it(seed):
    design, spot = lumpy(seed)
    for group in (spot, np.arange(len(design))):
        found = lb.design_breakdown(design, group=group)
        k = found.monotone + 1
        size = np.sort(pulls(design, group, found.direction))
        assert size[-k:].sum() / size.sum() == pytest.approx(found.shares[k], abs=1e-9)
        assert found.shares[k - 1] < 0.5 <= found.shares[k] + 1e-9


@pytest.mark.parametrize("count", [6, 8])
def test_huber_breaks_where_the_design_says(count):
    """Bad spots that pull where the design is weakest: survived up to `monotone`, and not one
    more.
    """
    design, spot = ring(count)
    found = lb.design_breakdown(design, group=spot)
    pull = np.linalg.norm((design @ found.direction).reshape(-1, 2), axis=1)
    worst = np.argsort(-pull, kind="stable")
    for bad, broken in ((found.monotone, False), (found.monotone + 1, True)):
        y = np.zeros((count, 2))
        y[worst[:bad]] = (1e6 * design @ found.direction / pull.max()).reshape(-1, 2)[worst[:bad]]
        fit = lb.irls(design, y.ravel(), scale=1.0, group=spot, max_iter=3000, on_fail="ignore")
        assert (np.abs(fit.x).max() > 1e4) == broken


def test_deletion_residuals_are_those_of_statsmodels():
    from statsmodels.api import OLS
    from statsmodels.datasets import stackloss

    data = stackloss.load_pandas()
    design, y = np.column_stack([np.ones(21), data.exog.to_numpy()]), data.endog.to_numpy()
    ours = lb.deletion_residuals(lb.lstsq(design, np.stack([y, 2 * y])))
    theirs = OLS(y, design).fit().get_influence().resid_studentized_external
    np.testing.assert_allclose(ours, np.stack([theirs, theirs]), rtol=1e-9)


def test_masking_one_bad_row_is_seen_and_two_hide_each_other():
    x = np.arange(12.0)
    design, y = (
        np.column_stack([np.ones(12), x]),
        0.1 * np.random.default_rng(4).standard_normal(12),
    )
    y[11] += 5.0
    assert np.abs(lb.deletion_residuals(lb.lstsq(design, y))).argmax() == 11
    assert np.abs(lb.deletion_residuals(lb.lstsq(design, y)))[11] > 10
    y[10] += 5.0
    assert np.abs(lb.deletion_residuals(lb.lstsq(design, y))).max() < 3.0
    for fit in (lb.lts(design, y), lb.mm(design, y)):
        assert fit.outliers().nonzero()[0].tolist() == [10, 11]


def test_a_matrix_is_asked_for():
    with pytest.raises(ValueError, match=r"A must have 2 dimensions, got shape \(3,\)"):
        lb.design_breakdown([1.0, 2.0, 3.0])
    with pytest.raises(
        ValueError, match="A must have at least as many rows as columns, got 1 rows and 2 columns"
    ):
        lb.design_breakdown([[1.0, 2.0]])
    with pytest.raises(ValueError, match="A must determine all 2 unknowns, got a matrix of rank 1"):
        lb.design_breakdown(np.ones((6, 2)))
    with pytest.raises(ValueError, match="A must determine all 2 unknowns, got a matrix of rank 0"):
        lb.design_breakdown(np.zeros((4, 2)))
