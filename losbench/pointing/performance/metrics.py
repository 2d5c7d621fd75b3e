"""The pointing metrics of ECSS-E-ST-60-10C over windows, each with an interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats, Indices
from losbench.checks import choice, finite_or_nan, increasing, number, shaped
from losbench.pointing.performance.budget import PointingRequirement
from losbench.pointing.performance.intervals import chi2_interval
from losbench.pointing.performance.percentiles import error_percentile
from losbench.pointing.performance.record import Metric, Record
from losbench.pointing.performance.windows import WindowStatistics, window_statistics
from losbench.series import gaps, runs
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PointingMetrics", "pointing_metrics"]

_NAMES = ("ape", "mpe", "rpe", "pde", "pre", "smear", "jitter")
_UNEVEN = 0.1  # of a step: what times may be off by


@dataclass(frozen=True, repr=False)
class PointingMetrics:
    """The metrics of a record; one-sigma (rms) values in radians, axes (...) as of the angles.

    Attributes
    ----------
    ape, mpe : Metric
        Absolute error, and error of a window's mean, about zero: a bias counts.
    rpe, smear, jitter : Metric
        Error about a window's mean; the part of it along the window's line, and the rest. Lucke's
        jitter is the RPE: see `jitter_lucke`.
    pde : Metric
        Drift: difference of two windows' means one separation apart, within one observation.
    pre : Metric
        Reproducibility: difference of the means of windows of two observations. Each metric holds a
        (...) array of values, (..., 2) of intervals and (...) of degrees of freedom.
    window_s, separation_s : float
    windows, dropped : int
        Windows used, and windows that a gap or a missing sample spoiled.
    route : str
        "windows" or "spectrum".
    notes : tuple of str
    """

    ape: Metric
    mpe: Metric
    rpe: Metric
    pde: Metric
    pre: Metric
    smear: Metric
    jitter: Metric
    window_s: float
    separation_s: float
    windows: int
    dropped: int
    route: str
    notes: tuple[str, ...]
    _angles: Floats = field(repr=False)
    _density: tuple[Floats, Floats] = field(repr=False)

    @property
    def jitter_lucke(self) -> Metric:
        """Jitter as Lucke, Sirlin and San Martin (1992) define it: the RPE, smear included."""
        return self.rpe

    def psd(self) -> tuple[Floats, Floats]:
        """Frequencies (f,) in Hz and one-sided power spectra (f, ...), rad^2/Hz, bias left out."""
        return self._density

    def percentiles(
        self, probabilities: Sequence[float] = (0.6827, 0.9545, 0.9973)
    ) -> pd.DataFrame:
        """Percentiles of the absolute error in arcseconds, with 95 % intervals.

        A row for each probability and axis, and with two axes or more one for the half-cone of the
        first two. NaN where too few independent samples lie beyond (`error_percentile`).
        """
        import pandas as pd

        errors = rad_to_arcsec(self._angles)
        columns = {f"axis {i + 1}": np.abs(column) for i, column in enumerate(errors.T)}
        if errors.shape[1] > 1:
            columns["half-cone"] = np.hypot(errors[:, 0], errors[:, 1])
        rows = []
        for name, column in columns.items():
            for p in probabilities:
                value, (low, high) = error_percentile(column, p)
                rows.append((name, p, value, low, high))
        names = ["of", "probability", "value_arcsec", "from_arcsec", "to_arcsec"]
        return pd.DataFrame(rows, columns=names)

    def table(self) -> pd.DataFrame:
        """Every metric in arcseconds, a row per metric and axis."""
        import pandas as pd

        rows = []
        for name in _NAMES:
            metric: Metric = getattr(self, name)
            value, dof = np.atleast_1d(rad_to_arcsec(metric.value)), np.atleast_1d(metric.dof)
            interval = rad_to_arcsec(metric.interval).reshape(-1, 2)
            rows += [
                (name.upper() if name in _NAMES[:5] else name, i + 1, v, *interval[i], dof[i])
                for i, v in enumerate(value)
            ]
        names = ["metric", "axis", "value_arcsec", "from_arcsec", "to_arcsec", "dof"]
        return pd.DataFrame(rows, columns=names)

    def verdict(self, requirement: PointingRequirement) -> tuple[str, ...]:
        """Whether a requirement is "met", "not met" or "not shown", axis by axis.

        Met if the whole interval lies within the limit, not met if it lies beyond, not shown
        otherwise or where there is no interval.
        """
        metric: Metric = getattr(self, requirement.index.lower())
        interval = requirement.factor * rad_to_arcsec(metric.interval).reshape(-1, 2)
        if np.size(requirement.limit) not in {1, len(interval)}:
            raise ValueError(
                f"limit of {requirement.id} must be one number or {len(interval)}, one per axis, "
                f"got {np.size(requirement.limit)}"
            )
        limits = np.broadcast_to(requirement.limit, len(interval))
        return tuple(
            "met" if high <= limit else "not met" if low > limit else "not shown"
            for (low, high), limit in zip(interval, limits, strict=True)
        )

    def __repr__(self) -> str:
        """The table, and what must be known about it."""
        head = f"PointingMetrics: windows of {self.window_s:g} s, {self.windows} used"
        rows = self.table().dropna(subset=["value_arcsec"]).to_string(index=False)
        return "\n".join([head, rows, *self.notes])


def pointing_metrics(
    angles: ArrayLike,
    time_s: ArrayLike,
    window_s: float,
    separation_s: float | None = None,
    *,
    observations: ArrayLike | None = None,
    route: Literal["windows", "spectrum"] = "windows",
    confidence: float = 0.95,
) -> PointingMetrics:
    """Pointing metrics of a record, by windows or by its power spectrum.

    Parameters
    ----------
    angles : (n,) or (n, k) array, radians
        Pointing errors; NaN marks a missing sample.
    time_s : (n,) array
        Increasing, evenly spaced but for gaps (steps beyond 1.5 times the median).
    window_s : float
        Length of a window, rounded to whole samples, two or more.
    separation_s : float, optional
        Between the two windows of the PDE, from start to start; without it there is none.
    observations : (n,) array, optional
        Labels of the observations that the PRE compares; by default stretches between gaps longer
        than a window.
    route : "windows" or "spectrum"
        Mean squares of all windows without a gap, started every eighth of their length; or
        integrals of the Welch spectrum, with weights that are exact for these windows.
    confidence : float
        Of the intervals.

    Returns
    -------
    PointingMetrics

    Raises
    ------
    ValueError
        If times do not increase or shapes do not fit, or no window fits into the record.

    Notes
    -----
    ECSS-E-ST-60-10C; Lucke, Sirlin and San Martin, J. Astronaut. Sci. 40, 557 (1992). The intervals
    are those of a chi-square with the smaller of two numbers of degrees of freedom, from the
    weighted spectrum and from the windows' own scatter. On series with a line in their spectrum
    those of RPE and jitter are conservative, and noted as such.

    Examples
    --------
    >>> white = np.random.default_rng(1).standard_normal(20_000)
    >>> found = pointing_metrics(white, 0.1 * np.arange(20_000), 5.0)
    >>> round(float(found.mpe.value), 2), round(float(found.rpe.value), 2)
    (0.14, 0.98)
    """
    given = finite_or_nan("angles", angles)
    t = increasing("time_s", time_s)
    shaped("angles", given, (t.size,) if given.ndim < 2 else (t.size, "k"), why="to match time_s")
    choice("route", route, ("windows", "spectrum"))
    level = number("confidence", confidence, low=0.0, high=1.0)
    series = given.reshape(t.size, -1)
    whole = np.logical_and.reduce(np.isfinite(series), axis=1)
    pieces = runs(t, whole)
    step_s = float(np.median(np.diff(t))) if t.size > 1 else np.nan
    samples = _samples("window_s", window_s, step_s, t, least=2)
    apart = None if separation_s is None else _samples("separation_s", separation_s, step_s, t)
    found = window_statistics(series, pieces, samples, apart) if pieces else None
    if found is None or not len(found.mean):
        raise ValueError(
            f"window_s must fit into a stretch without gaps, the longest of which is "
            f"{max((p.stop - p.start for p in pieces), default=0) * step_s:g} s, got {window_s:g} s"
        )
    labels = _labels(observations, t, window_s)
    record = Record(series, pieces, step_s, samples, apart, found, level)
    metrics = record.metrics(route) | {"pre": _reproducibility(found, labels, level)}
    if given.ndim == 1:
        metrics = {name: Metric(m.value[0], m.interval[0], m.dof[0]) for name, m in metrics.items()}
    possible = max((t.size - samples) // max(samples // 8, 1) + 1, len(found.mean))
    frequency, density = record.density
    return PointingMetrics(
        **metrics,
        window_s=samples * step_s,
        separation_s=np.nan if apart is None else apart * step_s,
        windows=len(found.mean),
        dropped=possible - len(found.mean),
        route=route,
        notes=(*_uneven(t, step_s), *record.notes()),
        _angles=series,
        _density=(frequency, density if given.ndim > 1 else density[:, 0]),
    )


def _samples(name: str, value: float, step_s: float, t: Floats, *, least: int = 1) -> int:
    seconds = number(name, value, low=0.0)
    samples = int(np.rint(seconds / step_s)) if np.isfinite(step_s) else 0
    if t.size < 2:
        raise ValueError("time_s must hold two samples or more, got one")
    if samples < least or samples > t.size:
        raise ValueError(
            f"{name} must span {least} samples or more and fit into the record, which has {t.size} "
            f"of {step_s:g} s, got {seconds:g} s"
        )
    return samples


def _uneven(t: Floats, step_s: float) -> tuple[str, ...]:
    step = np.diff(t)[~gaps(t)]
    if (np.abs(step - step_s) <= _UNEVEN * step_s).all():
        return ()
    return (
        f"Times are not evenly spaced: steps of {step.min():.3g} to {step.max():.3g} s count as "
        f"{step_s:.3g} s each, and windows hold a number of samples, not a time.",
    )


def _labels(observations: ArrayLike | None, t: Floats, window_s: float) -> Indices:
    if observations is None:
        return np.concatenate([[0], np.cumsum(np.diff(t) > window_s)]).astype(np.intp)
    labels = np.asarray(observations)
    shaped("observations", labels, (t.size,), why="to match time_s")
    return np.unique(labels, return_inverse=True)[1]


def _reproducibility(found: WindowStatistics, labels: Indices, level: float) -> Metric:
    """Root mean square difference of window means over all pairs of observations."""
    of = labels[found.start]
    groups = [found.mean[of == label] for label in np.unique(of)]
    axes = found.mean.shape[1]
    if len(groups) < 2:
        return Metric(np.full(axes, np.nan), np.full((axes, 2), np.nan), np.full(axes, np.nan))
    mean, square = (np.array([(group**power).mean(axis=0) for group in groups]) for power in (1, 2))
    count, nu = len(groups), float(len(groups) - 1)
    ordered = count * (count - 1)
    total = 2.0 * (count - 1) * square.sum(axis=0)
    total -= 2.0 * (mean.sum(axis=0) ** 2 - (mean**2).sum(axis=0))
    value = total / ordered
    interval = np.array([chi2_interval(float(v), nu, level) for v in value])
    return Metric(np.sqrt(value), interval, np.full(axes, nu))
