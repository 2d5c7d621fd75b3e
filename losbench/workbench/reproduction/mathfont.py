"""The font that formulas are drawn in: browsers stretch brackets only with a font that tells them
how.

matplotlib ships DejaVu Serif, which knows its brackets and roots. What formulas use of it fits into
each page.
"""

from __future__ import annotations

import base64
import io
import logging
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
from fontTools.subset import Options, Subsetter  # type: ignore[import-untyped]
from fontTools.ttLib import TTFont  # type: ignore[import-untyped]

__all__ = ["math_font"]

# Latin, accents, Greek, sub- and superscripts, letterlike signs, arrows, operators, bracket pieces,
# script and bold.
_USED = (
    *((0x20, 0x17F), (0x2C6, 0x2DD), (0x300, 0x33F), (0x370, 0x3FF), (0x2010, 0x23FF)),
    *((0x25A0, 0x25FF), (0x27C0, 0x27FF), (0x2980, 0x2AFF), (0x1D400, 0x1D7FF)),
)
# What DejaVu leaves at zero, in units of its 2048 to the em, after TeX's proportions.
_SET_IN = {
    "SubscriptShiftDown": 330,
    "SubscriptTopMax": 820,
    "SubscriptBaselineDropMin": 150,
    "SuperscriptShiftUp": 740,
    "SuperscriptShiftUpCramped": 600,
    "SuperscriptBottomMin": 220,
    "SuperscriptBaselineDropMax": 500,
    "UpperLimitGapMin": 230,
    "LowerLimitGapMin": 340,
    "FractionNumeratorShiftUp": 800,
    "FractionNumeratorDisplayStyleShiftUp": 1390,
    "FractionDenominatorShiftDown": 700,
    "FractionDenominatorDisplayStyleShiftDown": 1400,
}
_PRIMES = ("minute", "second", "uni2034")


@cache
def math_font() -> str:
    """Return the font as a data URL of about 100 kB."""
    logging.getLogger("fontTools").setLevel(logging.ERROR)
    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSerif.ttf"
    font = TTFont(path, recalcTimestamp=False)
    subsetter = Subsetter(Options(layout_features=["*"], drop_tables=["FFTM"]))
    subsetter.populate(unicodes=[code for first, last in _USED for code in range(first, last + 1)])
    subsetter.subset(font)
    constants = font["MATH"].table.MathConstants
    constants.ScriptPercentScaleDown, constants.ScriptScriptPercentScaleDown = 72, 55
    for name, value in _SET_IN.items():
        getattr(constants, name).Value = value
    _draw_primes_large(font)
    font.flavor = "woff"
    file = io.BytesIO()
    font.save(file)
    return "data:font/woff;base64," + base64.b64encode(file.getvalue()).decode()


def _draw_primes_large(font: Any) -> None:
    """Draw primes as TeX has them, twice as large and on the line: as superscripts they are scaled
    down and lifted.
    """
    for name in _PRIMES:
        glyph, (advance, bearing) = font["glyf"][name], font["hmtx"][name]
        glyph.removeHinting()
        if glyph.isComposite():
            for part in glyph.components:
                part.x *= 2
        else:
            glyph.coordinates.scale((2, 2))
            glyph.coordinates.translate((0, -2100))
        glyph.recalcBounds(font["glyf"])
        font["hmtx"][name] = (2 * advance, 2 * bearing)
