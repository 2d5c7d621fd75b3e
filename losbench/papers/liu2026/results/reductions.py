"""By how much EIWA lowers the scatter, frame by frame on the same hundreds, against a centroid that
does nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.checks import choice, number
from losbench.estimation.metrics import pv, rms
from losbench.papers.liu2026.results.centroiding import SERIES, TABLE_1, Constant
from losbench.papers.liu2026.scenario import ConstantBench

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Reductions", "printed_reductions", "reductions", "shape_values", "smoothed"]

CELLS = tuple((statistic, series) for series in SERIES for statistic in ("rms", "pv"))
"""Order of the cells, that of the claims irls-23 to -30 and, by statistic, -47 to -54."""
CLAIMS = {
    "eiwa": tuple(f"irls-{k}" for k in range(23, 31)),
    "eiwa in the text": tuple(f"irls-{47 + k // 2 + 4 * (k % 2)}" for k in range(8)),
}


@dataclass(frozen=True)
class Reductions:
    """Reductions from grey to EIWA in percent: of every hundred, and without EIWA's own part.

    Attributes
    ----------
    drawn : (draws, 8) array
        In the order of `CELLS`.
    null : (8,) array
        What is left of each mean if EIWA is the grey centroid: nothing, but for a filter after it.
    """

    drawn: Floats
    null: Floats

    @property
    def mean(self) -> Floats:
        """Return the means over the hundreds, (8,)."""
        return self.drawn.mean(axis=0)

    @property
    def covariance(self) -> Floats:
        """Return the scatter among the hundreds, (8, 8): all cells share frames."""
        return np.cov(self.drawn.T)

    def values(self, column: str = "eiwa") -> pd.DataFrame:
        """Return the cells as rows for a ledger: claim, value, error, null, low, high, unit."""
        import pandas as pd

        choice("column", column, CLAIMS)
        low, high = printed_reductions(column)
        error = np.sqrt(np.diag(self.covariance))
        return pd.DataFrame(
            {
                "claim": CLAIMS[column],
                "cell": [f"{statistic.upper()} {series}" for statistic, series in CELLS],
                "value": self.mean,
                "error": error,
                "null": self.null,
                "null_error": error,
                "low": low,
                "high": high,
                "unit": "% below grey",
            }
        )

    def pull(self, column: str = "eiwa", *, doing_nothing: bool = False) -> tuple[Floats, Floats]:
        """Return printed less ours, (8,), and its covariance, rounding included."""
        low, high = printed_reductions(column)
        centre = self.null if doing_nothing else self.mean
        rounding = np.diag((high - low) ** 2 / 12)
        return (low + high) / 2 - centre, self.covariance + rounding

    def chances(self) -> dict[str, tuple[float, float]]:
        """Return how often two statements are true, under EIWA and with its part taken out.

        "all lower": all eight reductions are positive (irls-46); "pv less": each series' PV is
        reduced by less than its RMS (irls-55).
        """

        def shares(drawn: Floats) -> tuple[float, float]:
            by_series = drawn.reshape(len(drawn), 4, 2)
            return (
                float(np.mean((drawn > 0).all(axis=1))),
                float(np.mean((by_series[..., 1] < by_series[..., 0]).all(axis=1))),
            )

        ours, nothing = shares(self.drawn), shares(self.drawn - self.mean + self.null)
        return {name: (ours[k], nothing[k]) for k, name in enumerate(("all lower", "pv less"))}


def printed_reductions(column: str = "eiwa") -> tuple[Floats, Floats]:
    """Lowest and highest reductions, (8,) in percent, that the prints of both columns allow."""
    half = 5e-5
    grey, ours = (
        np.array([TABLE_1[which][s][SERIES.index(series)] for s, series in CELLS])
        for which in ("grey", column)
    )
    return 100 * (1 - (ours + half) / (grey - half)), 100 * (1 - (ours - half) / (grey + half))


def smoothed(series: Floats, gain: float) -> Floats:
    """Filter a series along axis 0 by a steady Kalman filter of this gain; 1 changes nothing."""
    from scipy.signal import lfilter

    number("gain", gain, low=0.0, high=1.0)
    start = (1 - gain) * series[:1]
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], series, axis=0, zi=start)[0])


def reductions(
    run: Constant, setting: ConstantBench, *, gain: float = 1.0, draws: int = 1000
) -> Reductions:
    """Compare both centroids on the same random hundreds.

    Along x both share the spots' motion, so that the reduction is known much better than either
    level; its error is that of one hundred, such as the paper's.

    Parameters
    ----------
    run : Constant
    setting : ConstantBench
        Gives the sample and the seed.
    gain : float
        Of a Kalman filter after EIWA, as in section 3.1; the null then is the filtered grey one.
    draws : int
        Hundreds.
    """
    rng = np.random.default_rng(setting.seed)
    chosen = np.argsort(rng.random((draws, setting.frames)), axis=1)[:, : setting.sample]
    grey, eiwa = run.series("grey"), smoothed(run.series("eiwa"), gain)

    def drawn(series: Floats) -> Floats:
        hundreds = np.moveaxis(series[chosen], 1, 0)
        return np.stack([rms(hundreds), pv(hundreds)], axis=-1).reshape(draws, 8)

    before = drawn(grey)
    nothing = 100 * (1 - drawn(smoothed(grey, gain)) / before).mean(axis=0) if gain < 1 else 0.0
    return Reductions(100 * (1 - drawn(eiwa) / before), np.broadcast_to(nothing, 8))


def shape_values(run: Constant, setting: ConstantBench, draws: int = 1000) -> pd.DataFrame:
    """PV over RMS of the grey centroid along y, as rows for a ledger: irls-18 and irls-22.

    Only the RMS was set. The null is a sinusoid, whose PV is twice the root of two of its RMS.
    """
    import pandas as pd

    rng = np.random.default_rng(setting.seed)
    chosen = np.argsort(rng.random((draws, setting.frames)), axis=1)[:, : setting.sample]
    rows = []
    for claim, k in (("irls-18", 1), ("irls-22", 3)):
        hundreds = run.series("grey")[chosen, k].T
        ratio = pv(hundreds) / rms(hundreds)
        half, (r, p) = 5e-5, (TABLE_1["grey"][s][k] for s in ("rms", "pv"))
        rows.append(
            {
                "claim": claim,
                "value": ratio.mean(),
                "error": ratio.std(),
                "null": 2 * np.sqrt(2.0),
                "null_error": 0.05,
                "low": (p - half) / (r + half),
                "high": (p + half) / (r - half),
                "unit": "PV over RMS",
            }
        )
    return pd.DataFrame(rows)
