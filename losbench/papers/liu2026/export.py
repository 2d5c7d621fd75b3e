"""The warm-up as a camera would record it: whole frames on disk, with temperature log, camera file
and truth.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from losbench.arrays import Floats
from losbench.checks import integer
from losbench.imaging.spots import render_spots
from losbench.made import Made, head_of
from losbench.outputs import claim
from losbench.papers.liu2026.scenario import ThermalBench
from losbench.papers.liu2026.twin import WarmUp, warm_up
from losbench.units import rad_to_arcsec

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write_recording"]


def write_recording(
    out: str | Path,
    *,
    n_frames: int = 200,
    seed: int = 0,
    bench: ThermalBench | None = None,
    force: bool = False,
    progress: bool = False,
    inputs: Iterable[str | Path] = (),
    made: Made | None = None,
) -> Path:
    """Write the twin's warm-up to a folder that ``losbench measure`` reads.

    Parameters
    ----------
    out : path
        Gets ``frames/frame-00000.tif`` ..., ``times.csv``, ``temperature.csv`` (the room, each
        minute), ``camera.toml`` (with its detector) and ``truth.csv`` (angles and spot positions).
    n_frames : int
        Frames, spread evenly over the warm-up.
    seed : int
        Seed of the detector's noise.
    bench : ThermalBench, optional
        The twin; by default as assumed for the paper.
    force : bool
        Replace what an earlier simulation left in the folder; other files stay.
    progress : bool
        Show a progress bar.
    inputs : paths
        What ``bench`` was read from, which must not lie in ``out``.
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
    ValueError
        If ``n_frames`` is below 2, or an input lies in ``out``.
    """
    setting = bench or ThermalBench()
    integer("n_frames", n_frames, low=2)
    integer("seed", seed, low=0)
    run = warm_up(setting, time_s=np.linspace(0.0, setting.duration_s, n_frames))
    tables = _tables(run)
    frames = [f"frames/frame-{k:05d}.tif" for k in range(n_frames)]
    with claim(
        out, writes=[*frames, *tables, "camera.toml"], inputs=inputs, force=force
    ) as results:
        rng = np.random.default_rng(seed)
        bar = tqdm(frames, desc="frames", unit="frame", delay=2, disable=not progress)
        for k, name in enumerate(bar):
            results.write(name, _frame(setting, run.truth_px[k], rng))
        for name, table in tables.items():
            results.write(name, table.to_csv(index=False, lineterminator="\n"))
        toml = setting.camera.to_toml() + "\n" + setting.detector.to_toml()
        results.write("camera.toml", toml)
        settings = {"n_frames": n_frames, "seed": seed}
        head = head_of("simulation", made or Made.by(None, settings, inputs))
        results.publish({**head, "twin": "liu2026", "seed": seed})
    return results.folder


def _frame(setting: ThermalBench, spots_px: Floats, rng: np.random.Generator) -> bytes:
    import cv2

    electrons = np.full(setting.shape, setting.background_e)
    for spot, flux in zip(spots_px, setting.flux_e, strict=True):
        x, y = np.rint(spot).astype(int) - setting.window_px // 2
        window = electrons[y : y + setting.window_px, x : x + setting.window_px]
        window += render_spots(spot[None], flux, setting.spot_sigma_px, window.shape, (x, y))
    done, coded = cv2.imencode(".tif", setting.detector.expose(electrons, rng))
    if not done:
        raise OSError("a frame could not be coded as TIFF")
    return coded.tobytes()


def _tables(run: WarmUp) -> dict[str, pd.DataFrame]:
    import pandas as pd

    log_s = np.unique(np.append(np.arange(0.0, run.time_s[-1], 60.0), run.time_s[-1]))
    room = np.interp(log_s, run.time_s, run.room_degC)
    angles = rad_to_arcsec(run.angles_rad).T
    spots = {
        f"{axis}{n + 1}_px": run.truth_px[:, n, i] for n in range(2) for i, axis in enumerate("xy")
    }
    return {
        "times.csv": pd.DataFrame({"time_s": run.time_s}),
        "temperature.csv": pd.DataFrame({"time_s": log_s, "temperature_degC": room.round(3)}),
        "truth.csv": pd.DataFrame(
            {"time_s": run.time_s}
            | {
                f"{name}_arcsec": angle
                for name, angle in zip(("alpha", "beta", "gamma"), angles, strict=True)
            }
            | spots
        ),
    }
