"""Whether to believe a measurement, asked of the data alone: nobody knows the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtri

from losbench.arrays import Floats, Ints
from losbench.display import html_table
from losbench.imaging.results import SpotFlag

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Belief",
    "Slope",
    "drift_slope",
    "flags_by_name",
    "sampling_error",
    "second_differences",
]


_FEWEST = 10  # second differences, for a ratio that says anything
_BY_CHANCE = 0.01  # of the recordings without fault that are called at fault
_TELLS = 0.05  # a slope is known if its error is below
# Variance of the mean square of second differences of white noise, whose autocovariances are 6, -4
# and 1, over its mean squared: 2 (36 + 2 * 16 + 2) / 36 / N; half of that root for the scatter.
_PER_SAMPLE = 35.0 / 36.0


@dataclass(frozen=True)
class Slope:
    """How far one centroid follows what another sees of the drift: 1, unless one of them follows
    its window or a distorted spot.

    Attributes
    ----------
    value, error : float
        NaN where the drift is too small to tell.
    """

    value: float
    error: float


@dataclass(frozen=True)
class Belief:
    """What a measurement says of itself, without the truth.

    Attributes
    ----------
    scatter_px, predicted_px : (n, 2) arrays
        Noise of each spot's x and y from second differences over root 6, which no smooth drift
        enters, and the error that was predicted for it, root mean square over the frames.
    ratio_error : (n,) array
        Sampling error of scatter over predicted, for white noise; NaN where fewer than ten second
        differences are known.
    flags : dict of str to int
        How many centroids carry each flag, by its name.
    n_centroids : int
        Of how many.
    p_value : (F,) array or None
        Of the equations that are left over in each frame; None without angles.
    slope : Slope or None
        Against another centroid, where one was given.

    Examples
    --------
    >>> import losbench as lb
    >>> camera = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
    >>> light = lb.render_spots([[20.0, 15.0]], 5e4, 2.0, (32, 48)) + 30.0
    >>> frames = camera.expose(np.stack([light] * 40), 1)
    >>> belief = lb.measure(lb.read_recording(frames, detector=camera)).belief()
    >>> print(belief.sentences()[0])
    Scatter over predicted error: 0.93 to 1.21, sampling error 0.16: as predicted.
    """

    scatter_px: Floats
    predicted_px: Floats
    ratio_error: Floats
    flags: dict[str, int]
    n_centroids: int
    p_value: Floats | None = None
    slope: Slope | None = None

    @property
    def ratio(self) -> Floats:
        """Scatter over predicted error, (n, 2): near one, if noise is all that moves a spot from
        frame to frame.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.scatter_px / self.predicted_px

    def sentences(self) -> list[str]:
        """Say it, a line each."""
        lines = [self._of_scatter()]
        if self.p_value is not None:
            lines.append(self._of_p_values())
        marked = ", ".join(f"{name} {count}" for name, count in self.flags.items())
        lines.append(f"Flags of {self.n_centroids} centroids: {marked or 'none'}.")
        if self.slope is not None:
            lines.append(self._of_slope())
        return lines

    def to_frame(self) -> pd.DataFrame:
        """Return one row for each coordinate: scatter, predicted, their ratio and its error."""
        import pandas as pd

        names = [f"{axis}{n + 1}" for n in range(len(self.ratio)) for axis in "xy"]
        return pd.DataFrame(
            {
                "scatter_px": self.scatter_px.ravel(),
                "predicted_px": self.predicted_px.ravel(),
                "ratio": self.ratio.ravel(),
                "ratio_error": np.repeat(self.ratio_error, 2),
            },
            index=names,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers, None for what is not known, as the report holds them."""
        p_value = self._known_p_values()
        return {
            "scatter_over_predicted": _plain(self.ratio),
            "its_sampling_error": _plain(self.ratio_error),
            "scatter_px": _plain(self.scatter_px),
            "predicted_px": _plain(self.predicted_px),
            "p_value_median": round(float(np.median(p_value)), 4) if p_value.size else None,
            "p_value_below_0.05": round(float(np.mean(p_value < 0.05)), 4)
            if p_value.size
            else None,
            "flags": self.flags,
            "slope_between_centroids": None if self.slope is None else _plain(self.slope.value),
            "its_error": None if self.slope is None else _plain(self.slope.error),
        }

    def _repr_html_(self) -> str:
        rows = [
            [name, *(f"{1e3 * v:.2f}" for v in row[:2]), *(f"{v:.2f}" for v in row[2:])]
            for name, *row in self.to_frame().itertuples()
        ]
        heads = ["", "scatter (mpx)", "predicted (mpx)", "ratio", "its error"]
        note = " ".join(self.sentences())
        return html_table("Belief", heads, rows[:6], count=len(rows), note=note)

    def _known_p_values(self) -> Floats:
        p_value = np.array([]) if self.p_value is None else self.p_value
        return p_value[np.isfinite(p_value)]

    def _of_scatter(self) -> str:
        known = np.isfinite(self.ratio) & np.isfinite(self.ratio_error)[:, None]
        if not known.any():
            return "Scatter over predicted error: too few frames to tell."
        ratio, error = self.ratio[known], float(np.nanmax(self.ratio_error))
        off = np.log(ratio) / np.broadcast_to(self.ratio_error[:, None], known.shape)[known]
        sure = -ndtri(_BY_CHANCE / 2 / off.size)  # of many coordinates, one strays by chance
        verdict = "as predicted"
        if off.max() > sure:
            verdict = "spots scatter more than predicted: they shake, or gain or noise is wrong"
        elif off.min() < -sure:
            verdict = (
                "spots scatter less than predicted: frames share their noise, or a centroid hardly "
                "follows its spot"
            )
        return (
            f"Scatter over predicted error: {ratio.min():.2f} to {ratio.max():.2f}, sampling error "
            f"{error:.2g}: {verdict}."
        )

    def _of_p_values(self) -> str:
        p_value = self._known_p_values()
        if not p_value.size:
            return "p-values of the leftover equations: none is known."
        return (
            f"p-values of the leftover equations: median {np.median(p_value):.2f}, "
            f"{100 * np.mean(p_value < 0.05):.0f} % below 0.05, of {p_value.size} frames; a camera "
            "that only turns spreads them evenly."
        )

    def _of_slope(self) -> str:
        if self.slope is None or not np.isfinite(self.slope.value):
            return "Slope between two centroids: the drift is too small to tell."
        return (
            f"Slope between two centroids: {self.slope.value:.4f} ± {self.slope.error:.4f}; other "
            "than one, one of them follows its window or a distorted spot."
        )


def second_differences(xy_px: Floats) -> tuple[Floats, Ints]:
    """Noise (n, 2) of places (F, n, 2) from second differences, and from how many (n,)."""
    if len(xy_px) < 3:
        return np.full(xy_px.shape[1:], np.nan), np.zeros(xy_px.shape[1], dtype=np.int64)
    steps = np.diff(xy_px, n=2, axis=0)
    count = np.isfinite(steps).all(axis=2).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(steps, axis=0) / count[:, None]
        scatter = np.sqrt(np.nansum((steps - mean) ** 2, axis=0) / count[:, None] / 6.0)
    return scatter, count


def drift_slope(shifts_px: Floats, other_px: Floats, sigma_px: Floats) -> Slope:
    """Slope of one series of shifts (F, n, 2) over another of the same frames.

    Each coordinate is counted from its own mean. Noise of the ``other`` lowers the slope by its
    share ``sigma_px`` squared of the drift's variance; that is added to the error.
    """
    both = np.isfinite(shifts_px) & np.isfinite(other_px)
    count = both.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        one, two = (
            np.where(both, s - np.nansum(np.where(both, s, 0.0), axis=0) / count, 0.0)
            for s in (shifts_px, other_px)
        )
        drift = float(np.sum(two**2))
        slope = float(np.sum(one * two)) / drift if drift > 0 else np.nan
        left = float(np.sum((one - slope * two) ** 2)) / max(int(both.sum()) - 1, 1)
        lowered = float(np.nansum(np.where(both, sigma_px, 0.0) ** 2)) / drift if drift > 0 else 1.0
    error = float(np.hypot(np.sqrt(left / drift), lowered)) if drift > 0 else np.nan
    return Slope(slope, error) if error < _TELLS else Slope(np.nan, np.nan)


def flags_by_name(flags: Ints) -> dict[str, int]:
    """How many bit fields carry each flag, of those that any carries."""
    counts = {str(flag.name): int(np.count_nonzero(flags & flag)) for flag in SpotFlag}
    return {name: count for name, count in counts.items() if count}


def sampling_error(count: Ints) -> Floats:
    """Relative error (n,) of a scatter from so many second differences, for white noise."""
    with np.errstate(divide="ignore"):
        error = np.sqrt(_PER_SAMPLE / np.maximum(count, 1))
    return np.where(count >= _FEWEST, error, np.nan)


def _plain(values: Floats | float) -> Any:
    if isinstance(values, np.ndarray):
        return (
            [_plain(each) for each in values.tolist()]
            if values.ndim < 2
            else [_plain(each) for each in values]
        )
    return round(values, 5) if np.isfinite(values) else None
