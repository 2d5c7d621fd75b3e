"""Robust attitude as something to turn: when does IRLS differ from least squares, and what does it
cost?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.arrays import Bools, Floats
from losbench.figures import COLOURS
from losbench.units import rad_to_arcsec
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import (
    Choice,
    Control,
    Field,
    LogSlider,
    Slider,
    whole_number,
)
from losbench.workbench.explorers.picture import round_up

__all__ = ["IRLSExplorer"]


_ERROR_MM = 1e-4  # a hundredth of the paper's pixel of 10 um
_RADIUS_MM, _FOCAL_MM = 4.6, 260.0
_ROWS = 24_000  # of all draws together: what is solved while a slider moves
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_WITHIN_95 = 2.4477  # radius, in sigmas, of the ellipse that holds 95 % of a normal distribution
_FAR = 4.0  # standard deviations of skewness or kurtosis, beyond which a cloud is no normal one


def spots_on_a_circle(n_spots: int) -> np.ndarray:
    """Points (n, 3) of equally spaced spots."""
    turn = 2.0 * np.pi * np.arange(n_spots) / n_spots
    return np.column_stack(
        [_RADIUS_MM * np.cos(turn), _RADIUS_MM * np.sin(turn), np.full(n_spots, _FOCAL_MM)]
    )


def shifts_with_bad_spots(
    n_spots: int, n_frames: int, *, bad_percent: int, bad_sigma: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Shifts (F, n, 2) of all frames of all draws, and which of them are of a bad spot (F, n)."""
    draws = int(np.clip(_ROWS // (2 * n_spots * n_frames), 100, 1500))
    rng = np.random.default_rng(seed)
    shifts = rng.normal(0.0, _ERROR_MM, (draws * n_frames, n_spots, 2))
    bad = rng.random(shifts.shape[:2]) < bad_percent / 100
    shifts[..., 0] += bad_sigma * _ERROR_MM * bad
    return shifts, bad


def loss_named(name: str, c: float) -> lb.Loss:
    """Return the loss with its constant."""
    return lb.Huber(c) if name == "Huber" else lb.Bisquare(c)


def attitudes_both_ways(
    *,
    n_spots: int,
    n_frames: int,
    loss: str,
    c: float,
    scale: str | float,
    group: str,
    bad_percent: int,
    bad_sigma: float,
    seed: int,
) -> dict[str, lb.AttitudeFit]:
    """Solve shifts with bad spots among them by least squares and by IRLS; the truth is zero."""
    points = spots_on_a_circle(n_spots)
    shifts, _ = shifts_with_bad_spots(
        n_spots, n_frames, bad_percent=bad_percent, bad_sigma=bad_sigma, seed=seed
    )
    return {
        "least squares": lb.solve_attitude(points, shifts, method="ls", stack=n_frames),
        "IRLS": lb.solve_attitude(
            points,
            shifts,
            loss=loss_named(loss, c),
            scale=scale,
            group="spot" if group == "spot" else None,
            stack=n_frames,
        ),
    }


class IRLSExplorer(Explorer):
    """Spots on a circle, some of them bad: residuals and weights, and the angles found by LS and by
    IRLS.
    """

    controls: ClassVar[dict[str, Control]] = {
        "n_spots": Slider("spots", 8, 2, 12, 1),
        "n_frames": Slider("frames stacked in a solve", 4, 1, 20, 1),
        "loss": Choice("loss", {"Huber": "Huber", "Bisquare": "Bisquare"}, "Huber"),
        "c": Slider("its constant c", 1.345, 0.2, 8.0, 0.005, "scales"),
        "scale": Choice(
            "scale",
            {"known": _ERROR_MM, "mad": "mad", "std": "std", "std1": "std1", "rms": "rms"},
            "mad",
        ),
        "group": Choice(
            "one weight for each", {"spot": "spot", "coordinate": "coordinate"}, "spot"
        ),
        "bad_percent": Slider("bad spots", 10, 0, 50, 1, "%"),
        "bad_sigma": LogSlider("their error along x", 20.0, 1.0, 1000.0, unit="sigma"),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(attitudes_both_ways)
    answer = 'lb.rms(seen["IRLS"].angles_arcsec)'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "as in the paper": {
            "n_spots": 2,
            "n_frames": 1,
            "loss": "Huber",
            "c": 1.345,
            "scale": "std",
            "group": "coordinate",
        },
        "ten frames of two spots": {"n_spots": 2, "n_frames": 10},
        "no bad spots": {"bad_percent": 0},
    }
    size_in = (8.4, 3.6)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the residuals of one solve, the weight function with its weights, and the angles of
        all draws.
        """
        self._rows, self._weights, self._angles = figure.subplots(1, 3)
        good = {"ls": "none", "marker": "o", "ms": 4, "color": COLOURS["blue"]}
        bad = {"ls": "none", "marker": "x", "ms": 6, "mew": 1.6, "color": COLOURS["vermilion"]}
        (self._good,) = self._rows.plot([], [], label="good", **good)
        (self._bad,) = self._rows.plot([], [], label="bad", **bad)
        self._rows.set(
            title="IRLS residuals, first draw", xlabel="row of A", ylabel="residual (sigma)"
        )
        self._rows.legend(fontsize=8, ncols=2, loc="upper right", borderaxespad=0.1)
        (self._curve,) = self._weights.plot([], [], color=COLOURS["black"], lw=1.0)
        (self._good_weights,) = self._weights.plot([], [], **good)
        (self._bad_weights,) = self._weights.plot([], [], **bad)
        self._weights.set(
            title="their weights", xlabel="residual / scale", ylabel="weight", ylim=(-0.03, 1.05)
        )
        looks = {"least squares": ("orange", "--"), "IRLS": ("blue", "-")}
        self._clouds, self._ellipses = [], []
        for name, (colour, dashes) in looks.items():
            self._clouds += self._angles.plot([], [], ".", ms=2.5, color=COLOURS[colour], alpha=0.5)
            self._ellipses += self._angles.plot(
                [], [], color=COLOURS[colour], ls=dashes, lw=1.8, label=name
            )
        self._angles.plot(0.0, 0.0, "+", ms=12, color=COLOURS["black"], label="truth")
        self._angles.set(
            title="all draws; 95 % if normal", xlabel="X error (″)", ylabel="Y error (″)"
        )
        self._rows.locator_params(axis="x", nbins=3, integer=True)
        self._angles.locator_params(axis="x", nbins=2)
        self._angles.legend(
            fontsize=8,
            ncols=3,
            loc="upper left",
            borderaxespad=0.1,
            handlelength=1.1,
            columnspacing=0.7,
            handletextpad=0.3,
        )
        return [
            self._good,
            self._bad,
            self._curve,
            self._good_weights,
            self._bad_weights,
            *self._clouds,
            *self._ellipses,
        ]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Solve the draws both ways, and compare with the truth, which is zero."""
        seen = self.experiment(**settings)
        n_spots, n_frames, group = (settings[name] for name in ("n_spots", "n_frames", "group"))
        points, robust = spots_on_a_circle(n_spots), seen["IRLS"]
        drawn = {name: settings[name] for name in ("bad_percent", "bad_sigma", "seed")}
        bad = shifts_with_bad_spots(n_spots, n_frames, **drawn)[1][:n_frames, :, None]
        residuals = robust.residuals[:n_frames]
        size = np.abs(residuals)
        judged = np.broadcast_to(bad, size.shape)
        if group == "spot":
            size = np.broadcast_to(np.sqrt(np.mean(size**2, axis=-1, keepdims=True)), size.shape)
        else:
            judged = bad & (np.arange(2) == 0)
        self._show_rows(residuals.ravel(), judged.ravel())
        self._show_weights(
            (size / robust.scale[0]).ravel(),
            robust.weights[:n_frames].ravel(),
            judged.ravel(),
            loss_named(settings["loss"], settings["c"]),
        )
        best = rad_to_arcsec(
            np.sqrt(np.diag(lb.attitude_covariance(points, _ERROR_MM, stack=n_frames)))
        )
        found = {name: fit.angles_arcsec for name, fit in seen.items()}
        self._show_angles(list(found.values()))
        texts = {}
        for name, angles in found.items():
            error = np.sqrt(np.mean(angles**2, axis=0))
            texts[f"{name}: RMS error X · Y · Z (″)"] = " · ".join(
                f"{value:.3g}" for value in error
            )
            texts[f"{name}: bias in Y (″)"] = f"{angles[:, 1].mean():+.3g}"
            texts[f"{name}: efficiency in Y"] = f"{100.0 * (best[1] / error[1]) ** 2:.0f} %"
        difference = np.abs(found["IRLS"] - found["least squares"]).max()
        draws = len(found["IRLS"])
        return texts | {f"largest difference in {draws} draws": f"{difference:.2g} ″"}

    def _show_rows(self, residuals: Floats, bad: Bools) -> None:
        number = np.arange(1, residuals.size + 1)
        for chosen, line in ((~bad, self._good), (bad, self._bad)):
            line.set_data(number[chosen], residuals[chosen] / _ERROR_MM)
        limit = round_up(residuals / _ERROR_MM, least=3.0)
        self._rows.set(
            xlim=(0, round_up(residuals.size + 1, least=10.0)), ylim=(-limit, 1.2 * limit)
        )

    def _show_weights(self, scaled: Floats, weights: Floats, bad: Bools, rule: lb.Loss) -> None:
        for chosen, dots in ((~bad, self._good_weights), (bad, self._bad_weights)):
            dots.set_data(scaled[chosen], weights[chosen])
        reach = round_up(scaled, least=5.0)
        u = np.linspace(0.0, reach, 400)
        self._curve.set_data(u, rule.weights(u))
        self._weights.set_xlim(0.0, reach)

    def _show_angles(self, found: Sequence[Floats]) -> None:
        for angles, cloud, ellipse in zip(found, self._clouds, self._ellipses, strict=True):
            cloud.set_data(angles[:, 0], angles[:, 1])
            ellipse.set_data(*_ellipse(angles[:, :2]))
        every = np.abs(np.concatenate(found))
        wide, high = (round_up(np.quantile(every[:, k], 0.99)) for k in (0, 1))
        self._angles.set(xlim=(-wide, wide), ylim=(-high, 1.25 * high))


def _ellipse(points: Floats) -> Floats:
    """Outline (2, k) that holds 95 % of a normal cloud of points (n, 2); NaN where the cloud is
    skewed or has tails as no normal one has.
    """
    middle = points.mean(axis=0)[:, None]
    root = np.linalg.cholesky(np.cov(points.T) + 1e-24 * np.eye(2))
    round_cloud = np.linalg.solve(root, points.T - middle)
    for power, normal, spread in ((3, 0.0, 6.0), (4, 3.0, 24.0)):
        moment = np.mean(round_cloud**power, axis=1)
        if np.abs(moment - normal).max() > _FAR * np.sqrt(spread / len(points)):
            return np.full((2, len(_TURN)), np.nan)
    return middle + _WITHIN_95 * root @ np.stack([np.cos(_TURN), np.sin(_TURN)])
