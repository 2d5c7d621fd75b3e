"""The compiled fits of picassosr on stamps, in its own environment, as it wants pandas below 3.

``python -m venv DIR``, ``DIR/bin/pip install picassosr``, and LOSBENCH_PICASSO=DIR/bin/python.
``python picasso_fit.py stamps.npz fits.npz``: photons (n, side, side) and the variance of a reading;
places (n, 2) from the middle, and seconds of processor time, by the fit of 0.11 and by the older one.
"""

import contextlib
import sys
import time
import warnings

import numpy as np

with contextlib.redirect_stdout(sys.stderr):  # it says at once which sounds it cannot play
    from picasso import gaussmle
    from picasso.fitting import gaussfit, seeds


def new(stamps, variance):
    """Levenberg-Marquardt on the Poisson likelihood, both widths free."""
    side = stamps.shape[1]
    first = seeds.initial_parameters_gauss(stamps, side)
    found = gaussfit.fit_spots(gaussfit.ELLIPTIC, stamps, first, mle=True, variance=variance)
    return found[0][:, 1:3] - side // 2


def old(stamps, _variance):
    """Newton on the Poisson likelihood of a Gaussian integrated over pixels."""
    found = gaussmle.gaussmle(stamps, 1e-3, 100, method="sigmaxy")
    return found[0][:, :2] - stamps.shape[1] // 2


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    given = np.load(sys.argv[1])
    stamps = given["photons"].astype(np.float32)
    variance = np.full_like(stamps, given["variance"])
    result = {}
    for name, fit in (("new", new), ("old", old)):
        xy, times = fit(stamps, variance), []  # the first call compiles
        for _ in range(7):
            begin = time.process_time()
            fit(stamps, variance)
            times.append(time.process_time() - begin)
        result |= {f"{name}_xy": xy, f"{name}_s": np.percentile(times, 20)}
    np.savez(sys.argv[2], **result)
