"""Identification and pointing metrics in seconds: what an analyst waits for, beside a plain loop.

Limits are those of one idle core; a ratio is time over limit.
"""

from side_by_side import faster, in_turn, one_thread, report, within

one_thread()

import numpy as np  # noqa: E402

import losbench as lb  # noqa: E402
from losbench.pointing.thermal.lag import lagged  # noqa: E402
from losbench.pointing.thermal.terms import Lagged, Offset, Trend  # noqa: E402


def record(n: int):
    """Three temperatures of their own, an angle behind three lags, 2 % outliers."""
    rng = np.random.default_rng(1)
    t = 60.0 * np.arange(n)
    sensors = {
        f"T{k}": np.sin(2 * np.pi * t / period + k) + np.cos(2 * np.pi * t / (3.3 * period))
        for k, period in enumerate((30_000.0, 47_000.0, 81_000.0))
    }
    y = sum(
        g * lagged(s, t, tau)
        for g, s, tau in zip(
            (1.0, -0.5, 0.3), sensors.values(), (900.0, 4000.0, 9000.0), strict=True
        )
    )
    y = y + 0.1 * rng.standard_normal(n) + 5.0 * (rng.random(n) < 0.02)
    return 1e-6 * y, sensors, t


def plain_lag(temperature: np.ndarray, t: np.ndarray, tau_s: float) -> np.ndarray:
    """The same filter sample by sample."""
    x = np.empty_like(temperature)
    x[0] = temperature[0]
    for i in range(len(t) - 1):
        step = t[i + 1] - t[i]
        slope, decay = (temperature[i + 1] - temperature[i]) / step, np.exp(-step / tau_s)
        x[i + 1] = temperature[i + 1] + decay * (x[i] - temperature[i])
        x[i + 1] -= slope * tau_s * (1.0 - decay)
    return x


def lag_against_a_loop():
    _y, sensors, t = record(100_000)
    np.testing.assert_allclose(lagged(sensors["T0"], t, 900.0), plain_lag(sensors["T0"], t, 900.0))
    ours, peer = in_turn(
        lambda: lagged(sensors["T0"], t, 900.0),
        lambda: plain_lag(sensors["T0"], t, 900.0),
        rounds=3,
    )
    return faster("a lag on 1e5 samples", ours, "a loop over samples", peer, 5)


def in_seconds(what, call, limit_s):
    seconds, _ = in_turn(call, lambda: None, rounds=2)
    return within(what, seconds, f"{limit_s:g} s", limit_s, 1.0)


def fourteen_folds():
    y, sensors, t = record(5000)
    model = Offset() + Lagged("T0", "T1", "T2") + Trend(1)
    return in_seconds(
        "5000 samples, 3 lags, 14 folds, IRLS",
        lambda: lb.cross_validate(model, y, sensors, t, folds=14),
        2.0,
    )


def sensitivity_of_a_long_record():
    y, sensors, t = record(100_000)
    return in_seconds(
        "fit_sensitivity with a lag, 1e5",
        lambda: lb.fit_sensitivity(sensors["T0"], y, time_s=t, lag_s="fit"),
        2.0,
    )


def metrics():
    y = np.random.default_rng(2).standard_normal((1_000_000, 3))
    t = 0.05 * np.arange(len(y))

    def call():
        return lb.pointing_metrics(y, t, 10.0, 50.0).percentiles()

    return in_seconds("metrics of 1e6 x 3, percentiles", call, 2.0)


if __name__ == "__main__":
    report(
        "thermal",
        [lag_against_a_loop(), fourteen_folds(), sensitivity_of_a_long_record(), metrics()],
    )
