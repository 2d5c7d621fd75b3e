"""The pair's telemetry as an operator would have it: a CSV file, the TOML file that explains it,
and the truth.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from losbench.made import Made, head_of
from losbench.outputs import claim
from losbench.papers.ren2023.scenario import CONVENTION, Pair
from losbench.papers.ren2023.twin import FIRST_DAY, simulate
from losbench.telemetry.columns import HeadColumns, TelemetryFormat
from losbench.units import rad_to_arcsec

__all__ = ["write_telemetry"]


def write_telemetry(
    out: str | Path,
    *,
    seed: int | None = None,
    setting: Pair | None = None,
    force: bool = False,
    made: Made | None = None,
) -> Path:
    """Write simulated telemetry to a folder, for ``losbench drift``.

    Parameters
    ----------
    out : path
        Gets ``telemetry.csv``, ``telemetry.toml`` and ``truth.csv`` (drift of both heads, arcsec).
    seed : int, optional
        Of the simulation.
    setting : Pair, optional
        The pair; by default as assumed for the paper.
    force : bool
        Replace what an earlier simulation left in the folder; other files stay.
    made : Made, optional
        The command and its settings, for ``report.json``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileExistsError
        If ``out`` holds anything and ``force`` is not set.
    """
    import pandas as pd

    pair = setting or Pair()
    simulated = simulate(pair, seed)
    telemetry = simulated.telemetry
    heads = [
        HeadColumns(
            quaternion=tuple(f"q{k}_{axis}" for axis in "xyzw"),
            spots=tuple((f"spot{k}{n}_x_mm", f"spot{k}{n}_y_mm") for n in (1, 2)),
            reference=tuple(tuple(xy) for xy in pair.points_mm[:, :2].round(9).tolist()),
        )
        for k in (1, 2)
    ]
    form = TelemetryFormat(
        time="time",
        scalar=CONVENTION.scalar,
        direction=CONVENTION.direction,
        design_angle_deg=pair.angle_deg,
        focal_mm=pair.focal_mm,
        spot_sigma_um=pair.spot_noise_um,
        head_1=heads[0],
        head_2=heads[1],
    )
    utc = np.datetime64(FIRST_DAY, "ms") + np.rint(telemetry.time_s * 1e3).astype("timedelta64[ms]")
    columns = {"time": np.char.add(utc.astype(str), "Z")}
    for k, head in enumerate(heads):
        columns |= dict(zip(head.quaternion, telemetry.quaternions[k].T.round(12), strict=True))
        position = (
            (telemetry.points_mm[k, :, :2] + telemetry.shifts_mm[k]).reshape(len(utc), -1).round(7)
        )
        columns |= dict(zip([name for xy in head.spots for name in xy], position.T, strict=True))
    drift = rad_to_arcsec(simulated.drift_rad)
    truth = {
        f"drift_{k + 1}_{axis}_arcsec": drift[k, :, i].round(6)
        for k in range(2)
        for i, axis in enumerate("xyz")
    }
    tables: dict[str, dict[str, Any]] = {
        "telemetry.csv": columns,
        "truth.csv": {"time": columns["time"]} | truth,
    }
    with claim(out, writes=[*tables, "telemetry.toml"], force=force) as results:
        for name, table in tables.items():
            results.write(name, pd.DataFrame(table).to_csv(index=False, lineterminator="\n"))
        results.write("telemetry.toml", form.to_toml())
        begins = head_of("simulation", made or Made.by(None, {"seed": seed}, []))
        results.publish({**begins, "twin": "ren2023", "seed": seed})
    return results.folder
