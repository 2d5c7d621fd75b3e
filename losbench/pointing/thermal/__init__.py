"""From room temperature to node temperatures to line of sight, and back: which drift does one
degree cause?
"""

from losbench.pointing.thermal import terms
from losbench.pointing.thermal.choose import Choice, choose
from losbench.pointing.thermal.fitted import FittedModel
from losbench.pointing.thermal.folds import CrossValidation, cross_validate
from losbench.pointing.thermal.identify import Identification, identify
from losbench.pointing.thermal.network import ThermalNetwork, thermoelastic_tilt
from losbench.pointing.thermal.sensitivity import SensitivityFit, fit_sensitivity

__all__ = [
    "Choice",
    "CrossValidation",
    "FittedModel",
    "Identification",
    "SensitivityFit",
    "ThermalNetwork",
    "choose",
    "cross_validate",
    "fit_sensitivity",
    "identify",
    "terms",
    "thermoelastic_tilt",
]
