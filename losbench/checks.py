"""Argument checks with one message style: what the argument must be, and what came.

Every check takes the argument's name first and returns the value as the array or number that the
caller works with.
"""

from __future__ import annotations

from collections.abc import Iterable
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from losbench.arrays import Floats, Ints

__all__ = [
    "boolean",
    "choice",
    "finite",
    "finite_or_nan",
    "generator",
    "increasing",
    "integer",
    "named_twice",
    "non_negative",
    "number",
    "odd",
    "positive",
    "rotation",
    "shaped",
    "unit_quaternions",
    "unmasked",
]


# NumPy would read a date as its count of some unit.
_NO_NUMBERS = {"m": "durations", "M": "dates", "U": "text", "S": "text", "c": "complex numbers"}
_NO_NUMBERS |= {"V": "records"}
_LARGEST = 2**63 - 1
_UNIT = 1e-3  # text of three decimals keeps unit length to this


def finite(name: str, value: ArrayLike, *, ndim: int | None = None) -> Floats:
    """Return ``value`` as a float array, or raise ``ValueError`` if it is empty or holds NaN or
    infinity.
    """
    array = _floats(name, value, ndim)
    bad = ~np.isfinite(array)
    if bad.any():
        raise ValueError(
            f"{name} must be finite, got {int(bad.sum())} NaN or infinite of {array.size} values"
        )
    return array


def finite_or_nan(name: str, value: ArrayLike, *, ndim: int | None = None) -> Floats:
    """Return ``value`` as a float array in which NaN marks what is missing; raise if it is empty or
    holds infinity.
    """
    array = _floats(name, value, ndim)
    bad = np.isinf(array)
    if bad.any():
        raise ValueError(
            f"{name} must be finite or NaN, got {int(bad.sum())} infinite of {array.size} values"
        )
    return array


