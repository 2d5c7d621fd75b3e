"""Estimates that survive almost half of the rows being wrong: least trimmed squares and MM."""

from losbench.estimation.highbreakdown.efficient import mm as mm
from losbench.estimation.highbreakdown.trimmed import lts as lts
