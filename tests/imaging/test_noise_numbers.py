"""What readings tell of their noise, from either side of each number."""

import numpy as np
import pytest

from losbench.imaging.noise import Gain, Transfer, peak_reading, saturated, step_of


def test_a_gain_is_compared_and_shown_without_its_curve():
    curve = Transfer(np.arange(3.0), np.arange(3.0), np.arange(3.0), 1.0, 2.0)
    one, other = Gain(0.5, 0.1, 1.0, curve), Gain(0.5, 0.1, 1.0)
    assert one == other and repr(one) == repr(other) and "curve" not in repr(one)


@pytest.mark.parametrize(("floor", "coarse"), [(3.9, True), (4.1, False)])
def test_readings_are_coarse_with_a_noise_below_half_a_step(floor, coarse):
    curve = Transfer(np.zeros(1), np.zeros(1), np.zeros(1), floor, 0.0)
    assert Gain(0.5, 0.1, 4.0, curve).coarse == coarse
    assert not Gain(0.5, 0.1, 4.0).coarse


@pytest.mark.parametrize(
    ("size", "every"), [(2047, 1), (4095, 1), (4096, 3), (8191, 3), (8192, 5), (20_480, 11)]
)
def test_some_two_thousand_readings_tell_their_step_and_an_odd_number_is_left_out(size, every):
    """The one reading between the others counts where it is looked at."""
    told = 16 * (np.arange(size) % 16)
    for place in (every, 2 * every, every + 1, every - 1):
        readings = told.copy()
        readings[place] += 1
        found = step_of(readings.reshape(1, 1, size).astype(np.uint16))
        assert found == (1.0 if place % every == 0 else 16.0)


def test_readings_that_are_not_finite_tell_nothing():
    readings = 16.0 * (np.arange(900.0) % 16)
    readings[5] = np.nan
    assert step_of(readings.reshape(1, 30, 30)) == 16.0
    assert step_of(np.full((1, 30, 30), np.nan)) == 0.0
    assert step_of(readings.reshape(1, 30, 30) + 0.5) == 0.0


@pytest.mark.parametrize("level", [0.0, 100.0, -100.0])
@pytest.mark.parametrize(("sharing", "flagged"), [(5, False), (6, True)])
def test_a_plateau_is_counted_against_its_height_above_the_level(level, sharing, flagged):
    """Of ten by ten pixels, one more than five may share a top of a hundred."""
    raw = np.full((1, 12, 12), level + 3.0)
    raw[0, 5, 2 : 2 + sharing] = level + 100.0
    assert saturated(raw, None, np.array([level]), np.inf)[0].tolist() == [flagged]
    missing = np.zeros(raw.shape, bool)
    raw[0, 5, 2], missing[0, 5, 2] = np.nan, True
    told = saturated(raw, missing, np.array([level]), np.inf)[0]
    assert told.tolist() == [False]
    below = saturated(np.full((1, 12, 12), level - 1.0), None, np.array([level]), np.inf)[0]
    assert not below[0]


def test_the_highest_reading_is_that_of_pixels_that_were_read():
    raw = np.full((2, 5, 5), 4.0)
    raw[1, 0, 0], raw[0, 2, 2] = 9.0, np.nan
    assert peak_reading(raw, np.isnan(raw)).tolist() == [4.0, 9.0]
    assert peak_reading(raw[1:], None).tolist() == [9.0]
