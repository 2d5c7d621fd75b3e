"""Table 2 on the twin: angles by LS and by IRLS, frame by frame and stacked."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.estimation.robust import irls, lstsq
from losbench.optics.camera import design_matrix
from losbench.papers.liu2026.results.centroiding import Constant, sampled
from losbench.papers.liu2026.scenario import Bench, ConstantBench
from losbench.pointing.attitude import solve_attitude
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "AXES",
    "TABLE_2",
    "contaminated_ratios",
    "frame_angles",
    "stacked_ratios",
    "table_2",
]


AXES = ("alpha", "beta", "gamma")
TABLE_2 = {
    "LS": {"rms": (0.26, 0.24, 0.48), "pv": (1.02, 0.91, 1.36)},
    "IRLS": {"rms": (0.21, 0.23, 0.39), "pv": (0.83, 0.78, 1.05)},
}


def frame_angles(
    run: Constant, setting: ConstantBench, *, method: str, scale: str = "std"
) -> Floats:
    """Angles of every frame in arcseconds, (F, 3), from the EIWA centroids: eq. (7) or eq.
    (8)-(10), to the letter.
    """
    matrix = design_matrix(setting.points_mm, "paper")
    shifts = (run.eiwa_px - run.eiwa_px[0]) * setting.camera.pixel_mm
    y = shifts.reshape(len(shifts), -1)
    fit = lstsq(matrix, y) if method == "LS" else irls(matrix, y, scale=scale, on_fail="ignore")
    return rad_to_arcsec(fit.x)


def table_2(run: Constant, setting: ConstantBench) -> pd.DataFrame:
    """Table 2: RMS and PV of the angles of 100 frames in arcseconds, the twin's and the paper's."""
    import pandas as pd

    rows = []
    for method, printed in TABLE_2.items():
        angles = frame_angles(run, setting, method=method)
        for statistic, (mean, error) in sampled(angles, setting.sample, seed=setting.seed).items():
            rows += [
                {
                    "method": method,
                    "statistic": statistic,
                    "angle": a,
                    "twin": m,
                    "sampling_error": e,
                    "paper": p,
                }
                for a, m, e, p in zip(AXES, mean, error, printed[statistic], strict=True)
            ]
    return pd.DataFrame(rows).set_index(["method", "statistic", "angle"]).sort_index()


def stacked_ratios(shifts_mm: Floats, setting: Bench, *, stack: int, scale: str = "std") -> Floats:
    """RMS of IRLS over RMS of LS, (3,), when ``stack`` frames (F, 2, 2) share one solve; one weight
    per element.
    """
    solve = partial(solve_attitude, setting.points_mm, shifts_mm, model="paper", stack=stack)
    robust, least = solve(method="irls", scale=scale, group=None, max_iter=1000), solve(method="ls")
    return robust.angles.std(axis=0) / least.angles.std(axis=0)


def contaminated_ratios(
    setting: Bench,
    *,
    share: float,
    size: float,
    what: str,
    scale: str = "std",
    stack: int = 10,
    blocks: int = 4000,
    seed: int,
) -> Floats:
    """IRLS over LS in RMS, (3,), for unit noise of which a ``share`` is off by ``size`` sigma,
    either way.

    Parameters
    ----------
    setting : Bench
        Gives the layout of the spots.
    share, size : float
        Fraction of bad frames, or of bad elements, and by how many sigma they are off.
    what : "frames" or "elements"
        Whether all four elements of a frame go bad together, each with its own sign, or each on its
        own.
    scale, stack
        As for `stacked_ratios`.
    blocks : int
        Solves; the ratio is known to about 1 / sqrt(blocks).
    seed : int
        Seed of the noise.
    """
    rng = np.random.default_rng(seed)
    shape = (blocks * stack, 2, 2)
    bad = rng.random((shape[0], 1, 1) if what == "frames" else shape) < share
    noise = rng.standard_normal(shape) + size * bad * rng.choice([-1.0, 1.0], shape)
    return stacked_ratios(noise * setting.camera.pixel_mm * 1e-2, setting, stack=stack, scale=scale)
