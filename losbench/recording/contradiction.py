"""Where frames are surely noisier, or quieter, than a detector would have them."""

from __future__ import annotations

import numpy as np

from losbench.imaging.detector import Detector
from losbench.imaging.noise import Gain

__all__ = ["contradictions"]


_SURE = 4.0  # sigma: of many recordings, none is called wrong by chance
_APART = 0.15  # of a gain; less moves no error by more than 7 %
_NOISIER = 1.4  # times the variance; light of a spot in its ring makes a tenth or two


def contradictions(given: Detector, found: Gain) -> list[str]:
    """Say, with the numbers, where the frames of a recording do not bear a detector out.

    >>> contradictions(Detector(gain_e_per_dn=2.0), Gain(0.25, 0.01))
    ['The frames contradict the detector: their variance grows by 0.25 +- 0.01 DN per DN of ...
    """
    if not found.known or found.coarse:
        return []
    said = []
    if abs(found.per_dn - given.per_dn) > max(_SURE * found.std_error, _APART * given.per_dn):
        said.append(
            f"The frames contradict the detector: their variance grows by {found.per_dn:.3g} +- "
            f"{found.std_error:.2g} DN per DN of signal, its gain says {given.per_dn:.3g}."
        )
    if found.curve is not None:
        floor, level = found.curve.floor_dn2, found.curve.level_dn
        expected = float(given.variance_dn(level))
        if not 1.0 / _NOISIER < floor / max(expected, 1e-30) < _NOISIER:
            said.append(
                f"The frames contradict the detector: around the spots, at {level:.4g} DN, they "
                f"scatter by {np.sqrt(floor):.3g} DN rms, its offset and read noise say "
                f"{np.sqrt(max(expected, 0.0)):.3g}."
            )
    return said
