"""One chain to turn and to drag: from the light of some spots to arcseconds of three angles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.arrays import Floats
from losbench.figures import COLOURS
from losbench.pointing.attitude.layout import largest_shares
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.chain_steps import camera_and_places, pixels_to_arcsec
from losbench.workbench.explorers.controls import (
    Choice,
    Control,
    Field,
    LogSlider,
    Slider,
    moved_spots,
    whole_number,
)
from losbench.workbench.explorers.picture import round_up
from losbench.workbench.explorers.view import Handle, spot_handles

__all__ = ["ChainExplorer"]

_MOVING = 50  # frames: more would take a moving hand too long, and 20 are shown
_SHOWN_MOVING = 20
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_Z = 20.0  # by what errors about z are divided to be drawn beside the others
_PAIRS = {
    (0, 1): ("X, Y", "blue", "-"),
    (0, 2): ("X, Z/20", "green", "--"),
    (1, 2): ("Y, Z/20", "purple", ":"),
}
_MARKS = {"least squares": ("s", "orange"), "Huber": ("o", "blue"), "RLM": ("x", "black")}


def camera_path(label: str, text: str) -> str:
    """Read ``none`` or the path of a camera's TOML file."""
    if text.strip() == "none" or Path(text.strip()).is_file():
        return text.strip()
    raise ValueError(f"{label} must be 'none' or the path of a TOML file, got {text.strip()!r}")


