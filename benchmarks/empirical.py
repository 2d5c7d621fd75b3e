"""What a template from the recording's own spots brings: scatter over the bound, six shapes.

Frames wander by half a pixel, as in notebook 04. The error that `lb.Empirical` states is held
against its scatter in the frames that made the template, and in 200 others.
``python benchmarks/empirical.py`` prints the table that `docs/estimator.md` sums up.
"""

from __future__ import annotations

import numpy as np

import losbench as lb

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SIDE, HALF, WINDOW, SEEDS = 33, 16, 21, 4
FINE = (np.arange(5 * SIDE) + 0.5) / 5 - 0.5 - HALF
SHAPES = {
    "Gaussian": lambda x, y: np.exp(-0.125 * (x**2 + y**2)),
    "Moffat": lambda x, y: (1.0 + (x**2 + y**2) / 16.0) ** -2.5,
    "disc": lambda x, y: 1.0 / (1.0 + np.exp((np.hypot(x, y) - 5.0) / 0.3)),
    "ring": lambda x, y: np.exp(-0.5 * ((np.hypot(x, y) - 5.0) / 0.8) ** 2),
    "coma": lambda x, y: (
        np.exp(-0.125 * (x**2 + y**2))
        + 0.4 * np.exp(-(((x - 2.5) / 3.0) ** 2 + (y / 2.0) ** 2) / 2)
    ),
    "two lobes": lambda x, y: (
        np.exp(-((x - 3.0) ** 2 + y**2) / 8) + 0.7 * np.exp(-((x + 3.0) ** 2 + y**2) / 8)
    ),
}


def light_of(shape, xy, peak):
    """Electrons (n, 33, 33) of a shape at (n, 2) from the middle."""
    x, y = FINE - xy[:, :1, None], FINE[:, None] - xy[:, 1:, None]
    return peak * SHAPES[shape](x, y).reshape(-1, SIDE, 5, SIDE, 5).mean(axis=(2, 4)) + 100.0


def bound_of(shape, peak):
    """Least error of x and y, mean of both, with flux and level fitted as well, pixels."""
    h, nowhere = 0.01, np.zeros((1, 2))
    at = light_of(shape, nowhere, peak)[0]
    slopes = [
        (light_of(shape, nowhere + d, peak) - light_of(shape, nowhere - d, peak))[0] / (2 * h)
        for d in ((h, 0.0), (0.0, h))
    ]
    basis = np.stack([*slopes, at - 100.0, np.ones_like(at)], axis=-1).reshape(-1, 4)
    basis /= np.sqrt(at + 25.0).reshape(-1, 1)
    return float(np.sqrt(np.linalg.inv(basis.T @ basis).diagonal()[:2].mean()))


def measured(shape, frames, peak, seed, method):
    """Errors about a common offset, and what is stated of them, (n, 2) pixels; and the method."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-0.5, 0.5, (frames, 2))
    seen = CAMERA.expose(light_of(shape, truth, peak), rng)
    found = lb.centroid(seen, [[HALF, HALF]], method=method, detector=CAMERA)
    error = found.xy[:, 0] - truth
    return error - error.mean(axis=0), found.sigma_xy[:, 0], found.method


def root_mean(values):
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print EIWA and the template over the bound, and stated errors over scatter."""
    print(
        f"{'shape':10s} frames  peak (e-)  bound (mpx)  EIWA / bound  Empirical / bound  "
        "stated / scatter  in other frames"
    )
    cases = [(300, 5e3), (100, 5e3), (30, 5e3), (10, 5e3), (300, 5e2), (30, 5e2)]
    for frames, peak in cases:
        for shape in SHAPES:
            eiwa, own, other = [], [], []
            for seed in range(SEEDS):
                case = shape, frames, peak, seed
                eiwa.append(measured(*case, lb.EIWA(WINDOW))[0])
                own.append(measured(*case, lb.Empirical(window=WINDOW)))
                other.append(measured(shape, 200, peak, 100 + seed, own[-1][2]))
            ratios = [
                root_mean([stated for _, stated, _ in some])
                / root_mean([error for error, _, _ in some])
                for some in (own, other)
            ]
            bound = bound_of(shape, peak)
            print(
                f"{shape:10s} {frames:6d} {peak:10.0f} {1e3 * bound:12.2f} "
                f"{root_mean(eiwa) / bound:13.2f} "
                f"{root_mean([error for error, _, _ in own]) / bound:18.2f} "
                f"{ratios[0]:17.2f} {ratios[1]:16.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
