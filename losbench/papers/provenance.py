"""What a scenario is made of: values that a paper states, and values that had to be assumed, each
with its reason.
"""

from __future__ import annotations

from dataclasses import field, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["assumed", "assumptions", "calibrated", "stated"]


def stated(value: Any, unit: str, where: str) -> Any:
    """Make a dataclass field whose value the paper prints, at ``where``."""
    return field(default=value, metadata={"unit": unit, "source": "stated", "reason": where})


def assumed(value: Any, unit: str, reason: str) -> Any:
    """Make a dataclass field whose value the paper does not give; ``reason`` says why this one."""
    return field(default=value, metadata={"unit": unit, "source": "assumed", "reason": reason})


def calibrated(value: Any, unit: str, reason: str) -> Any:
    """Make a dataclass field chosen so that a printed number comes out; ``reason`` names that
    number.
    """
    return field(default=value, metadata={"unit": unit, "source": "calibrated", "reason": reason})


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
