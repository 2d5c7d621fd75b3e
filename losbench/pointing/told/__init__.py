"""What reports say of sensitivities and pointing metrics: numbers, sentences, sections, pictures.

The series that they are about have names: a key for files, and words for sentences, as
``{"alpha": "about X"}``.
"""

from losbench.pointing.told.metrics import (
    METRICS,
    metric_numbers,
    metric_sentences,
    metrics_figure,
    metrics_section,
)
from losbench.pointing.told.numbers import finite, table_of
from losbench.pointing.told.sensitivity import (
    Sensitivity,
    compensated_figure,
    sensitivity_section,
    sensitivity_to,
)

__all__ = [
    "METRICS",
    "Sensitivity",
    "compensated_figure",
    "finite",
    "metric_numbers",
    "metric_sentences",
    "metrics_figure",
    "metrics_section",
    "sensitivity_section",
    "sensitivity_to",
    "table_of",
]
