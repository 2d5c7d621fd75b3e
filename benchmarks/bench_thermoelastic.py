"""The thermo-elastic camera: its build, and a series by modes beside stepping the whole mesh and
tracing every ray.

Ratios of times on the same camera and room, and how far the answers are apart; ``--save`` writes
them to benchmarks/baselines/thermoelastic.csv. One thread: set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.sparse.linalg import splu

from losbench.thermoelastic import draw_camera, example_camera, prepared_camera

BASELINE = Path(__file__).parent / "baselines" / "thermoelastic.csv"
STEP_S = 5.0
LIMITS = {"build, s": 5.0, "series, s": 0.2, "picture, s": 3.0, "px apart": 1e-3, "K apart": 0.01}


def clock(call, repeat=3):
    """Best seconds of several calls, and what the last one returned."""
    seconds = []
    for _ in range(repeat):
        begin = time.process_time()
        value = call()
        seconds.append(time.process_time() - begin)
    return min(seconds), value


def built():
    camera = example_camera()
    _ = camera.los_map, camera.heat_modes
    return camera


def drawn(camera, field):
    figure = Figure(figsize=(10, 4.4))
    for ax, cut in zip(figure.subplots(1, 2), (None, 0.0), strict=True):
        draw_camera(ax, camera, field, cut_mm=cut, rays=True)
    figure.savefig(io.BytesIO(), format="png")


def stepped(camera, times, room):
    """Crank and Nicolson over all vertices, with a table that lags the room as in the camera."""
    heat, step = camera.heat, times[1] - times[0]
    drive = heat.drive(times, {"room_degC": room}).series
    left = splu((heat.capacity / step + heat.loss / 2).tocsc())
    right = (heat.capacity / step - heat.loss / 2).tocsc()
    field = np.empty((times.size, camera.structure.mesh.nvertices))
    field[0] = heat.steady @ drive[0]
    for k in range(times.size - 1):
        field[k + 1] = left.solve(right @ field[k] + heat.gain @ (drive[k] + drive[k + 1]) / 2)
    return field


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true")
    options = parser.parse_args()
    times = np.arange(0.0, 9000.0 + STEP_S, STEP_S)
    room = np.interp(times, [600.0, 5400.0], [18.0, 25.0])
    inputs = {"room_degC": room}
    build_s, camera = clock(built)
    modes_s, run = clock(lambda: camera.simulate(times, inputs))
    full_s, field = clock(lambda: stepped(camera, times, room), repeat=1)
    trace_s, (px, _) = clock(lambda: camera.trace(field), repeat=1)
    draw_s, _ = clock(lambda: drawn(camera, field[-1]))
    apart_K = float(np.abs(camera.temperatures(times, inputs) - field).max())
    small = prepared_camera("aluminium + Zerodur")[1]
    change_s, _ = clock(lambda: small.modes([1.4, 0.5, 1.5, 1.0, 1.0]), repeat=20)
    values = (build_s, modes_s, draw_s, float(np.abs(run.px - px).max()), apart_K)
    missed = False
    for (name, limit), value in zip(LIMITS.items(), values, strict=True):
        missed |= value > limit
        print(f"{name:12s} {value:9.3g}  at most {limit:g}  {'MISSED' if value > limit else 'ok'}")
    rows = [
        ("series by stepping over by modes", full_s / modes_s),
        ("series by rays over by the map", trace_s / modes_s),
        ("new films, build over reduced", build_s / change_s),
    ]
    for name, value in rows:
        print(f"{name:40s} {value:.3g} times")
    if options.save:
        with BASELINE.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([("what", "ratio"), *rows])
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
