"""Centroids and backgrounds by name: the one place where a name becomes an object."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypedDict

from numpy.typing import ArrayLike

from losbench.checks import choice, number
from losbench.imaging.auto import AutoCentroid
from losbench.imaging.background import Background, Level, Ring
from losbench.imaging.eiwa import EIWA
from losbench.imaging.empirical import Empirical
from losbench.imaging.grey import Grey
from losbench.imaging.likelihood import Gaussian, Likelihood
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.weighted import Weighted

__all__ = ["MethodFields", "as_background", "as_method"]


_METHODS: dict[str, type[CentroidMethod]] = {
    "auto": AutoCentroid,
    "eiwa": EIWA,
    "grey": Grey,
    "weighted": Weighted,
    "likelihood": Likelihood,
    "gaussian": Gaussian,
    "empirical": Empirical,
}


_BACKGROUNDS: dict[str, Background] = {"ring": Ring(), "none": Level(0.0)}


class MethodFields(TypedDict, total=False):
    """What may stand beside the name of a centroid; ``sigma`` is a second word for ``width``."""

    window: ArrayLike | None
    width: ArrayLike | None
    sigma: ArrayLike | None
    stop: str | None
    tolerance: float | None
    max_iter: int | None
    centre: str | None
    hot_pixel_gate: bool | None
    smooth: str | None


def as_method(method: CentroidMethod | str, given: MethodFields) -> CentroidMethod:
    """Return the centroid of that name with these fields; an object is returned as it is.

    A field that the named centroid does not have is left out: it says what another would do.

    Raises
    ------
    ValueError
        If there is none of that name, or fields are given beside an object.
    """
    unknown = sorted(given.keys() - MethodFields.__annotations__.keys())
    if unknown:
        raise TypeError(f"no centroid has a field {unknown[0]!r}")
    chosen = {name: value for name, value in given.items() if value is not None}
    # A name and a class of ours are known at once; a protocol looks for each of its members.
    ours = type(method) in _METHODS.values()
    if not isinstance(method, str) and (ours or isinstance(method, CentroidMethod)):
        if chosen:
            name, value = next(iter(chosen.items()))
            raise ValueError(
                f"{name} and method exclude each other: got {name}={value!r} beside "
                f"method={method!r}; give it to {type(method).__name__}(...)"
            )
        return method
    kind: Any = _METHODS[choice("method", method, _METHODS)]
    if "sigma" in chosen:
        if "width" in chosen:
            raise ValueError("width and sigma are two words for one thing: give width")
        chosen["width"] = chosen.pop("sigma")
    known = {field.name for field in fields(kind)}
    return kind(**{name: value for name, value in chosen.items() if name in known})


def as_background(
    background: Background | str | float | None, ring: int | None = None
) -> Background:
    """Return the object that a name, a number or None stands for; ``ring`` is the side for "ring".

    Raises
    ------
    ValueError
        If there is none, or a side is given beside another background.
    """
    found: Background
    if background is None or isinstance(background, str):
        found = _BACKGROUNDS[choice("background", background or "none", _BACKGROUNDS)]
    elif isinstance(background, Background):
        found = background
    else:
        found = Level(number("background", background))
    if ring is None:
        return found
    if background != "ring":
        raise ValueError(
            f"ring and background exclude each other: got ring={ring!r} beside "
            f"background={background!r}; give background=Ring({ring!r})"
        )
    return Ring(ring)
