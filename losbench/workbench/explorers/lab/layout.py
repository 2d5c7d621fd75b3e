"""Scene 9: your own layout of spots, and how many bad ones it survives before any is taken."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure

import losbench as lb
from losbench.figures import COLOURS
from losbench.workbench.explorers.base import Explorer
from losbench.workbench.explorers.controls import Control, Field, Slider, moved_spots
from losbench.workbench.explorers.lab.smallsystems import spot_rows
from losbench.workbench.explorers.view import Handle, spot_handles

__all__ = ["YourLayout", "ring"]


_MOST = 14


def spots_on_an_arc(
    *, spots: int, arc_deg: int, away: float, moved: tuple[tuple[float, ...], ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Places u, v of spots on a unit circle or a part of it, the first one moved along u, then
    those moved by hand.
    """
    steps = spots if arc_deg == 360 else max(spots - 1, 1)
    turn = np.deg2rad(arc_deg) * np.arange(spots) / steps
    u, v = np.cos(turn), np.sin(turn)
    u[0], v[0] = away, 0.0
    for spot, *place in moved:
        if spot <= spots:
            u[int(spot) - 1], v[int(spot) - 1] = place
    return u, v


def breakdown_of_a_layout(**layout: Any) -> lb.DesignBreakdown:
    """Count the bad spots that two shifts and a turn survive, whatever the bad ones say."""
    u, v = spots_on_an_arc(**layout)
    return lb.design_breakdown(spot_rows(u, v), group=np.repeat(np.arange(len(u)), 2))


class YourLayout(Explorer):
    """Spots on an arc, one of them pulled away: the turn that the worst bad spots could fake, and
    their share.
    """

    controls: ClassVar[dict[str, Control]] = {
        "spots": Slider("spots", 8, 2, _MOST, 1),
        "arc_deg": Slider("arc that they fill", 360, 20, 360, 5, "°"),
        "away": Slider("first spot off centre", 1.0, 0.0, 5.0, 0.1, "radii"),
        "moved": Field("moved (spot u v, …)", (), moved_spots(low=-5.0, high=6.0)),
    }
    experiment = staticmethod(breakdown_of_a_layout)
    answer = "seen.monotone, seen.any"
    presets: ClassVar[dict[str, dict[str, Any]]] = {
        "two spots": {"spots": 2},
        "half a ring": {"arc_deg": 180},
        "one far away": {"away": 5.0},
    }

    def build(self, figure: Figure) -> Sequence[Artist]:
        """Draw the layout, and the share of the worst k spots."""
        left, right = figure.subplots(1, 2)
        (self._spots,) = left.plot([], [], "o", ms=8, color=COLOURS["blue"])
        (self._worst,) = left.plot(
            [], [], "o", ms=15, mfc="none", mew=1.8, color=COLOURS["vermilion"]
        )
        (self._pivot,) = left.plot([], [], "+", ms=14, mew=1.8, color=COLOURS["black"])
        left.set(
            xlim=(-2.2, 5.5),
            ylim=(-2.6, 2.6),
            aspect="equal",
            xlabel="u (radii)",
            ylabel="v (radii)",
        )
        left.set_title("drag a spot  ○ too many bad ones  + their turn", fontsize=10)
        (self._shares,) = right.plot([], [], "o-", color=COLOURS["blue"], ms=5)
        right.axhline(0.5, color=COLOURS["vermilion"], lw=1.2, ls="--")
        right.set(
            xlim=(-0.3, 7.3),
            ylim=(0.0, 1.02),
            xlabel="bad spots k",
            title="largest share of k spots in a pull",
        )
        return [self._spots, self._worst, self._pivot, self._shares]

    def handles(self, *, moved: tuple[tuple[float, ...], ...], **layout: Any) -> Sequence[Handle]:
        """Every spot."""
        u, v = spots_on_an_arc(moved=moved, **layout)
        return spot_handles(self._spots.axes, np.column_stack([u, v]), moved, decimals=1)

    def update(self, **layout: Any) -> Mapping[str, str]:
        """Find the breakdown of the layout."""
        found = self.experiment(**layout)
        u, v = spots_on_an_arc(**layout)
        spots = len(u)
        a, b, turn = found.direction
        pull = np.hypot(a - turn * v, b + turn * u)
        worst = np.argsort(-pull, kind="stable")[: found.monotone + 1]
        self._spots.set_data(u, v)
        self._worst.set_data(u[worst], v[worst])
        near = abs(turn) * 4.0 > np.hypot(a, b)
        self._pivot.set_data([-b / turn] if near else [], [a / turn] if near else [])
        self._shares.set_data(np.arange(spots + 1), found.shares)
        return {
            "bad spots survived by Huber": str(found.monotone),
            "… by LTS or MM, as by any estimate": str(found.any),
            "equations · unknowns": f"{2 * spots} · 3",
        }


def ring(spots: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of spots on a unit circle, and the spot of each row."""
    turn = 2.0 * np.pi * np.arange(spots) / spots
    return spot_rows(np.cos(turn), np.sin(turn)), np.repeat(np.arange(spots), 2)
