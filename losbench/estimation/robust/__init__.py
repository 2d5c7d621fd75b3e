"""Batched least squares and iteratively reweighted least squares."""

from losbench.estimation.robust.fit import irls as irls
from losbench.estimation.robust.fit import lstsq as lstsq
from losbench.estimation.robust.result import RobustFit as RobustFit
