"""Which fields of a scenario a value has read, found out while it is computed."""

from __future__ import annotations

import sys
from dataclasses import fields
from functools import cache
from types import FrameType
from typing import Any, TypeVar

from losbench.papers.liu2026.scenario import ConstantBench, MonteCarlo, ThermalBench
from losbench.papers.lyu2015.scenario import Setting
from losbench.papers.provenance import Calibration, calibration
from losbench.papers.ren2023.scenario import Pair

__all__ = ["calibrated_fields", "fields_read", "watch"]

_Scenario = TypeVar("_Scenario")


def watch(scenario: _Scenario) -> _Scenario:
    """Return a copy of a scenario that remembers which of its fields are read.

    Parameters
    ----------
    scenario : dataclass
        Of any paper. What is derived from the copy by `dataclasses.replace` remembers along.

    Returns
    -------
    The same scenario, of a subclass of its type.

    Examples
    --------
    >>> watched = watch(ConstantBench())
    >>> watched.flux_e[0] > 0
    True
    >>> sorted(fields_read(watched))
    ['ConstantBench.flux_e']
    """
    kind = type(scenario)
    names = frozenset(f.name for f in fields(scenario))  # type: ignore[arg-type]
    seen: set[str] = set()

    def remember(self: Any, name: str) -> Any:
        if name in names and not _copies(sys._getframe(1)):  # noqa: SLF001
            seen.add(name)
        return object.__getattribute__(self, name)

    watched = type(kind.__name__, (kind,), {"__getattribute__": remember, "_seen": seen})
    given: dict[str, Any] = {name: object.__getattribute__(scenario, name) for name in names}
    copy: _Scenario = watched(**given)
    seen.clear()
    return copy


def _copies(caller: FrameType) -> bool:
    """Whether a frame is of dataclasses, which reads all to copy, compare or show: no use of it."""
    return caller.f_globals.get("__name__") == "dataclasses" or caller.f_code.co_name in {
        *("__repr__", "__eq__", "__hash__")
    }


def fields_read(scenario: Any) -> frozenset[str]:
    """Return the names of the fields that a watched scenario was asked for, its type before each.

    Raises
    ------
    ValueError
        If the scenario is not watched: nobody knows then.

    Examples
    --------
    >>> setting = watch(Setting())
    >>> float(round(setting.field_deg))
    8.0
    >>> sorted(fields_read(setting))
    ['Setting.field_deg']
    """
    seen = getattr(type(scenario), "_seen", None)
    if seen is None:
        raise ValueError(
            f"{type(scenario).__name__} is not watched: make it with losbench.watch(...)"
        )
    return frozenset(f"{type(scenario).__name__}.{name}" for name in seen)


@cache
def calibrated_fields() -> dict[str, Calibration]:
    """Return the calibrated fields of all scenarios, with the claims that set them."""
    return {
        f"{scenario.__name__}.{f.name}": calibration(f)
        for scenario in (ConstantBench, ThermalBench, MonteCarlo, Setting, Pair)
        for f in fields(scenario)
        if f.metadata.get("source") == "calibrated"
    }
