"""What a template from the recording's own spots would bring: scatter over the bound, six shapes.

No part of the library. Frames wander by half a pixel, as in notebook 04; the template is a field of
cubic splines, knots half a pixel apart, fitted by least squares to all windows at once, and places
and template are found in turns, from those of EIWA. ``python benchmarks/empirical.py`` prints the
table that `docs/estimator.md` sums up.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

import losbench as lb

CAMERA = lb.Detector(gain_e_per_dn=2.0, read_noise_e=5.0, offset_dn=100.0)
SIDE, HALF, REACH, KNOTS = 33, 16, 9, 0.5
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


class Splines:
    """A field of cubic splines, ``c`` (k, k), on knots around the middle of a spot."""

    def __init__(self):
        inner = np.arange(-REACH - 0.5, REACH + 0.5 + 1e-9, KNOTS)
        self.knots = np.concatenate([[inner[0]] * 3, inner, [inner[-1]] * 3])
        self.count, self.c = len(self.knots) - 4, None

    def along(self, at, slope=0):
        """Each spline at some places, (S, k)."""
        inside = np.clip(at, self.knots[3], self.knots[-4] - 1e-9)
        return BSpline(self.knots, np.eye(self.count), 3)(inside, slope)

    def fit(self, windows, xy):
        """Least squares of all windows (n, S, S) at once, smooth where nothing tells."""
        size, grid = self.count**2, np.arange(-REACH, REACH + 1)
        normal, moment = np.zeros((size, size)), np.zeros(size)
        for window, (x, y) in zip(windows, xy, strict=True):
            down, across = self.along(grid - y), self.along(grid - x)
            normal += np.kron(down.T @ down, across.T @ across)
            moment += (down.T @ window @ across).ravel()
        bent = np.diff(np.eye(self.count), 2, axis=0)
        rough = np.kron(bent.T @ bent, np.eye(self.count))
        rough += np.kron(np.eye(self.count), bent.T @ bent)
        unit = np.trace(normal) / size
        normal += unit * (1e-3 * rough + 1e-9 * np.eye(size))
        self.c = np.linalg.solve(normal, moment).reshape(self.count, self.count)

    def at(self, xy, slopes=(0, 0)):
        """Light of the template at a place, or its slope along x and y, (S, S)."""
        grid = np.arange(-REACH, REACH + 1)
        return self.along(grid - xy[1], slopes[1]) @ self.c @ self.along(grid - xy[0], slopes[0]).T


def moved(windows, xy, splines):
    """Places (n, 2) at which the template fits each window best, by scoring steps."""
    xy = xy.copy()
    for window, place in zip(windows, xy, strict=True):
        for _ in range(5):
            model = splines.at(place)
            columns = [
                model,
                -splines.at(place, (1, 0)),
                -splines.at(place, (0, 1)),
                1.0 + 0 * model,
            ]
            root = np.sqrt(np.maximum(model, 0.0) + 125.0).ravel()
            basis = np.stack(columns, axis=-1).reshape(-1, 4) / root[:, None]
            found = np.linalg.lstsq(basis, window.ravel() / root, rcond=None)[0]
            step = np.clip(found[1:3] / found[0], -1.0, 1.0)
            place += step
            if np.hypot(*step) < 1e-4:
                break
    return xy


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


def scatter(xy, truth):
    """Scatter about a common offset, pixels."""
    return float(np.std(xy - truth - np.mean(xy - truth, axis=0)))


def main() -> None:
    """Print EIWA and the template over the bound."""
    print(f"{'shape':10s} frames  peak (e-)  bound (mpx)  EIWA / bound  template / bound")
    cases = [(300, 5e3), (100, 5e3), (30, 5e3), (10, 5e3), (300, 5e2)]
    for frames, peak in cases:
        for shape in SHAPES:
            truth = np.random.default_rng(5).uniform(-0.5, 0.5, (frames, 2))
            seen = CAMERA.expose(light_of(shape, truth, peak), 6)
            eiwa = lb.centroid(seen, [[HALF, HALF]], method=lb.EIWA(21), detector=CAMERA)
            xy, splines = eiwa.xy[:, 0] - HALF, Splines()
            near = slice(HALF - REACH, HALF + REACH + 1)
            windows = (seen[:, near, near] - CAMERA.offset_dn) * CAMERA.gain_e_per_dn - 100.0
            bound, of_eiwa = bound_of(shape, peak), scatter(xy, truth)
            for _ in range(3):
                splines.fit(windows, xy)
                xy = moved(windows, xy, splines)
            print(
                f"{shape:10s} {frames:6d} {peak:10.0f} {1e3 * bound:12.2f} "
                f"{of_eiwa / bound:13.2f} {scatter(xy, truth) / bound:17.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
