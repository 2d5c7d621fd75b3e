"""statsmodels' RLM, made to converge: the outside reference for `irls`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import choice, finite

__all__ = ["statsmodels_rlm"]


def statsmodels_rlm(A: ArrayLike, y: ArrayLike, *, c: float = 1.345, scale: str = "mad") -> Floats:
    """Solve one system by statsmodels' RLM with Huber's loss, to convergence.

    RLM's own stopping rule depends on the unit of y and its custom scale is broken in 0.14; both
    are put right here, so that what differs from `irls` is the algorithm alone. A few milliseconds
    a system: it knows no batches.

    Parameters
    ----------
    A : (n, p) array
        Design matrix.
    y : (n,) array
        Observations.
    c : float
        Huber's constant.
    scale : "mad" or "std"
        Median absolute residual over 0.6745 (its own), or population standard deviation (liu2026).

    Returns
    -------
    (p,) array

    Examples
    --------
    >>> import losbench as lb
    >>> A = np.stack([np.ones(9), np.arange(9.0)], axis=-1)
    >>> y = np.array([1.0, 3.1, 4.9, 7.2, 8.8, 40.0, 13.1, 14.8, 17.2])
    >>> bool(np.abs(statsmodels_rlm(A, y) - lb.irls(A, y).x).max() < 1e-9)
    True
    """
    from statsmodels.robust.norms import HuberT
    from statsmodels.robust.robust_linear_model import RLM

    class PopulationScale(RLM):  # type: ignore[misc]
        def _estimate_scale(self, resid: Floats, *_: object) -> float:
            return float(np.std(resid))

    kind = {"mad": RLM, "std": PopulationScale}[choice("scale", scale, ("mad", "std"))]
    model = kind(finite("y", y, ndim=1), finite("A", A, ndim=2), M=HuberT(c))
    return np.asarray(model.fit(conv="coefs", tol=1e-13, maxiter=5000).params)
