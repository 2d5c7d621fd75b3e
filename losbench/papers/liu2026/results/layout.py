"""Table 2 as an inverse problem: the layouts of two spots that give the printed numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from losbench.arrays import Floats
from losbench.checks import choice, integer
from losbench.papers.liu2026.results.angles import AXES, TABLE_2
from losbench.papers.liu2026.results.centroiding import TABLE_1
from losbench.papers.liu2026.results.twospots import two_spot_angles
from losbench.units import rad_to_arcsec

__all__ = [
    "STATISTICS",
    "LayoutFit",
    "LayoutModel",
    "fit_table_2",
    "table_2_statistics",
]

_HALF_SENSOR_MM = np.array([9.6, 5.4])
_SAMPLE = 100  # frames behind a cell of Table 2

STATISTICS = (
    *("LS RMS alpha", "LS RMS beta"),
    *(f"IRLS/LS {s} {a}" for s in ("RMS", "PV") for a in AXES),
    *(f"LS PV/RMS {a}" for a in AXES),
    "LS RMS gamma",
)
"""The twelve statistics that Table 2 is read as; the first eight are fitted."""
FITTED = 8
_FORMS = ("gaussian", "outliers", "sinusoid")


def table_2_prints(angles_ls: Floats, angles_irls: Floats) -> Floats:
    """Logarithms of the twelve cells of Table 2, (B, 12), for blocks of angles (B, n, 3).

    In the order LS RMS, LS PV, IRLS RMS, IRLS PV, each for alpha, beta and gamma.
    """
    parts = [
        statistic(angles, axis=1)
        for angles in (angles_ls, angles_irls)
        for statistic in (np.std, np.ptp)
    ]
    return np.log(np.concatenate(parts, axis=-1))


def _statistics_matrix() -> Floats:
    """Rows of `STATISTICS` over the twelve logarithms of `table_2_prints`."""
    rms_ls, pv_ls, rms_irls, pv_irls = np.eye(12).reshape(4, 3, 12)
    return np.concatenate(
        [rms_ls[:2], rms_irls - rms_ls, pv_irls - pv_ls, pv_ls - rms_ls, rms_ls[2:]]
    )


def _printed() -> tuple[Floats, Floats]:
    """Logarithms of the printed cells and their variance by rounding to 0.01 arcsec."""
    cells = np.concatenate([TABLE_2[m][s] for m in ("LS", "IRLS") for s in ("rms", "pv")])
    return np.log(cells), (0.01 / cells) ** 2 / 12


def table_2_statistics() -> tuple[Floats, Floats]:
    """The twelve statistics as printed, as logarithms, and their covariance by rounding."""
    cells, rounding = _printed()
    matrix = _statistics_matrix()
    return matrix @ cells, (matrix * rounding) @ matrix.T


@dataclass(frozen=True)
class LayoutFit:
    """Where two spots must stand to give Table 2.

    Attributes
    ----------
    middle_mm : (2,) array
        Middle of both spots from the axis.
    baseline_deg : float
        Direction from B to A, from the x axis.
    separation_mm : float
        Distance between them.
    correlation : (2,) array
        Of A's and B's centroids along x and along y; zero unless fitted.
    chi2 : float
        Over the eight fitted statistics, with their full covariance.
    parameters : int
    mean, covariance : (12,), (12, 12) arrays
        The model's `STATISTICS` as logarithms, and the scatter of a hundred frames.
    """

    middle_mm: Floats
    baseline_deg: float
    separation_mm: float
    correlation: Floats
    chi2: float
    parameters: int
    mean: Floats
    covariance: Floats

    @property
    def dof(self) -> int:
        """Return the degrees of freedom left."""
        return FITTED - self.parameters

    @property
    def p_value(self) -> float:
        """Return the chance of a chi-square as large, were the reading right."""
        return float(chdtrc(self.dof, self.chi2))

    @property
    def points_mm(self) -> Floats:
        """Return the places of A and B, (2, 2)."""
        return _points(self.middle_mm, self.baseline_deg, self.separation_mm)

    @property
    def on_sensor(self) -> bool:
        """Return whether both spots lie on the 19.2 by 10.8 mm of section 3.1."""
        return bool((np.abs(self.points_mm) <= _HALF_SENSOR_MM + 0.05).all())

    @property
    def pulls(self) -> Floats:
        """Return printed less model over sigma, for all twelve `STATISTICS`."""
        printed, rounding = table_2_statistics()
        return (printed - self.mean) / np.sqrt(np.diag(self.covariance + rounding))

    @property
    def misfit(self) -> tuple[Floats, Floats]:
        """Return printed less model of the fitted statistics, (8,), and its covariance."""
        printed, rounding = table_2_statistics()
        return (printed - self.mean)[:FITTED], (self.covariance + rounding)[:FITTED, :FITTED]

    @property
    def shape_p_value(self) -> float:
        """Return the chance of PV over RMS as far from the model's as printed, three axes of LS."""
        printed, rounding = table_2_statistics()
        part = slice(FITTED, FITTED + 3)
        rest = (printed - self.mean)[part]
        spread = (self.covariance + rounding)[part, part]
        return float(chdtrc(3, rest @ np.linalg.solve(spread, rest)))

    def cells(self) -> tuple[Floats, Floats]:
        """Return the model's twelve cells of Table 2 in arcseconds, and their sampling errors.

        In the order LS RMS, LS PV, IRLS RMS, IRLS PV, each for alpha, beta and gamma.
        """
        back = np.linalg.inv(_statistics_matrix())
        value = np.exp(back @ self.mean)
        return value, value * np.sqrt(np.diag(back @ self.covariance @ back.T))

    @property
    def gamma_factor(self) -> float:
        """Return how many times larger than printed the model's RMS of gamma is."""
        return float(np.exp(self.mean[-1] - table_2_statistics()[0][-1]))


