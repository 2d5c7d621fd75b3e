"""Three small angles from the displacements of spots, for whole batches of frames."""

from losbench.pointing.attitude.accuracy import attitude_covariance as attitude_covariance
from losbench.pointing.attitude.layout import SpotLayout as SpotLayout
from losbench.pointing.attitude.layout import bad_spots_survived as bad_spots_survived
from losbench.pointing.attitude.layout import design_layout as design_layout
from losbench.pointing.attitude.result import AttitudeFit as AttitudeFit
from losbench.pointing.attitude.solve import solve_attitude as solve_attitude