class ChainExplorer(Explorer):
    """Spots on a sensor, the first one with its window, the ellipses of three angles, weights over
    residuals, and errors by least squares, Huber and RLM.
    """

    controls: ClassVar[dict[str, Control]] = {
        "spots": Slider("spots of the ring", 8, 2, 12, 1),
        "layout": Choice(
            "layout",
            {"ring of spots": "ring", "the paper's two": "paper", "as Table 2 asks": "table 2"},
            "ring",
        ),
        "moved": Field("moved (spot x y, …)", (), moved_spots(low=-1e5, high=1e5)),
        "light_e": LogSlider("light", 4e4, 1e3, 1e6, "e⁻"),
        "read_noise_e": Slider("read noise", 20, 0, 100, 1, "e⁻"),
        "background_e": Slider("background", 50, 0, 1000, 10, "e⁻"),
        "sigma_x_px": Slider("spot sigma x", 2.5, 1.0, 4.0, 0.1, "px"),
        "sigma_y_px": Slider("spot sigma y", 2.5, 1.0, 4.0, 0.1, "px"),
        "window_px": Slider("window", 15, 7, 25, 2, "px"),
        "frames": Slider("frames", 20, 1, 100, 1),
        "bad_percent": Slider("bad spots", 10, 0, 45, 1, "%"),
        "bad_px": Slider("they are off by", 1.0, 0.0, 3.0, 0.05, "px"),
        "c": Slider("Huber's c", 1.345, 0.3, 5.0, 0.005),
        "camera_file": Field("camera file", "none", camera_path),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(pixels_to_arcsec)
    answer = 'seen["errors_arcsec"]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "the paper's two spots": {"layout": "paper"},
        "the layout Table 2 asks for": {"layout": "table 2"},
        "ring of eight": {"layout": "ring", "spots": 8},
        "no bad spots": {"bad_percent": 0},
    }
    size_in = (8.4, 3.75)
    settles = True

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw five panels."""
        panels = figure.subplot_mosaic(
            [["sensor", "sensor", "spot"], ["ellipses", "weights", "errors"]],
            height_ratios=(1.15, 1.0),
        )
        self._axes = panels
        blue, red, black = (COLOURS[name] for name in ("blue", "vermilion", "black"))
        (self._spots,) = panels["sensor"].plot([], [], "o", ms=6, color=blue)
        (self._worst,) = panels["sensor"].plot([], [], "o", ms=13, mfc="none", mew=1.6, color=red)
        panels["sensor"].set_title("drag the spots  ○ most leverage", fontsize=10)
        self._image = panels["spot"].imshow(
            np.zeros((3, 3)), cmap="gray", extent=(-15, 15, 15, -15)
        )
        (self._window,) = panels["spot"].plot([], [], color=COLOURS["orange"], lw=1.6)
        panels["spot"].set_title("spot 1, first frame (px)", fontsize=10)
        panels["spot"].grid(visible=False)
        self._ellipses = [
            panels["ellipses"].plot([], [], color=COLOURS[colour], ls=ls, label=name)[0]
            for name, colour, ls in _PAIRS.values()
        ]
        panels["ellipses"].set_title("1 σ if no spot is bad (″)", fontsize=10)
        panels["ellipses"].legend(fontsize=7, loc="upper right", borderaxespad=0, labelspacing=0.2)
        (self._good,) = panels["weights"].plot([], [], ".", ms=4, color=blue)
        (self._bad,) = panels["weights"].plot([], [], "x", ms=4, color=red, label="bad")
        panels["weights"].set(ylim=(-0.03, 1.05))
        panels["weights"].set_title("weight over residual / scale", fontsize=10)
        panels["weights"].legend(fontsize=7, loc="center right", borderaxespad=0)
        panels["errors"].axhline(0.0, color=black, lw=0.8)
        self._errors = {
            name: panels["errors"].plot(
                [], [], marker, ms=7, mfc="none", color=COLOURS[colour], label=name
            )[0]
            for name, (marker, colour) in _MARKS.items()
        }
        panels["errors"].set(xlim=(-0.5, 2.5), xticks=[0, 1, 2], xticklabels=["X", "Y", "Z/20"])
        panels["errors"].set_title("error (″)", fontsize=10)
        panels["errors"].legend(fontsize=7, loc="upper right", borderaxespad=0, labelspacing=0.2)
        still = [self._spots, self._worst, self._image, self._window, *self._ellipses]
        return [*still, self._good, self._bad, *self._errors.values()]

    def handles(
        self, *, moved: tuple[tuple[float, ...], ...], window_px: int, **settings: Any
    ) -> Sequence[Handle]:
        """Every spot, and the right edge of the first one's window."""
        named = {name: settings[name] for name in ("layout", "spots", "camera_file")}
        _, places = camera_and_places(moved=moved, **named)
        wide = self.slides("window_px")
        edge = Handle(
            label="edge of the window",
            axes=self._axes["spot"],
            x=window_px / 2,
            y=0.0,
            move=lambda x, _: wide(2 * abs(x), 0.0),
            step=(1.0, 0.0),
            text=f"window {window_px} px",
        )
        return [*spot_handles(self._axes["sensor"], places, moved, decimals=0), edge]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Go through the chain; while a hand moves, with kept noise and the fast breakdown."""
        quick = self.moving
        if quick and settings["frames"] > _MOVING:
            settings["frames"] = _SHOWN_MOVING
        seen = self.experiment(**settings, noise=_kept_noise if quick else None)
        rows = _weighted_rows(seen)
        leverage = _leverage(rows)
        self._show_sensor(seen, leverage)
        self._show_spot(seen, settings["window_px"])
        self._show_angles(seen)
        self._show_weights(seen)
        errors, sigma = seen["errors_arcsec"], np.sqrt(np.diag(seen["covariance_arcsec2"]))
        texts = {f"error X · Y · Z (″), {name}": _row(error) for name, error in errors.items()}
        lost = int(np.isnan(seen["found"].xy[..., 0]).sum())
        return texts | {
            "1 σ if no spot is bad": _row(sigma),
            "Huber − RLM (″)": f"{np.abs(errors['Huber'] - errors['RLM']).max():.0e}",
            "bad spots survived": _survived(rows, quick=quick),
            "most leverage, of 3": f"{leverage.max():.2f}",
            "lost": f"{lost} of {seen['found'].xy[..., 0].size}",
        }

    def _show_sensor(self, seen: Mapping[str, Any], leverage: Floats) -> None:
        high, wide = seen["camera"].shape
        most = leverage >= leverage.max() - 1e-6
        self._spots.set_data(*seen["places"].T)
        self._worst.set_data(*seen["places"][most].T)
        self._axes["sensor"].set(xlim=(0, wide - 1), ylim=(high - 1, 0))

    def _show_spot(self, seen: Mapping[str, Any], window_px: int) -> None:
        image, (x, y) = seen["first"], seen["corner"] - seen["places"][0]
        side = len(image)
        self._image.set_data(image)
        self._image.set_extent((x - 0.5, x + side - 0.5, y + side - 0.5, y - 0.5))
        self._image.set_clim(image.min(), image.max())
        half = window_px / 2
        corners = np.array([[-half, half, half, -half, -half], [-half, -half, half, half, -half]])
        self._window.set_data(*corners)
        self._axes["spot"].set(xlim=(-19.5, 19.5), ylim=(19.5, -19.5))

    def _show_angles(self, seen: Mapping[str, Any]) -> None:
        scale = np.array([1.0, 1.0, 1.0 / _Z])
        covariance = seen["covariance_arcsec2"] * np.outer(scale, scale)
        drawn = []
        for line, pair in zip(self._ellipses, _PAIRS, strict=True):
            outline = _ellipse(covariance[np.ix_(pair, pair)])
            line.set_data(*outline)
            drawn.append(outline)
        reach = round_up(drawn, least=0.01)
        self._axes["ellipses"].set(xlim=(-reach, reach), ylim=(-reach, reach))
        errors = {name: error * scale for name, error in seen["errors_arcsec"].items()}
        for shift, (name, mark) in zip((-0.12, 0.0, 0.12), self._errors.items(), strict=True):
            mark.set_data(np.arange(3) + shift, errors[name])
        top = round_up([*errors.values()], least=0.01)
        self._axes["errors"].set_ylim(-top, top)

    def _show_weights(self, seen: Mapping[str, Any]) -> None:
        fit, bad = seen["huber"], np.repeat(seen["bad"][..., None], 2, axis=-1).ravel()
        sigma = seen["sigma_px"] * seen["camera"].pixel_mm
        scaled = (fit.residuals / sigma).ravel() / fit.scale.ravel()[0]
        weights = fit.weights.ravel()
        for chosen, dots in ((~bad, self._good), (bad, self._bad)):
            dots.set_data(scaled[chosen], weights[chosen])
        reach = round_up(scaled, least=5.0)
        self._axes["weights"].set_xlim(-reach, reach)


@lru_cache(maxsize=2)
def _kept_noise(shape: tuple[int, ...], seed: int) -> Any:
    """Standard normals, drawn once: while a hand moves, only their size changes."""
    return np.random.default_rng(seed).standard_normal(shape, dtype=np.float32)


def _weighted_rows(seen: Mapping[str, Any]) -> Floats:
    """Rows (2n, 3), each in its own error; those of spots that are always lost are zero."""
    sigma = seen["sigma_px"].reshape(-1, 1)
    rows = lb.design_matrix(seen["camera"].points_mm(seen["places"])) / sigma
    return np.where(np.isfinite(rows), rows, 0.0)


def _leverage(rows: Floats) -> Floats:
    """Leverage of each spot (n,), the squared size of its two rows of Q; together 3."""
    return (np.linalg.qr(rows)[0].reshape(-1, 6) ** 2).sum(axis=-1)


def _survived(rows: Floats, *, quick: bool) -> str:
    if np.linalg.matrix_rank(rows) < 3:
        return "none"
    spots = len(rows) // 2
    if quick:
        return f"{int(np.sum(largest_shares(rows)[1:] < 0.5 - 1e-9))} of {spots}"
    found = lb.design_breakdown(rows, group=np.repeat(np.arange(spots), 2))
    return f"{found.monotone} of {spots}"


def _ellipse(covariance: Floats) -> Floats:
    """Outline (2, k) of one sigma; NaN where the covariance is not finite."""
    if not np.isfinite(covariance).all():
        return np.full((2, len(_TURN)), np.nan)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return root @ np.stack([np.cos(_TURN), np.sin(_TURN)])


def _row(values: Floats) -> str:
    return " · ".join(f"{value:+.3f}" for value in values)
