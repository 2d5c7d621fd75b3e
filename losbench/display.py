"""Results in a notebook: a small table with errors, and a DataFrame with everything."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import islice
from math import floor, isfinite, log10
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["html_table", "table", "with_error"]


_ROWS_SHOWN = 8  # with title, heads, what is left out and a note: a dozen lines


def html_table(
    title: str,
    heads: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    count: int,
    note: str = "",
) -> str:
    """HTML of a result: a title, the first rows of ``count``, and how many are left out; all
    escaped.

    >>> print(html_table("Fit <1>", ["x", "y"], [["1.0 ± 0.1", 2]], count=1))
    <div><b>Fit &lt;1&gt;</b><table>
    <tr><th>x</th><th>y</th></tr>
    <tr><td>1.0 ± 0.1</td><td>2</td></tr>
    </table></div>
    """
    shown = list(islice(rows, _ROWS_SHOWN))
    lines = [f"<div><b>{escape(title)}</b><table>", _row("th", heads)]
    lines += [_row("td", row) for row in shown]
    if count > len(shown):
        more = f"... and {count - len(shown)} more: .to_frame() has all"
        lines.append(f'<tr><td colspan="{len(heads)}">{more}</td></tr>')
    return "\n".join([*lines, f"</table>{escape(note)}</div>"])


def with_error(value: float, error: float, unit: str = "") -> str:
    """Text of a number with its one-sigma error to two digits, or with what is lacking in words.

    >>> [with_error(12.34567, 0.0213, "px"), with_error(1.0, np.nan), with_error(np.nan, 1.0)]
    ['12.346 ± 0.021 px', '1, error unknown', 'none']
    >>> with_error(4.5678e-7, 2.3e-9)
    '(4.568 ± 0.023)e-07'
    """
    unit = f" {unit}" if unit else ""
    if not isfinite(value):
        return "none" if value != value else f"{value:g}{unit}"
    if not (isfinite(error) and error > 0):
        known = "" if error == 0 else ", error unknown"
        return f"{value:.6g}{unit}{known}"
    size = floor(log10(max(abs(value), error)))
    power = size if not -3 <= size <= 5 else 0
    digits = max(0, 1 - floor(log10(error)) + power)
    text = f"{value / 10.0**power:.{digits}f} ± {error / 10.0**power:.{digits}f}"
    return (f"({text})e{power:+03d}" if power else text) + unit


def table(columns: Mapping[str, ArrayLike], *, axes: Sequence[str] = ()) -> pd.DataFrame:
    """DataFrame with one row per element of the columns, all of one shape (...); ``axes`` name the
    index.

    >>> print(table({"x": np.zeros((2, 2))}, axes=["frame", "spot"]))
                  x
    frame spot
    0     0     0.0
          1     0.0
    1     0     0.0
          1     0.0
    """
    import pandas as pd

    arrays = {name: np.asarray(values) for name, values in columns.items()}
    shape = next(iter(arrays.values())).shape
    flat: dict[str, Any] = {name: array.reshape(-1) for name, array in arrays.items()}
    if not shape:
        return pd.DataFrame(flat)
    names = list(axes) if len(axes) == len(shape) else [f"axis{k}" for k in range(len(shape))]
    index: Any = pd.MultiIndex.from_product([range(size) for size in shape], names=names)
    if len(shape) == 1:
        index = pd.RangeIndex(shape[0], name=names[0])
    return pd.DataFrame(flat, index=index)


def _row(cell: str, values: Iterable[object]) -> str:
    return "<tr>" + "".join(f"<{cell}>{escape(str(v))}</{cell}>" for v in values) + "</tr>"
