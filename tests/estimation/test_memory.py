"""How well one record tells a variance, against the closed forms of a first-order
autoregression.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

from losbench.estimation.memory import _autocovariance, _lagged_products, variance_sampling

N, RECORDS = 4000, 150


@pytest.fixture(scope="module", params=[0.0, 0.8, 0.95])
def memory(request):
    """The autoregression's coefficient, and records (n, records) of unit variance."""
    rho = request.param
    white = np.random.default_rng(9).standard_normal((N + 400, RECORDS))
    return rho, np.sqrt(1.0 - rho**2) * lfilter([1.0], [1.0, -rho], white, axis=0)[400:]


def test_the_variance_of_the_mean_is_put_back(memory):
    rho, series = memory
    lost, _ = variance_sampling(series)
    expected = (1.0 + rho) / (1.0 - rho) / N
    assert lost.mean() == pytest.approx(
        expected, rel=0.2
    )  # summing up to the first negative lag adds a little
    assert series.mean(axis=0).var() == pytest.approx(expected, rel=0.25)


def test_the_error_of_the_variance_is_its_scatter(memory):
    rho, series = memory
    _, error = variance_sampling(series)
    expected = np.sqrt(2.0 * (1.0 + rho**2) / (1.0 - rho**2) / N)
    assert error.mean() == pytest.approx(expected, rel=0.1)
    assert series.var(axis=0).std() == pytest.approx(error.mean(), rel=0.15)


def test_a_missing_sample_is_left_out(memory):
    _, series = memory
    gappy = series.copy()
    gappy[::7] = np.nan
    for whole, holed in zip(variance_sampling(series), variance_sampling(gappy), strict=True):
        assert np.isfinite(holed).all()
        assert 0.9 < holed.mean() / whole.mean() < 1.25


def test_columns_do_not_meet(memory):
    _, series = memory
    for batch, alone in zip(
        variance_sampling(series[:, :3]), variance_sampling(series[:, 1]), strict=True
    ):
        assert batch[1] == pytest.approx(float(alone), rel=1e-9)


@pytest.mark.parametrize("n", range(1, 34))
def test_products_are_summed_over_every_pair_and_no_pair_twice(n):
    series = np.random.default_rng(n).standard_normal((n, 2))
    expected = [[series[: n - k, j] @ series[k:, j] for j in (0, 1)] for k in range(n)]
    np.testing.assert_allclose(_lagged_products(series), expected, atol=1e-12)
    gappy = series.copy()
    gappy[:: max(n // 3, 2), 1] = np.nan
    if n < 3:
        return
    covariance, count = _autocovariance(gappy)
    about = gappy - np.nanmean(gappy, axis=0)
    for k in range(n):
        pairs = about[: n - k] * about[k:]
        there = np.isfinite(pairs).sum(axis=0)
        mean = np.nansum(pairs, axis=0) / np.maximum(there, 1)
        np.testing.assert_allclose(covariance[k], mean, atol=1e-12)
    assert count.tolist() == np.isfinite(gappy).sum(axis=0).tolist()
