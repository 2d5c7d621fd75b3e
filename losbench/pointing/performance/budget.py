"""A pointing budget after ECSS-E-ST-60-10C: sources in, indices and verdicts out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from losbench.arrays import Floats
from losbench.checks import choice, finite, number, positive
from losbench.parameters import read_toml

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PointingBudget", "PointingRequirement", "PointingSource", "read_requirements"]

INDICES = ("APE", "MPE", "RPE", "PDE", "PRE")
# What a source's parameter (its sigma, amplitude or range) counts in each index.
_FACTORS: dict[str, dict[str, float]] = {
    "noise": {"APE": 1.0, "RPE": 1.0},
    "uniform noise": {"APE": 12**-0.5, "RPE": 12**-0.5},
    "fast sine": {"APE": 2**-0.5, "RPE": 2**-0.5},
    "slow sine": {"APE": 2**-0.5, "MPE": 2**-0.5, "PDE": 2**0.5, "PRE": 2**0.5},
    "bias": {"APE": 1.0, "MPE": 1.0, "PRE": 2**0.5},
}
_LAWS = ("exactly", "gaussian", "uniform")


@dataclass(frozen=True)
class PointingRequirement:
    """A limit on one index.

    Parameters
    ----------
    id : str
    index : str
        "APE", "MPE", "RPE", "PDE", "PRE"; for measured metrics also "smear" and "jitter".
    limit : float or (k,) sequence, arcsec
        One for all axes, or one each.
    probability : float
        Share of time and cases that must keep the limit; two-sided Gaussian quantile.
    factor : float, optional
        The multiple of sigma itself, where a requirement rounds it: 2 for 95 % in the standard's
        Annex C.

    Examples
    --------
    >>> round(PointingRequirement("R1", "APE", 20.0, probability=0.95).factor, 3)
    1.96
    """

    id: str
    index: str
    limit: float | tuple[float, ...]
    probability: float = 0.95
    factor: float = 0.0

    def __post_init__(self) -> None:
        """Check, and work out the factor where it is not given."""
        from scipy.special import ndtri

        choice("index", self.index, (*INDICES, "smear", "jitter"))
        positive("limit", self.limit)
        number("probability", self.probability, low=0.0, high=1.0 - 1e-12)
        if not number("factor", self.factor, low=0.0):
            object.__setattr__(self, "factor", float(ndtri(0.5 + 0.5 * self.probability)))


@dataclass(frozen=True)
class PointingSource:
    """One source of pointing error, or a group of them.

    Parameters
    ----------
    name : str
    kind : str
        "noise" (parameter: sigma), "uniform noise" (range), "fast sine" and "slow sine" (amplitude;
        against the window), "bias" (the error itself), or "group".
    mean, sigma : (k,) arrays, arcsec
        Of the parameter over the ensemble.
    parts : tuple of PointingSource
        Of a group.
    """

    name: str
    kind: str
    mean: Floats
    sigma: Floats
    parts: tuple[PointingSource, ...] = ()

    def contribution(self, index: str) -> tuple[Floats, Floats]:
        """Mean and standard deviation that it adds to an index, (k,) each, arcsec.

        The mean of a bias adds as it is; everything else counts by the root mean square of its
        parameter, times the factor of its kind.
        """
        if self.parts:
            return _together(self.parts, index)
        factor = _FACTORS[self.kind].get(index, 0.0)
        if self.kind == "bias":
            # Between observations a bias that is the same in all of them makes no difference.
            return self.mean * (factor if index != "PRE" else 0.0), factor * self.sigma
        return np.zeros_like(self.mean), factor * np.hypot(self.mean, self.sigma)


def _together(sources: tuple[PointingSource, ...], index: str) -> tuple[Floats, Floats]:
    """Mean and standard deviation (k,) that sources add to an index together."""
    found = [source.contribution(index) for source in sources]
    return sum(mean for mean, _ in found), np.sqrt(sum(sigma**2 for _, sigma in found))  # type: ignore[return-value]


@dataclass(frozen=True)
class PointingBudget:
    """Sources of pointing error against requirements.

    Examples
    --------
    >>> noise = PointingSource("star sensor", "noise", np.array([3.0]), np.array([0.0]))
    >>> shift = PointingSource("launch", "bias", np.array([0.0]), np.array([4.0]))
    >>> need = PointingRequirement("R1", "APE", 12.0, factor=2.0)
    >>> PointingBudget((need,), (noise, shift)).table()[["total_arcsec", "verdict"]].values.tolist()
    [[10.0, 'met']]
    """

    requirements: tuple[PointingRequirement, ...]
    sources: tuple[PointingSource, ...]

    @classmethod
    def from_toml(cls, path: str | Path) -> PointingBudget:
        """Read a budget: ``[[requirement]]`` and ``[[source]]`` tables, arcseconds throughout.

        A requirement has ``id``, ``index``, ``limit`` and ``probability`` or ``factor``. A source
        has ``name``, ``kind`` and one of ``exactly`` (a number, or one per axis), ``gaussian``
        (mean and sigma) or ``uniform`` (from and to), each a pair or a list of pairs per axis; or,
        in
        place of them, ``source`` tables of its own.

        Raises
        ------
        ValueError, FileNotFoundError
            Naming the file and the entry.
        """
        file, tables = Path(path).name, read_toml(path)
        if unknown := sorted(set(tables) - {"requirement", "source"}):
            raise ValueError(
                f"{file}: unknown table {', '.join(unknown)}; known are requirement, source"
            )
        needs = read_requirements(path)
        sources = [
            _source(entry, f"{file}: source {i}")
            for i, entry in enumerate(_tables(tables, "source", file), 1)
        ]
        axes = {source.mean.size for source in sources} | {np.size(n.limit) for n in needs}
        if len(axes - {1}) > 1:
            raise ValueError(f"{file}: all entries must have as many axes, got {sorted(axes)}")
        return cls(needs, tuple(sources))

    @property
    def axes(self) -> int:
        """Number of axes."""
        return max(
            [source.mean.size for source in self.sources]
            + [np.size(need.limit) for need in self.requirements]
        )

    def total(self, requirement: PointingRequirement) -> Floats:
        """Error at the requirement's level, (k,), arcsec: ``|mean| + factor sigma`` of the sum."""
        mean, sigma = _together(self.sources, requirement.index)
        return np.broadcast_to(np.abs(mean) + requirement.factor * sigma, self.axes)

    def table(self) -> pd.DataFrame:
        """Every requirement and axis: total, limit, margin, verdict."""
        import pandas as pd

        rows = []
        for need in self.requirements:
            limits = np.broadcast_to(need.limit, self.axes)
            for axis, (total, limit) in enumerate(zip(self.total(need), limits, strict=True), 1):
                verdict = "met" if total <= limit else "not met"
                rows.append((need.id, need.index, axis, total, limit, limit - total, verdict))
        lengths = ["total_arcsec", "limit_arcsec", "margin_arcsec"]
        names = ["id", "index", "axis", *lengths, "verdict"]
        return pd.DataFrame(rows, columns=names)

    def contributions(self) -> pd.DataFrame:
        """Every source's share: one-sigma error by index and axis, and mean, arcsec."""
        import pandas as pd

        rows = []
        for source in self.sources:
            for index in INDICES:
                mean, sigma = (np.broadcast_to(v, self.axes) for v in source.contribution(index))
                rows += [
                    (source.name, source.kind, index, axis + 1, mean[axis], sigma[axis])
                    for axis in range(self.axes)
                ]
        names = ["source", "kind", "index", "axis", "mean_arcsec", "sigma_arcsec"]
        return pd.DataFrame(rows, columns=names)


