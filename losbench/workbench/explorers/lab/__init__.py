"""Nine scenes of the robust estimation lab: one thing to touch in each, and one number to check."""

from losbench.workbench.explorers.lab.acts import MMActs
from losbench.workbench.explorers.lab.basins import Basins
from losbench.workbench.explorers.lab.breakdown import BreakdownMeter
from losbench.workbench.explorers.lab.drag import DragPoint
from losbench.workbench.explorers.lab.layout import YourLayout
from losbench.workbench.explorers.lab.leverage import Leverage
from losbench.workbench.explorers.lab.masking import Masking
from losbench.workbench.explorers.lab.scales import ScaleIsTheHero
from losbench.workbench.explorers.lab.shapes import LossShapes
from losbench.workbench.explorers.lab.smallsystems import METHODS, ring_errors, stacked_errors

__all__ = [
    "METHODS",
    "Basins",
    "BreakdownMeter",
    "DragPoint",
    "Leverage",
    "LossShapes",
    "MMActs",
    "Masking",
    "ScaleIsTheHero",
    "YourLayout",
    "ring_errors",
    "stacked_errors",
]
