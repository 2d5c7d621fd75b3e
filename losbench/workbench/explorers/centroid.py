"""One spot as something to turn: what noise, background, window and start do to its centroid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.arrays import Floats
from losbench.figures import COLOURS
from losbench.imaging.methods import as_background
from losbench.imaging.places import peak_pixels
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
from losbench.workbench.explorers.view import Handle

__all__ = ["CentroidExplorer"]


_SIZE = 61
_TRUTH = (30.31, 29.83)
_HOT = (34, 27)
_FRAMES = 30
_WINDOW = 19
_PHASES = np.linspace(-0.5, 0.5, 17)
_TURN = np.linspace(0.0, 2.0 * np.pi, 73)
_GAIN_E, _OFFSET_DN = 4.0, 100.0


def detector_with_a_hot_pixel(read_noise_e: float, hot_e: float) -> lb.Detector:
    """Return the detector; its hot pixel lies beside the spot."""
    hot = ((*_HOT, float(hot_e)),) if hot_e else ()
    return lb.Detector(
        gain_e_per_dn=_GAIN_E, offset_dn=_OFFSET_DN, read_noise_e=read_noise_e, hot_pixels=hot
    )


def light_with_a_spot_at(
    xy: np.ndarray,
    *,
    flux_e: float,
    diameter_px: float,
    background_e: float,
    gradient_e: float,
) -> np.ndarray:
    """Electrons to expect of frames with the spot at the places (..., 2)."""
    ramp = background_e + gradient_e * np.arange(_SIZE)
    return lb.render_spots(xy[..., None, :], flux_e, diameter_px / 4, (_SIZE, _SIZE)) + ramp


def methods_with_a_window(window_px: int) -> dict[str, Any]:
    """Return the centroids to choose from."""
    return {
        "EIWA, Newton": lb.EIWA(window=window_px),
        "EIWA, stops on a small step": lb.EIWA(window=window_px, stop="step"),
        "grey, on the peak pixel": lb.Grey(window=window_px),
        "grey, where it starts": lb.Grey(window=window_px, centre="start"),
        "weighted, Gaussian template": lb.Weighted(window=window_px),
    }


def centroids_of_many_frames(
    *,
    flux_e: float,
    read_noise_e: float,
    background_e: float,
    gradient_e: float,
    diameter_px: float,
    window_px: int,
    offset_x_px: float,
    offset_y_px: float,
    hot_e: int,
    method: str,
    background: str,
    seed: int,
) -> dict[str, Any]:
    """Expose the spot many times and measure it; and once without noise, at places over a pixel."""
    scene = {"flux_e": flux_e, "diameter_px": diameter_px}
    scene |= {"background_e": background_e, "gradient_e": gradient_e}
    how = {"method": methods_with_a_window(window_px)[method], "background": background}
    truth, off = np.array(_TRUTH), np.array([offset_x_px, offset_y_px])
    detector = detector_with_a_hot_pixel(read_noise_e, hot_e)
    light = light_with_a_spot_at(truth, **scene)
    frames = detector.expose(np.broadcast_to(light, (_FRAMES, _SIZE, _SIZE)), seed)
    places = truth.round() + np.stack([np.linspace(-0.5, 0.5, 17), np.zeros(17)], axis=-1)
    quiet = light_with_a_spot_at(places, **scene) / _GAIN_E + _OFFSET_DN
    return {
        "frames": frames,
        "start": truth + off,
        "found": lb.centroid(frames, (truth + off)[None], detector=detector, **how),
        "s_curve": lb.centroid(quiet, (places + off)[:, None], **how).xy[:, 0, 0] - places[:, 0],
    }


class CentroidExplorer(Explorer):
    """A spot, the path of its window, how the centroid converges, its error, and its S-curve."""

    controls: ClassVar[dict[str, Control]] = {
        "flux_e": LogSlider("light of the spot", 4e5, 2e3, 1e6, unit="e⁻"),
        "read_noise_e": Slider("read noise", 5.0, 0.0, 100.0, 1.0, "e⁻"),
        "background_e": Slider("background at x = 0", 50.0, 0.0, 1000.0, 10.0, "e⁻/px"),
        "gradient_e": Slider("its gradient along x", 0.0, 0.0, 10.0, 0.1, "e⁻/px²"),
        "diameter_px": Slider("spot diameter, 4 sigma", 12.0, 4.0, 24.0, 0.5, "px"),
        "window_px": Slider("window", _WINDOW, 5, 39, 2, "px"),
        "offset_x_px": Slider("start off along x", 1.6, -4.0, 4.0, 0.1, "px"),
        "offset_y_px": Slider("start off along y", -1.2, -4.0, 4.0, 0.1, "px"),
        "hot_e": Slider("hot pixel", 0, 0, 20000, 500, "e⁻"),
        "method": Choice(
            "method", {name: name for name in methods_with_a_window(_WINDOW)}, "EIWA, Newton"
        ),
        "background": Choice(
            "background taken off", {"plane of a ring": "ring", "none": "none"}, "ring"
        ),
        "seed": Field("seed", 0, whole_number),
    }
    experiment = staticmethod(centroids_of_many_frames)
    answer = f'seen["found"].xy[0, 0] - {_TRUTH}, seen["found"].sigma_xy[0, 0]'
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "as in the paper": {
            "method": "EIWA, stops on a small step",
            "background": "none",
            "window_px": 13,
        },
        "faint, on a pedestal": {
            "flux_e": 8000.0,
            "background_e": 400.0,
            "method": "EIWA, stops on a small step",
            "background": "none",
        },
    }
    size_in = (8.4, 3.5)

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the spot, the trace over evaluations, the S-curve and the errors of many frames."""
        panels = figure.subplot_mosaic(
            [["spot", "trace", "errors"], ["spot", "s_curve", "errors"]],
            width_ratios=(1.25, 1, 1.1),
        )
        self._axes = panels
        self._image = panels["spot"].imshow(np.zeros((_SIZE, _SIZE)), cmap="gray")
        panels["spot"].grid(visible=False)
        panels["spot"].set(title="spot, start and final window", xlabel="x (px)", ylabel="y (px)")
        panels["spot"].set(xlim=(5, _SIZE - 6), ylim=(_SIZE - 6, 5))
        (self._start,) = panels["spot"].plot([], [], color=COLOURS["sky"], ls="--", lw=1.4)
        (self._final,) = panels["spot"].plot([], [], color=COLOURS["orange"], lw=1.8)
        (self._path,) = panels["spot"].plot([], [], ".-", color=COLOURS["orange"], ms=5, lw=1.0)
        (self._trace,) = panels["trace"].semilogy([], [], "o-", ms=3.5, color=COLOURS["blue"])
        self._predicted = panels["trace"].axhline(1.0, color=COLOURS["black"], ls="--", lw=1.0)
        panels["trace"].set(title="centre − truth (px)", xlabel="evaluation", ylim=(1e-5, 10.0))
        (self._s_curve,) = panels["s_curve"].plot([], [], color=COLOURS["green"])
        panels["s_curve"].set(
            title="S-curve (mpx)",
            xlabel="place on the pixel (px)",
            xlim=(-0.5, 0.5),
            xticks=[-0.5, 0, 0.5],
        )
        (self._cloud,) = panels["errors"].plot([], [], ".", ms=4, color=COLOURS["sky"])
        (self._this,) = panels["errors"].plot(
            [], [], "o", ms=6, color=COLOURS["vermilion"], label="this frame"
        )
        (self._ellipse,) = panels["errors"].plot(
            [], [], "--", lw=1.2, color=COLOURS["black"], label="predicted sigma"
        )
        panels["errors"].set(xlabel="x (mpx)", ylabel="y (mpx)", aspect="equal", adjustable="box")
        panels["errors"].set_title(f"errors of {_FRAMES} frames")
        panels["errors"].legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.05, -0.27))
        for axes in (panels["s_curve"], panels["errors"]):
            axes.axhline(0.0, color=COLOURS["black"], lw=0.6)
        panels["errors"].locator_params(axis="x", nbins=2)
        panels["errors"].axvline(0.0, color=COLOURS["black"], lw=0.6)
        overlay: list[Artist] = [self._start, self._final, self._path]
        return [
            self._image,
            *overlay,
            self._trace,
            self._predicted,
            self._s_curve,
            self._cloud,
            self._this,
            self._ellipse,
        ]

    def handles(
        self, *, offset_x_px: float, offset_y_px: float, window_px: int, **_: Any
    ) -> Sequence[Handle]:
        """The start, and the right edge of its window."""
        x, y = _TRUTH[0] + offset_x_px, _TRUTH[1] + offset_y_px
        both, wide = self.slides("offset_x_px", "offset_y_px"), self.slides("window_px")
        axes, edge = self._axes["spot"], x + window_px / 2
        return [
            Handle(
                label="start",
                axes=axes,
                x=x,
                y=y,
                move=lambda to_x, to_y: both(to_x - _TRUTH[0], to_y - _TRUTH[1]),
                step=(0.1, 0.1),
                text=f"off by {offset_x_px:g}, {offset_y_px:g} px",
            ),
            Handle(
                label="edge of the window",
                axes=axes,
                x=edge,
                y=y,
                move=lambda to_x, _: wide(2 * abs(to_x - x), 0.0),
                step=(1.0, 0.0),
                text=f"window {window_px} px",
            ),
        ]

    def update(self, **settings: Any) -> Mapping[str, str]:
        """Measure the spot, and show what came of it."""
        seen = self.experiment(**settings)
        frames, found, s_curve = seen["frames"], seen["found"], seen["s_curve"]
        window_px = settings["window_px"]
        method = methods_with_a_window(window_px)[settings["method"]]
        errors, sigma = found.xy[:, 0] - _TRUTH, found.sigma_xy[:, 0]
        path = _path(frames[0], seen["start"], found.xy[0, 0], method, settings["background"])
        self._show_spot(frames[0], path, window_px)
        self._show_numbers(path, errors, sigma, s_curve)
        with np.errstate(invalid="ignore"):
            rms, predicted = (np.sqrt(np.mean(values**2, axis=0)) for values in (errors, sigma))
        flags = lb.SpotFlag(int(found.flags[0, 0]))
        return {
            "error of this frame x · y (mpx)": _pair(errors[0]),
            "its predicted error (mpx)": _pair(sigma[0]),
            f"RMS error of {_FRAMES} frames (mpx)": _pair(rms),
            "predicted (mpx)": _pair(predicted),
            "S-curve, half its height (mpx)": f"{500.0 * np.ptp(s_curve):.2g}",
            "evaluations": f"{found.n_iter[0, 0]}",
            "flags": (flags.name or "").replace("|", ", ").lower() or "none",
        }

    def _show_spot(self, frame: Any, path: Floats, window_px: int) -> None:
        self._image.set_data(frame)
        self._image.set_clim(frame.min(), np.percentile(frame, 99.9))  # not the hot pixel
        half = window_px / 2
        corners = np.array([[-half, half, half, -half, -half], [-half, -half, half, half, -half]])
        for outline, centre in ((self._start, path[0]), (self._final, path[-1])):
            outline.set_data(*(corners + centre[:, None]))
        self._path.set_data(*path.T)

    def _show_numbers(self, path: Floats, errors: Floats, sigma: Floats, s_curve: Floats) -> None:
        distance = np.maximum(np.linalg.norm(path - _TRUTH, axis=1), 1e-5)
        self._trace.set_data(np.arange(len(path)), distance)
        self._predicted.set_ydata([np.hypot(*sigma[0])] * 2)
        self._axes["trace"].set_xlim(-0.3, round_up(len(path), least=10.0))
        self._s_curve.set_data(_PHASES, 1e3 * s_curve)
        high = round_up(1e3 * s_curve, least=0.1)
        self._axes["s_curve"].set_ylim(-high, high)
        self._cloud.set_data(*(1e3 * errors.T))
        self._this.set_data(*(1e3 * errors[:1].T))
        self._ellipse.set_data(
            *(1e3 * sigma[0][:, None] * np.stack([np.cos(_TURN), np.sin(_TURN)]))
        )
        limit = round_up([*(1e3 * errors.ravel()), *(1e3 * sigma[0])])
        self._axes["errors"].set(xlim=(-limit, limit), ylim=(-limit, limit))


def _path(frame: Any, start: Floats, found: Floats, method: Any, background: str) -> Floats:
    """Where the window stood, one row for each evaluation; other windows stay, and only their
    centroid is elsewhere.
    """
    if isinstance(method, lb.EIWA):
        return method.path(frame, start, background=as_background(background))
    # as centroid() puts it where nothing is said
    on_peak = method.stays and method.centre is None
    first = peak_pixels(frame, start[None], method.window // 4)[0] if on_peak else start.round()
    return np.stack([first, np.where(np.isnan(found), first, found)])


def _pair(xy_px: Floats) -> str:
    return " · ".join(f"{1e3 * value:.2f}" for value in xy_px)
