"""What a recording says, frame by frame, and whether to believe it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats, Ints
from losbench.display import html_table, with_error
from losbench.imaging.results import flag_counts
from losbench.pointing.attitude import AttitudeFit
from losbench.recording.belief import (
    Belief,
    drift_slope,
    flags_by_name,
    sampling_error,
    second_differences,
)

if TYPE_CHECKING:
    import pandas as pd

    from losbench.recording.survey import Survey

__all__ = ["Measurement"]


@dataclass(frozen=True)
class Measurement:
    """What a recording says, frame by frame.

    Attributes
    ----------
    xy_px, sigma_xy_px : (F, n, 2) arrays
        Spot positions on the detector and their predicted one-sigma errors; NaN where a spot was
        lost.
    flags : (F, n) array
        `SpotFlag` bits of each spot.
    shifts_px, sigma_shifts_px : (F, n, 2) arrays
        Displacement from the reference, the reference's own error included.
    reference_px : (n, 2) array
        Reference positions.
    attitude : AttitudeFit or None
        Angles in radians with covariance; None without a camera.
    table : DataFrame
        One row a frame: time, temperatures, positions, shifts, angles in arcseconds with one-sigma
        errors.
    notes : tuple of str
        What the reader of the table must know, a line each.
    surveys : tuple of Survey
        For each stamp, what was fixed beforehand: window, width, noise, expected places.
    """

    xy_px: Floats
    sigma_xy_px: Floats
    flags: Ints
    shifts_px: Floats
    sigma_shifts_px: Floats
    reference_px: Floats
    attitude: AttitudeFit | None
    table: pd.DataFrame
    notes: tuple[str, ...]
    surveys: tuple[Survey, ...] = ()

    def belief(self, other: Measurement | None = None) -> Belief:
        """Say what the data themselves tell of these numbers, without the truth.

        Parameters
        ----------
        other : Measurement, optional
            Of the same frames and spots by another centroid; NaN in frames that it left out.

        Returns
        -------
        Belief
            Scatter over predicted error by second differences, p-values of the leftover equations,
            flags by name, and against ``other`` the slope of the drift.

        Raises
        ------
        ValueError
            If ``other`` has another number of frames or spots.

        Examples
        --------
        >>> import losbench as lb
        >>> light = lb.render_spots([[20.0, 15.0]], 5e4, 2.0, (32, 48)) + 100.0
        >>> frames = lb.Detector(read_noise_e=5.0).expose(np.stack([light] * 40), 1)
        >>> lb.measure(lb.read_recording(frames), spots=[[20, 15]]).belief().ratio.shape
        (1, 2)
        """
        if other is not None and other.xy_px.shape != self.xy_px.shape:
            raise ValueError(
                f"other must be of the same frames and spots, {self.xy_px.shape[:2]}, got "
                f"{other.xy_px.shape[:2]}"
            )
        scatter, count = second_differences(self.xy_px)
        seen = np.isfinite(self.sigma_xy_px)
        with np.errstate(invalid="ignore"):
            predicted = np.sqrt(np.nansum(self.sigma_xy_px**2, axis=0) / seen.sum(axis=0))
        return Belief(
            scatter_px=scatter,
            predicted_px=predicted,
            ratio_error=sampling_error(count),
            flags=flags_by_name(self.flags),
            n_centroids=self.flags.size,
            p_value=None if self.attitude is None else self.attitude.p_value,
            slope=None
            if other is None
            else drift_slope(other.shifts_px, self.shifts_px, self.sigma_xy_px),
        )

    def to_frame(self) -> pd.DataFrame:
        """Return the table."""
        return self.table

    def _repr_html_(self) -> str:
        """Return the first frames with their errors, and how many centroids carry which flag."""
        n_frames, n_spots = self.flags.shape
        shown = min(n_spots, 2)
        heads = ["frame", *(f"d{axis}{n + 1} (px)" for n in range(shown) for axis in "xy")]
        names = ("alpha", "beta", "gamma") if self.attitude is not None else ()
        heads += [f"{name} (arcsec)" for name in names]
        rows = (
            [
                k,
                *(
                    with_error(self.shifts_px[k, n, i], self.sigma_shifts_px[k, n, i])
                    for n in range(shown)
                    for i in range(2)
                ),
                *(
                    with_error(*self.table.loc[k, [f"{name}_arcsec", f"sigma_{name}_arcsec"]])
                    for name in names
                ),
            ]
            for k in range(n_frames)
        )
        note = flag_counts(self.flags)
        title = f"{n_spots} spots in {n_frames} frames"
        return html_table(title, heads, rows, count=n_frames, note=note)
