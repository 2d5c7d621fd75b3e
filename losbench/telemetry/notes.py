"""What the reader of a pair's drift report must know: signs in the numbers that something in the
telemetry is wrong.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from losbench.page import Doubt
from losbench.pointing.starcamera import CorrectedPair, DriftFit, time_tag_offset
from losbench.telemetry.read import Telemetry
from losbench.telemetry.tracks import ends

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["change_notes", "clock_notes", "head_notes", "missing_notes", "slow_notes"]

_WORST_CONDITION = 1000.0  # two spots 7 arcmin apart
_FAR_FROM_ONE = 2.0  # scatter of the spots over what was said of it, or its inverse
_ENOUGH = 20  # rows with all spots, to judge that scatter
_SLOW = 3.0  # LSFE over NEA: distortion of the optics stays below one
_BEYOND = 3.0  # standard errors by which a correction must make things worse
_CLEAR_OFFSET = 10.0  # stated sigmas of a time offset; slow errors alone reach four


def head_notes(
    pair: CorrectedPair,
    heads: tuple[int, int],
    *,
    sigma_mm: float | None,
    smooth_s: float | None,
    max_gap_s: float,
) -> list[str]:
    """Say how well each head's drift is known, and where it is not."""
    lines = []
    for k, fit in enumerate(pair.fits):
        head = f"Head {heads[k]}"
        error = 3.0 * np.nanmedian(fit.std_error_arcsec.reshape(-1, 3), axis=0)
        lines.append(
            f"{head}: drift known to {error[0]:.2g}, {error[1]:.2g}, {error[2]:.2g} arcsec about "
            "x, y, z "
            f"(3 sigma, one sample); condition {fit.condition:.1f}."
        )
        if fit.condition > _WORST_CONDITION:
            lines.append(
                Doubt(
                    f"{head}: the spots stand so near to each other that z is lost; is spot_unit "
                    "right?"
                )
            )
        if sigma_mm is not None and np.isfinite(fit.residuals[..., 0]).all(axis=1).sum() >= _ENOUGH:
            lines.append(_scatter_note(head, _residual_rms(fit) / sigma_mm))
        lost = int(np.isnan(fit.delta).any(axis=1).sum())
        left = int(np.isnan(pair.drift[k]).any(axis=1).sum())
        if lost:
            lines.append(
                f"{head}: {lost} of {len(fit.delta)} rows give no drift of their own: "
                f"{lost - left} are "
                f"interpolated over up to {max_gap_s:g} s (max_gap_s), {left} stay missing."
            )
    if smooth_s is not None:
        lines.append(f"The drift is a mean over {smooth_s:g} s.")
    return lines


def _residual_rms(fit: DriftFit) -> float:
    """Rms of the shifts about a pure turn, by degrees of freedom: two per spot seen, less three per
    sample.
    """
    known = np.isfinite(fit.residuals)
    freedom = np.count_nonzero(known) - 3 * np.count_nonzero(known.any(axis=(1, 2)))
    return float(np.sqrt(np.sum(fit.residuals[known] ** 2) / freedom)) if freedom else np.nan


def _scatter_note(head: str, ratio: float) -> str:
    line = f"{head}: the spots scatter about a pure turn by {ratio:.2f} times spot_sigma_um"
    if 1.0 / _FAR_FROM_ONE <= ratio <= _FAR_FROM_ONE:
        return f"{line}."
    return Doubt(
        f"{line}, far from 1: check single bad spots, the order and signs of their columns, "
        "spot_unit, and sigma."
    )


def change_notes(tracks: pd.DataFrame) -> list[str]:
    """Say so if the correction makes the change from the first to the last track larger, clearly
    beyond its error.
    """
    found = ends(tracks, "mean_before_arcsec", "mean_after_arcsec")
    if found is None:
        return []
    first, last = found
    raw, corrected = (
        last[f"mean_{which}_arcsec"] - first[f"mean_{which}_arcsec"]
        for which in ("before", "after")
    )
    error = float(np.hypot(last["mean_after_sigma_arcsec"], first["mean_after_sigma_arcsec"]))
    if not abs(corrected) - abs(raw) > _BEYOND * error:
        return []
    return [
        Doubt(
            f"The correction makes the angle's change larger, {corrected:+.3f} +- {error:.2g} for "
            f"{raw:+.3f} arcsec: check the sign of the spots, whether the heads' spots are "
            "swapped, focal_mm and spot_unit."
        )
    ]


def slow_notes(tracks: pd.DataFrame) -> list[str]:
    """Say so if the slow error is far above the noise."""
    ratio = float((tracks["lsfe_unbiased_arcsec"] / tracks["nea_unbiased_arcsec"]).median())
    if not ratio > _SLOW:
        return []
    return [
        Doubt(
            f"LSFE is {ratio:.1f} times NEA, more than optics do. Stellar aberration left in the "
            "attitudes does this (losbench.pointing.starcamera.remove_aberration takes it out), "
            "and so do wrong time tags of one head."
        )
    ]


def clock_notes(read: Telemetry, angle: pd.DataFrame) -> list[str]:
    """Say by how much the heads' time tags differ, by the first track whose rate tells."""
    why = "no track has ten rows with both attitudes"
    for track, rows in angle.groupby("track").indices.items():
        heads = read.pair.quaternions[:, rows]
        if np.isfinite(heads).all(axis=(0, 2)).sum() < 10:
            continue
        try:
            offset = time_tag_offset(
                read.pair.time_s[rows], *heads, convention=read.pair.convention
            )
        except ValueError as error:
            why = str(error)
            continue
        added, error_ms = 1e3 * offset.seconds, 1e3 * offset.sigma_s
        digits = 0 if error_ms >= 10.0 else 1
        line = (
            f"The heads agree best with {added:+.{digits}f} +- {error_ms:.{digits}f} ms added to "
            f"the second one's time tags (track {track}; white noise assumed)."
        )
        if abs(added) > _CLEAR_OFFSET * error_ms:
            return [Doubt(f"{line} That is far from 0: put the tags right first.")]
        return [line]
    return [f"Time tags of the heads not compared: {why}."]


def missing_notes(*, spots: bool, designed: bool, zero_deg: float) -> list[str]:
    """Say what spots and a design angle would add, where there are none."""
    notes = []
    if not spots:
        notes.append(
            "No reference spots: the angle is judged as it is. Spots and focal_mm would tell which "
            "head turns, about which axis, and take its drift out."
        )
    if not designed:
        notes.append(
            f"No design angle: angles count from {zero_deg:.6f} deg, their median, and how steady "
            "they are is all that speaks for the convention. design_angle_deg would check it."
        )
    return notes
