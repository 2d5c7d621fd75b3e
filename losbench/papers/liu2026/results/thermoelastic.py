"""What a thermo-elastic camera makes of the warm-up: materials, one lag against the model's own
parameters, where to put thermometers, and a budget that closes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from losbench.arrays import Floats
from losbench.optics.camera import design_matrix
from losbench.optics.jacobian import los_angles, los_jacobian
from losbench.papers.liu2026.camerabench import CameraBench
from losbench.pointing.thermal import fit_sensitivity
from losbench.thermoelastic.camera import ThermoelasticCamera
from losbench.thermoelastic.heat import Heat
from losbench.thermoelastic.loads import Power
from losbench.thermoelastic.model import MATERIAL_SETS
from losbench.thermoelastic.reduced import ReducedHeat
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "UncertainCamera",
    "budget",
    "left_over",
    "material_drifts",
    "one_lag",
    "own_parameters",
    "sensor_places",
]

_AXES = ["alpha", "beta", "gamma"]
_EVERY_S = 30.0
_CENTROID_PX = 0.02


def material_drifts(setting: CameraBench) -> pd.DataFrame:
    """Drift of the line of sight and of focus over the warm-up, for each of the `MATERIAL_SETS`.

    Returns
    -------
    DataFrame
        Peak to valley of alpha and beta, arcsec, and of focus, um; alpha per degree at rest.
    """
    import pandas as pd

    time = np.arange(0.0, setting.duration_s + 1e-9, _EVERY_S)
    rows = {}
    for name in MATERIAL_SETS:
        camera = replace(setting, materials=name, model=None).chain
        run = camera.simulate(time, {"room_degC": setting.room_degC(time)})
        alpha, beta, _ = rad_to_arcsec(np.ptp(run.angles_rad, axis=0))
        rows[name] = {
            "alpha_arcsec": alpha,
            "beta_arcsec": beta,
            "focus_um": np.ptp(run.focus_um[:, 0]),
            "alpha_arcsec_per_degC": rad_to_arcsec(camera.steady_rad_per_degC)[0],
        }
    return pd.DataFrame(rows).T


def left_over(setting: CameraBench) -> pd.Series:
    """RMS of alpha, arcsec and without noise, that temperatures leave over once alpha is fitted to
    them: one lagged room, the five nodes of the small model, four thermometers.
    """
    import pandas as pd

    time = np.arange(0.0, setting.duration_s + 1e-9, _EVERY_S)
    room = setting.room_degC(time)
    run = setting.chain.simulate(time, {"room_degC": room})
    alpha = rad_to_arcsec(run.angles_rad[:, 0])
    fit = fit_sensitivity(room, run.angles_rad[:, 0], time_s=time, lag_s="fit", method="ls")
    rows = {"room, one lag": float(rad_to_arcsec(fit.rms))}
    for name, columns in {
        "five nodes of the network": setting.network.simulate(time, room),
        "four exact thermometers": run.temperature_degC,
    }.items():
        design = np.column_stack([np.ones_like(time), columns])
        off = alpha - design @ np.linalg.lstsq(design, alpha, rcond=None)[0]
        rows[name] = float(np.sqrt(np.mean(off**2)))
    return pd.Series(rows, name="alpha left over (arcsec)")


def one_lag(setting: CameraBench, *, seeds: int = 60) -> pd.DataFrame:
    """Fit alpha by one temperature with one lag, once for each seed of the centroids' noise.

    Returns
    -------
    DataFrame
        k by one lag, the 95 % interval of all lags and the truth, arcsec per degree, and whether
        the interval holds it.
    """
    import pandas as pd

    time = np.arange(0.0, setting.duration_s + 1e-9, _EVERY_S)
    room = setting.room_degC(time)
    run = setting.chain.simulate(time, {"room_degC": room})
    per_px = los_angles(setting.chain.optics)[0]
    truth = float(rad_to_arcsec(setting.chain.steady_rad_per_degC)[0])
    rows = []
    for seed in range(seeds):
        noise = np.random.default_rng(seed).normal(0.0, _CENTROID_PX, (time.size, 4))
        alpha = run.angles_rad[:, 0] + noise @ per_px
        fit = fit_sensitivity(room, alpha, time_s=time, lag_s="fit")
        low, high = fit.k_interval_arcsec_per_degC
        rows.append((float(fit.k_arcsec_per_degC), low, high, truth, low <= truth <= high))
    return pd.DataFrame(rows, columns=["k", "from", "to", "truth", "holds"])


@dataclass(frozen=True)
class UncertainCamera:
    """A camera whose heat paths and expansions are known only so well.

    Parameters
    ----------
    camera : ThermoelasticCamera
        Of the example's loads: air, draught along one wall, table.
    spread : (8,) floats
        Standard deviations of the logarithms of `NAMES`; the last, stray heat in the focal plane,
        in watts.
    """

    camera: ThermoelasticCamera
    spread: tuple[float, ...] = (0.15, 0.5, 0.5, 0.3, 0.05, 0.03, 0.01, 0.1)

    NAMES = (
        "air",
        "draught",
        "feet",
        "table's lag",
        "conduction",
        "heat capacity",
        "expansion of the bench",
        "stray heat",
    )

    @cached_property
    def reduced(self) -> ReducedHeat:
        """Return the heat with stray watts as one more load."""
        loads = (*self.camera.loads, Power("stray_W", "FP"))
        heat = Heat(self.camera.structure, loads)
        return ReducedHeat.of(heat, heat.modes(self.camera.modes))

    @cached_property
    def bench_map(self) -> Floats:
        """Share of the bench's expansion in the camera's `los_map`, (4, vertices)."""
        structure, optics = self.camera.structure, self.camera.optics
        same = [structure.materials[p] == structure.materials["bench"] for p in structure.parts]
        expansion = structure.per_cell("expansion_per_K") * np.array(same)[structure.cell_part]
        motions = self.camera.elasticity.motion_map(optics.pivot_mm, expansion)
        return (los_jacobian(optics) @ motions)[:4]

    def shifts_px(self, z: Floats, time_s: Floats, room_degC: Floats) -> Floats:
        """Shifts (n, 4) of both spots since the first time, z (8,) deviations away from nominal."""
        air, wall, feet, lag, conduction, capacity, bench = np.exp(z[:7] * self.spread[:7])
        reduced = self.reduced
        moved = reduced.lagged(lag)
        modes = moved.modes([air, wall, feet, 1.0], conduction=conduction, capacity=capacity)
        stray = np.append(0.0, np.full(time_s.size - 1, z[7] * self.spread[7]))
        drive = moved.heat.drive(time_s, {"room_degC": room_degC, "stray_W": stray})
        los = self.camera.los_map[:4] + (bench - 1.0) * self.bench_map
        px = modes.amplitudes(time_s, drive) @ (los @ modes.shapes).T
        return px - px[0]

    def k_arcsec_per_degC(self, z: Floats) -> float:
        """Alpha per degree at rest: only expansions enter."""
        los = self.camera.los_map[:4] + np.expm1(z[6] * self.spread[6]) * self.bench_map
        return float(rad_to_arcsec(los_angles(self.camera.optics)[0] @ los.sum(axis=1)))


def own_parameters(
    uncertain: UncertainCamera, setting: CameraBench, *, seeds: int = 20
) -> pd.DataFrame:
    """Fit the model's own parameters with their spreads as priors, to spots with noise.

    Each seed draws a camera from the priors and a run of it; the fit does not know them.

    Returns
    -------
    DataFrame
        k, the ends of its 95 % interval and the truth, arcsec per degree, and whether it holds.
    """
    import pandas as pd
    from scipy.optimize import least_squares

    time = np.arange(0.0, setting.duration_s + 1e-9, 10 * _EVERY_S)
    room = setting.room_degC(time)
    nothing = np.zeros(8)
    slope = np.zeros(8)
    up, down = (uncertain.k_arcsec_per_degC(sign * _unit(6)) for sign in (0.5, -0.5))
    slope[6] = up - down
    rows = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        true = rng.standard_normal(8)
        seen = uncertain.shifts_px(true, time, room) + rng.normal(0, _CENTROID_PX, (time.size, 4))

        def misfit(z: Floats, seen: Floats = seen) -> Floats:
            off = (uncertain.shifts_px(z, time, room) - seen) / _CENTROID_PX
            return np.append(off.ravel(), z)

        fit = least_squares(misfit, nothing, x_scale=1.0, diff_step=np.array([1e-3]), xtol=1e-6)
        equations = np.asarray(fit.jac)
        half = 1.96 * np.sqrt(slope @ np.linalg.solve(equations.T @ equations, slope))
        k, truth = uncertain.k_arcsec_per_degC(fit.x), uncertain.k_arcsec_per_degC(true)
        rows.append((k, k - half, k + half, truth, abs(k - truth) <= half))
    return pd.DataFrame(rows, columns=["k", "from", "to", "truth", "holds"])


def budget(
    uncertain: UncertainCamera,
    setting: CameraBench,
    *,
    time_s: float = 5400.0,
    draws: int = 400,
    seed: int = 20260017,
) -> pd.DataFrame:
    """Error of a predicted drift, term by term, their root sum of squares, and Monte Carlo.

    Parameters
    ----------
    uncertain : UncertainCamera
    setting : CameraBench
    time_s : float
        When the drift is compared with its prediction.
    draws, seed : int
        Of the Monte Carlo, which perturbs everything at once.

    Returns
    -------
    DataFrame
        Rows: heat, expansion, layout, centroid, root sum of squares, Monte Carlo, their ratio;
        columns alpha, beta, gamma in arcsec, one sigma.
    """
    import pandas as pd

    time = np.array([0.0, 1.0, setting.hold_s, time_s])
    room = setting.room_degC(time)
    spots, pinhole = uncertain.camera.optics.observe()[0], uncertain.camera.optics.pinhole
    axis = pinhole.principal_px or (0.0, 0.0)
    layout = np.array([0.002 * pinhole.focal_mm, 20.0, 20.0, 0.5, 0.5, 0.5, 0.5])

    def angles(z: Floats) -> Floats:
        """Measured drift (3,) for deviations (8 of the model, 7 of the layout, 4 of centroids)."""
        moved = np.array([pinhole.focal_mm, *axis]) + layout[:3] * z[8:11]
        camera = replace(pinhole, focal_mm=moved[0], principal_px=tuple(moved[1:]))
        rows = design_matrix(camera.points_mm(spots + (layout[3:] * z[11:15]).reshape(2, 2)))
        shift = uncertain.shifts_px(z[:8], time, room)[-1] + _CENTROID_PX * z[15:]
        turned = uncertain.camera.optics.field_turn @ np.linalg.pinv(rows) @ shift
        return rad_to_arcsec(turned * pinhole.pixel_mm)

    size = 19
    each = np.array([(angles(_unit(i, size)) - angles(-_unit(i, size))) / 2 for i in range(size)])
    groups = {
        "heat": [0, 1, 2, 3, 4, 5, 7],
        "expansion": [6],
        "layout": list(range(8, 15)),
        "centroids": list(range(15, 19)),
    }
    rows = {name: np.sqrt(np.sum(each[rows] ** 2, axis=0)) for name, rows in groups.items()}
    rows["root sum of squares"] = np.sqrt(np.sum(each**2, axis=0))
    drawn = np.random.default_rng(seed).standard_normal((draws, size))
    rows["Monte Carlo"] = np.std([angles(z) for z in drawn], axis=0, ddof=1)
    rows["ratio"] = rows["Monte Carlo"] / rows["root sum of squares"]
    return pd.DataFrame(rows, index=_AXES).T


def sensor_places(
    uncertain: UncertainCamera, *, sensors: int = 6, runs: int = 24, seed: int = 0
) -> pd.DataFrame:
    """Thermometers where they tell most about the line of sight, beside random places.

    Half of the runs, each of a camera drawn from the priors and a room that wanders, train the best
    linear estimate of alpha and beta from noisy thermometers (10 mK); the other half judge it.

    Returns
    -------
    DataFrame
        RMS error of alpha and beta, arcsec: greedy, the mean of 20 random choices, none; and the
        greedy places as text.
    """
    import pandas as pd

    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 9000.0, 300.0)
    camera, noise_K = uncertain.camera, 0.01
    fields = []
    for _ in range(runs):
        room = camera.reference_degC + np.cumsum(rng.normal(0.0, 0.8, time.size))
        factors = np.exp(rng.standard_normal(3) * uncertain.spread[:3])
        modes = uncertain.reduced.modes([*factors, 1.0])
        stray = rng.uniform(0.0, 1.0)
        drive = uncertain.reduced.heat.drive(time, {"room_degC": room, "stray_W": stray})
        fields.append(modes.amplitudes(time, drive) @ modes.shapes.T - camera.reference_degC)
    train, test = (np.concatenate(fields[part::2]) for part in (0, 1))
    angles = rad_to_arcsec(camera.angle_map[:2])

    def error(chosen: list[int], seen: Floats) -> Floats:
        """RMS (2,) of what the best linear estimate from these vertices leaves over."""
        a, b = train[:, chosen], train @ angles.T
        gram = a.T @ a + len(a) * noise_K**2 * np.eye(len(chosen))
        gain = np.linalg.solve(gram, a.T @ b)
        left = seen @ angles.T - seen[:, chosen] @ gain
        return np.sqrt(np.mean(left**2, axis=0) + noise_K**2 * np.sum(gain**2, axis=0))

    surface = np.unique(camera.structure.mesh.facets[:, camera.structure.outside])[::3]
    greedy: list[int] = []
    for _ in range(sensors):
        costs = [np.sum(error([*greedy, int(node)], train) ** 2) for node in surface]
        greedy.append(int(surface[int(np.argmin(costs))]))
    luck = [error(list(rng.choice(surface, sensors, replace=False)), test) for _ in range(20)]
    rows = {
        "greedy": error(greedy, test),
        "random": np.mean(luck, axis=0),
        "none": np.sqrt(np.mean((test @ angles.T) ** 2, axis=0)),
    }
    table = pd.DataFrame(rows, index=_AXES[:2]).T
    table.attrs["places_mm"] = camera.structure.mesh.p.T[greedy].round(1).tolist()
    return table


def _unit(index: int, size: int = 8) -> Floats:
    return np.eye(size)[index]
