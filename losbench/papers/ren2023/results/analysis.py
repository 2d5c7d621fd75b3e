"""What the paper does not ask: which reading closes, what the sliding mean leaks, and what else
moves the angle.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from losbench.arrays import Floats
from losbench.estimation.stability import split_error
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.papers.ren2023.twin import attitude_error, body_attitude, simulate
from losbench.pointing.starcamera import boresight_angle, drift_from_spots, interpolate_attitude
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["budget", "closure", "split_table"]


def closure(
    total: float, nea: float, lsfe: float, windows: tuple[int, ...] = (3, 5, 7, 9)
) -> pd.DataFrame:
    """What LSFE a total error and an NEA of one camera leave room for, reading by reading; all
    arcsec, 3 sigma.

    White noise of NEA and an independent slow error add up to the total; the mean of w samples
    keeps the slow error and NEA^2 / w of the noise. Were NEA the residual 3 std(e - m), LSFE and
    NEA alone would make the total.

    Returns
    -------
    DataFrame
        One row per reading: LSFE predicted, LSFE printed, their difference.
    """
    import pandas as pd

    slow = total**2 - nea**2
    rows = [
        {"NEA": "epoch difference", "window": w, "LSFE predicted": np.sqrt(slow + nea**2 / w)}
        for w in windows
    ]
    rows.append({"NEA": "residual", "window": 5, "LSFE predicted": np.sqrt(slow)})
    rows.append(
        {"NEA": "epoch difference, LSFE unbiased", "window": 5, "LSFE predicted": np.sqrt(slow)}
    )
    table = pd.DataFrame(rows).assign(**{"LSFE printed": lsfe})
    table["difference"] = table["LSFE predicted"] - lsfe
    return table.set_index("NEA")


def split_table(
    setting: Pair,
    *,
    windows: tuple[int, ...] = (3, 5, 9, 21),
    correlations_s: tuple[float, ...] = (5.0, 15.0, 30.0),
    tracks: int = 100,
    seed: int = 1,
) -> pd.DataFrame:
    """Both forms of LSFE and NEA against the truth that was simulated, over window lengths and
    correlation times.

    Parameters
    ----------
    setting : Pair
        One of its cameras is simulated; track length and rate are its own.
    windows, correlations_s : tuples
        What to try.
    tracks : int
        Independent tracks per case.
    seed : int
        Of the tracks.

    Returns
    -------
    DataFrame
        Means over the tracks in units of the truth: the paper's LSFE, the unbiased one, its mean
        stated uncertainty and its actual scatter, the share of tracks within one and two stated
        sigma; the same for NEA where it differs.
    """
    import pandas as pd

    rows = []
    for correlation in correlations_s:
        case = replace(setting, correlation_s=correlation, days=tuple(map(float, range(tracks))))
        error = attitude_error(case, np.random.default_rng(seed))[0, :, 0].reshape(tracks, -1).T
        series = rad_to_arcsec(error)
        for window in windows:
            paper, fair = (
                split_error(series, window=window, unbiased=unbiased) for unbiased in (False, True)
            )
            miss = np.abs(fair.lsfe - setting.lsfe_arcsec) / fair.lsfe_sigma
            noise_miss = np.abs(fair.nea - setting.nea_arcsec) / fair.nea_sigma
            rows.append(
                {
                    "correlation_s": correlation,
                    "window": window,
                    "LSFE paper": _mean_square(paper.lsfe) / setting.lsfe_arcsec,
                    "LSFE unbiased": _mean_square(fair.lsfe) / setting.lsfe_arcsec,
                    "stated +-": fair.lsfe_sigma.mean() / setting.lsfe_arcsec,
                    "scatter": fair.lsfe.std() / setting.lsfe_arcsec,
                    "within 1": (miss < 1).mean(),
                    "within 2": (miss < 2).mean(),
                    "NEA unbiased": _mean_square(fair.nea) / setting.nea_arcsec,
                    "NEA within 1": (noise_miss < 1).mean(),
                }
            )
    return pd.DataFrame(rows).set_index(["correlation_s", "window"])


def budget(setting: Pair) -> pd.DataFrame:
    """What else moves the angle by as much as the drift: computed, one effect at a time, on
    noise-free attitudes.

    Returns
    -------
    DataFrame
        Effect, its size, and what it does to the angle in arcsec (as ``what`` says: peak to valley,
        shift, 3 sigma).
    """
    import pandas as pd

    quiet = replace(setting, lsfe_arcsec=0.0, nea_arcsec=0.0, days=setting.days[-1:])
    t = quiet.time_s
    body = body_attitude(quiet, t)
    heads = [(body * axes).as_quat() for axes in quiet.axes]
    angle = _angle(*heads)

    late = interpolate_attitude(t, heads[1], t[8:-8] + 1e-3, convention=CONVENTION)
    shift = _angle(heads[0][8:-8], late) - angle[8:-8]
    pitch_along_normal = 1e-3 * 2 * np.pi / setting.orbit_s
    rounded = {d: _angle(*(np.round(q, d) for q in heads)) - angle for d in (6, 8)}
    moved = simulate(quiet, aberration=True).telemetry.quaternions
    still = simulate(quiet).telemetry.quaternions
    aberration = _angle(*moved) - _angle(*still)
    rows = [
        ("time tags 1 ms apart", "this pair, peak to valley", np.ptp(shift)),
        (
            "time tags 1 ms apart",
            "at most, pitch about the common normal",
            float(rad_to_arcsec(pitch_along_normal)),
        ),
        ("quaternions with 6 decimals", "3 sigma", 3 * rounded[6].std()),
        ("quaternions with 8 decimals", "3 sigma", 3 * rounded[8].std()),
        ("stellar aberration left in", "peak to valley in a track", np.ptp(aberration)),
        (
            "focal length +10 ppm, spots on one side",
            "false drift",
            _focal_error(setting, straddle=False),
        ),
        (
            "focal length +10 ppm, spots astride the axis",
            "false drift",
            _focal_error(setting, straddle=True),
        ),
        ("angle by 2 acos(w)", "returns 0 below", _acos_limit()),
    ]
    return pd.DataFrame(rows, columns=["effect", "what", "arcsec"]).set_index("effect")


def _focal_error(setting: Pair, *, straddle: bool) -> float:
    points = setting.points_mm.copy()
    if not straddle:
        points[1, 0] *= -1.0
    return float(np.abs(drift_from_spots(points, 1e-5 * points[:, :2]).delta_arcsec).max())


def _acos_limit() -> float:
    """Largest angle whose quaternion has a scalar part that rounds to one."""
    angles = np.geomspace(1e-9, 1e-6, 4000)
    scalar = Rotation.from_rotvec(angles[:, None] * [1.0, 0.0, 0.0]).as_quat()[:, 3]
    return float(rad_to_arcsec(angles[2 * np.arccos(scalar) == 0].max()))


def _angle(first: Floats, second: Floats) -> Floats:
    return rad_to_arcsec(boresight_angle(first, second, convention=CONVENTION))


def _mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
