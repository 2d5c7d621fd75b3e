"""A fitted model: predicts, compensates, and is kept as a TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.parameters import read_toml
from losbench.pointing.thermal import terms
from losbench.pointing.thermal.design import bind, read_series
from losbench.pointing.thermal.terms import Model
from losbench.resources import write_whole

__all__ = ["FittedModel"]

_SIGN = "compensated angle = angle - predicted angle"
_KINDS = {
    kind.__name__: kind
    for kind in (
        terms.Offset,
        terms.Linear,
        terms.Difference,
        terms.Lagged,
        terms.Trend,
        terms.Steps,
        terms.Fourier,
        terms.Product,
    )
}


@dataclass(frozen=True)
class FittedModel:
    """Terms with their unknowns, for one axis (a series) or k axes.

    Attributes
    ----------
    model : Model
        With the origin of its trends.
    coefficients : (k, p) array
        Radians per unit of each column.
    tau_s : (k, l) array
        Fitted lags of each axis.
    reference : dict of float
        What is subtracted from each sensor.
    frame : str
        What the angles are: axes and sense, in words.
    series : bool
        Whether the angles were a series (n,) instead of (n, k).
    """

    model: Model
    coefficients: Floats
    tau_s: Floats
    reference: Mapping[str, float]
    frame: str = "rotation vector that carries the reference directions into the observed ones"
    series: bool = False

    def predict(self, sensors: Mapping[str, ArrayLike], time_s: ArrayLike) -> Floats:
        """Angles (n,) or (n, k), radians, for sensors (n,) over times (n,).

        NaN where a sensor is missing. Lags start in equilibrium with the first sample.
        """
        design = bind(self.model, sensors, time_s, reference=self.reference)
        angles = np.stack(
            [design.matrix(tau) @ x for tau, x in zip(self.tau_s, self.coefficients, strict=True)],
            axis=1,
        )
        angles[~design.known] = np.nan
        return angles[:, 0] if self.series else angles

    def compensate(
        self, angles: ArrayLike, sensors: Mapping[str, ArrayLike], time_s: ArrayLike
    ) -> Floats:
        """Angles less what the model predicts, of their shape, radians."""
        predicted = self.predict(sensors, time_s)
        given = read_series(angles, len(predicted))
        wanted = 1 if self.series else predicted.shape[1]
        if given.shape[1] != wanted:
            raise ValueError(f"angles must have {wanted} axes as the model, got {given.shape[1]}")
        return given.reshape(predicted.shape) - predicted

    def save(self, path: str | Path) -> None:
        """Write a TOML file that `from_toml` reads back bit by bit."""
        write_whole(Path(path), self.to_toml())

    def to_toml(self) -> str:
        """Return it as the text of that file."""
        lines = [
            'unit = "rad"',
            f'sign = "{_SIGN}"',
            f"frame = {_text(self.frame)}",
            f"series = {str(self.series).lower()}",
            "",
            "[reference]",
            *(f"{_text(name)} = {float(value)!r}" for name, value in self.reference.items()),
        ]
        for term in self.model.terms:
            lines += ["", "[[term]]", *_term_lines(term)]
        for tau, x in zip(self.tau_s, self.coefficients, strict=True):
            pairs = zip(self.model.labels, x, strict=True)
            lines += ["", "[[axis]]", f"tau_s = {[float(v) for v in tau]!r}", "coefficients = ["]
            lines += [f"  {float(value)!r}, # {label}" for label, value in pairs]
            lines += ["]"]
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, path: str | Path) -> FittedModel:
        """Read what `save` wrote.

        Raises
        ------
        ValueError, FileNotFoundError
            If the file is missing or not such a model; the message says what is wrong.
        """
        file, table = Path(path).name, read_toml(path)
        needed = {"unit", "sign", "frame", "series", "reference", "term", "axis"}
        if set(table) != needed:
            wrong = sorted(set(table) ^ needed)
            raise ValueError(
                f"{file}: a thermal model has {', '.join(sorted(needed))}; see {wrong}"
            )
        for key, only in (("unit", "rad"), ("sign", _SIGN)):
            if table[key] != only:
                raise ValueError(f"{file}: {key} must be {only!r}, got {table[key]!r}")
        try:
            model = Model(tuple(_read_term(entry) for entry in table["term"]))
            found = cls(
                model,
                np.array([axis["coefficients"] for axis in table["axis"]], dtype=np.float64),
                np.array([axis["tau_s"] for axis in table["axis"]], dtype=np.float64),
                {name: float(value) for name, value in table["reference"].items()},
                str(table["frame"]),
                bool(table["series"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{file}: not a thermal model: {error}") from None
        lags = sum(len(t.names) for t in model.terms if isinstance(t, terms.Lagged) and t.free)
        axes = len(table["axis"])
        if found.coefficients.shape != (axes, len(model.labels)) or found.tau_s.shape != (
            axes,
            lags,
        ):
            raise ValueError(
                f"{file}: each axis must have {len(model.labels)} coefficients and {lags} lags"
            )
        return found


def _text(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _value(value: Any) -> str:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, tuple):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if type(value).__name__ in _KINDS:
        return "{ " + ", ".join(_term_lines(value)) + " }"
    return repr(value)


def _term_lines(term: Any) -> list[str]:
    values = {name: value for name, value in vars(term).items() if value is not None}
    return [
        f'kind = "{type(term).__name__}"',
        *(f"{name} = {_value(value)}" for name, value in values.items()),
    ]


def _read_term(entry: dict[str, Any]) -> Any:
    given: dict[str, Any] = {
        k: tuple(v) if isinstance(v, list) else v for k, v in entry.items() if k != "kind"
    }
    kind: Any = _KINDS[entry["kind"]]
    if kind is terms.Product:
        return terms.Product(_read_term(given["first"]), _read_term(given["second"]))
    return kind(*given.pop("names", ()), **given)