def read_requirements(path: str | Path) -> tuple[PointingRequirement, ...]:
    """Read the ``[[requirement]]`` tables of a budget file, which need have no sources."""
    file = Path(path).name
    return tuple(
        _requirement(entry, f"{file}: requirement {i}")
        for i, entry in enumerate(_tables(read_toml(path), "requirement", file), 1)
    )


def _tables(holder: Mapping[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    found = holder.get(key)
    if not isinstance(found, list) or not found or not all(isinstance(e, dict) for e in found):
        raise ValueError(f"{where}: at least one [[{key}]] table is needed")
    return found


def _requirement(entry: dict[str, Any], where: str) -> PointingRequirement:
    from losbench.parameters import from_table

    given = dict(entry)
    if isinstance(given.get("limit"), list):
        given["limit"] = tuple(given["limit"])
    return from_table(PointingRequirement, given, where=where)


def _source(entry: dict[str, Any], where: str) -> PointingSource:
    known = {"name", "kind", "source", *_LAWS}
    if unknown := sorted(set(entry) - known):
        raise ValueError(
            f"{where}: unknown key {', '.join(unknown)}; known are {', '.join(sorted(known))}"
        )
    name = entry.get("name")
    if not isinstance(name, str):
        raise ValueError(f"{where}: name must be a text, got {name!r}")
    where = f"{where} ({name})"
    laws = [law for law in (*_LAWS, "source") if law in entry]
    if len(laws) != 1:
        raise ValueError(
            f"{where}: exactly one of exactly, gaussian, uniform and source is needed, got "
            f"{', '.join(laws) or 'none'}"
        )
    if laws == ["source"]:
        parts = tuple(
            _source(part, f"{where}: source {i}")
            for i, part in enumerate(_tables(entry, "source", where), 1)
        )
        axes = max(part.mean.size for part in parts)
        return PointingSource(name, "group", np.zeros(axes), np.zeros(axes), parts)
    try:
        kind = choice("kind", entry.get("kind"), _FACTORS)
        mean, sigma = _parameter(laws[0], entry[laws[0]])
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return PointingSource(name, kind, mean, sigma)


def _parameter(law: str, value: ArrayLike) -> tuple[Floats, Floats]:
    """Mean and standard deviation (k,) of a parameter over the ensemble."""
    given = finite(law, value)
    if law == "exactly":
        mean = np.atleast_1d(given)
        if mean.ndim != 1:
            raise ValueError(f"exactly must be a number, or one per axis, got {value!r}")
        return mean, np.zeros_like(mean)
    pairs = np.atleast_2d(given)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ValueError(f"{law} must be a pair of numbers, or one pair per axis, got {value!r}")
    one, other = pairs.T
    if law == "gaussian":
        if (other < 0).any():
            raise ValueError(f"gaussian must hold a mean and a sigma of at least 0, got {value!r}")
        return one, other
    if (other < one).any():
        raise ValueError(f"uniform must run from the smaller to the larger, got {value!r}")
    return 0.5 * (one + other), (other - one) / np.sqrt(12.0)
