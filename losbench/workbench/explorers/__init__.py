"""Explorers: sliders over a picture that follows them, one call each, for notebooks."""

from losbench.workbench.explorers.centroid import CentroidExplorer
from losbench.workbench.explorers.chain import ChainExplorer
from losbench.workbench.explorers.identify import IdentifyExplorer
from losbench.workbench.explorers.inertial import InertialExplorer
from losbench.workbench.explorers.irls import IRLSExplorer
from losbench.workbench.explorers.montecarlo import MonteCarloExplorer
from losbench.workbench.explorers.starcamera import StarCameraExplorer
from losbench.workbench.explorers.thermal import ThermalExplorer
from losbench.workbench.explorers.thermoelastic import ThermoelasticExplorer

__all__ = [
    "CentroidExplorer",
    "ChainExplorer",
    "IRLSExplorer",
    "IdentifyExplorer",
    "InertialExplorer",
    "MonteCarloExplorer",
    "StarCameraExplorer",
    "ThermalExplorer",
    "ThermoelasticExplorer",
]