@dataclass(frozen=True)
class LayoutModel:
    """What two spots make of Table 1's scatter: the same random frames for every layout.

    Parameters
    ----------
    column : str
        Of `TABLE_1`, whose RMS the centroids get: "eiwa", "eiwa in the text" or "grey".
    scale : "run" or "frame"
        Where Huber's c comes from, as in `two_spot_angles`.
    pixel_um, focal_mm, separation_mm : float
        The distance of the spots is that of 1.1914 degrees, unless told.
    form : "gaussian", "outliers" or "sinusoid"
        Frames independent; 2 % of the elements five times larger; or A along x as Student's t with
        four degrees of freedom and B along x a sinusoid of random phase in each block that carries
        0.96 of the variance. The RMS is that of the column in each case.
    blocks : int
        Blocks of 100 frames.
    seed : int
    """

    column: str = "eiwa"
    scale: str = "run"
    pixel_um: float = 10.0
    focal_mm: float = 260.0
    separation_mm: float = 5.406
    form: str = "gaussian"
    blocks: int = 300
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse readings that are not known."""
        choice("column", self.column, TABLE_1)
        choice("scale", self.scale, ("run", "frame"))
        choice("form", self.form, _FORMS)
        integer("blocks", self.blocks, low=30)

    @cached_property
    def unit(self) -> Floats:
        """Return noise of unit variance, (blocks, 100, 2, 2): spots, then x and y."""
        rng = np.random.default_rng(self.seed)
        shape = (self.blocks, _SAMPLE, 2, 2)
        noise = rng.standard_normal(shape)
        if self.form == "outliers":
            noise *= np.where(rng.random(shape) < 0.02, 5.0, 1.0) / np.sqrt(1 + 0.02 * 24)
        if self.form == "sinusoid":
            noise[:, :, 0, 0] = rng.standard_t(4, shape[:2]) / np.sqrt(2.0)
            # A phase for each block: with one for all the blocks would not scatter.
            phase = 2 * np.pi * (rng.random((self.blocks, 1)) + 0.0373 * np.arange(_SAMPLE))
            noise[:, :, 1, 0] *= np.sqrt(1 - 0.96)
            noise[:, :, 1, 0] += np.sqrt(2 * 0.96) * np.sin(phase)
        return noise

    def points_of(self, place: Floats) -> Floats:
        """Return the places of A and B on the sensor, (2, 2)."""
        return _points(place[:2], place[2], place[3] if len(place) > 3 else self.separation_mm)

    def blocks_of(self, place: Floats) -> tuple[Floats, Floats]:
        """Angles (blocks, 100, 3) in arcseconds by LS and by IRLS at a place.

        ``place`` holds the middle x and y in mm, the direction in degrees, and perhaps the
        distance in mm and the correlations along x and y.
        """
        noise = self.unit
        if len(place) > 3:
            r = np.asarray(place[4:6])
            b = r * noise[:, :, 0] + np.sqrt(1 - r**2) * noise[:, :, 1]
            noise = np.stack([noise[:, :, 0], b], axis=2)
        rms_mm = np.reshape(TABLE_1[self.column]["rms"], (2, 2)) * self.pixel_um * 1e-3
        points = self.points_of(place)
        shifts = (noise * rms_mm).reshape(-1, 2, 2)
        ls, irls = (
            rad_to_arcsec(two_spot_angles(points, shifts, focal_mm=self.focal_mm, scale=scale))
            for scale in (None, self.scale)
        )
        return ls.reshape(self.blocks, _SAMPLE, 3), irls.reshape(self.blocks, _SAMPLE, 3)

    def statistics(self, place: Floats) -> Floats:
        """Logarithms of the twelve `STATISTICS` of each block, (blocks, 12)."""
        return table_2_prints(*self.blocks_of(place)) @ _statistics_matrix().T

    def fit(self, start: Floats, rounds: int = 3) -> LayoutFit:
        """Improve a place by Gauss-Newton, the covariance taken anew in each round."""
        printed, rounding = table_2_statistics()
        place, part = np.array(start, dtype=np.float64), slice(0, FITTED)
        low, high = _limits(len(place))
        for _ in range(rounds):
            values = self.statistics(place)
            whiten = np.linalg.inv(np.linalg.cholesky((np.cov(values.T) + rounding)[part, part]))

            def misfit(at: Floats, whiten: Floats = whiten) -> Floats:
                rest = whiten @ (printed - self.statistics(at).mean(axis=0))[part]
                # A wall at the sensor's edge, a sigma for each 0.05 mm beyond.
                beyond = np.maximum(np.abs(self.points_of(at)) - _HALF_SENSOR_MM, 0.0)
                return np.append(rest, beyond.ravel() / 0.05)

            # Steps of PV are small kinks: a difference over 1e-3 looks past them.
            place = least_squares(
                misfit,
                place,
                bounds=(low, high),
                diff_step=[1e-3] * len(place),
                x_scale=_SCALE[: len(place)],
                xtol=1e-5,
                ftol=1e-5,
                max_nfev=25,
            ).x
        return self.at(place)

    def at(self, place: Floats) -> LayoutFit:
        """Judge a place as it is."""
        printed, rounding = table_2_statistics()
        values = self.statistics(place)
        mean, covariance = values.mean(axis=0), np.cov(values.T)
        rest = (printed - mean)[:FITTED]
        chi2 = rest @ np.linalg.solve((covariance + rounding)[:FITTED, :FITTED], rest)
        free = len(place) > 3
        return LayoutFit(
            middle_mm=place[:2],
            baseline_deg=float(place[2]),
            separation_mm=float(place[3]) if free else self.separation_mm,
            correlation=place[4:6] if free else np.zeros(2),
            chi2=float(chi2),
            parameters=len(place),
            mean=mean,
            covariance=covariance,
        )

    def search(self, tries: int = 300, keep: int = 4, seed: int = 1) -> list[Floats]:
        """Return the best of random places on the sensor, to begin with."""
        rng = np.random.default_rng(seed)
        few = replace(self, blocks=30)
        places = rng.uniform([-9.6, -5.4, -180.0], [9.6, 5.4, 180.0], (tries, 3))
        chi2 = [few.at(place).chi2 for place in places]
        return [places[k] for k in np.argsort(chi2)[:keep]]


def fit_table_2(
    column: str = "eiwa",
    *,
    scale: str = "run",
    pixel_um: float = 10.0,
    separation_mm: float = 5.406,
    form: str = "gaussian",
    correlated: bool = False,
    start: tuple[float, ...] | None = None,
    blocks: int = 300,
) -> LayoutFit:
    """Fit the place of two spots to the levels of alpha and beta and the six ratios of Table 2.

    Parameters
    ----------
    column, scale, pixel_um, separation_mm, form, blocks
        As for `LayoutModel`.
    correlated : bool
        Fit the distance and the correlations of A with B along x and along y too.
    start : tuple, optional
        Middle x and y in mm and direction from B to A in degrees, in place of a search; with
        ``correlated`` perhaps also the distance in mm and both correlations.

    Returns
    -------
    LayoutFit

    Raises
    ------
    ValueError
        If a column, form or scale is not known.

    Examples
    --------
    >>> fit = fit_table_2(start=(6.7, 2.0, 150.0), blocks=60)
    >>> fit.dof, fit.chi2 < 20.0, fit.gamma_factor > 15.0
    (5, True, True)
    """
    model = LayoutModel(
        column, scale, pixel_um=pixel_um, separation_mm=separation_mm, form=form, blocks=blocks
    )
    starts = [np.array(start)] if start else model.search()
    if correlated and len(starts[0]) == 3:
        starts = [np.append(one, [separation_mm, 0.0, 0.0]) for one in starts]
    return min((model.fit(one) for one in starts), key=lambda fit: fit.chi2)


_SCALE = np.array([1.0, 1.0, 10.0, 1.0, 0.3, 0.3])


def _limits(count: int) -> tuple[Floats, Floats]:
    high = np.array([9.6, 5.4, 360.0, 22.0, 0.95, 0.95])[:count]
    low = np.array([-9.6, -5.4, -360.0, 0.5, -0.95, -0.95])[:count]
    return low, high


def _points(middle_mm: Floats, baseline_deg: float, separation_mm: float) -> Floats:
    turn = np.radians(baseline_deg)
    half = separation_mm / 2 * np.array([np.cos(turn), np.sin(turn)])
    return np.stack([middle_mm + half, middle_mm - half])
