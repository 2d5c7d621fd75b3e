"""Robust attitude as something to turn: when does IRLS differ from least squares, and what does it
cost?
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from losbench.arrays import Bools, Floats
from losbench.estimation.losses import Bisquare, Huber
from losbench.figures import COLOURS
from losbench.pointing.attitude import attitude_covariance, solve_attitude
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


_LOSSES: dict[str, type[Huber] | type[Bisquare]] = {"Huber": Huber, "Bisquare": Bisquare}
_GROUPS: dict[str, Literal["spot"] | None] = {"spot": "spot", "coordinate": None}
_ERROR_MM = 1e-4  # a hundredth of the paper's pixel of 10 um
_RADIUS_MM, _FOCAL_MM = 4.6, 260.0
_ROWS = 24_000  # of all draws together: what is solved while a slider moves
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_WITHIN_95 = 2.4477  # radius, in sigmas, of the ellipse that holds 95 % of a normal distribution


class IRLSExplorer(Explorer):
    """Spots on a circle, some of them bad: residuals and weights, and the angles found by LS and by
    IRLS.
    """

    controls: ClassVar[dict[str, Control]] = {
        "n_spots": Slider("spots", 8, 2, 12, 1),
        "n_frames": Slider("frames stacked in a solve", 4, 1, 20, 1),
        "loss": Choice("loss", {name: name for name in _LOSSES}, "Huber"),
        "c": Slider("its constant c", 1.345, 0.2, 8.0, 0.005, "scales"),
        "scale": Choice(
            "scale",
            {"known": _ERROR_MM, "mad": "mad", "std": "std", "std1": "std1", "rms": "rms"},
            "mad",
        ),
        "group": Choice("one weight for each", {name: name for name in _GROUPS}, "spot"),
        "bad_percent": Slider("bad spots", 10, 0, 50, 1, "%"),
        "bad_sigma": LogSlider("their error along x", 20.0, 1.0, 1000.0, unit="sigma"),
        "seed": Field("seed", 0, whole_number),
    }
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
            title="all draws, 95 % ellipses", xlabel="X error (″)", ylabel="Y error (″)"
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

    def update(
        self,
        *,
        n_spots: int,
        n_frames: int,
        loss: str,
        c: float,
        scale: str,
        group: str,
        bad_percent: int,
        bad_sigma: float,
        seed: int,
    ) -> Mapping[str, str]:
        """Draw shifts with bad spots among them, solve them both ways, and compare with the truth,
        which is zero.
        """
        points, draws = _spots(n_spots), _draws(n_spots, n_frames)
        shifts, bad = _shifts(n_spots, n_frames, bad_percent / 100, bad_sigma, seed)
        least = solve_attitude(points, shifts, method="ls", stack=n_frames)
        rule = _LOSSES[loss](c)
        robust = solve_attitude(
            points, shifts, loss=rule, scale=scale, group=_GROUPS[group], stack=n_frames
        )
        one = slice(n_frames)
        residuals, size = robust.residuals[one], np.abs(robust.residuals[one])
        if group == "spot":
            size = np.broadcast_to(np.sqrt(np.mean(size**2, axis=-1, keepdims=True)), size.shape)
        else:
            bad = bad & (np.arange(2) == 0)
        self._show_rows(residuals.ravel(), bad[one].ravel())
        self._show_weights(
            (size / robust.scale[0]).ravel(), robust.weights[one].ravel(), bad[one].ravel(), rule
        )
        best = rad_to_arcsec(
            np.sqrt(np.diag(attitude_covariance(points, _ERROR_MM, stack=n_frames)))
        )
        found = {"least squares": least.angles_arcsec, "IRLS": robust.angles_arcsec}
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
        return texts | {f"largest difference in {draws} draws": f"{difference:.2g} ″"}

    def _show_rows(self, residuals: Floats, bad: Bools) -> None:
        number = np.arange(1, residuals.size + 1)
        for chosen, line in ((~bad, self._good), (bad, self._bad)):
            line.set_data(number[chosen], residuals[chosen] / _ERROR_MM)
        limit = round_up(residuals / _ERROR_MM, least=3.0)
        self._rows.set(
            xlim=(0, round_up(residuals.size + 1, least=10.0)), ylim=(-limit, 1.2 * limit)
        )

    def _show_weights(
        self, scaled: Floats, weights: Floats, bad: Bools, rule: Huber | Bisquare
    ) -> None:
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
        wide, high = (round_up([line.get_data()[k] for line in self._ellipses]) for k in (0, 1))
        self._angles.set(xlim=(-wide, wide), ylim=(-high, 1.25 * high))

    def code(
        self,
        *,
        n_spots: int,
        n_frames: int,
        loss: str,
        c: float,
        scale: str,
        group: str,
        **bad: Any,
    ) -> str:
        """Return the draws and the call of `solve_attitude`."""
        return f"""\
import numpy as np
import losbench as lb

turn = 2 * np.pi * np.arange({n_spots}) / {n_spots}
points = np.column_stack([{_RADIUS_MM} * np.cos(turn), {_RADIUS_MM} * np.sin(turn), np.full({n_spots}, {_FOCAL_MM})])
rng = np.random.default_rng({bad["seed"]})
shifts = rng.normal(0.0, {_ERROR_MM}, ({_draws(n_spots, n_frames) * n_frames}, {n_spots}, 2))
bad = rng.random(shifts.shape[:2]) < {bad["bad_percent"] / 100}
shifts[..., 0] += {bad["bad_sigma"] * _ERROR_MM} * bad
fit = lb.solve_attitude(
    points, shifts, loss=lb.{loss}({c}), scale={scale!r}, group={_GROUPS[group]!r}, stack={n_frames}
)
print(lb.rms(fit.angles_arcsec))"""


def _spots(n_spots: int) -> Floats:
    turn = 2.0 * np.pi * np.arange(n_spots) / n_spots
    return np.column_stack(
        [_RADIUS_MM * np.cos(turn), _RADIUS_MM * np.sin(turn), np.full(n_spots, _FOCAL_MM)]
    )


def _draws(n_spots: int, n_frames: int) -> int:
    return int(np.clip(_ROWS // (2 * n_spots * n_frames), 100, 1500))


def _shifts(
    n_spots: int, n_frames: int, share: float, sigmas: float, seed: int
) -> tuple[Floats, Bools]:
    """Shifts of all frames, and which of them are of a bad spot."""
    rng = np.random.default_rng(seed)
    shifts = rng.normal(0.0, _ERROR_MM, (_draws(n_spots, n_frames) * n_frames, n_spots, 2))
    bad = rng.random(shifts.shape[:2]) < share
    shifts[..., 0] += sigmas * _ERROR_MM * bad
    return shifts, np.stack([bad, bad], axis=-1)


def _ellipse(points: Floats) -> Floats:
    """Outline (2, k) that holds 95 % of a normal cloud of points (n, 2)."""
    root = np.linalg.cholesky(np.cov(points.T) + 1e-24 * np.eye(2))
    return points.mean(axis=0)[:, None] + _WITHIN_95 * root @ np.stack(
        [np.cos(_TURN), np.sin(_TURN)]
    )
