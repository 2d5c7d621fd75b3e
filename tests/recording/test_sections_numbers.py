"""Which number a report puts first."""

from types import SimpleNamespace

import pytest

from losbench.recording.sections import Told, _number


def of_axes(*axes):
    names = ("alpha", "beta", "gamma")
    found = {
        name: {
            "arcsec_per_degC": size,
            "interval_95_arcsec_per_degC": interval,
            "lag_state": state,
        }
        for name, (size, interval, state) in zip(names, axes, strict=True)
    }
    return Told(None, None, None, SimpleNamespace(numbers=lambda: found))


SMALL = (0.5, (0.4, 0.6), "told")
OPEN = (-3.0, (-7.0, 1.0), "told")
LAGGING = (2.0, (1.5, 2.5), "not identifiable")
NEGATIVE = (-0.7, (-0.8, -0.6), "told")


@pytest.mark.parametrize(
    ("axes", "word", "rest"),
    [
        (
            (SMALL, OPEN, LAGGING),
            "+0.5 arcsec/degC",
            "about X (95 %: +0.4 to +0.6); -3 about Y (not told from none), "
            "+2 about Z (not told from none).",
        ),
        (
            (SMALL, NEGATIVE, LAGGING),
            "-0.7 arcsec/degC",
            "about Y (95 %: -0.8 to -0.6); +0.5 about X, +2 about Z (not told from none).",
        ),
        (
            (LAGGING, OPEN, LAGGING),
            "-3 arcsec/degC",
            "about Y (95 %: -7 to +1); +2 about X (not told from none), "
            "+2 about Z (not told from none).",
        ),
    ],
)
def test_the_largest_sensitivity_that_is_told_comes_first_or_else_the_largest(axes, word, rest):
    answer = _number(of_axes(*axes))
    assert (answer.word, answer.text) == (word, rest)
