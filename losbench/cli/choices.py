"""Arguments that say how to measure, and the objects that they make."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from losbench.imaging.background import Background
    from losbench.imaging.finder import Find
    from losbench.imaging.protocols import CentroidMethod
    from losbench.recording.angles import Angles

__all__ = ["add_choices", "angles_of", "background_of", "centroid_of", "reference_of", "spots_of"]


def add_choices(parser: argparse.ArgumentParser) -> None:
    """Add them to a parser."""
    spots = parser.add_argument_group("spots")
    spots.add_argument(
        "--spots",
        metavar="X,Y ...",
        help='spot positions in the first frame, "690,539 1230,539"; default found',
    )
    spots.add_argument(
        "--n-spots", type=int, help="how many spots to find; default all that stand out"
    )
    spots.add_argument(
        "--threshold",
        type=float,
        default=8.0,
        metavar="SIGMA",
        help="how far a spot must stand out, in standard deviations of the noise (%(default)s)",
    )
    spots.add_argument(
        "--smooth",
        type=_smooth,
        metavar="PX|kalman",
        help="smooth the frame by a Gaussian of that sigma before spots are looked for; or smooth "
        "the positions over the frames before taking shifts",
    )
    spots.add_argument(
        "--order",
        default="x",
        choices=["x", "light", "peak"],
        help="how spots are numbered: from left to right, by light or by peak (%(default)s)",
    )
    centroid = parser.add_argument_group("centroid")
    centroid.add_argument(
        "--method",
        default="auto",
        choices=["auto", "eiwa", "grey", "weighted", "likelihood", "gaussian", "empirical"],
        help="centroid (%(default)s: what the spots ask for; eiwa where a stop is given)",
    )
    centroid.add_argument(
        "--window", type=int, help="window side in pixels, odd; default 6 sigma of the spot"
    )
    centroid.add_argument(
        "--width", type=float, metavar="PX", help="sigma of the template; default found"
    )
    centroid.add_argument(
        "--stop", choices=["error", "step"], help='of EIWA; "step" is the paper to the letter'
    )
    centroid.add_argument("--tolerance", type=float, metavar="PX", help="of the stop")
    centroid.add_argument("--max-iter", type=int, help="evaluations of a window (50)")
    centroid.add_argument(
        "--centre", choices=["start", "peak"], help="where the first window stands (peak)"
    )
    centroid.add_argument(
        "--hot-pixel-gate",
        action="store_true",
        default=None,
        help="replace pixels that stand out of their 3 x 3 median",
    )
    centroid.add_argument(
        "--background",
        default="ring",
        metavar="ring|none|DN",
        help="what is taken off: a plane through a ring, nothing, or a level (%(default)s)",
    )
    centroid.add_argument(
        "--ring", type=int, metavar="PX", help="side of the square in the ring; default the window"
    )
    angles = parser.add_argument_group("shifts and angles")
    angles.add_argument(
        "--reference",
        default="first",
        metavar="first|K",
        help="shifts count from the first frame or the mean of K",
    )
    angles.add_argument(
        "--model", default="pinhole", choices=["pinhole", "paper"], help="geometry (%(default)s)"
    )
    angles.add_argument(
        "--solver",
        default="auto",
        choices=["auto", "irls", "ls", "lts", "mm"],
        help="angles (%(default)s)",
    )


def _smooth(text: str) -> float | str:
    return text if text == "kalman" else float(text)


def centroid_of(options: argparse.Namespace) -> CentroidMethod:
    """Return the centroid that the arguments describe."""
    from losbench.imaging.methods import MethodFields, as_method

    given: MethodFields = {
        "window": options.window,
        "width": options.width,
        "stop": options.stop,
        "tolerance": options.tolerance,
        "max_iter": options.max_iter,
        "centre": options.centre,
        "hot_pixel_gate": options.hot_pixel_gate,
        "smooth": "kalman" if options.smooth == "kalman" else None,
    }
    stop = options.stop or options.tolerance or options.max_iter
    return as_method("eiwa" if options.method == "auto" and stop else options.method, given)


def background_of(options: argparse.Namespace) -> Background:
    """Return the background that the arguments describe."""
    from losbench.imaging.methods import as_background

    text = options.background
    if text in ("ring", "none"):
        return as_background(text, options.ring)
    try:
        return as_background(float(text), options.ring)
    except ValueError:
        raise ValueError(f"--background must be ring, none or a number, got {text!r}") from None


def spots_of(options: argparse.Namespace) -> list[list[float]] | Find:
    """Return where the spots are, or how they are found."""
    from losbench.imaging.finder import Find

    text = options.spots
    if text is None:
        smooth = options.smooth if isinstance(options.smooth, float) else 0.0
        return Find(options.n_spots, options.threshold, smooth, options.order)
    try:
        return [[float(x), float(y)] for x, y in (pair.split(",") for pair in text.split())]
    except ValueError:
        raise ValueError(
            f'--spots must be X,Y pairs in pixels, e.g. "690.3,539.1 1229.8,538.6", got {text!r}'
        ) from None


def angles_of(options: argparse.Namespace) -> Angles:
    """Return how shifts become angles."""
    from losbench.recording.angles import Angles

    return Angles(options.solver, options.model)


def reference_of(options: argparse.Namespace) -> str | int:
    """Return what shifts count from."""
    text: Any = options.reference
    if text == "first":
        return "first"
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"--reference must be 'first' or a whole number, got {text!r}") from None
