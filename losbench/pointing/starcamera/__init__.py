"""Star cameras: their drift from reference spots, its correction, and the angle between two
boresights.
"""

from losbench.pointing.starcamera.aberration import earth_velocity_km_s as earth_velocity_km_s
from losbench.pointing.starcamera.aberration import remove_aberration as remove_aberration
from losbench.pointing.starcamera.attitude import Observability as Observability
from losbench.pointing.starcamera.attitude import boresight_angle as boresight_angle
from losbench.pointing.starcamera.attitude import check_design as check_design
from losbench.pointing.starcamera.attitude import correct_drift as correct_drift
from losbench.pointing.starcamera.attitude import observability as observability
from losbench.pointing.starcamera.convention import QuaternionConvention as QuaternionConvention
from losbench.pointing.starcamera.drift import DriftFit as DriftFit
from losbench.pointing.starcamera.drift import drift_from_spots as drift_from_spots
from losbench.pointing.starcamera.pair import CorrectedPair as CorrectedPair
from losbench.pointing.starcamera.pair import PairTelemetry as PairTelemetry
from losbench.pointing.starcamera.pair import correct_pair as correct_pair
from losbench.pointing.starcamera.timing import TimeOffset as TimeOffset
from losbench.pointing.starcamera.timing import interpolate_attitude as interpolate_attitude
from losbench.pointing.starcamera.timing import interpolate_drift as interpolate_drift
from losbench.pointing.starcamera.timing import smooth_drift as smooth_drift
from losbench.pointing.starcamera.timing import time_tag_offset as time_tag_offset
