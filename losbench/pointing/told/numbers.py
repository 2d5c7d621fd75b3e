"""How numbers of a table stand in files and cells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["between", "finite", "short", "table_of", "together"]


def table_of(frame: pd.DataFrame, names: Mapping[str, str]) -> str:
    """CSV of a table of `Identification` or `PointingMetrics`, its axes by their keys."""
    keys = list(names)
    named = frame.assign(axis=[keys[i - 1] for i in frame["axis"]])
    return str(named.to_csv(index=False, lineterminator="\n", float_format="%.9g"))


def finite(value: float, digits: int = 6) -> float | None:
    """Return a number for a file, None where there is none: JSON knows no NaN."""
    return round(float(value), digits) if np.isfinite(value) else None


def short(value: float | None) -> str:
    """Three digits, and nothing where there is no number."""
    return "" if value is None or not np.isfinite(value) else _digits(value)


def between(low: float | None, high: float | None) -> str:
    """An interval, and nothing where an end is not known."""
    if low is None or high is None or not np.isfinite([low, high]).all():
        return ""
    return together(f"{_digits(low)} to {_digits(high)}")


def together(text: str) -> str:
    """Text that a narrow column does not break."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def _digits(value: float) -> str:
    return f"{value:#.3g}".rstrip(".")
