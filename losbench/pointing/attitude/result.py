"""What an attitude solve hands back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from losbench.arrays import Bools, Floats, Ints
from losbench.display import html_table, table, with_error
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AttitudeFit"]

_ANGLES = ("alpha", "beta", "gamma")


@dataclass(frozen=True)
class AttitudeFit:
    """Angles of each solve, and how far to trust them; a solve takes one frame, or K with stack=K.

    Attributes
    ----------
    angles : (..., 3) array
        Rotation vector (alpha, beta, gamma), radians; NaN where too few spots were seen.
    cov : (..., 3, 3) array
        Covariance of the angles, radians squared.
    residuals : (..., n, 2) array
        Model minus shift of every spot of every frame, unit of the shifts; NaN where the spot is
        missing.
    weights : (..., n, 2) array
        Robust weight of every shift, 1 for least squares, 0 where the spot is missing.
    leverage : (..., n, 2) array
        Part of its own error that a shift puts into the fit; 1 - leverage is its redundancy number.
        NaN where missing.
    redundancy : (...) int array
        Shifts beyond the three needed; below zero where too few spots were seen.
    p_value : (...) array
        Probability of residuals at least as large as those of least squares if ``sigma`` is right
        and no spot is bad (chi-square test); NaN without sigma.
    scale : (...) array
        Residual scale: unit of the shifts, or of sigma where that was given.
    converged, ok : (...) bool arrays
        Whether the iteration settled; whether enough spots were seen.
    """

    angles: Floats
    cov: Floats
    residuals: Floats
    weights: Floats
    leverage: Floats
    redundancy: Ints
    p_value: Floats
    scale: Floats
    converged: Bools
    ok: Bools

    @property
    def std_error(self) -> Floats:
        """One-sigma errors of the angles (..., 3), radians."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    @property
    def angles_arcsec(self) -> Floats:
        """The angles (..., 3) in arcseconds."""
        return rad_to_arcsec(self.angles)

    @property
    def std_error_arcsec(self) -> Floats:
        """One-sigma errors of the angles (..., 3) in arcseconds."""
        return rad_to_arcsec(self.std_error)

    def to_frame(self) -> pd.DataFrame:
        """Return a pandas table with one row per solve: the angles and their errors in arcseconds,
        and how far to trust them.
        """
        columns: dict[str, Any] = {}
        for k, name in enumerate(_ANGLES):
            columns[f"{name}_arcsec"] = self.angles_arcsec[..., k]
            columns[f"sigma_{name}_arcsec"] = self.std_error_arcsec[..., k]
        for name, values in (
            ("redundancy", self.redundancy),
            ("p_value", self.p_value),
            ("scale", self.scale),
            ("converged", self.converged),
            ("ok", self.ok),
        ):
            columns[name] = values
        return table(columns, axes=["solve"])

    def _repr_html_(self) -> str:
        batch = self.angles.shape[:-1]
        settled = int(np.count_nonzero(self.converged))
        title = f"AttitudeFit: {self.ok.size} solves, {settled} converged; arcseconds"
        rows = (
            (
                ", ".join(map(str, at)),
                *map(
                    with_error,
                    self.angles_arcsec[at].tolist(),
                    self.std_error_arcsec[at].tolist(),
                ),
                "" if np.isnan(self.p_value[at]) else f"{self.p_value[at]:.2g}",
                self._trouble(at),
            )
            for at in np.ndindex(batch)
        )
        heads = ["solve", *_ANGLES, "p-value", ""]
        return html_table(title, heads, rows, count=self.ok.size)

    def _trouble(self, at: tuple[int, ...]) -> str:
        if not self.ok[at]:
            return "too few spots"
        return "" if self.converged[at] else "not converged"
