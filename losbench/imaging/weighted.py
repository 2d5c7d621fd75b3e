"""The optimal weighted centroid: a Gaussian template of known width, each pixel weighted by the
inverse of its variance.
"""

from __future__ import annotations

from dataclasses import dataclass

from losbench.imaging.common import TemplateFields
from losbench.imaging.protocols import Estimate, Windows
from losbench.imaging.template import fit_template

__all__ = ["Weighted"]


@dataclass(frozen=True)
class Weighted(TemplateFields):
    """Weigh each pixel by a Gaussian template and the inverse of its variance.

    For round spots, it reaches the Cramer-Rao bound, if the width is right.

    Parameters
    ----------
    width : float, (2,) or (n, 2) array, pixels, optional
        Sigma of the template, along x and y. By default what fits best: the median over frames for
        a spot that four frames show well, else the median of the call, weighted by information. One
        faint or undersampled star does not tell its width.
    window : odd int or (n,) of them, pixels, optional
        Side N of the window, or of that of each spot; see `centroid` for the default.
    tolerance : float, pixels
        A fit is done when the square of a step, which is about what it leaves, is shorter.
    max_iter : int
        Steps before it counts as not converged.
    centre, hot_pixel_gate, smooth
        As for `EIWA`.

    Raises
    ------
    ValueError
        If the window is even, or another field is out of range.

    Notes
    -----
    The error is that of the information in the window, with the error of the background plane; it
    does not know how far a spot is from a Gaussian.

    Examples
    --------
    >>> import losbench as lb
    >>> image = lb.render_spots([[20.3, 15.8]], 1e4, 2.0, (40, 50))
    >>> lb.centroid(image, [[20, 16]], method=lb.Weighted(2.0, window=13)).xy.round(2).tolist()
    [[20.3, 15.8]]
    """

    def measure(self, windows: Windows) -> Estimate:
        """Fit flux and place of a Gaussian of known width to each window.

        With the information error. A fit that leaves the middle pixel by more than a pixel stops
        there, not converged.
        """
        fit = fit_template(windows, tolerance=self.tolerance, max_iter=self.max_iter)
        return fit.estimate(windows)
