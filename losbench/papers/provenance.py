"""What a scenario is made of: values that a paper states, and values that had to be assumed, each
with its reason.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Calibration", "assumed", "assumptions", "calibrated", "calibration", "stated"]


def stated(value: Any, unit: str, where: str) -> Any:
    """Make a dataclass field whose value the paper prints, at ``where``."""
    return field(default=value, metadata={"unit": unit, "source": "stated", "reason": where})


def assumed(value: Any, unit: str, reason: str) -> Any:
    """Make a dataclass field whose value the paper does not give; ``reason`` says why this one."""
    return field(default=value, metadata={"unit": unit, "source": "assumed", "reason": reason})


def calibrated(
    value: Any,
    unit: str,
    reason: str,
    *,
    to: tuple[str, ...] = (),
    low: Any = None,
    high: Any = None,
) -> Any:
    """Make a dataclass field chosen so that printed numbers come out.

    Parameters
    ----------
    value, unit, reason
        As for `assumed`.
    to : tuple of str
        Ids of the claims that chose it: they are no evidence, and what reads the field depends on
        them.
    low, high : optional
        Both ends of what the paper allows in its place.
    """
    return field(
        default=value,
        metadata={
            "unit": unit,
            "source": "calibrated",
            "reason": reason,
            "calibration": Calibration(tuple(to), low, high),
        },
    )


@dataclass(frozen=True)
class Calibration:
    """The claims that chose a field, and both ends of what the paper allows it."""

    to: tuple[str, ...]
    low: Any = None
    high: Any = None


def calibration(one: Field[Any]) -> Calibration:
    """Return how a field was calibrated; ``ValueError`` if it was not."""
    found = one.metadata.get("calibration")
    if not isinstance(found, Calibration):
        raise ValueError(f"{one.name} is not a calibrated field")
    return found


def assumptions(scenario: Any) -> pd.DataFrame:
    """Return the table of a scenario: name, value, unit, source (stated, assumed or calibrated) and
    reason.
    """
    import pandas as pd

    rows = [
        {"name": f.name, "value": getattr(scenario, f.name), **f.metadata}
        for f in fields(scenario)
        if f.metadata
    ]
    return pd.DataFrame(rows, columns=["name", "value", "unit", "source", "reason"])
