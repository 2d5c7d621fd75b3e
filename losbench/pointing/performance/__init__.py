"""How steady does it point? The pointing metrics of ECSS, their intervals, and a budget of them."""

from losbench.pointing.performance.budget import (
    PointingBudget,
    PointingRequirement,
    PointingSource,
)
from losbench.pointing.performance.metrics import PointingMetrics, pointing_metrics
from losbench.pointing.performance.percentiles import error_percentile, half_cone
from losbench.pointing.performance.record import Metric
from losbench.pointing.performance.sharpness import mtf, noise_floor

__all__ = [
    "Metric",
    "PointingBudget",
    "PointingMetrics",
    "PointingRequirement",
    "PointingSource",
    "error_percentile",
    "half_cone",
    "mtf",
    "noise_floor",
    "pointing_metrics",
]