def positive(name: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a float array whose elements are all finite and above zero."""
    array = finite(name, value)
    if (array <= 0).any():
        raise ValueError(f"{name} must be positive, got {array.min():g}")
    return array


def non_negative(name: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a float array whose elements are all finite and not below zero."""
    array = finite(name, value)
    if (array < 0).any():
        raise ValueError(f"{name} must not be negative, got {array.min():g}")
    return array


def number(name: str, value: object, *, low: float = -np.inf, high: float = np.inf) -> float:
    """Return ``value`` as one finite float between ``low`` and ``high``, both allowed."""
    try:
        if isinstance(value, str | bool | np.bool_):
            raise TypeError  # float() would read it
        if value is np.ma.masked or isinstance(value, np.timedelta64 | np.datetime64):
            raise TypeError
        result = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number, got {_shown(value)}") from None
    if not np.isfinite(result) or not low <= result <= high:
        raise ValueError(f"{name} must be a finite number{_range(low, high)}, got {result:g}")
    return result


def integer(name: str, value: object, *, low: int | None = None, high: int | None = None) -> int:
    """Return ``value`` as an int between ``low`` and ``high``, both allowed; 3.0 passes, 3.5 and
    True do not.
    """
    if isinstance(value, bool | np.bool_ | np.timedelta64) or not isinstance(
        value, int | float | np.integer | np.floating
    ):
        raise ValueError(f"{name} must be a whole number, got {_shown(value)}")
    if value != value or value in (np.inf, -np.inf) or int(value) != value:
        raise ValueError(f"{name} must be a whole number, got {_shown(value)}")
    if abs(int(value)) > _LARGEST:
        raise ValueError(f"{name} must be a whole number of 64 bits, got {_shown(value)}")
    limits = (-np.inf if low is None else low, np.inf if high is None else high)
    if not limits[0] <= value <= limits[1]:
        raise ValueError(f"{name} must be a whole number{_range(*limits)}, got {int(value)}")
    return int(value)


def odd(name: str, value: object, *, low: int = 1, why: str = "") -> int:
    """Return ``value`` as an odd int of at least ``low``."""
    side = integer(name, value, low=low)
    if side % 2 == 0:
        raise ValueError(f"{name} must be odd{', ' + why if why else ''}, got {side}")
    return side


def increasing(name: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a float array (n,) each of whose elements exceeds the one before it."""
    t = finite(name, value, ndim=1)
    late = np.diff(t) <= 0
    if late.any():
        k = int(np.argmax(late)) + 1
        kind = "equals" if t[k] == t[k - 1] else "is before"
        unit = " s" if name.endswith("_s") else ""
        raise ValueError(
            f"{name} must increase, but sample {k} at {t[k]:g}{unit} {kind} the one before it"
        )
    return t


def rotation(name: str, value: ArrayLike) -> Floats:
    """Return ``value`` as a float array (3, 3) that is a proper rotation to a millionth."""
    matrix = finite(name, value)
    shaped(name, matrix, (3, 3))
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
        raise ValueError(f"{name} must be a rotation matrix: orthonormal rows, determinant +1")
    return matrix


def unit_quaternions(name: str, value: ArrayLike, *, rows: Ints | None = None) -> Floats:
    """Return ``value`` as a float array (..., 4) of quaternions, each of unit length or with a NaN;
    the message counts them, or names the ``rows`` (n,) of a file that they come from.
    """
    q = finite_or_nan(name, value)
    shaped(name, q, ("...", 4))
    length = np.sqrt(np.vecdot(q, q)).ravel()
    bad = np.abs(length - 1.0) > _UNIT
    if bad.any():
        k = int(np.argmax(bad))
        place = f"the first, number {k}," if rows is None else f"row {rows[k]}"
        raise ValueError(
            f"{name} must have unit length to {_UNIT:g}, but {np.count_nonzero(bad)} of "
            f"{bad.size} have not; {place} has length {length[k]:.4g}"
        )
    return q


def boolean(name: str, value: object) -> bool:
    """Return ``value`` if it is True or False, a NumPy bool included."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {_shown(value)}")
    return bool(value)


def generator(name: str, value: object) -> np.random.Generator:
    """Return ``value`` as a random generator: a Generator as it is, or one made from a whole number
    as its seed.
    """
    if isinstance(value, np.random.Generator):
        return value
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise ValueError(
            f"{name} must be a numpy Generator or a seed of at least 0, got {_shown(value)}"
        )
    return np.random.default_rng(int(value))


def choice(name: str, value: Any, options: Iterable[str]) -> str:
    """Return ``value`` if it is one of the ``options``; the message lists them."""
    allowed = list(options)
    if not isinstance(value, str) or value not in allowed:
        raise ValueError(
            f"{name} must be one of {', '.join(map(repr, allowed))}, got {_shown(value)}"
        )
    return value


def named_twice(name: str, value: Any, default: Any, **second: Any) -> tuple[str, Any]:
    """Return the word that was used for an argument with two, and its value; the second is None
    where it is not used.

    >>> named_twice("tolerance", 1e-10, 1e-10, tol=1e-6)
    ('tol', 1e-06)
    """
    ((word, given),) = second.items()
    if given is None:
        return name, value
    if value is not default and np.any(value != default):
        raise ValueError(f"{name} and {word} are one thing, got both: give {name} alone")
    return word, given


def shaped(name: str, array: NDArray[Any], shape: tuple[int | str, ...], *, why: str = "") -> None:
    """Raise unless ``array`` has the shape asked for.

    An int is a fixed length, a letter any length, a leading "..." any number of batch axes.

    >>> shaped("points", np.zeros((4, 2)), ("n", 2))
    >>> shaped("shifts", np.zeros((100, 3, 2)), ("...", 4, 2), why="to match 4 points")
    Traceback (most recent call last):
    ValueError: shifts must have shape (..., 4, 2) to match 4 points, got (100, 3, 2)
    """
    wanted = shape[1:] if shape and shape[0] == "..." else shape
    actual = array.shape[array.ndim - len(wanted) :] if shape != wanted else array.shape
    fits = len(actual) == len(wanted) and array.ndim >= len(wanted)
    if not fits or any(isinstance(w, int) and w != a for w, a in zip(wanted, actual, strict=True)):
        text = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
        raise ValueError(
            f"{name} must have shape ({text}){' ' + why if why else ''}, got {array.shape}"
        )


def unmasked(value: ArrayLike) -> NDArray[Any]:
    """Return an array in which NaN stands where a masked array is masked; integers become floats
    only then.
    """
    if not isinstance(value, np.ma.MaskedArray):
        return np.asarray(value)
    data, mask = np.ma.getdata(value), np.ma.getmaskarray(value)
    if not mask.any() or data.dtype.kind not in "buif":
        return data
    return np.where(mask, np.nan, data).astype(np.result_type(data.dtype, np.float32))


def _floats(name: str, value: ArrayLike, ndim: int | None) -> Floats:
    given = getattr(value, "unit", None)
    if given is not None:  # NumPy would drop it without a word
        raise ValueError(f"{name} must be plain numbers, got some in {given}: convert them first")
    try:
        array = _as_floats(unmasked(value))
    except (TypeError, ValueError, OverflowError) as error:
        held = f" of {value.dtype}" if isinstance(value, np.ndarray) else ""
        why = f": {error}" if isinstance(error, _NoNumber) else ""
        kind = type(value).__name__
        raise ValueError(f"{name} must be an array of numbers, got {kind}{held}{why}") from None
    if ndim is not None and array.ndim != ndim:
        raise ValueError(
            f"{name} must have {ndim} dimension{'s' * (ndim != 1)}, got shape {array.shape}"
        )
    if array.size == 0:
        raise ValueError(f"{name} must hold at least one sample, got shape {array.shape}")
    return array


class _NoNumber(TypeError):
    """What an array holds in place of a number."""


def _as_floats(given: NDArray[Any]) -> Floats:
    if given.dtype.kind in _NO_NUMBERS:
        raise _NoNumber(_NO_NUMBERS[given.dtype.kind])
    if given.dtype.kind != "O":
        return given.astype(np.float64, copy=False)
    # NumPy would parse text and read a duration as its count of some unit.
    return np.array([_as_float(each) for each in given.ravel()]).reshape(given.shape)


def _as_float(value: object) -> float:
    if value is None or value is np.ma.masked or str(value) == "<NA>":  # the last is pandas'
        return np.nan
    if isinstance(value, np.timedelta64) or not isinstance(value, Real | Decimal):
        raise _NoNumber(f"it holds {type(value).__name__}")
    try:
        return float(value)
    except OverflowError:
        raise _NoNumber("it holds an integer too large for a float") from None


def _shown(value: object) -> str:
    """A value for a message, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # integers beyond 4300 digits have no text
        return "an integer of thousands of digits"
    return text if len(text) <= 60 else f"{text[:60]}..."


def _range(low: float, high: float) -> str:
    if np.isfinite(low) and np.isfinite(high):
        return f" from {low:g} to {high:g}"
    if np.isfinite(low):
        return f" of at least {low:g}"
    return f" of at most {high:g}" if np.isfinite(high) else ""
