"""The centroids by name: the one place where a name becomes an object."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TypedDict

from numpy.typing import ArrayLike

from losbench.checks import choice
from losbench.imaging.eiwa import EIWA
from losbench.imaging.gaussian import Gaussian
from losbench.imaging.grey import Grey
from losbench.imaging.protocols import CentroidMethod
from losbench.imaging.weighted import Weighted

__all__ = ["MethodFields", "as_method"]


_NAMED: dict[str, Callable[..., CentroidMethod]] = {
    "eiwa": EIWA,
    "grey": Grey,
    "weighted": Weighted,
    "gaussian": Gaussian,
}


class MethodFields(TypedDict, total=False):
    """What may stand beside the name of a centroid; ``sigma`` is a second word for ``width``."""

    window: int | None
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
    if isinstance(method, CentroidMethod):
        if chosen:
            name, value = next(iter(chosen.items()))
            raise ValueError(
                f"{name} and method exclude each other: got {name}={value!r} beside "
                f"method={method!r}; give it to {type(method).__name__}(...)"
            )
        return method
    kind = _NAMED[choice("method", method, _NAMED)]
    if "sigma" in chosen:
        if "width" in chosen:
            raise ValueError("width and sigma are two words for one thing: give width")
        chosen["width"] = chosen.pop("sigma")
    known = inspect.signature(kind).parameters
    return kind(**{name: value for name, value in chosen.items() if name in known})
