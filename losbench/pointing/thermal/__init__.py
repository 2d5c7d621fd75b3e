"""From room temperature to node temperatures to line of sight, and back: which drift does one
degree cause?
"""

from losbench.pointing.thermal.network import ThermalNetwork, thermoelastic_tilt
from losbench.pointing.thermal.sensitivity import SensitivityFit, fit_sensitivity

__all__ = ["SensitivityFit", "ThermalNetwork", "fit_sensitivity", "thermoelastic_tilt"]
