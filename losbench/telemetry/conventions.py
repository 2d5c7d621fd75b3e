"""What telemetry itself says of its convention and its clocks: the angle between two heads on one
structure is steady only if both are right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from losbench.arrays import Floats
from losbench.page import Doubt
from losbench.pointing.starcamera import QuaternionConvention, boresight_angle
from losbench.series import split_tracks
from losbench.units import rad_to_arcsec

__all__ = ["Evidence", "check_convention", "check_steady", "evidence", "proposal", "rate_offset"]

_MOST_ARCSEC = 20.0  # twice what is named where it is refused
_CLEARLY = 2.0  # times as steady; less is chance, or heads that hardly turned
_FEWEST = 20
_LONGEST_LAG_S = 300.0
_MOST_RATES = 20_000
_AGREES = 0.9
_AS_WELL = 0.02
_RATE_OVER_S = 2.0


@dataclass(frozen=True)
class Evidence:
    """The angle between two heads if they keep to a convention: its median, and the half-width of
    the middle half of all angles, which single bad attitudes do not move.
    """

    convention: QuaternionConvention
    angle_deg: float
    scatter_arcsec: float

    def __str__(self) -> str:
        return (
            f"{self.convention}: {self.angle_deg:.3f} deg, scatter {self.scatter_arcsec:.3g} arcsec"
        )


def evidence(quaternions: Floats, boresight: tuple[float, ...]) -> list[Evidence]:
    """How steady the angle between two heads (2, n, 4) is by each convention, the steadiest
    first.
    """
    found = []
    for convention in QuaternionConvention.every():
        angle = np.degrees(
            boresight_angle(*quaternions, convention=convention, boresight=boresight)
        )
        known = angle[np.isfinite(angle)]
        found.append(Evidence(convention, float(np.median(known)), 3600.0 * _half_width(known)))
    return sorted(found, key=lambda each: each.scatter_arcsec)


def proposal(quaternions: Floats, boresight: tuple[float, ...]) -> str:
    """What telemetry without a named convention speaks for, and how to confirm it."""
    found = evidence(quaternions, boresight)
    listed = "; ".join(map(str, found))
    if _settled(found[0], found[1], quaternions):
        return (
            f"no convention is named; the angle between the heads is steadiest with {listed}. "
            f"Confirm the first by {_option(found[0])}, or name another"
        )
    return (
        f"no convention is named, and the telemetry does not tell which it is ({listed}): name it "
        f"by {_option(found[0])} or another"
    )


def check_convention(
    quaternions: Floats, convention: QuaternionConvention, boresight: tuple[float, ...]
) -> list[str]:
    """Refuse a convention if another makes the angle clearly steadier; say so where the telemetry
    cannot tell.

    Raises
    ------
    ValueError
        With the convention that fits.
    """
    found = evidence(quaternions, boresight)
    own = next(each for each in found if each.convention == convention)
    best = found[0]
    if own is not best and _settled(best, own, quaternions):
        raise ValueError(
            f"with {own} the angle between the heads is not steady; it is with {best}: name that "
            f"convention ({_option(best)})"
        )
    other = next(each for each in found if each is not own)
    if _settled(own, other, quaternions):
        return []
    return [
        Doubt(
            f"The telemetry does not tell its convention: the angle scatters by "
            f"{own.scatter_arcsec:.3g} arcsec with the one that is named, and by "
            f"{other.scatter_arcsec:.3g} with {other.convention}."
        )
    ]


def check_steady(
    quaternions: Floats,
    convention: QuaternionConvention,
    boresight: tuple[float, ...],
    time_s: Floats,
) -> None:
    """Raise if the angle within the tracks moves more than heads on one structure do, beyond its
    noise from sample to sample: time tags, columns or convention are wrong.
    """
    angle = rad_to_arcsec(boresight_angle(*quaternions, convention=convention, boresight=boresight))
    known = np.isfinite(angle)
    angle, track = angle[known], split_tracks(time_s)[known]
    if len(angle) < _FEWEST:
        return
    _, first = np.unique(track, return_index=True)
    about = np.concatenate([part - np.median(part) for part in np.split(angle, first[1:])])
    scatter = _half_width(about)
    noise = _half_width(np.diff(about)) / np.sqrt(2.0)
    if scatter**2 - noise**2 > _MOST_ARCSEC**2:
        raise ValueError(
            f"the angle between the heads moves within a track by {scatter:.3g} arcsec (half-width "
            f"of its middle half, {noise:.2g} of it noise), more than {_MOST_ARCSEC:g}: aberration "
            "in a low orbit moves heads on one structure by up to 10 against each other, heat by a "
            "few, so time tags, columns or convention are wrong" + rate_offset(quaternions, time_s)
        )


def _half_width(values: Floats) -> float:
    low, high = np.percentile(values, [25.0, 75.0])
    return float(high - low) / 2.0


def rate_offset(quaternions: Floats, time_s: Floats) -> str:
    """Say at which offset of the second head's tags both turn at the same rate, whose size no
    mounting and no convention changes; nothing if none stands out.
    """
    heads = [_rate(q, time_s) for q in quaternions]
    if min(len(t) for t, _ in heads) < _FEWEST:
        return ""
    (t1, r1), (t2, r2) = heads
    step = max(float(np.median(np.diff(t1))), 0.1)
    t1, r1 = t1[:_MOST_RATES], r1[:_MOST_RATES]
    lags = np.arange(-_LONGEST_LAG_S, _LONGEST_LAG_S + step, step)
    agreement = np.zeros(len(lags))
    for k, lag in enumerate(lags):
        inside = (t1 >= t2[0] + lag) & (t1 <= t2[-1] + lag)
        if np.count_nonzero(inside) < max(_FEWEST, len(t1) // 4):
            continue
        one, two = r1[inside], np.interp(t1[inside] - lag, t2, r2)
        if np.ptp(one) > 0 and np.ptp(two) > 0:
            agreement[k] = np.corrcoef(one, two)[0, 1]
    best = float(agreement.max())
    alike = lags[agreement >= best - _AS_WELL]
    if best < _AGREES or np.abs(alike).min() <= step:
        return ""
    if np.ptp(alike) > 2.0 * _RATE_OVER_S + step:
        return (
            "; both heads turn alike at several offsets of the second one's time tags, such as "
            f"{alike[np.argmin(np.abs(alike))]:+.1f} s: the tags are wrong, and the motion repeats"
        )
    offset = lags[np.argmax(agreement)]
    return f"; both heads turn alike with {offset:+.1f} s added to the second one's time tags"


def _rate(quaternions: Floats, time_s: Floats) -> tuple[Floats, Floats]:
    """Size of the angular rate, over two seconds each, and when."""
    known = np.isfinite(quaternions).all(axis=1)
    q, t = quaternions[known], time_s[known]
    if len(t) < _FEWEST:
        return t[:0], t[:0]
    usual = float(np.median(np.diff(t)))
    k = min(max(1, round(_RATE_OVER_S / usual)), len(t) - 1)
    step = t[k:] - t[:-k]
    near = step <= 1.5 * k * usual
    cosine = np.minimum(np.abs(np.vecdot(q[k:], q[:-k])), 1.0)
    return ((t[k:] + t[:-k]) / 2.0)[near], (2.0 * np.arccos(cosine) / step)[near]


def _settled(best: Evidence, other: Evidence, quaternions: Floats) -> bool:
    whole = np.isfinite(quaternions).all(axis=(0, 2)).sum()
    return bool(whole >= _FEWEST and other.scatter_arcsec > _CLEARLY * best.scatter_arcsec)


def _option(found: Evidence) -> str:
    return f"--convention {found.convention.scalar},{found.convention.direction}"
